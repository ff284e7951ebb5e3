"""Smooth reconstructions: polynomials kept, samples met, order of convergence, bounds, what is refused."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, cast

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.interpolate import make_interp_spline

from isosample.errors import InputError
from isosample.volume import reconstruction as module
from isosample.volume import spline_fit
from isosample.volume.grid import Volume
from isosample.volume.reconstruction import GridSpline, Reconstruction, spline_kernel
from isosample.volume.spline_kernels import spline_value_gradient

if TYPE_CHECKING:
    from isosample.volume.grid import F64

U = 2.0**-53
SMOOTH = [kind for kind in Reconstruction if kind.smooth]
PARAMETERS = {
    Reconstruction.CUBIC: (1, 0),
    Reconstruction.BSPLINE: (1, 0),
    Reconstruction.BC21: (2, 1),
    Reconstruction.CATMULL_ROM: (0, 0.5),
}


def build(samples: F64, reconstruction: Reconstruction = Reconstruction.CUBIC) -> GridSpline:
    return GridSpline.build(Volume(samples), reconstruction)


def places_in(shape: tuple[int, ...], count: int = 300, seed: int = 5) -> F64:
    """Random index coordinates (x, y, z) in a grid, some of them on samples and on the box's faces."""
    last = np.array(shape[::-1]) - 1.0
    places = np.random.default_rng(seed).random((count, 3)) * last
    places[::3] = np.round(places[::3])
    places[1::7, 0], places[2::7, 1], places[3::7, 2] = last[0], 0.0, last[2]
    return places


def rounding(spline: GridSpline, shape: tuple[int, ...]) -> float:
    """Bound of the rounding of a value, and of a slope, whose weights sum to at most 2 in absolute value.

    A banded solve is stable backwards: its residual is below 20 roundings (9 diagonals, two sweeps) of the
    coefficients, those of the first axes being means of the last. What three residuals change of the field is a
    spline through them, with coefficients below the product of the norms of the three inverses. The
    evaluation itself takes 30 roundings.
    """
    growth = 1.0
    for count in shape:
        inverse = np.linalg.inv(interpolation_matrix(count))[:, 1:-1]
        growth *= float(np.abs(inverse).sum(axis=1).max())
    return 2.0 * (3 * 20 * growth + 30) * U * float(np.abs(spline.coefficients).max())


def interpolation_matrix(count: int) -> F64:
    """The matrix of the fit along one axis, (count + 2, count + 2), from its definition."""
    order = min(4, count)
    matrix = np.zeros((count + 2, count + 2))
    for row in range(1, count + 1):
        matrix[row, row - 1 : row + 2] = np.array([1.0, 4.0, 1.0]) / 6.0
    matrix[0, : order + 1] = np.diff(np.eye(order + 1), n=order, axis=0)
    matrix[-1, -order - 1 :] = np.diff(np.eye(order + 1), n=order, axis=0)
    return matrix


def polynomial(degrees: tuple[int, ...], shape: tuple[int, ...]) -> Any:
    """Random polynomial of the given degrees (z, y, x), in coordinates scaled to [0, 1]."""
    from numpy.polynomial import polynomial as p

    weights = np.random.default_rng(1).normal(size=[degree + 1 for degree in degrees])
    scale = 1.0 / (np.array(shape) - 1.0)

    def value(z: F64, y: F64, x: F64, axis: int | None = None) -> F64:
        w = weights if axis is None else cast("F64", p.polyder(weights, axis=axis)) * scale[axis]
        return cast("F64", p.polyval3d(z * scale[0], y * scale[1], x * scale[2], w))

    return value


@pytest.mark.parametrize("shape", [(2, 2, 2), (2, 3, 4), (4, 3, 2), (5, 6, 9), (3, 12, 4)])
def test_the_cubic_spline_keeps_polynomials_up_to_degree_three(shape: tuple[int, ...]) -> None:
    """Of degree n − 1 where an axis has n < 4 samples; gradients too."""
    value = polynomial(tuple(min(3, count - 1) for count in shape), shape)
    spline = build(value(*np.indices(shape).astype(np.float64)))
    places = places_in(shape)
    values, gradients = spline.evaluate(places)
    x, y, z = places.T
    tolerance = rounding(spline, shape)
    assert np.abs(values - value(z, y, x)).max() <= tolerance < 1e-8
    for axis in range(3):
        assert np.abs(gradients[:, 2 - axis] - value(z, y, x, axis=axis)).max() <= tolerance


@pytest.mark.parametrize("shape", [(2, 2, 2), (3, 2, 5), (6, 11, 7), (2, 3, 40)])
def test_the_cubic_spline_passes_through_the_samples(shape: tuple[int, ...]) -> None:
    samples = np.random.default_rng(2).normal(size=shape)
    spline = build(samples)
    z, y, x = np.indices(shape)
    values, _ = spline.evaluate(np.stack([x, y, z], axis=-1).reshape(-1, 3))
    tolerance = (3 * 20 + 30) * U * np.abs(spline.coefficients).max()  # three residuals, see `rounding`
    assert np.abs(values.reshape(shape) - samples).max() <= tolerance < 1e-10
    assert np.abs(spline.samples() - samples).max() <= tolerance


@pytest.mark.parametrize("shape", [(4, 5, 6), (9, 4, 12)])
def test_the_cubic_spline_is_that_of_scipy_with_not_a_knot_ends(shape: tuple[int, ...]) -> None:
    samples = np.random.default_rng(3).normal(size=shape)
    spline = build(samples)
    knots = [np.sort(np.random.default_rng(4).random(7) * (count - 1)) for count in shape]
    mesh = np.stack(np.meshgrid(*knots, indexing="ij")[::-1], axis=-1).reshape(-1, 3)
    values, gradients = spline.evaluate(mesh)
    for differentiated in (None, 0, 1, 2):
        expected = samples
        for axis, count in enumerate(shape):
            line = make_interp_spline(np.arange(count), expected, k=3, axis=axis)
            expected = line(knots[axis], nu=1 if axis == differentiated else 0)
        found = values if differentiated is None else gradients[:, 2 - differentiated]
        # scipy solves another system, whose condition is as small: twice the rounding of ours.
        assert np.abs(found - expected.ravel()).max() <= 2.0 * rounding(spline, shape) < 1e-7


def smooth_errors(count: int, reconstruction: Reconstruction) -> tuple[float, float]:
    """Largest error of value and gradient (per unit) for a smooth field, sampled on [0, 1]³, border included."""

    def field(p: F64) -> F64:
        return cast(
            "F64", np.sin(3.0 * p[..., 0]) * np.cos(2.0 * p[..., 1] + 0.5) + np.exp(p[..., 2] * p[..., 0])
        )

    scale = 1.0 / (count - 1)
    z, y, x = np.indices((count,) * 3) * scale
    spline = build(field(np.stack([x, y, z], axis=-1)), reconstruction)
    places = places_in((101,) * 3, 4000) / 100.0
    values, gradients = spline.evaluate(np.minimum(places / scale, count - 1.0))
    px, py, pz = places.T
    exact = np.stack(
        [
            3.0 * np.cos(3.0 * px) * np.cos(2.0 * py + 0.5) + pz * np.exp(pz * px),
            -2.0 * np.sin(3.0 * px) * np.sin(2.0 * py + 0.5),
            px * np.exp(pz * px),
        ],
        axis=-1,
    )
    return float(np.abs(values - field(places)).max()), float(np.abs(gradients / scale - exact).max())


def test_the_cubic_spline_converges_with_order_four_up_to_the_border() -> None:
    """Gradients with order 3. Halving the spacing gains 16 and 8; the border's share of the error falls faster."""
    coarse, fine = (smooth_errors(count, Reconstruction.CUBIC) for count in (65, 129))
    assert 16.0 * 0.8 < coarse[0] / fine[0] < 16.0 * 1.25
    assert 8.0 * 0.8 < coarse[1] / fine[1] < 8.0 * 1.25
    assert fine[0] < 1e-8


def test_the_b_spline_smooths_with_order_two() -> None:
    """By h² f'' / 6 along every axis inside; the linear continuation has the same order at the border."""
    coarse, fine = (smooth_errors(count, Reconstruction.BSPLINE)[0] for count in (17, 33))
    assert 4.0 * 0.8 < coarse / fine < 4.0 * 1.25


def ramp(shape: tuple[int, ...]) -> tuple[F64, F64]:
    gradient = np.array([0.5, -1.25, 2.0])
    z, y, x = np.indices(shape)
    return gradient[0] * x + gradient[1] * y + gradient[2] * z + 3.0, gradient


@pytest.mark.parametrize("shape", [(2, 2, 2), (5, 3, 7)])
def test_the_b_spline_keeps_linear_fields(shape: tuple[int, ...]) -> None:
    samples, gradient = ramp(shape)
    places = places_in(shape)
    values, gradients = build(samples, Reconstruction.BSPLINE).evaluate(places)
    tolerance = 60 * U * 2.0 * np.abs(samples).max()  # 30 roundings of weights and sums, extrapolated samples
    assert np.abs(values - places @ gradient - 3.0).max() <= tolerance
    assert np.abs(gradients - gradient).max() <= 2.0 * tolerance


def test_bc21_keeps_linear_fields_at_samples_and_halfway_only() -> None:
    """Between them a ramp of slope 1 is off by Σ (m − 1) w_m − u = 2u (1 − u)(1 − 2u) · 3/2, at most 1/√12."""
    shape = (6, 5, 7)
    samples, gradient = ramp(shape)
    spline = build(samples, Reconstruction.BC21)
    tolerance = 60 * U * 2.0 * np.abs(samples).max() * spline.absolute_sum**3
    halves = np.round(2.0 * places_in(shape)) / 2.0
    assert np.abs(spline.evaluate(halves)[0] - halves @ gradient - 3.0).max() <= tolerance
    places = places_in(shape)
    u = places - np.minimum(np.floor(places), np.array(shape[::-1]) - 2.0)
    off = (3.0 * u * (1.0 - u) * (1.0 - 2.0 * u)) @ gradient
    assert np.abs(spline.evaluate(places)[0] - places @ gradient - 3.0 - off).max() <= tolerance


@pytest.mark.parametrize("shape", [(2, 2, 2), (3, 2, 5), (6, 11, 7)])
def test_catmull_rom_passes_through_the_samples_exactly(shape: tuple[int, ...]) -> None:
    samples = np.random.default_rng(2).normal(size=shape)
    spline = build(samples, Reconstruction.CATMULL_ROM)
    assert np.array_equal(spline.samples(), samples)
    z, y, x = np.indices(shape)
    places = np.stack([x, y, z], axis=-1).reshape(-1, 3)
    # At the last sample of an axis the weights are sums that leave a rounding or two of their terms, below 15 / 6.
    rounding = 3 * 4 * 4 * U * float(np.abs(spline.coefficients).max())
    assert np.abs(spline.evaluate(places)[0].reshape(shape) - samples).max() <= rounding


@pytest.mark.parametrize("shape", [(2, 2, 2), (2, 3, 4), (5, 6, 9)])
def test_catmull_rom_keeps_parabolas_up_to_the_border(shape: tuple[int, ...]) -> None:
    """Of degree n − 1 where an axis has n < 3 samples; gradients too. Coefficients are the samples and their like."""
    value = polynomial(tuple(min(2, count - 1) for count in shape), shape)
    spline = build(value(*np.indices(shape).astype(np.float64)), Reconstruction.CATMULL_ROM)
    places = places_in(shape)
    values, gradients = spline.evaluate(places)
    x, y, z = places.T
    tolerance = (
        200 * U * 5.0**3 * np.abs(spline.coefficients).max()
    )  # weights and their terms sum to at most 5
    assert np.abs(values - value(z, y, x)).max() <= tolerance < 1e-10
    for axis in range(3):
        assert np.abs(gradients[:, 2 - axis] - value(z, y, x, axis=axis)).max() <= 2.0 * tolerance


def test_catmull_rom_converges_with_order_three_up_to_the_border() -> None:
    """Gradients with order 2. Halving the spacing gains 8 and 4."""
    coarse, fine = (smooth_errors(count, Reconstruction.CATMULL_ROM) for count in (65, 129))
    assert 8.0 * 0.8 < coarse[0] / fine[0] < 8.0 * 1.25
    assert 4.0 * 0.8 < coarse[1] / fine[1] < 4.0 * 1.25


@pytest.mark.parametrize("reconstruction", SMOOTH)
def test_reconstructions_say_whether_they_pass_through_the_samples(reconstruction: Reconstruction) -> None:
    samples = np.random.default_rng(16).normal(size=(5, 6, 7))
    apart = np.abs(build(samples, reconstruction).samples() - samples).max()
    assert reconstruction.interpolates == bool(apart < 1e-12)
    assert Reconstruction.TRILINEAR.interpolates


@pytest.mark.parametrize("reconstruction", SMOOTH)
def test_kernels_are_the_published_piecewise_cubics(reconstruction: Reconstruction) -> None:
    b, c = PARAMETERS[reconstruction]
    kernel, absolute_sum = spline_kernel(reconstruction)
    u = np.linspace(0.0, 1.0, 1001)
    weights = np.polynomial.polynomial.polyval(u, kernel.T)
    for m in range(4):
        x = np.abs(u + 1.0 - m)
        inner = (12 - 9 * b - 6 * c) * x**3 + (-18 + 12 * b + 6 * c) * x**2 + (6 - 2 * b)
        outer = (-b - 6 * c) * x**3 + (6 * b + 30 * c) * x**2 + (-12 * b - 48 * c) * x + (8 * b + 24 * c)
        # Terms up to 168 / 6 cancel in the outer form, each rounded three times; four terms.
        assert np.abs(weights[m] - np.where(x < 1.0, inner, outer) / 6.0).max() <= 3 * 4 * 28 * U
    assert np.abs(weights.sum(axis=0) - 1.0).max() <= 16 * 4 * U  # partition of unity
    assert np.abs(weights).sum(axis=0).max() == pytest.approx(absolute_sum, abs=64 * U)


def test_a_wrong_kernel_is_noticed(monkeypatch: pytest.MonkeyPatch) -> None:
    kernel, _ = spline_kernel(Reconstruction.BSPLINE)
    wrong = kernel.copy()
    wrong[1, 2], wrong[2, 2] = -kernel[0, 2], -2.0 * kernel[0, 2]
    monkeypatch.setattr(module, "spline_kernel", lambda _: (wrong, 1.0))
    with pytest.raises(AssertionError):
        test_the_cubic_spline_keeps_polynomials_up_to_degree_three((5, 6, 9))
    with pytest.raises(AssertionError):
        test_the_b_spline_keeps_linear_fields((5, 3, 7))


@pytest.mark.parametrize("reconstruction", SMOOTH)
def test_value_and_gradient_are_continuous_across_cells(reconstruction: Reconstruction) -> None:
    """A place just below a sample belongs to the cell before: 2^-30 of a step changes a slope by its bend."""
    shape = (6, 7, 8)
    spline = build(np.random.default_rng(6).normal(size=shape), reconstruction)
    above = 1.0 + np.floor(np.random.default_rng(7).random((200, 3)) * (np.array(shape[::-1]) - 2.0))
    free = np.random.default_rng(8).random((200, 3)) * 0.9
    for axis in range(3):
        here = above + free
        here[:, axis] = above[:, axis]
        below = here.copy()
        below[:, axis] -= 2.0**-30
        (v0, g0), (v1, g1) = spline.evaluate(here), spline.evaluate(below)
        largest = np.abs(spline.coefficients).max()
        # |w'| sums to at most 4, |w''| to at most 16 along an axis, for each of these kernels.
        assert np.abs(v0 - v1).max() <= 2.0**-30 * 16 * 64 * largest
        assert np.abs(g0 - g1).max() <= 2.0**-30 * 64 * 64 * largest


@pytest.mark.parametrize("reconstruction", SMOOTH)
def test_gradients_are_those_of_the_values(reconstruction: Reconstruction) -> None:
    """A central difference inside one cell is off by h² / 6 times the third derivative, constant there."""
    shape = (5, 6, 7)
    spline = build(np.random.default_rng(9).normal(size=shape), reconstruction)
    cells = np.floor(np.random.default_rng(10).random((300, 3)) * (np.array(shape[::-1]) - 1.0))
    places = cells + 0.1 + 0.8 * np.random.default_rng(11).random((300, 3))
    _, gradients = spline.evaluate(places)
    step = 2.0**-14
    largest = np.abs(spline.coefficients).max()
    for axis in range(3):
        shift = step * np.eye(3)[axis]
        difference = (spline.evaluate(places + shift)[0] - spline.evaluate(places - shift)[0]) / (2.0 * step)
        # |w'''| sums to at most 32 (bc21), the other axes weigh at most 16 / 9.
        assert np.abs(difference - gradients[:, axis]).max() <= largest * (
            step**2 / 6.0 * 32 * 16 / 9 + 200 * U / step
        )


@given(
    samples=arrays(
        np.float64,
        st.tuples(*[st.integers(2, 5)] * 3),
        elements=st.floats(-8.0, 8.0, width=32, allow_subnormal=False),
    ),
    reconstruction=st.sampled_from(SMOOTH),
    seed=st.integers(0, 1000),
)
def test_the_bounds_hold_everywhere(samples: F64, reconstruction: Reconstruction, seed: int) -> None:
    spline = build(samples, reconstruction)
    low, high = spline.value_range
    values, _ = spline.evaluate(places_in(samples.shape, seed=seed))
    slack = 60 * U * spline.absolute_sum**3 * np.abs(spline.coefficients).max()  # the evaluation's rounding
    assert low - slack <= values.min()
    assert values.max() <= high + slack


def test_bounds_are_as_wide_as_negative_weights_ask() -> None:
    """Samples that alternate in sign: at the middle of a cell all weights of bc21 add up in absolute value."""
    z, y, x = np.indices((6, 6, 6))
    signs = np.array([-1.0, -1.0, 1.0, 1.0, -1.0, -1.0])
    spline = build(signs[z] * signs[y] * signs[x], Reconstruction.BC21)
    assert spline.evaluate([[2.5, 2.5, 2.5]])[0] == pytest.approx((4.0 / 3.0) ** 3, abs=200 * U)
    _, high = spline.value_range
    assert high >= (4.0 / 3.0) ** 3 - 200 * U
    assert build(np.full((3, 4, 5), 7.0), Reconstruction.BSPLINE).value_range == (7.0, 7.0)


@pytest.mark.parametrize("reconstruction", SMOOTH)
@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("side", [0, 1])
def test_faces_have_the_coefficients_of_their_own_spline(
    reconstruction: Reconstruction, axis: int, side: int
) -> None:
    shape = (4, 5, 6)
    spline = build(np.random.default_rng(12).normal(size=shape), reconstruction)
    face = spline.face_coefficients(axis, side)
    others = [other for other in range(3) if other != axis]  # u then v
    assert face.shape == (shape[2 - others[1]] + 2, shape[2 - others[0]] + 2)
    places = places_in(shape)
    places[:, axis] = side * (shape[2 - axis] - 1.0)
    cell = [np.minimum(np.floor(places[:, o]), shape[2 - o] - 2).astype(int) for o in others]
    weights = [
        np.polynomial.polynomial.polyval(places[:, o] - c, spline.kernel.T)
        for o, c in zip(others, cell, strict=True)
    ]
    taps = np.arange(4)
    block = face[cell[1][:, None, None] + taps[:, None], cell[0][:, None, None] + taps]
    values = np.einsum("un,vn,nvu->n", weights[0], weights[1], block)
    expected = spline.evaluate(places)[0]
    assert np.abs(values - expected).max() <= 60 * U * np.abs(spline.coefficients).max() * 64 / 27


def test_slabs_do_not_change_the_coefficients(monkeypatch: pytest.MonkeyPatch) -> None:
    samples = np.random.default_rng(13).normal(size=(7, 8, 9))
    whole = build(samples).coefficients
    monkeypatch.setattr(spline_fit, "SLAB_SAMPLES", 100)
    assert np.abs(build(samples).coefficients - whole).max() <= 8 * U * np.abs(whole).max()


def test_integers_and_views_are_taken_as_they_are() -> None:
    samples = np.random.default_rng(14).integers(0, 255, (10, 6, 8)).astype(np.uint8)
    assert np.array_equal(
        build(samples[::2].transpose(2, 0, 1)).coefficients,  # type: ignore[arg-type]  # any real dtype
        build(np.ascontiguousarray(samples[::2].transpose(2, 0, 1), dtype=np.float64)).coefficients,
    )


def test_the_compiled_kernel_computes_what_its_source_says() -> None:
    spline = build(np.random.default_rng(15).normal(size=(4, 5, 6)))
    interpreted: Any = cast("Any", spline_value_gradient).py_func
    for x, y, z in places_in((4, 5, 6), 20).tolist():
        compiled_result = spline_value_gradient(spline.coefficients, spline.kernel, x, y, z)
        assert compiled_result == pytest.approx(
            interpreted(spline.coefficients, spline.kernel, x, y, z), abs=64 * U
        )


@pytest.mark.parametrize(
    ("samples", "reconstruction", "message"),
    [
        (np.zeros((3, 3, 3)), Reconstruction.TRILINEAR, "trilinear reconstruction is no spline.*'cubic'"),
        (np.zeros((3, 1, 3)), Reconstruction.CUBIC, r"\(3, 1, 3\) samples.*two along every axis"),
        (
            np.array([[[np.nan, 1], [2, 3]], [[np.inf, 1], [2, 3]]]),
            Reconstruction.BC21,
            "1 NaN and 1 infinite.*bc21",
        ),
    ],
)
def test_volumes_without_a_spline_are_refused(
    samples: F64, reconstruction: Reconstruction, message: str
) -> None:
    with pytest.raises(InputError, match=message):
        build(samples, reconstruction)


@pytest.mark.parametrize(
    ("points", "message"),
    [
        ([0.0, 0.0, 0.0], r"shape \(3,\); expected \(N, 3\)"),
        (
            [[0.0, 0.0, 0.0], [0.0, 2.5, 0.0]],
            r"points\[1\] is \[0.0, 2.5, 0.0\]; the samples go from 0 to \[3.0, 2.0, 1.0\]",
        ),
        ([[0.0, np.nan, 0.0]], r"points\[0\]"),
    ],
)
def test_places_outside_the_grid_are_refused(points: list[Any], message: str) -> None:
    spline = build(np.zeros((2, 3, 4)))
    with pytest.raises(InputError, match=message):
        spline.evaluate(points)
    with pytest.raises(InputError, match=r"face \(3, 0\) does not exist"):
        spline.face_coefficients(3, 0)

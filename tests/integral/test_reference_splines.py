"""The reference integral of smooth reconstructions: closed forms, Riemann sums, what the tolerance promises."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any, cast

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from isosample.errors import InputError
from isosample.integral.bernstein import halve_polynomial, polynomial_bounds
from isosample.integral.field_reference import integrate_field_rays
from isosample.integral.reference import ReferenceTracer, integrate_rays
from isosample.integral.spline_cells import ELEVATION, cell_polynomial, hermite_cubic, hermite_error
from isosample.transfer.control_points import ControlPoint, Isosurface
from isosample.transfer.transfer_function import TransferFunction
from isosample.volume.field import Field
from isosample.volume.grid import F64, Volume
from isosample.volume.reconstruction import GridSpline, Reconstruction, spline_kernel

if TYPE_CHECKING:
    from isosample.volume.geometry import GridGeometry

U = 2.0**-53
SMOOTH = [kind for kind in Reconstruction if kind.smooth]
TURN = np.array([[0.8, -0.36, -0.48], [0.6, 0.48, 0.64], [0.0, -0.8, 0.6]])
RED, GREEN, BLUE = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
TENT = TransferFunction(  # continuous, with changing colour
    [
        ControlPoint(0.2, RED, 0.0),
        ControlPoint(0.5, GREEN, 0.8),
        ControlPoint(0.7, BLUE, 0.2),
        ControlPoint(0.9, (0.0, 1.0, 1.0), 0.0),
    ]
)


def noise(n: int = 5, seed: int = 0, **placement: Any) -> Volume:
    return Volume(np.random.default_rng(seed).random((n, n + 1, n + 2)), **placement)


def random_rays(volume: Volume, count: int, distance: float = 30.0) -> tuple[F64, F64]:
    rng = np.random.default_rng(1)
    ways = rng.normal(size=(count, 3))
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    box = volume.box
    return box.corner + rng.random((count, 3)) @ box.edges - distance * ways, ways


def chord(volume: Volume, origin: F64, way: F64) -> tuple[float, float]:
    """Where a generic ray enters and leaves the box."""
    unit_from_world = np.linalg.inv(volume.box.edges.T)
    o, d = unit_from_world @ (origin - volume.box.corner), unit_from_world @ way
    faces = np.stack([-o / d, (1.0 - o) / d])
    return float(faces.min(axis=0).max()), float(faces.max(axis=0).min())


class CubicPolynomial(Field):
    """A random polynomial of degree 3 in each index coordinate, which a cubic spline keeps, in world space."""

    def __init__(self, geometry: GridGeometry, offset: float) -> None:
        self.weights = np.random.default_rng(3).normal(size=(4, 4, 4)) * 0.3
        self.weights[0, 0, 0] = offset + 0.5
        self.matrix = np.linalg.inv(geometry.world_from_index)
        self.scale = 1.0 / (np.array(geometry.size_xyz) - 1.0)

    def _places(self, points: F64) -> F64:
        return cast("F64", (points @ self.matrix[:3, :3].T + self.matrix[:3, 3]) * self.scale)

    def value(self, points: F64) -> F64:
        x, y, z = self._places(points).T
        return cast("F64", np.polynomial.polynomial.polyval3d(x, y, z, self.weights))

    def gradient(self, points: F64) -> F64:
        p = np.polynomial.polynomial
        x, y, z = self._places(points).T
        parts = [p.polyval3d(x, y, z, p.polyder(self.weights, axis=axis)) for axis in range(3)]
        return cast("F64", (np.stack(parts, axis=-1) * self.scale) @ self.matrix[:3, :3])


@pytest.mark.parametrize("offset", [0.0, 1000.0])
@pytest.mark.parametrize("tolerance", [1e-5, 1e-8])
def test_a_cubic_polynomial_is_integrated_as_the_closed_form_field(tolerance: float, offset: float) -> None:
    """Two references, each within its own tolerance; under both a tent with an isosurface."""
    size = (6, 5, 7)
    volume = Volume(np.zeros(size[::-1]), spacing=(1.0, 0.5, 2.0), origin=(1.0, -3.0, 2.0), direction=TURN)
    field = CubicPolynomial(volume.geometry, offset)
    z, y, x = np.mgrid[0 : size[2], 0 : size[1], 0 : size[0]]
    index = np.stack([x, y, z], axis=-1).reshape(-1, 3)
    matrix = volume.world_from_index
    samples = field.value(index @ matrix[:3, :3].T + matrix[:3, 3]).reshape(size[::-1])
    volume = replace(volume, array=samples)
    low, high = volume.value_range
    at = [low + (high - low) * share for share in (0.1, 0.4, 0.7, 0.95)]
    colors = [RED, GREEN, BLUE, GREEN]
    tf = TransferFunction(
        [ControlPoint(v, c, e) for v, c, e in zip(at, colors, (0.0, 0.8, 0.2, 0.0), strict=True)],
        [Isosurface(at[1], (1.0, 1.0, 1.0), 0.25)],
    )
    origins, ways = random_rays(volume, 60)
    expected = integrate_field_rays(field, tf, volume.box, origins, ways, tolerance=1e-10)
    found = integrate_rays(
        volume, tf, origins, ways, reconstruction=Reconstruction.CUBIC, tolerance=tolerance
    )
    # Samples and coefficients (up to 200 times the values' range at the border) are rounded, and so are positions
    # up to 40; the picture changes by at most 1.2 · 15 per change by the range.
    rounding = 18 * (200 + 40 * 30 + 10 * abs(offset) / (high - low) * 200) * U
    assert np.abs(found - expected).max() <= tolerance + 1e-10 + rounding
    assert np.count_nonzero(expected[:, 3] > 0.3) > 20


@pytest.mark.parametrize("reconstruction", [Reconstruction.CUBIC, Reconstruction.BSPLINE])
def test_a_linear_field_looks_as_with_trilinear_interpolation(reconstruction: Reconstruction) -> None:
    z, y, x = np.mgrid[0:5, 0:7, 0:9]
    volume = Volume(
        np.stack([x, y, z], axis=-1) @ np.array([0.05, 0.025, -0.0375]) + 0.3,
        spacing=(1.0, 2.0, 0.5),
        direction=TURN,
    )
    tf = TransferFunction(TENT.points, [Isosurface(0.4, (1.0, 1.0, 1.0), 0.25)])
    for distance in (30.0, 0.0):  # from afar and from inside
        origins, ways = random_rays(volume, 80, distance)
        planes = [(1.0, 0.3, -0.2, float(0.4 - np.array([1.0, 0.3, -0.2]) @ volume.box.centre))]
        expected = integrate_rays(volume, tf, origins, ways, clip_planes=planes)
        found = integrate_rays(volume, tf, origins, ways, clip_planes=planes, reconstruction=reconstruction)
        # Values below 1 and positions below 60 with some 500 roundings, times a sensitivity of 10 · 20; 1e-10 each.
        assert np.abs(found - expected).max() <= 2e-10 + 500 * 60 * U * 200
        assert np.count_nonzero(expected[:, 3] > 0.3) > 20


@pytest.mark.parametrize("reconstruction", SMOOTH)
def test_a_constant_slab_attenuates_by_its_chord(reconstruction: Reconstruction) -> None:
    volume = Volume(np.full((5, 6, 7), 0.3), spacing=(1.0, 2.0, 0.5), direction=TURN)
    tf = TransferFunction([ControlPoint(0.1, RED, 0.2), ControlPoint(0.5, RED, 0.2)])
    origins, ways = random_rays(volume, 40)
    ends = np.array([chord(volume, o, w) for o, w in zip(origins, ways, strict=True)])
    alpha = -np.expm1(-0.2 * (ends[:, 1] - ends[:, 0]))
    found = integrate_rays(volume, tf, origins, ways, reconstruction=reconstruction, tolerance=1e-2)
    assert np.abs(found - alpha[:, None] * [1.0, 0.0, 0.0, 1.0]).max() <= 60 * 60 * U


@pytest.mark.parametrize("reconstruction", [Reconstruction.BSPLINE, Reconstruction.BC21])
def test_a_plateau_on_an_isovalue_is_not_crossed(reconstruction: Reconstruction) -> None:
    """Where the coefficients are equal no rounding moves the value; `cubic` has coefficients that are rounded."""
    samples = np.full((5, 6, 9), 0.3)
    samples[0, 0, 0] = 0.0
    tf = TransferFunction(
        [ControlPoint(0.1, RED, 0.2), ControlPoint(0.5, RED, 0.2)], [Isosurface(0.3, GREEN, 0.5)]
    )
    origins, ways = random_rays(Volume(samples), 80)
    far = [(1.0, 0.0, 0.0, -3.0)]  # three cells from the sample that differs
    found, trilinear = (
        integrate_rays(Volume(samples), tf, origins, ways, clip_planes=far, reconstruction=which)
        for which in (reconstruction, Reconstruction.TRILINEAR)
    )
    assert np.abs(found - trilinear).max() <= 1e-13
    assert found[:, 1].max() == 0.0
    assert found[:, 0].max() > 0.5


def riemann_sum(
    volume: Volume, tf: TransferFunction, ray: tuple[F64, F64], reconstruction: Reconstruction, n: int
) -> F64:
    """n equal steps through the box, each with the optics of its middle; isosurfaces where samples change sides."""
    origin, way = ray
    start, end = chord(volume, origin, way)
    step = (end - start) / n
    t = start + (np.arange(n) + 0.5) * step
    matrix = np.linalg.inv(volume.world_from_index)
    places = (origin + t[:, None] * way) @ matrix[:3, :3].T + matrix[:3, 3]
    values, _ = GridSpline.build(volume, reconstruction).evaluate(places)
    color, extinction = tf.evaluate(values)
    through = np.exp(-np.concatenate([[0.0], np.cumsum(extinction * step)]))
    opacity = -np.expm1(-extinction * step)
    for surface in tf.isosurfaces:
        inside = values >= surface.value
        through[1:] *= np.cumprod(np.where(np.diff(inside, append=inside[-1]), 1.0 - surface.opacity, 1.0))
    light = (through[:-1] * opacity) @ color
    return np.array([*light, 1.0 - through[-1]])


@pytest.mark.parametrize("reconstruction", SMOOTH)
def test_fine_riemann_sums_converge_to_the_integral(reconstruction: Reconstruction) -> None:
    """Of one linear piece the error falls by 4 when the step is halved; a step over a kink errs by its own square."""
    volume = noise(spacing=(1.0, 0.5, 2.0), direction=TURN)
    low, high = GridSpline.build(volume, reconstruction).value_range
    piece = TransferFunction([ControlPoint(low, RED, 0.0), ControlPoint(high, GREEN, 0.4)])
    origins, ways = random_rays(volume, 12)
    for tf in (piece, TENT):
        exact = integrate_rays(volume, tf, origins, ways, reconstruction=reconstruction)
        coarse, fine = (
            np.array(
                [riemann_sum(volume, tf, ray, reconstruction, n) for ray in zip(origins, ways, strict=True)]
            )
            for n in (5000, 10000)
        )
        # Steps below 2e-3, slopes up to 60 and an extinction that changes by 5.7 per unit: (h f')² τ' / 12 at most.
        assert np.abs(fine - exact).max() <= 2e-6
        if tf is piece:
            assert 3.9 < np.abs(coarse - exact).max() / np.abs(fine - exact).max() < 4.1
    with pytest.raises(AssertionError):  # the trilinear field is another one
        assert np.abs(fine - integrate_rays(volume, TENT, origins, ways)).max() <= 2e-6


@pytest.mark.parametrize("reconstruction", SMOOTH)
def test_isosurfaces_are_crossed_as_often_as_samples_change_sides(reconstruction: Reconstruction) -> None:
    volume = noise(spacing=(1.0, 0.5, 2.0), direction=TURN)
    tf = TransferFunction([], [Isosurface(0.4, RED, 0.2), Isosurface(0.6, GREEN, 0.1)])
    origins, ways = random_rays(volume, 60)
    exact = integrate_rays(volume, tf, origins, ways, reconstruction=reconstruction)
    sums = np.array(
        [riemann_sum(volume, tf, ray, reconstruction, 4000)[3] for ray in zip(origins, ways, strict=True)]
    )
    # A step of 3e-3 misses pairs of crossings that lie closer: seldom, and then the sum has fewer of them.
    differs = np.abs(exact[:, 3] - sums) > 1e-12
    assert differs.sum() <= 2
    assert np.all(exact[differs, 3] > sums[differs])
    assert exact[:, 3].max() > 0.5


@pytest.mark.parametrize("reconstruction", SMOOTH)
@pytest.mark.parametrize("tolerance", [1e-2, 1e-4, 1e-7])
def test_the_tolerance_is_kept(reconstruction: Reconstruction, tolerance: float) -> None:
    """Against a tolerance 1000 times as small; and cubics that are not checked would break it."""
    volume = noise(seed=4)
    origins, ways = random_rays(volume, 80)
    fine = integrate_rays(
        volume, TENT, origins, ways, reconstruction=reconstruction, tolerance=1e-3 * tolerance
    )
    tracer = ReferenceTracer.build(volume, TENT, reconstruction=reconstruction, tolerance=tolerance)
    error = np.abs(tracer.integrate(origins, ways)[0] - fine).max()
    assert 0.0 < error <= 1.001 * tolerance
    if tolerance < 1e-3:
        assert tracer.accuracy is not None
        agreement, rules = tracer.accuracy
        careless = [
            replace(tracer, accuracy=tracer.accuracy._replace(agreement=np.full_like(agreement, 10.0))),
            replace(
                tracer,
                accuracy=tracer.accuracy._replace(rules=rules._replace(integrals=0.99 * rules.integrals)),
            ),
        ]
        for other in careless:
            with pytest.raises(AssertionError):
                assert np.abs(other.integrate(origins, ways)[0] - fine).max() <= 1.001 * tolerance


@pytest.mark.parametrize("reconstruction", SMOOTH)
def test_the_tolerance_is_kept_where_a_steep_band_borders_on_an_empty_one(
    reconstruction: Reconstruction,
) -> None:
    """A cubic that crosses both must suit the steeper; one that suits the empty band alone would not do."""
    volume = noise(seed=4)
    steep = [ControlPoint(0.5, RED, 0.0), ControlPoint(0.501, GREEN, 100.0), ControlPoint(0.51, BLUE, 100.0)]
    tf = TransferFunction(steep)
    origins, ways = random_rays(volume, 80)
    fine = integrate_rays(volume, tf, origins, ways, reconstruction=reconstruction, tolerance=1e-8)
    tracer = ReferenceTracer.build(volume, tf, reconstruction=reconstruction, tolerance=1e-4)
    assert np.abs(tracer.integrate(origins, ways)[0] - fine).max() <= 1.001e-4
    assert tracer.accuracy is not None
    agreement = tracer.accuracy.agreement
    loose = replace(
        tracer, accuracy=tracer.accuracy._replace(agreement=np.full_like(agreement, agreement.max()))
    )
    with pytest.raises(AssertionError):
        assert np.abs(loose.integrate(origins, ways)[0] - fine).max() <= 1.001e-4


@pytest.mark.parametrize("reconstruction", SMOOTH)
def test_more_panels_change_less_than_the_tolerance(reconstruction: Reconstruction) -> None:
    volume = noise(seed=5)
    points = [*TENT.points, ControlPoint(0.9, RED, 1.0), ControlPoint(1.2, GREEN, 0.4)]  # a step
    tf = TransferFunction(points, [Isosurface(0.45, BLUE, 0.3)])
    origins, ways = random_rays(volume, 60)
    once, twice = (
        integrate_rays(
            volume, tf, origins, ways, reconstruction=reconstruction, tolerance=1e-7, panels=panels
        )
        for panels in (1, 2)
    )
    assert 0.0 < np.abs(once - twice).max() <= 1e-7


@pytest.mark.parametrize("reconstruction", SMOOTH)
def test_opacity_is_the_same_there_and_back(reconstruction: Reconstruction) -> None:
    """In faces, along edges and through corners of cells too; an isosurface too many would be 0.1."""
    volume = noise(seed=6)
    tf = TransferFunction(TENT.points, [Isosurface(0.55, BLUE, 0.1)])
    last = np.array(volume.size_xyz) - 1.0
    rng = np.random.default_rng(7)
    places, ways = (
        np.round(2.0 * rng.random((60, 3)) * last) / 2.0,
        rng.integers(-1, 2, (60, 3)).astype(float),
    )
    ways[~ways.any(axis=1)] = [1.0, 0.0, 0.0]
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    there, back = (
        integrate_rays(volume, tf, places - 30.0 * way, way, reconstruction=reconstruction, tolerance=1e-9)[
            :, 3
        ]
        for way in (ways, -ways)
    )
    assert np.abs(there - back).max() <= 2e-9
    assert np.ptp(there) > 0.3


@pytest.mark.parametrize("reconstruction", SMOOTH)
def test_blocks_without_extinction_are_skipped_and_nothing_is_lost(reconstruction: Reconstruction) -> None:
    z, y, x = np.mgrid[0:50, 0:50, 0:50]
    volume = Volume(np.sqrt((x - 24.0) ** 2 + (y - 25.0) ** 2 + (z - 24.5) ** 2))
    tf = TransferFunction(
        [ControlPoint(2.0, RED, 0.0), ControlPoint(4.0, GREEN, 1.0)], [Isosurface(23.0, BLUE, 0.5)]
    )
    origins, ways = random_rays(volume, 60, 90.0)
    tracer = ReferenceTracer.build(volume, tf, reconstruction=reconstruction, tolerance=1e-8)
    rgba, counts = tracer.integrate(origins, ways)
    tracer.grid.visible[:] = True
    everything, more = tracer.integrate(origins, ways)
    assert np.abs(rgba - everything).max() <= 1e-12
    assert counts[:, 1].sum() > 20  # cells without extinction
    if spline_kernel(reconstruction)[1] == 1.0:  # with negative weights bounds are about twice as wide
        assert counts[:, 2].sum() > 20  # passages through blocks that were not looked at
        assert more[:, 0].sum() > 1.2 * counts[:, 0].sum()


@pytest.mark.parametrize("way", [1.0, -1.0])
def test_behind_skipped_blocks_the_field_is_read_afresh(way: float) -> None:
    """The last cell before the gap is walked for a far tap's sake; its value must not begin the cell behind."""
    row = np.arange(26.0)
    row[18:] += (
        30.0  # the spline climbs in the cell from 16 to 17, beside a block that knows no sample above 17
    )
    volume = Volume(np.broadcast_to(row, (3, 3, 26)).copy())
    points = [(0.0, 0.1), (6.5, 0.1), (6.5, 0.0), (20.0, 0.0), (20.0, 0.1), (60.0, 0.1)]
    tf = TransferFunction([ControlPoint(value, RED, extinction) for value, extinction in points])
    tracer = ReferenceTracer.build(volume, tf, reconstruction=Reconstruction.BSPLINE)
    assert tracer.grid.visible[0, 0].tolist() == [True, False, True, True]
    ray = [[-4.0 if way > 0 else 40.0, 0.7, 1.2]], [[way, 0.0, 0.0]]
    rgba = tracer.integrate(*ray)[0]
    tracer.grid.visible[:] = True
    assert np.abs(rgba - tracer.integrate(*ray)[0]).max() <= 1e-13
    assert rgba[0, 3] > 0.5


def test_one_sample_between_blocks_is_seen_from_every_block() -> None:
    for place in ((8, 4, 4), (4, 8, 4), (4, 4, 8), (8, 8, 8), (7, 9, 8)):
        samples = np.zeros((18, 18, 18))
        samples[place] = 1.0
        tf = TransferFunction([ControlPoint(1e-4, RED, 1.0), ControlPoint(1.0, RED, 1.0)])
        tracer = ReferenceTracer.build(Volume(samples), tf, reconstruction=Reconstruction.BSPLINE)
        origins, ways = random_rays(Volume(np.zeros((3, 3, 3))), 40)
        origins = origins + np.array(place[::-1]) - 1.0  # through the cells around the sample
        rgba = tracer.integrate(origins, ways)[0]
        assert not tracer.grid.visible.all()
        tracer.grid.visible[:] = True
        assert np.abs(rgba - tracer.integrate(origins, ways)[0]).max() <= 1e-13
        assert np.count_nonzero(rgba[:, 3] > 0.1) > 10


def test_samples_that_are_not_finite_are_refused() -> None:
    samples = np.zeros((4, 4, 4))
    samples[1, 2, 3] = np.nan
    with pytest.raises(
        InputError, match=r"1 NaN and 0 infinite.*trilinear reconstruction, which can mask them"
    ):
        integrate_rays(
            Volume(samples), TENT, [[0.0, 0, -9]], [[0.0, 0, 1]], reconstruction=Reconstruction.BC21
        )
    with pytest.raises(InputError, match="tolerance 1e-15 must be"):
        integrate_rays(
            noise(), TENT, [[0.0, 0, -9]], [[0.0, 0, 1]], reconstruction=Reconstruction.CUBIC, tolerance=1e-15
        )


@given(
    seed=st.integers(0, 10_000),
    reconstruction=st.sampled_from(SMOOTH),
    depth=st.integers(0, 4),
)
def test_a_cell_s_polynomial_is_the_spline_along_the_line(
    seed: int, reconstruction: Reconstruction, depth: int
) -> None:
    """And its Hermite cubic is no farther off than its coefficients say, on every half of a half."""
    rng = np.random.default_rng(seed)
    samples, ends = rng.normal(size=(4, 4, 4)), np.ascontiguousarray(rng.random((2, 3)))
    if seed % 3 == 0:
        ends = np.round(ends)
    kernel, _ = spline_kernel(reconstruction)
    polynomial = np.empty(10)
    cell_polynomial(samples, kernel, ends, np.empty((3, 4, 4)), polynomial)
    s = np.linspace(0.0, 1.0, 33)

    def spline(places: F64) -> F64:
        w = np.polynomial.polynomial.polyval(ends[0] + places[:, None] * (ends[1] - ends[0]), kernel.T)
        return cast("F64", np.einsum("an,bn,cn,cba->n", w[:, :, 0], w[:, :, 1], w[:, :, 2], samples))

    tolerance = 64 * 4 * U * 64 / 27 * np.abs(samples).max()
    assert np.abs(bernstein(s, 9) @ polynomial - spline(s)).max() <= tolerance
    start, width = 0.0, 1.0
    for _ in range(depth):
        front = np.empty(10)
        halve_polynomial(polynomial, front)
        width *= 0.5
        if rng.random() < 0.5:
            polynomial = front
        else:
            start += width
    low, high = polynomial_bounds(polynomial)
    values = spline(start + width * s)
    assert low - tolerance <= values.min()
    assert values.max() <= high + tolerance
    cubic = hermite_cubic(polynomial)
    error = np.abs(bernstein(s, 3) @ cubic - values).max()
    bound = hermite_error(polynomial, cubic)
    assert error <= bound + 4 * tolerance
    assert bound <= 30.0 * error + 40 * tolerance  # not wasteful: halving lets them meet


def bernstein(s: F64, degree: int) -> F64:
    from math import comb

    return np.stack([comb(degree, i) * s**i * (1.0 - s) ** (degree - i) for i in range(degree + 1)], axis=-1)


def test_raising_the_degree_keeps_the_polynomial() -> None:
    s = np.linspace(0.0, 1.0, 21)
    assert np.abs(bernstein(s, 9) @ ELEVATION - bernstein(s, 3)).max() <= 32 * U
    assert np.abs(ELEVATION.sum(axis=1) - 1.0).max() <= 4 * U


@pytest.mark.parametrize("fault", ["one tap", "one weight"])
def test_a_wrong_tap_or_weight_is_noticed(fault: str) -> None:
    volume = noise(seed=8)
    tracer = ReferenceTracer.build(volume, TENT, reconstruction=Reconstruction.BSPLINE, tolerance=1e-6)
    grid: Any = tracer.grid
    origins, ways = random_rays(volume, 40)
    right = integrate_rays(volume, TENT, origins, ways, reconstruction=Reconstruction.BSPLINE, tolerance=1e-6)
    coefficients, kernel = grid.coefficients.copy(), grid.kernel.copy()
    if fault == "one tap":
        coefficients[3, 3, 3] += 0.01
    else:
        kernel[1, 3], kernel[2, 3] = kernel[1, 3] + 0.01, kernel[2, 3] - 0.01
    for array in (coefficients, kernel):
        array.setflags(write=False)
    wrong = replace(tracer, grid=grid._replace(coefficients=coefficients, kernel=kernel))
    with pytest.raises(AssertionError):
        assert np.abs(wrong.integrate(origins, ways)[0] - right).max() <= 2e-6

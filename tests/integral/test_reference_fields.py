"""The reference integral of closed-form fields: against closed forms, and as the limit of finer grids."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

import numpy as np
import pytest

from isosample.errors import CapacityError, InputError
from isosample.integral import field_pieces, field_reference
from isosample.integral.band_table import BandTable
from isosample.integral.field_reference import integrate_field_rays
from isosample.integral.level_isolation import Isolation
from isosample.integral.ray_pieces import Pieces
from isosample.integral.reference import integrate_rays
from isosample.transfer.control_points import ControlPoint, Isosurface
from isosample.transfer.transfer_function import TransferFunction
from isosample.volume.analytic import (
    Constant,
    Field,
    GaussianMixture,
    LinearRamp,
    PlaneWaves,
    SphereDistance,
    sample_field,
)
from isosample.volume.geometry import Box

if TYPE_CHECKING:
    from collections.abc import Callable

    from isosample.volume.grid import F64

WHITE = (1.0, 1.0, 1.0)
BOX = Box(corner=np.array([-2.0, -3.0, -2.5]), edges=np.diag([4.0, 6.0, 5.0]))


def rays(count: int, spread: float = 1.0) -> tuple[F64, F64]:
    rng = np.random.default_rng(1)
    ways = rng.normal(size=(count, 3))
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    return rng.normal(size=(count, 3)) * spread - 20.0 * ways, ways


def test_a_ramp_and_a_constant_are_those_of_a_grid() -> None:
    """A linear field is its own trilinear interpolant."""
    tf = TransferFunction(
        [ControlPoint(-5.0, (1.0, 0.0, 0.2), 0.1), ControlPoint(4.0, (0.0, 1.0, 0.5), 0.7)],
        [Isosurface(0.3, WHITE, 0.2)],
    )
    origins, ways = rays(40)
    plane = (0.3, -0.2, 1.0, 0.1)
    for field in (LinearRamp((1.0, -0.5, 0.75), 0.25), Constant(1.5)):
        volume = sample_field(field, (3, 5, 4), lower=(-2, -3, -2.5), upper=(2, 3, 2.5), dtype=np.float64)
        for planes in ([], [plane]):
            expected = integrate_rays(volume, tf, origins, ways, clip_planes=planes)
            rgba = integrate_field_rays(field, tf, BOX, origins, ways, clip_planes=planes)
            assert np.abs(rgba - expected).max() <= 3e-10
            assert expected[:, 3].max() > 0.5


def test_shells_of_a_distance_field_are_chords() -> None:
    """Constant extinction between two radii: closed form, with a step of the transfer function at both."""
    inner, outer, extinction = 0.6, 1.7, 0.8
    tf = TransferFunction(
        [ControlPoint(inner, WHITE, extinction), ControlPoint(outer, WHITE, extinction)],
        [Isosurface(1.0, (1.0, 0.0, 0.0), 0.3)],
    )
    origins, ways = rays(200, spread=0.8)
    origins[0] = -9.0 * ways[0]  # through the centre, where the field has a kink
    closest = np.linalg.norm(np.cross(origins, ways), axis=1)
    chords = [2 * np.sqrt(np.maximum(r**2 - closest**2, 0.0)) for r in (inner, outer)]
    alpha = 1.0 - np.exp(-extinction * (chords[1] - chords[0])) * np.where(closest < 1.0, 0.49, 1.0)
    rgba = integrate_field_rays(SphereDistance((0.0, 0.0, 0.0), 0.0), tf, BOX, origins, ways)
    # The field is met to about tolerance / 2; a crossing moves by that divided by the slope cos of the angle.
    slope = np.ones(len(closest))
    for radius in (inner, 1.0, outer):
        cosine = np.sqrt(np.maximum(1 - (closest / radius) ** 2, 0.0))
        slope = np.where(closest < radius, np.minimum(slope, cosine), slope)
    good = slope > 0.05
    assert good.mean() > 0.9
    assert np.abs(rgba[good, 3] - alpha[good]).max() <= 1e-10 + 2 * extinction * 1e-10 / 0.05
    assert (closest < inner).any()
    assert (closest > outer).any()


def test_finer_grids_approach_it_in_second_order() -> None:
    field = GaussianMixture(((0.3, 0.1, 0.0), (-0.8, 0.4, 0.5)), (1.1, 0.8), (1.0, 0.6))
    tf = TransferFunction(
        [
            ControlPoint(0.1, (1.0, 0.0, 0.0), 0.0),
            ControlPoint(0.4, (1.0, 1.0, 0.0), 0.6),
            ControlPoint(0.9, (0.0, 0.0, 1.0), 0.0),
        ]
    )
    origins, ways = rays(60)
    exact = integrate_field_rays(field, tf, BOX, origins, ways, tolerance=1e-8)
    errors = []
    for n in (17, 33, 65):
        volume = sample_field(field, (n, n, n), lower=(-2, -3, -2.5), upper=(2, 3, 2.5), dtype=np.float64)
        errors.append(np.sqrt(np.mean((integrate_rays(volume, tf, origins, ways) - exact) ** 2)))
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert np.all(np.abs(orders - 2.0) < 0.2), orders
    # A field that is 1 % too high is seen.
    wrong = GaussianMixture(field.centres, field.widths, (1.01, 0.606))
    other = integrate_field_rays(wrong, tf, BOX, origins, ways, tolerance=1e-8)
    with pytest.raises(AssertionError):
        assert np.abs(other - exact).max() < 1e-4


@pytest.mark.parametrize("tolerance", [1e-4, 1e-7])
def test_the_tolerance_is_met(tolerance: float) -> None:
    field = PlaneWaves(((2.0, 1.0, 0.5), (-1.0, 2.0, 3.0)), (1.0, 0.7), (0.3, 1.0))
    tf = TransferFunction(
        [
            ControlPoint(-1.0, (1.0, 0.0, 0.0), 0.0),
            ControlPoint(0.2, (0.0, 1.0, 0.0), 2.0),
            ControlPoint(1.0, (0.0, 0.0, 1.0), 0.1),
            ControlPoint(1.8, (0.0, 0.0, 1.0), 0.0),
        ]
    )
    origins, ways = rays(30)
    rgba = integrate_field_rays(field, tf, BOX, origins, ways, tolerance=tolerance)
    finer = integrate_field_rays(field, tf, BOX, origins, ways, tolerance=tolerance / 100)
    assert 0 < np.abs(rgba - finer).max() <= tolerance


SIDES: tuple[Literal["left", "right"], ...] = ("left", "right")
LEVEL = 0.35  # where the transfer function of the narrow Gaussians begins
EXTINCTION = 3000.0
NARROW = TransferFunction(
    [ControlPoint(LEVEL, (1.0, 0.4, 0.0), EXTINCTION), ControlPoint(1.2, (0.0, 0.5, 1.0), EXTINCTION)]
)


def narrow_ray_through(field: Field, tf: TransferFunction, tolerance: float = 1e-6) -> F64:
    rgba = integrate_field_rays(field, tf, BOX, [[0.0, 0.0, -9.0]], [[0.0, 0.0, 1.0]], tolerance=tolerance)
    return np.asarray(rgba[0])


def slab_by_quadrature(centre: float, width: float, amplitude: float) -> F64:
    """Midpoint sums over the stretch on which the Gaussian is above the level, known in closed form.

    The colour is smooth there: n panels err by less than the second derivative, (extinction · stretch)² or
    so, over 24 n², about 1e-9.
    """
    half = width * np.sqrt(2 * np.log(amplitude / LEVEL))
    count = 20000
    t = centre + half * ((np.arange(count) + 0.5) * 2 / count - 1)
    value = amplitude * np.exp(-0.5 * ((t - centre) / width) ** 2)
    share = ((value - LEVEL) / (1.2 - LEVEL))[:, None]
    color = np.array([1.0, 0.4, 0.0]) * (1 - share) + np.array([0.0, 0.5, 1.0]) * share
    depth = EXTINCTION * (2 * half / count)
    weight = np.exp(-depth * np.arange(count)) * -np.expm1(-depth)
    return np.append((weight[:, None] * color).sum(axis=0), -np.expm1(-depth * count))


@pytest.mark.parametrize("width", [4e-4, 1e-3])
@pytest.mark.parametrize("centre", [-2.49321, -0.317123, 0.0123456789, 1.7071, 2.4876])
def test_a_gaussian_far_narrower_than_the_pieces_is_found(width: float, centre: float) -> None:
    """First pieces are 5 / 64 = 0.078 long; at the nearest of their ends and middles the Gaussian is 0."""
    knots = np.linspace(-2.5, 2.5, 129)
    assert np.abs(knots - centre).min() > 4 * width
    rgba = narrow_ray_through(GaussianMixture(((0.0, 0.0, centre),), (width,), (0.7,)), NARROW)
    expected = slab_by_quadrature(centre, width, 0.7)
    # Either end of the stretch moves by the error of the field, at most the tolerance, over its slope there.
    slope = LEVEL / width * np.sqrt(2 * np.log(0.7 / LEVEL))
    assert np.abs(rgba - expected).max() <= 1e-6 + 2 * EXTINCTION * 1e-6 / slope + 1e-8
    assert expected[3] > 0.7


def test_a_narrow_gaussian_on_a_slope_that_crosses_the_isosurface_is_crossed_too() -> None:
    """The piece in which a wide Gaussian crosses 0.5 holds a narrow one, which adds two crossings."""
    surface = TransferFunction([], [Isosurface(0.5, WHITE, 0.3)])
    crossing = -np.sqrt(2 * np.log(2.0))
    for offset, amplitude in ((0.0173, -0.4), (-0.0173, 0.4)):  # down behind the crossing, up before it
        centres = ((0.0, 0.0, 0.0), (0.0, 0.0, crossing + offset))
        field = GaussianMixture(centres, (1.0, 1e-3), (1.0, amplitude))
        rgba = narrow_ray_through(field, surface)
        np.testing.assert_allclose(rgba, np.full(4, 1 - 0.7**4), rtol=0, atol=1e-12)  # opacity only: exact


def test_a_narrow_gaussian_on_a_slope_that_crosses_a_step_is_seen() -> None:
    """Extinction 1 from 0.5 on: depth is length, and the bump before the crossing adds its own."""
    tf = TransferFunction([ControlPoint(0.5, WHITE, 1.0), ControlPoint(100.0, WHITE, 1.0)])
    crossing, width = np.sqrt(2 * np.log(2.0)), 1e-3
    centre = -crossing - 0.0173
    field = GaussianMixture(((0.0, 0.0, 0.0), (0.0, 0.0, centre)), (1.0, width), (1.0, 0.4))
    t = centre + np.linspace(-8, 8, 400000) * width
    bump = (
        (field.value(np.stack([np.zeros_like(t), np.zeros_like(t), t], axis=-1)) >= 0.5).mean() * 16 * width
    )
    assert bump > 1e-3
    depth = -np.log1p(-narrow_ray_through(field, tf, tolerance=1e-8)[3])
    # Two ends of the bump are counted to a spacing of 4e-8 each; all ends move by 1e-8 over their slopes > 0.5.
    assert abs(depth - 2 * crossing - bump) <= 8e-8 + 4 * 1e-8 / 0.5


def test_a_bump_that_stays_below_the_peak_of_a_tent_is_found() -> None:
    """Nothing at the level itself, much above it, and no other level that the bound could reach."""
    tent = TransferFunction([ControlPoint(LEVEL, WHITE, 0.0), ControlPoint(100.0, WHITE, 1.2e6)])
    field = GaussianMixture(((0.0, 0.0, 0.0123456789),), (1e-3,), (0.7,))
    t = 0.0123456789 + np.linspace(-2e-3, 2e-3, 100001)
    value = field.value(np.stack([np.zeros_like(t), np.zeros_like(t), t], axis=-1))
    depth = tent.evaluate(value)[1].mean() * 4e-3  # kinks at both ends: about (4e-8)² of slope, negligible
    assert depth > 1.0
    # the mean counts both ends of the grid, 1 part in 100000
    assert abs(narrow_ray_through(field, tent)[3] + np.expm1(-depth)) <= 3e-5 * depth


def hidden_one_by_one(tf: TransferFunction, ends: F64, over: float, length: float) -> bool:
    """What `_Isolation.hides` answers, from the transfer function itself; tolerance 0.5, agreement 0.01."""
    low, high = min(ends), max(ends)
    surfaces = [surface.value for surface in tf.isosurfaces]
    levels = [*(point.value for point in tf.points), *surfaces]
    for start, stop in ((low - over, low), (high, high + over)):
        inside = [level for level in levels if start <= level <= stop]
        seen = [tf.evaluate(np.array([level]), side=side)[1][0] for level in inside for side in SIDES]
        seen += [tf.evaluate(np.array([end]))[1][0] for end in (start, stop) if inside and end not in ends]
        if max(seen, default=0.0) * length > 0.5 or (over > 0.01 and set(inside) & set(surfaces)):
            return True
    steps = [-0.4, 0.9]
    most = max(point.extinction for point in tf.points)
    crossed = any(low < level < high for level in surfaces)
    crossed |= most * length > 0.5 and any(low < level < high for level in steps)
    return crossed and over > 0.01


def test_what_hides_is_what_the_transfer_function_shows_within_reach() -> None:
    points = [(-1.0, 0.0), (-0.4, 0.0), (-0.4, 2.0), (0.1, 2.0), (0.3, 9.0), (0.9, 0.5)]
    tf = TransferFunction(
        [ControlPoint(value, WHITE, extinction) for value, extinction in points],
        [Isosurface(0.7, WHITE, 0.2), Isosurface(1.5, WHITE, 0.2)],
    )
    bands = BandTable.from_transfer_function(tf)
    isolation = Isolation.build(1.0, bands, 0.5, 0.01)
    rng, count = np.random.default_rng(3), 3000
    values = rng.uniform(-2, 2, (count, 1)) + rng.normal(size=(count, 2)) * 0.05
    length = np.abs(np.diff(values, axis=1))[:, 0] + rng.uniform(0, 0.5, count)
    over = 0.5 * (length - np.abs(np.diff(values, axis=1))[:, 0])
    ends = np.stack([np.zeros(count), length], axis=1)
    pieces = Pieces(np.zeros(count, dtype=np.int64), ends, values, values)
    hidden = isolation.hides(pieces, np.zeros(count))
    expected = [hidden_one_by_one(tf, values[i], over[i], length[i]) for i in range(count)]
    np.testing.assert_array_equal(hidden, expected)
    assert 0.05 < hidden.mean() < 0.95


def test_a_narrow_dip_below_an_isosurface_is_crossed_twice() -> None:
    field = GaussianMixture(((0.0, 0.0, 0.0), (0.0, 0.0, 0.4123)), (50.0, 1e-3), (0.9, -0.7))
    surface = TransferFunction([], [Isosurface(0.5, WHITE, 0.3)])
    # It enters the box inside, at 0.9, which is no crossing.
    np.testing.assert_allclose(narrow_ray_through(field, surface), np.full(4, 0.51), rtol=0, atol=1e-12)


def test_many_rays_are_worked_on_in_parts_where_they_need_many_pieces(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    field = GaussianMixture(((0.0, 0.0, 0.0123456789),), (1e-3,), (0.7,))
    origins = np.stack([np.linspace(-1e-3, 1e-3, 9), np.zeros(9), np.full(9, -9.0)], axis=1)
    ways = np.tile([0.0, 0.0, 1.0], (9, 1))
    whole = integrate_field_rays(field, NARROW, BOX, origins, ways, tolerance=1e-6)
    monkeypatch.setattr(field_pieces, "MAX_PIECES", 1 << 14)
    parts: list[slice] = []

    def counted(work: Callable[[slice], None], rows: slice, of: Field) -> None:
        parts.append(rows)
        original(work, rows, of)

    original = field_reference._work_on_halves
    monkeypatch.setattr(field_reference, "_work_on_halves", counted)
    np.testing.assert_array_equal(
        integrate_field_rays(field, NARROW, BOX, origins, ways, tolerance=1e-6), whole
    )
    assert len(parts) > 0
    assert whole[4, 3] > 0.7


class Unbounded(GaussianMixture):
    """The same field, but nothing is known of its slope."""

    def lipschitz(self) -> None:  # type: ignore[override]
        return None


def test_a_field_without_a_bound_is_verified_at_points_only() -> None:
    """It is what misses the narrow Gaussian, and it does well for the wide one."""
    narrow = (((0.0, 0.0, 0.0123456789),), (4e-4,), (0.7,))
    assert narrow_ray_through(Unbounded(*narrow), NARROW)[3] == 0.0
    assert narrow_ray_through(GaussianMixture(*narrow), NARROW)[3] > 0.7
    wide = (((0.3, 0.1, 0.0),), (0.8,), (1.0,))
    tf = TransferFunction([ControlPoint(0.2, WHITE, 0.0), ControlPoint(0.9, WHITE, 1.0)])
    known, unknown = (narrow_ray_through(kind(*wide), tf) for kind in (GaussianMixture, Unbounded))
    assert known[3] > 0.5
    assert np.abs(known - unknown).max() <= 2e-6  # the tolerance of either


def test_a_peak_between_visible_bands_is_not_missed() -> None:
    """Extinction 10000 around 0.8, 0.01 elsewhere: the ends of a piece see but the 0.01."""
    points = [(0.0, 0.01), (0.75, 0.01), (0.8, 10000.0), (0.85, 0.01), (2.0, 0.01)]
    tf = TransferFunction([ControlPoint(value, WHITE, extinction) for value, extinction in points])
    centre, width = 0.4123, 1e-3
    field = GaussianMixture(((0.0, 0.0, 0.0), (0.0, 0.0, centre)), (50.0, width), (0.3, 0.6))
    rgba = narrow_ray_through(field, tf, tolerance=1e-4)
    t = centre + np.linspace(-8, 8, 400001) * width
    values = field.value(np.stack([np.zeros_like(t), np.zeros_like(t), t], axis=-1))
    extinction = tf.evaluate(values)[1]
    depth = 0.01 * (5.0 - 16 * width) + extinction.mean() * 16 * width
    # The mean is off by at most the largest extinction times a spacing or two, 10000 · 4e-8 · 2 = 8e-4.
    assert depth > 1.0
    assert abs(rgba[3] + np.expm1(-depth)) <= (1e-3 + 1e-4) * np.exp(-depth) + 1e-4


class Liar(LinearRamp):
    """A ramp with another bound of its slope."""

    bound = 0.0

    def lipschitz(self) -> float:
        return self.bound


@pytest.mark.parametrize("bound", [-1.0, np.nan, np.inf])
def test_a_bound_that_is_none_is_refused(bound: float) -> None:
    ramp = Liar((0.0, 0.0, 2.0))
    object.__setattr__(ramp, "bound", bound)
    with pytest.raises(InputError, match=r"Liar bounds its slope by .* expected a finite number >= 0"):
        narrow_ray_through(ramp, NARROW)


def test_a_bound_that_the_field_contradicts_is_refused() -> None:
    ramp = Liar((0.0, 0.0, 2.0))
    object.__setattr__(ramp, "bound", 1.9)
    with pytest.raises(
        InputError, match=r"Liar bounds its slope by 1.9, yet changes by 0.15625 over 0.078125"
    ):
        narrow_ray_through(ramp, NARROW)
    object.__setattr__(ramp, "bound", 2.0)
    assert narrow_ray_through(ramp, NARROW)[3] > 0.7


def test_a_ray_that_stays_beside_an_isosurface_is_refused_and_one_upon_it_is_not(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """1e-9 from the isovalue over a length of 5, bound 1: 5 / 2e-9 pieces would be needed."""
    ramp = LinearRamp((1.0, 0.0, 0.0), 0.5)
    monkeypatch.setattr(field_pieces, "MAX_PIECES", 1 << 14)  # as many would be refused, in less time
    beside, upon = (TransferFunction([], [Isosurface(value, WHITE, 0.5)]) for value in (0.5 + 1e-9, 0.5))
    with pytest.raises(CapacityError, match=r"ray 0 runs so close to a visible value of LinearRamp"):
        narrow_ray_through(ramp, beside, tolerance=1e-10)
    assert narrow_ray_through(ramp, upon, tolerance=1e-10)[3] == 0.0  # it enters at the isovalue: no crossing


class Pole(Field):
    """1 / x, which is infinite in the middle of the box."""

    def value(self, points: F64) -> F64:
        with np.errstate(divide="ignore"):
            return np.asarray(1.0 / points[..., 0])

    def gradient(self, points: F64) -> F64:
        return np.zeros(points.shape)


def test_wrong_input_is_named() -> None:
    tf = TransferFunction([], [Isosurface(0.5, WHITE, 0.5)])
    with pytest.raises(InputError, match=r"Pole has value inf .* expected finite numbers"):
        integrate_field_rays(Pole(), tf, BOX, [[0.0, 0.0, -9.0]], [[0.0, 0.0, 1.0]])
    flat = Box(corner=np.zeros(3), edges=np.diag([1.0, 1.0, 0.0]))
    with pytest.raises(InputError, match="has no extent"):
        integrate_field_rays(Constant(0.0), tf, flat, [[0.0, 0.0, -9.0]], [[0.0, 0.0, 1.0]])
    with pytest.raises(InputError, match="tolerance"):
        integrate_field_rays(Constant(0.0), tf, BOX, [[0.0, 0.0, -9.0]], [[0.0, 0.0, 1.0]], tolerance=0.0)
    assert not integrate_field_rays(Constant(0.0), tf, BOX, [[9.0, 0.0, -9.0]], [[0.0, 0.0, 1.0]]).any()

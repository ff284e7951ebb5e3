"""Narrow peaks become sheets that show what the resolved peak shows; everything else stays as it is."""

from __future__ import annotations

import itertools
import json
import math
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from isosample.errors import InputError
from isosample.transfer.isovalues import IsovaluePlan, Reason, plan_isovalues
from isosample.transfer.sheets import SHEET_COUNT, SHEET_WIDTH, Gradients, split_sheets
from isosample.transfer.transfer_function import ControlPoint, Isosurface, TransferFunction
from isosample.volume.grid import Volume
from isosample.volume.statistics import gradient_at_values

if TYPE_CHECKING:
    from collections.abc import Sequence

Color = tuple[float, float, float]

RED, BLUE = (1.0, 0.0, 0.0), (0.0, 0.0, 1.0)
WIDTH = 1e-4  # with a gradient of 1 per voxel a hundredth of the width that a mesh separates


def constant_gradient(gradient: float | None = 1.0) -> Gradients:
    """Return the same typical gradient everywhere."""
    return lambda values: [gradient] * len(values)


def points_of(*points: tuple[float, float], color: Color = RED) -> list[ControlPoint]:
    """Control points of one colour from (value, extinction)."""
    return [ControlPoint(value, color, extinction) for value, extinction in points]


def tent(centre: float, width: float, height: float, base: float = 0.0) -> list[tuple[float, float]]:
    """Three points of a symmetric peak of the given full width above `base`."""
    return [(centre - width / 2, base), (centre, height), (centre + width / 2, base)]


def plan_of(
    *points: tuple[float, float], value_range: tuple[float, float] = (0.0, 10.0), **options: Any
) -> IsovaluePlan:
    """Plan of a red transfer function, with narrow peaks as sheets."""
    options = {"per_slope": 0, "gradients": constant_gradient(), **options}
    return plan_isovalues(TransferFunction(points_of(*points)), value_range, **options)


def test_a_narrow_tent_is_one_value_with_the_area_below_it() -> None:
    plan = plan_of(*tent(5, WIDTH, 300))
    np.testing.assert_allclose(plan.isovalues, [5], rtol=1e-15)
    assert plan.reasons == (Reason.SHEET,)
    # area of the triangle: width · height / 2; the width's relative rounding is ulp(5) / 1e-4 = 9e-12
    np.testing.assert_allclose(plan.sheet_area, [WIDTH * 150], rtol=2e-11)
    np.testing.assert_allclose(plan.sheet_color, [RED], rtol=1e-15)
    np.testing.assert_allclose(plan.sheet_width, [WIDTH], rtol=2e-11)
    np.testing.assert_array_equal(plan.band_extinction, np.zeros((2, 2)))
    assert plan.skipped[SHEET_COUNT] == 1


def test_a_narrow_box_is_a_sheet_also_where_the_transfer_function_ends() -> None:
    closed = plan_of((5, 0), (5, 40), (5 + WIDTH, 40), (5 + WIDTH, 0))
    open_ends = plan_of((5, 40), (5 + WIDTH, 40))
    for plan in (closed, open_ends):
        np.testing.assert_allclose(plan.isovalues, [5 + WIDTH / 2], rtol=1e-15)
        np.testing.assert_allclose(plan.sheet_area, [40 * WIDTH], rtol=2e-11)
        np.testing.assert_array_equal(plan.band_extinction, np.zeros((2, 2)))


def test_a_skewed_peak_stands_at_its_centre_of_mass_with_the_mean_colour_of_its_light() -> None:
    points = [ControlPoint(5, RED, 0), ControlPoint(5.0001, RED, 10), ControlPoint(5.0004, BLUE, 0)]
    plan = plan_isovalues(TransferFunction(points), (0, 10), gradients=constant_gradient())
    # a triangle's centroid is the mean of its corners
    np.testing.assert_allclose(plan.isovalues, [5 + 0.0005 / 3], rtol=1e-14)
    # blue rises from 0 to 1 over the falling side, where extinction falls from 10 to 0:
    # ∫ blue · extinction = 0.0003 · 10 / 6, of an area of 0.0004 · 10 / 2
    np.testing.assert_allclose(plan.sheet_color, [[0.75, 0, 0.25]], rtol=0, atol=1e-11)


def test_the_excess_alone_is_the_sheet_and_the_slope_below_stays() -> None:
    plan = plan_of((0, 0), (5 - WIDTH / 2, 5), (5, 505), (5 + WIDTH / 2, 5), (10, 0))
    np.testing.assert_allclose(plan.isovalues, [5], rtol=1e-15)
    np.testing.assert_allclose(plan.sheet_area, [500 * WIDTH / 2], rtol=2e-11)
    np.testing.assert_array_equal(plan.band_extinction, [[0, 5], [5, 0]])


def test_a_peak_on_a_step_leaves_the_step() -> None:
    plan = plan_of((5 - WIDTH / 2, 0), (5, 500), (5 + WIDTH / 2, 2), (8, 2), (8, 0))
    assert plan.reasons[0] is Reason.SHEET
    assert plan.skipped["values_merged"] == 0
    np.testing.assert_array_equal(plan.band_extinction, [[0, 0], [2, 2], [0, 0]])


def test_two_near_peaks_are_two_sheets_in_their_order() -> None:
    red, blue = tent(5, WIDTH, 300), tent(5 + 2 * WIDTH, WIDTH, 100)
    points = [*points_of(*red), *points_of(*blue, color=BLUE)]
    plan = plan_isovalues(TransferFunction(points), (0, 10), gradients=constant_gradient())
    np.testing.assert_allclose(plan.isovalues, [5, 5 + 2 * WIDTH], rtol=1e-15)
    np.testing.assert_allclose(plan.sheet_color, [RED, BLUE], atol=1e-11)
    np.testing.assert_allclose(plan.sheet_area, [150 * WIDTH, 50 * WIDTH], rtol=4e-11)


def test_two_peaks_that_share_an_end_are_two_sheets() -> None:
    plan = plan_of((5, 0), (5.0001, 300), (5.0002, 0), (5.0003, 100), (5.0004, 0))
    np.testing.assert_allclose(plan.isovalues, [5.0001, 5.0003], rtol=1e-15)
    np.testing.assert_array_equal(plan.band_extinction, np.zeros((3, 2)))


@pytest.mark.parametrize("side", [1, -1])
def test_a_function_that_begins_or_ends_with_a_step_keeps_it_beside_a_sheet(side: int) -> None:
    points = [(100, 1), (100, 2), (200, 0), *tent(500, WIDTH, 300)]
    if side < 0:
        points = [(600 - value, extinction) for value, extinction in reversed(points)]
    plan = plan_of(*points, value_range=(0, 600))
    whole = plan_of(*points, value_range=(0, 600), gradients=None)
    # of the step at 100 the side outside is never seen: the same bands as without the sheet
    assert plan.sheet_area.any()
    slope = {1: 0, -1: -1}[side]
    np.testing.assert_array_equal(
        plan.band_extinction[[slope, slope + side]], whole.band_extinction[[slope, slope + side]]
    )
    np.testing.assert_array_equal(plan.band_extinction[slope + side], [2, 0] if side > 0 else [0, 2])


def test_a_valley_above_the_line_makes_one_peak() -> None:
    plan = plan_of((5, 0), (5.0001, 300), (5.0002, 100), (5.0003, 300), (5.0004, 0))
    np.testing.assert_allclose(plan.isovalues, [5.0002], rtol=1e-15)
    # four pieces of width 1e-4 with the means 150, 200, 200, 150
    np.testing.assert_allclose(plan.sheet_area, [700e-4], rtol=4e-11)


def test_of_a_spike_on_a_wide_hump_the_spike_alone_is_a_sheet() -> None:
    plan = plan_of((3, 0), (5 - WIDTH / 2, 1), (5, 200), (5 + WIDTH / 2, 1), (7, 0))
    assert plan.reasons == (Reason.SLOPE_END, Reason.SHEET, Reason.SLOPE_END)
    np.testing.assert_allclose(plan.sheet_area, [0, 199 * WIDTH / 2, 0], rtol=2e-11)


@pytest.mark.parametrize(
    ("gradient", "is_sheet"), [(0.99 * 0.4 / SHEET_WIDTH, False), (1.01 * 0.4 / SHEET_WIDTH, True)]
)
def test_the_width_in_voxels_decides(gradient: float, is_sheet: bool) -> None:
    # 0.4 wide: below a hundredth of a voxel where the field rises by more than 40 per voxel
    plan = plan_of(*tent(50, 0.4, 3), value_range=(0, 100), gradients=constant_gradient(gradient))
    assert (plan.sheet_area > 0).any() == is_sheet
    assert len(plan.isovalues) == (1 if is_sheet else 3)


@pytest.mark.parametrize(
    ("points", "value_range"),
    [
        (((4, 0), (5, 3), (6, 0)), (0, 10)),  # wide
        (((1, 0), (5, 4), (5, 9), (9, 9)), (0, 10)),  # a step
        (((4, 0), (5, 100), (5 + WIDTH, 100), (5 + WIDTH, 0)), (0, 10)),  # narrow only on one side
        (((1, 0), (1 + WIDTH / 2, 90), (1 + WIDTH, 100), (9, 0)), (0, 10)),  # a bend in a narrow rise
        (tent(10, WIDTH, 300), (0, 10)),  # half beyond the maximum
        (tent(0, WIDTH, 300), (0, 10)),  # half below the minimum
        (tent(5, 3e-15, 300), (0, 10)),  # narrower than float64 resolves
    ],
)
def test_other_shapes_stay_as_they_are(
    points: Sequence[tuple[float, float]], value_range: tuple[float, float]
) -> None:
    plan = plan_of(*points, value_range=value_range)
    plain = plan_of(*points, value_range=value_range, gradients=None)
    assert plan.to_dict() == plain.to_dict()
    assert not plan.sheet_area.any()


def test_a_peak_that_ends_at_the_maximum_is_a_sheet_below_it() -> None:
    plan = plan_of(*tent(10 - WIDTH / 2, WIDTH, 300))
    np.testing.assert_allclose(plan.isovalues, [10 - WIDTH / 2], rtol=1e-15)


def test_where_no_gradient_is_known_a_peak_stays_as_it_is() -> None:
    unknown = plan_of(*tent(5, WIDTH, 300), gradients=constant_gradient(None))
    assert len(unknown.isovalues) == 3
    without = plan_of(*tent(5, WIDTH, 300), gradients=None)
    assert unknown.to_dict() == without.to_dict()


def test_gradients_are_not_asked_for_where_no_peak_can_be_narrow() -> None:
    def fail(values: Sequence[float]) -> Sequence[float | None]:
        raise AssertionError(values)

    # a gradient per voxel is at most √3 · range: peaks wider than 0.01 · √3 · 10 = 0.17 cannot be sheets
    plan_of(*tent(5, 0.18, 300), gradients=fail)
    with pytest.raises(AssertionError):
        plan_of(*tent(5, 0.17, 300), gradients=fail)


def test_a_sheet_and_an_isosurface_inside_it_share_a_value_and_keep_both_colours() -> None:
    surface = 5 + WIDTH / 8
    tf = TransferFunction(points_of(*tent(5, WIDTH, 300)), [Isosurface(surface, BLUE, 0.5)])
    plan = plan_isovalues(tf, (0, 10), gradients=constant_gradient())
    np.testing.assert_array_equal(plan.isovalues, [surface])
    assert plan.reasons == (Reason.IMPULSE,)
    np.testing.assert_allclose(plan.sheet_area, [150 * WIDTH], rtol=2e-11)
    np.testing.assert_allclose(plan.sheet_color, [RED], atol=1e-11)
    np.testing.assert_array_equal(plan.impulse_color, [BLUE])
    np.testing.assert_array_equal(plan.impulse_opacity, [0.5])


def test_of_two_isosurfaces_inside_a_peak_the_nearer_carries_the_sheet() -> None:
    near, far = 5 + WIDTH / 8, 5 - WIDTH / 4
    surfaces = [Isosurface(near, BLUE, 0.5), Isosurface(far, BLUE, 0.25)]
    tf = TransferFunction(points_of(*tent(5, WIDTH, 300)), surfaces)
    plan = plan_isovalues(tf, (0, 10), gradients=constant_gradient())
    np.testing.assert_array_equal(plan.isovalues, [far, near])
    np.testing.assert_array_equal(plan.impulse_opacity, [0.25, 0.5])
    assert plan.sheet_area[0] == 0 < plan.sheet_area[1]


def test_a_linear_volume_measures_the_width() -> None:
    z, y, x = np.mgrid[:6, :6, :6]
    volume = Volume((3.0 * x + 2.0 * y + 6.0 * z), spacing=(0.5, 2.0, 1.0))
    gradients = partial(gradient_at_values, volume)
    plan = plan_of(*tent(20.2, 0.05, 9), value_range=volume.value_range, gradients=gradients)
    np.testing.assert_allclose(plan.sheet_width, [0.05 / 7], rtol=1e-12)  # √(9 + 4 + 36) = 7 per voxel


def resolved_opacity(transfer_function: TransferFunction, slope: float, bend: float, reach: float) -> float:
    """Opacity of a peak around 5 along a ray with the field 5 + slope t + bend t² / 2, |t| <= reach."""
    values = np.array([point.value for point in transfer_function.points]) - 5
    # the places of the control points: 2 v / (slope + √(slope² + 2 bend v)) solves without cancellation
    places = 2 * values / (slope + np.sqrt(slope**2 + 2 * bend * values))
    assert np.abs(places).max() < reach
    nodes, weights = np.polynomial.legendre.leggauss(12)
    depth = 0.0
    for start, stop in itertools.pairwise(places.tolist()):
        t = 0.5 * (start + stop) + 0.5 * (stop - start) * nodes
        offset = slope * t + 0.5 * bend * t * t
        heights = [point.extinction for point in transfer_function.points]
        extinction = np.interp(offset, values, heights)
        depth += 0.5 * (stop - start) * float(weights @ extinction)
    return -math.expm1(-depth)


def sheet_opacity(plan: IsovaluePlan, slope: float, bend: float) -> float:
    """Opacity of the plan's only sheet where the same ray crosses it."""
    steep = np.sqrt(slope**2 + 2 * bend * (plan.isovalues[0] - 5))
    return float(-np.expm1(-plan.sheet_area[0] / steep))


def skewed(width: float) -> TransferFunction:
    """Peak of area 1 around 5, steeper on one side."""
    return TransferFunction(points_of((5 - width / 4, 0), (5, 2 / width), (5 + 3 * width / 4, 0)))


@pytest.mark.parametrize("slope", [0.3, 1.0, 4.0])
def test_on_a_linear_field_a_sheet_is_exactly_as_opaque_as_the_peak(slope: float) -> None:
    for width in (1e-2, 1e-3):
        plan = plan_isovalues(skewed(width), (0, 10), gradients=constant_gradient(10.0))
        # both are 1 − exp(−1 / slope); the rounding of 5 ± width is ulp(5) / 1e-3 = 9e-13 of the width
        expected = -np.expm1(-1 / slope)
        assert sheet_opacity(plan, slope, 0.0) == pytest.approx(expected, rel=4e-12)
        assert resolved_opacity(skewed(width), slope, 0.0, 1.0) == pytest.approx(expected, rel=4e-12)


def test_where_the_field_bends_the_error_falls_with_the_square_of_the_width() -> None:
    widths = np.array([0.08, 0.04, 0.02, 0.01])
    errors = []
    for width in widths:
        plan = plan_isovalues(skewed(width), (0, 10), gradients=constant_gradient(10.0))
        errors.append(abs(sheet_opacity(plan, 1.0, 2.0) - resolved_opacity(skewed(width), 1.0, 2.0, 1.0)))
    # optical depth ∫ τ dv / f'(v) with 1/f' expanded about the centre of mass: no term of first order remains
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    np.testing.assert_allclose(orders, 2, atol=0.1)
    assert errors[-1] < 1e-4  # (f'' / f'^2)^2 · variance · 3/2 = 4 · 1.5 · 5e-2 · width² = 3e-5


def test_a_sheet_at_the_summit_would_err_by_the_first_power_of_the_width() -> None:
    errors = []
    for width in (0.02, 0.01):
        plan = plan_isovalues(skewed(width), (0, 10), gradients=constant_gradient(10.0))
        shown = -np.expm1(-plan.sheet_area[0] / 1.0)  # slope at the summit, not at the centre of mass
        errors.append(abs(shown - resolved_opacity(skewed(width), 1.0, 2.0, 1.0)))
    assert np.log2(errors[0] / errors[1]) == pytest.approx(1, abs=0.1)


def test_what_the_rest_shows_differs_by_less_than_the_width() -> None:
    tf = TransferFunction(
        points_of((0, 0), (5 - WIDTH / 2, 5), (5, 505), (5 + WIDTH / 2, 3), (10, 1), (10, 0))
    )
    sheets, rest = split_sheets(tf, (-1, 11), constant_gradient())
    probes = np.concatenate([np.linspace(0, 5 - WIDTH, 50), np.linspace(5 + WIDTH, 9.99, 50)])
    # an end of a slope of width 5 and rise 5 moves by WIDTH / 2: at most that times the slope
    np.testing.assert_allclose(rest.evaluate(probes)[1], tf.evaluate(probes)[1], rtol=0, atol=WIDTH)
    assert len(sheets) == 1


def test_a_plan_with_sheets_survives_json_and_an_older_one_is_refused() -> None:
    plan = plan_of(*tent(5, WIDTH, 300))
    document = json.loads(json.dumps(plan.to_dict()))
    assert IsovaluePlan.from_dict(document).to_dict() == plan.to_dict()
    for name in ("sheet_area", "sheet_color", "sheet_width"):
        older = {key: value for key, value in document.items() if key != name}
        with pytest.raises(InputError, match=f"lacks or misuses '{name}'; make it anew"):
            IsovaluePlan.from_dict(older)


@pytest.mark.parametrize("area", [-1.0, float("nan"), float("inf")])
def test_an_impossible_area_is_refused(area: float) -> None:
    document = plan_of(*tent(5, WIDTH, 300)).to_dict()
    with pytest.raises(InputError, match="sheet_area"):
        IsovaluePlan.from_dict({**document, "sheet_area": [area]})


def test_rows_give_area_and_width() -> None:
    row = plan_of(*tent(5, WIDTH, 300)).describe()[0]
    assert row.reason == "sheet"
    assert row.sheet_area == pytest.approx(150 * WIDTH)
    assert row.sheet_width == pytest.approx(WIDTH)


@given(
    st.lists(
        st.tuples(st.integers(0, 60), st.one_of(st.just(0.0), st.floats(0, 50))), min_size=2, max_size=12
    ).map(lambda points: sorted(points, key=lambda point: point[0])),
    st.floats(0.01, 30),
    st.tuples(st.integers(-5, 65), st.integers(-5, 65)),
)
def test_sheets_and_rest_hold_what_the_whole_holds(
    entries: list[tuple[int, float]], gradient: float, ends: tuple[int, int]
) -> None:
    low, high = 0.1 * min(ends), 0.1 * max(ends)
    try:
        tf = TransferFunction(points_of(*[(0.01 * value, extinction) for value, extinction in entries]))
    except InputError:
        return  # a third point at one value
    sheets, rest = split_sheets(tf, (low, high), constant_gradient(gradient))
    limit = SHEET_WIDTH * gradient
    top = max(extinction for _, extinction in entries)
    assert all(low < sheet.value < high and sheet.width < SHEET_WIDTH for sheet in sheets)
    assert all(0 < sheet.area <= top * limit for sheet in sheets)
    whole, left = integral(tf), integral(rest)
    # Taking a run out removes its excess; moving its two ends by at most the width changes what is below the
    # line, and the two slopes beside it, by at most width · top each.
    assert abs(whole - left - sum(sheet.area for sheet in sheets)) <= 3 * len(sheets) * top * limit + 1e-12


def integral(transfer_function: TransferFunction) -> float:
    """Integral of the extinction over the value."""
    return sum(
        0.5 * (slope.high.value - slope.low.value) * (slope.low.extinction + slope.high.extinction)
        for slope in transfer_function.slopes()
    )

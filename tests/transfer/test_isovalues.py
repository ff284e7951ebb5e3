from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from isosample.errors import InputError
from isosample.transfer.isovalues import IsovaluePlan, Reason, plan_isovalues
from isosample.transfer.transfer_function import ControlPoint, Isosurface, TransferFunction

RED, BLUE = (1.0, 0.0, 0.0), (0.0, 0.0, 1.0)


def tf_of(*points: tuple[float, float], surfaces: tuple[float, ...] = ()) -> TransferFunction:
    """Red transfer function from (value, extinction), with blue isosurfaces of opacity 0.5."""
    return TransferFunction(
        [ControlPoint(value, RED, extinction) for value, extinction in points],
        [Isosurface(value, BLUE, 0.5) for value in surfaces],
    )


TENTS = ((0.0, 0.0), (2.0, 1.0), (4.0, 0.0), (6.0, 0.0), (8.0, 2.0), (9.0, 2.0), (10.0, 0.0))


def test_the_hand_computed_plan_of_two_tents() -> None:
    plan = plan_isovalues(tf_of(*TENTS), (0, 10), per_slope=1)
    np.testing.assert_array_equal(plan.isovalues, [1, 2, 3, 4, 6, 7, 8, 9, 9.5])
    assert [reason.name for reason in plan.reasons] == [
        *("BETWEEN", "PEAK", "BETWEEN", "SLOPE_END", "SLOPE_END"),
        *("BETWEEN", "PEAK", "PEAK", "BETWEEN"),
    ]
    edges = [0, 1, 2, 3, 4, 6, 7, 8, 9, 9.5, 10]
    np.testing.assert_array_equal(plan.band_values, np.stack([edges[:-1], edges[1:]], axis=1))
    at_edges = [0, 0.5, 1, 0.5, 0, 0, 1, 2, 2, 1, 0]
    np.testing.assert_array_equal(plan.band_extinction, np.stack([at_edges[:-1], at_edges[1:]], axis=1))
    np.testing.assert_array_equal(plan.band_color, np.broadcast_to(RED, (10, 2, 3)))
    np.testing.assert_array_equal(plan.band_visible, [True] * 4 + [False] + [True] * 5)
    assert plan.skipped["constant_slopes"] == 1


def test_constant_plateaus_get_no_values_inside() -> None:
    tf = tf_of((0, 0), (1, 2), (5, 2), (6, 0))
    plan = plan_isovalues(tf, (-1, 7), per_slope=3)
    assert not ((plan.isovalues > 1) & (plan.isovalues < 5)).any()
    assert len(plan.isovalues) == 4 + 2 * 3
    recolored = TransferFunction([ControlPoint(1, RED, 2), ControlPoint(5, BLUE, 2)])
    assert len(plan_isovalues(recolored, (0, 7), per_slope=3).isovalues) == 2 + 3


def test_for_light_constant_plateaus_are_divided_as_any_slope_as_far_as_they_are_visible() -> None:
    tf = tf_of((-4, 0), (-2, 0), (0, 0), (1, 2), (5, 2), (6, 0), (8, 3), (20, 3))
    unlit, lit = (plan_isovalues(tf, (-3, 12), per_slope=3, lit=light) for light in (False, True))
    assert unlit.skipped["constant_slopes"] == 2
    assert lit.skipped["constant_slopes"] == 0
    added = sorted(set(lit.isovalues.tolist()) - set(unlit.isovalues.tolist()))
    assert added == [2, 3, 4, 9, 10, 11]  # up to the range's end, and none where nothing is visible
    assert set(unlit.isovalues.tolist()) <= set(lit.isovalues.tolist())
    inside = (lit.band_values[:, 0] >= 1) & (lit.band_values[:, 1] <= 5)
    np.testing.assert_array_equal(lit.band_extinction[inside], np.full((4, 2), 2.0))


def test_a_plan_says_whether_light_would_need_more_isovalues() -> None:
    plateau, tent = tf_of((0, 0), (1, 2), (5, 2)), tf_of((0, 0), (1, 2), (5, 0))
    assert plan_isovalues(plateau, (0, 5)).lacks_light
    assert not plan_isovalues(plateau, (0, 5), lit=True).lacks_light
    assert not plan_isovalues(tent, (0, 5)).lacks_light
    lit = plan_isovalues(plateau, (0, 5), lit=True)
    assert IsovaluePlan.from_dict(json.loads(json.dumps(lit.to_dict()))).lit
    older = lit.to_dict()
    del older["lit"]  # as plans were kept before
    assert not IsovaluePlan.from_dict(older).lit


def test_values_between_are_spaced_over_the_part_of_the_slope_inside_the_range() -> None:
    plan = plan_isovalues(tf_of((0, 0), (8, 8), (9, 0)), (2, 6), per_slope=3)
    np.testing.assert_array_equal(plan.isovalues, [3, 4, 5])
    np.testing.assert_array_equal(plan.band_extinction[0], [2, 3])
    np.testing.assert_array_equal(plan.band_extinction[-1], [5, 6])
    assert plan.skipped["points_outside_range"] == 3


def test_ends_with_extinction_are_steps() -> None:
    plan = plan_isovalues(tf_of((2, 1), (4, 3)), (0, 10), per_slope=0)
    np.testing.assert_array_equal(plan.isovalues, [2, 4])
    assert plan.reasons == (Reason.STEP, Reason.PEAK)
    np.testing.assert_array_equal(plan.band_extinction, [[0, 0], [1, 3], [0, 0]])


def test_a_step_gives_one_value_with_two_limits() -> None:
    tf = tf_of((0, 0), (2, 1), (2, 3), (3, 4), (3, 0))
    plan = plan_isovalues(tf, (0, 5), per_slope=0)
    np.testing.assert_array_equal(plan.isovalues, [2, 3])
    np.testing.assert_array_equal(plan.band_extinction, [[0, 1], [3, 4], [0, 0]])
    assert plan.reasons == (Reason.STEP, Reason.PEAK)


def test_a_step_of_colour_alone_is_a_step_where_something_is_visible() -> None:
    points = [(0.0, RED, 1.0), (1.0, RED, 1.0), (1.0, BLUE, 1.0), (2.0, BLUE, 1.0)]
    plan = plan_isovalues(TransferFunction([ControlPoint(*point) for point in points]), (0, 2))
    assert plan.reasons == (Reason.STEP,)
    np.testing.assert_array_equal(plan.band_color[:, :, 2], [[0, 0], [1, 1]])
    dark = TransferFunction([ControlPoint(value, color, 0) for value, color, _ in points])
    assert len(plan_isovalues(dark, (0, 2)).isovalues) == 0


def test_points_between_invisible_slopes_are_skipped_and_counted() -> None:
    tf = tf_of((0, 0), (1, 0), (2, 0), (3, 1), (4, 0))
    plan = plan_isovalues(tf, (-1, 5), per_slope=0)
    np.testing.assert_array_equal(plan.isovalues, [2, 3, 4])
    assert plan.skipped["points_without_visible_slope"] == 2


@pytest.mark.parametrize("value_range", [(-5.0, -1.0), (11.0, 12.0), (4.5, 5.5)])
def test_a_range_with_nothing_visible_gives_an_empty_plan(value_range: tuple[float, float]) -> None:
    plan = plan_isovalues(tf_of(*TENTS), value_range)
    assert plan.isovalues.shape == (0,)
    np.testing.assert_array_equal(plan.band_values, [value_range])
    np.testing.assert_array_equal(plan.band_extinction, [[0, 0]])


def test_a_constant_volume_has_one_band_of_no_width() -> None:
    plan = plan_isovalues(tf_of(*TENTS, surfaces=(2.0,)), (2, 2))
    assert len(plan.isovalues) == 0
    np.testing.assert_array_equal(plan.band_values, [[2, 2]])
    np.testing.assert_array_equal(plan.band_extinction, [[1, 1]])
    assert plan.skipped["isosurfaces_outside_range"] == 1


def test_slope_values_at_the_ends_of_the_range_are_left_out_with_limits_from_inside() -> None:
    tf = tf_of((0, 1), (2, 1), (2, 5), (10, 3), (10, 9), (12, 9))
    plan = plan_isovalues(tf, (2, 10), per_slope=0)
    assert len(plan.isovalues) == 0
    np.testing.assert_array_equal(plan.band_extinction, [[5, 3]])


def test_isosurfaces_reach_the_maximum_but_not_the_minimum() -> None:
    plan = plan_isovalues(tf_of((0, 1), (4, 5), surfaces=(0.0, 1.0, 4.0, 5.0)), (0, 4), per_slope=0)
    np.testing.assert_array_equal(plan.isovalues, [1, 4])
    assert plan.reasons == (Reason.IMPULSE, Reason.IMPULSE)
    np.testing.assert_array_equal(plan.band_values, [[0, 1], [1, 4], [4, 4]])
    np.testing.assert_array_equal(plan.band_extinction, [[1, 2], [2, 5], [5, 5]])
    np.testing.assert_array_equal(plan.impulse_opacity, [0.5, 0.5])
    np.testing.assert_array_equal(plan.impulse_color, [BLUE, BLUE])
    assert plan.skipped["isosurfaces_outside_range"] == 2


def test_an_isosurface_on_a_peak_is_one_value() -> None:
    plan = plan_isovalues(tf_of((0, 0), (2, 1), (4, 0), surfaces=(2.0,)), (0, 4), per_slope=1)
    np.testing.assert_array_equal(plan.isovalues, [1, 2, 3])
    assert plan.reasons[1] is Reason.IMPULSE
    np.testing.assert_array_equal(plan.impulse_opacity, [0, 0.5, 0])
    assert plan.skipped["values_merged"] == 1


def test_near_duplicates_are_one_value_with_the_limits_outside_them() -> None:
    near = np.nextafter(2.0, 3.0)  # 1 ulp above: the slope from 2 to `near` becomes a step
    plan = plan_isovalues(tf_of((0, 1), (2, 1), (near, 7), (4, 7)), (0, 4), per_slope=0)
    assert len(plan.isovalues) == 1
    np.testing.assert_array_equal(plan.band_extinction, [[1, 1], [7, 7]])
    assert plan.skipped["values_merged"] == 1
    apart = 2.0 + 4 * np.spacing(2.0)
    assert len(plan_isovalues(tf_of((0, 1), (2, 1), (apart, 7), (4, 7)), (0, 4), per_slope=0).isovalues) == 2


def test_a_near_duplicate_of_the_maximum_does_not_empty_the_last_band() -> None:
    last = np.nextafter(255.0, 0.0)
    plan = plan_isovalues(tf_of((0, 0), (200, 3), (last, 3)), (0, 255), per_slope=0)
    np.testing.assert_array_equal(plan.isovalues, [200])
    np.testing.assert_array_equal(plan.band_extinction[-1], [3, 3])


def test_a_value_between_that_misses_zero_by_rounding_merges_with_the_isosurface_there() -> None:
    tf = tf_of((-0.3, 0), (0.1, 4), (0.2, 0), surfaces=(0.0,))
    values = plan_isovalues(tf, (-1, 1), per_slope=3).isovalues
    assert (values == 0).sum() == 1
    assert np.diff(values).min() > 1e-3


def test_two_close_isosurfaces_stay_two() -> None:
    # the value between at 0 has the tolerance of its slope, 4 ulp of 1 = 8.9e-16, and reaches both
    plan = plan_isovalues(tf_of((-1, 0), (1, 4), (2, 0), surfaces=(1e-17, 3e-16)), (-2, 3), per_slope=1)
    np.testing.assert_array_equal(plan.isovalues[plan.impulse_opacity > 0], [1e-17, 3e-16])
    assert 0.0 not in plan.isovalues


def test_extra_values_are_taken_where_something_is_visible() -> None:
    plan = plan_isovalues(tf_of(*TENTS), (0, 10), per_slope=0, extra=[0.5, 2.0, 5.0, 8.5, 20.0])
    np.testing.assert_array_equal(plan.isovalues, [0.5, 2, 4, 6, 8, 8.5, 9])
    assert plan.skipped["extra_values_not_visible"] == 2


def test_isosurfaces_alone_need_no_points() -> None:
    plan = plan_isovalues(tf_of(surfaces=(1.0, 2.0)), (0, 3))
    np.testing.assert_array_equal(plan.isovalues, [1, 2])
    np.testing.assert_array_equal(plan.band_extinction, np.zeros((3, 2)))


@pytest.mark.parametrize("bad", [(1.0, 0.0), (np.nan, 1.0), (0.0, np.inf)])
def test_a_range_that_is_none_is_refused(bad: tuple[float, float]) -> None:
    with pytest.raises(InputError, match="value range"):
        plan_isovalues(tf_of(*TENTS), bad)


def test_a_negative_count_is_refused() -> None:
    with pytest.raises(InputError, match="per_slope -1"):
        plan_isovalues(tf_of(*TENTS), (0, 1), per_slope=-1)


def test_a_plan_survives_json() -> None:
    for surfaces in [(), (1.5,)]:
        plan = plan_isovalues(tf_of(*TENTS, surfaces=surfaces), (0, 10))
        again = IsovaluePlan.from_dict(json.loads(json.dumps(plan.to_dict())))
        assert again.to_dict() == plan.to_dict()
        assert again.isovalues.dtype == np.float64
    empty = plan_isovalues(tf_of(*TENTS), (20, 30))
    assert IsovaluePlan.from_dict(empty.to_dict()).to_dict() == empty.to_dict()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"isovalues": [2.0, 1.0]}, "band_values has shape"),
        ({"reasons": []}, "reasons has 0 entries"),
        ({"skipped": None}, "lacks or misuses"),
    ],
)
def test_a_damaged_plan_is_refused(change: dict[str, Any], message: str) -> None:
    document = plan_isovalues(tf_of(*TENTS), (0, 10)).to_dict()
    with pytest.raises(InputError, match=message):
        IsovaluePlan.from_dict({**document, **change})


def test_rows_describe_the_plan() -> None:
    rows = plan_isovalues(tf_of((2, 1), (4, 3), surfaces=(3.0,)), (0, 10), per_slope=0).describe()
    assert [tuple(row) for row in rows] == [
        (0, 2.0, "step", 0.0, 1.0, 0.0, 0.0, 0.0),
        (1, 3.0, "isosurface", 2.0, 2.0, 0.5, 0.0, 0.0),
        (2, 4.0, "peak", 3.0, 0.0, 0.0, 0.0, 0.0),
    ]


CHANNEL = st.floats(0, 1)
POINTS = st.lists(
    st.tuples(
        st.floats(-100, 100).map(lambda v: round(v, 2)),
        st.tuples(CHANNEL, CHANNEL, CHANNEL),
        st.one_of(st.just(0.0), st.floats(0, 50)),
    ),
    min_size=2,
    max_size=8,
).map(lambda points: sorted(points, key=lambda point: point[0]))


@given(POINTS, st.lists(st.floats(-120, 120), max_size=3, unique=True), st.integers(0, 4), st.data())
def test_inside_every_band_the_transfer_function_is_linear(
    points: list[tuple[float, tuple[float, float, float], float]],
    surfaces: list[float],
    per_slope: int,
    data: st.DataObject,
) -> None:
    low = data.draw(st.floats(-110, 110))
    high = data.draw(st.floats(low, 120))
    try:
        tf = TransferFunction(
            [ControlPoint(*point) for point in points], [Isosurface(v, BLUE, 0.5) for v in surfaces]
        )
    except InputError:
        return  # a third point at one value
    plan = plan_isovalues(tf, (low, high), per_slope=per_slope)
    assert plan.band_values[0, 0] == low
    assert plan.band_values[-1, 1] == high
    where = np.array(data.draw(st.lists(st.floats(0.01, 0.99), min_size=1, max_size=4)))
    for band in range(len(plan.band_values)):
        start, stop = plan.band_values[band]
        probes = start + where * (stop - start)
        probes = probes[(probes > start) & (probes < stop)]
        if stop - start < 1e-9:
            continue  # the merging of near-duplicates moves limits by up to 4 ulp; see the bound below
        weight = (probes - start) / (stop - start)
        color, extinction = tf.evaluate(probes)
        ends = plan.band_extinction[band]
        mixed = (1 - weight) * ends[0] + weight * ends[1]
        # Values below 128 have ulp 1.4e-14 or less; moving an end by 4 of them over a band of width w moves
        # the interpolant by 4 · 1.4e-14 / w of its rise (<= 50), and rounding adds 8 · 2^-53 · 50.
        tolerance = 50 * (4 * 1.5e-14 / (stop - start) + 8 * 2.0**-53)
        np.testing.assert_allclose(mixed, extinction, rtol=0, atol=tolerance)
        visible = extinction > tolerance
        mixed_color = (1 - weight)[:, None] * plan.band_color[band, 0]
        mixed_color = mixed_color + weight[:, None] * plan.band_color[band, 1]
        np.testing.assert_allclose(mixed_color[visible], color[visible], rtol=0, atol=tolerance)

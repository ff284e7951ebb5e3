"""The float64 walk over crossing lists: closed forms, spans, cuts, sheets, and lists in the wrong order."""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
import pytest
from numpy.polynomial import Polynomial

from isosample.errors import InputError
from isosample.integral.compositing import over
from isosample.integral.crossing_lists import BORDER, CrossingLists
from isosample.integral.data_centric import integrate_lists
from isosample.integral.optics import segment_weights
from isosample.integral.quadrature import panel_nodes
from isosample.integral.segment_rule import SegmentRule
from isosample.transfer.control_points import ControlPoint, Isosurface
from isosample.transfer.isovalues import plan_isovalues
from isosample.transfer.transfer_function import TransferFunction

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from isosample.transfer.isovalue_plan import IsovaluePlan
    from isosample.volume.grid import F64

Row = tuple[float, int, bool, float, float]

RED, BLUE = (1.0, 0.25, 0.0), (0.0, 0.5, 1.0)


def ramp(
    *isosurfaces: Isosurface, blue: tuple[float, float, float] = BLUE, per_slope: int = 2
) -> IsovaluePlan:
    """Extinction 0 at 0.2 to 0.6 at 0.8, with isovalues 0.2, 0.4, 0.6, 0.8."""
    points = [ControlPoint(0.2, RED, 0.0), ControlPoint(0.8, blue, 0.6)]
    return plan_isovalues(TransferFunction(points, isosurfaces), (0.0, 1.0), per_slope=per_slope)


def enter(distance: float, value: float) -> Row:
    return (distance, BORDER, True, np.nan, value)


def leave(distance: float, value: float) -> Row:
    return (distance, BORDER, False, np.nan, value)


def up(distance: float, level: int, slope: float = np.nan) -> Row:
    return (distance, level, True, slope, 0.0)


def down(distance: float, level: int, slope: float = np.nan) -> Row:
    return (distance, level, False, slope, 0.0)


def lists_of(*rays: Sequence[Row], tolerance: float = 0.0) -> CrossingLists:
    rows = [row for ray in rays for row in ray]
    distance, level, rising, slope, value = (np.array([row[k] for row in rows]) for k in range(5))
    zero = np.zeros(len(rows))
    first = np.concatenate([[0], np.cumsum([len(ray) for ray in rays], dtype=np.int64)])
    return CrossingLists(first, distance, level, rising, slope, zero, value, zero + tolerance)


def light_along(plan: IsovaluePlan, value: Callable[[F64], F64], edges: Sequence[float]) -> F64:
    """RGBA of a field along a ray, by 20 Gauss nodes on 100 pieces between the edges: independent of every rule.

    `edges` are where the ray enters, crosses and leaves. The emission's cumulative depth at a node is integrated
    by the same nodes on the stretch before it.
    """
    tau0, tau1 = plan.band_extinction.T
    fine = np.unique(np.concatenate([np.linspace(a, b, 101) for a, b in pairwise(edges)]))

    def optics(t: F64) -> tuple[F64, F64]:
        v = value(t)
        band = np.searchsorted(plan.isovalues, v, side="right")
        low, high = plan.band_values[band].T
        part = (v - low) / (high - low)
        color = plan.band_color[band]
        shade = color[..., 0, :] * (1.0 - part)[..., None] + color[..., 1, :] * part[..., None]
        return tau0[band] * (1.0 - part) + tau1[band] * part, shade

    rgb, before = np.zeros(3), 0.0
    for a, b in pairwise(fine):
        t, w = panel_nodes([a, b], 20)
        tau, color = optics(t)
        inner, weights = panel_nodes(np.stack([np.full(20, a), t], axis=1), 20)
        depth = before + (weights * optics(inner.ravel())[0].reshape(20, 20)).sum(axis=1)
        rgb += (w * tau * np.exp(-depth)) @ color
        before += float(w @ tau)
    return np.array([*rgb, -np.expm1(-before)])


def cubic_rule_error(length: float, band: int, place: Polynomial, panels: int) -> float:
    """Bound of the error that the cubic rule makes in the colour of a segment in a band of the ramp.

    `place` is the position p(u) in the band, x(u) = `length` times the extinction, D its integral. A colour changes by
    1/3 at most over the band, and takes the integral of p x e^-D over u of that. Over a panel of the length h

    - three Gauss nodes err by (3!)^4 / (7 (6!)^3) h^7 times the 6th derivative, where (q e^-D)' = (q' - x q) e^-D;
      their weights are divided by their sum and multiplied by the opacity, which is exact: with m in [0, 1] the mean of
      p at the nodes, what is integrated that well is (p - m) x e^-D, of which m = 0 and m = 1 are the extremes;
    - D at a node is that of the parabola through x at the three nodes, off by the 3rd derivative times h^4 / 6
      times the integral of (v - v_1) (v - v_2) (v - v_3), which is -1/400 at the first and third and 1/320 at the
      second node. That e^-D differs by so much between nodes shifts the mean of p by no more, times an opacity <= D.
    """
    x = length * 0.2 * (band + place)
    nodes = 6.0**4 / (7.0 * 720.0**3) * max(sixth(place * x, x), sixth((place - 1.0) * x, x)) / panels**6
    uneven = np.expm1((1 / 400 + 1 / 320) / 6.0 * largest(x.deriv(3)) / panels**4)
    return float(nodes + uneven * x.integ()(1.0)) / 3.0


def hermite(front: float, back: float, slope_front: float, slope_back: float) -> Polynomial:
    """Return the cubic with these values and slopes at 0 and 1."""
    rise = back - front
    return Polynomial(
        [
            front,
            slope_front,
            3.0 * rise - 2.0 * slope_front - slope_back,
            slope_front + slope_back - 2.0 * rise,
        ]
    )


def sixth(q: Polynomial, x: Polynomial) -> float:
    """Bound of the 6th derivative of q e^-D on [0, 1], where x is that of D."""
    for _ in range(6):
        q = q.deriv() - x * q
    return largest(q)


def largest(q: Polynomial) -> float:
    """Largest size of a polynomial on [0, 1]: at an end, or where its derivative vanishes."""
    turns = q.deriv().trim().roots().real
    return float(np.abs(q(np.clip([0.0, 1.0, *turns], 0.0, 1.0))).max())


def test_a_linear_field_is_exact_by_the_linear_and_the_cubic_rule() -> None:
    plan, slope = ramp(), 0.1
    ray = [enter(1.0, 0.1), *(up(2.0 + 2.0 * k, k, slope) for k in range(4)), leave(9.0, 0.9)]
    weights = segment_weights(
        0.0, 0.6 * 6.0
    )  # extinction and colour are linear from 0.2 to 0.8, 6 units long
    expected = np.array([*(weights[0] * np.array(RED) + weights[1] * np.array(BLUE)), weights.sum()])
    linear = integrate_lists(lists_of(ray), plan, rule=SegmentRule.LINEAR, reach=0.0).rgba[0]
    np.testing.assert_allclose(linear, expected, rtol=0, atol=1e-14)
    cubic = integrate_lists(lists_of(ray), plan, rule=SegmentRule.CUBIC, reach=0.0).rgba[0]
    assert abs(cubic[3] - expected[3]) < 1e-14  # extinction is linear: the depth is exact
    # Each segment is one panel of depth x <= 1 at most; p τ e^-D has a 6th derivative of 30 x^5 at most there, and the
    # error of three nodes is (3!)^4 / (7 (6!)^3) = 5e-7 times that, per segment; as much again by the scaling.
    assert np.abs(cubic - expected).max() < 3 * 2 * 5e-7 * 30
    blunt = [(*row[:3], np.nan, *row[4:]) for row in ray]
    without = integrate_lists(lists_of(blunt), plan, rule=SegmentRule.CUBIC, reach=0.0).rgba[0]
    np.testing.assert_allclose(without, cubic, rtol=0, atol=1e-14)  # the chords have the same slope
    steep = [(*row[:3], 1.3 * row[3], *row[4:]) for row in ray]
    wrong = integrate_lists(lists_of(steep), plan, rule=SegmentRule.CUBIC, reach=0.0).rgba[0]
    assert np.abs(wrong - expected).max() > 1e-3


@pytest.mark.parametrize("height", [0.15, 0.35, 0.55])
def test_a_parabola_is_exact_by_the_cubic_rule(height: float) -> None:
    """f = 0.2 + height (1 − s²), s = (t − 5) / 3: it crosses 0.2 at 2 and 8, and turns inside a band."""
    for color in (RED, BLUE):
        plan = ramp(blue=color)
        levels = [k for k, v in enumerate(plan.isovalues) if v < 0.2 + height]
        offsets = [3.0 * np.sqrt(1.0 - (plan.isovalues[k] - 0.2) / height) for k in levels]
        slopes = [2.0 * height * offset / 9.0 for offset in offsets]
        rows = list(zip(levels, offsets, slopes, strict=True))
        rises = [up(5.0 - offset, k, slope) for k, offset, slope in rows]
        falls = [down(5.0 + offset, k, slope) for k, offset, slope in reversed(rows)]
        lists = lists_of([enter(1.0, 0.0), *rises, *falls, leave(9.0, 0.0)])
        edges = [row[0] for row in (*rises, *falls)]
        parabola = 0.2 + height * (1.0 - Polynomial([-5.0 / 3.0, 1.0 / 3.0]) ** 2)
        truth = light_along(plan, parabola, edges)
        cubic, linear = (
            integrate_lists(lists, plan, rule=rule, reach=0.0).rgba[0]
            for rule in (SegmentRule.CUBIC, SegmentRule.LINEAR)
        )
        bands = [*levels, *levels[-2::-1]]
        bound = sum(
            cubic_rule_error(
                end - start,
                band,
                (parabola(Polynomial([start, end - start])) - 0.2) / 0.2 - band,
                panels=2 if band == levels[-1] else 1,
            )
            for band, (start, end) in zip(bands, pairwise(edges), strict=True)
        )
        assert abs(cubic[3] - truth[3]) < 1e-13
        assert np.abs(cubic - truth).max() < (1e-13 if color == RED else bound) < 1e-3
        assert np.abs(linear - truth).max() > 0.04


def test_the_constant_rules_hold_the_front_value() -> None:
    plan = ramp()
    lists = lists_of([enter(0.0, 0.5), up(1.0, 2), leave(7.0, 0.7)])
    first, second = 0.3, 0.4  # extinction at the entry and at 0.6
    colors = [np.array(RED) * (1 - p) + np.array(BLUE) * p for p in (0.5, 2 / 3)]
    for rule, opacities in (
        (SegmentRule.CONSTANT, (-np.expm1(-first), -np.expm1(-6 * second))),
        (SegmentRule.CONSTANT_FIRST_ORDER, (first, 1.0)),  # 6 · 0.4 is above 1: opaque
    ):
        front, back = ([*(a * c), a] for a, c in zip(opacities, colors, strict=True))
        found = integrate_lists(lists, plan, rule=rule, reach=0.0).rgba[0]
        np.testing.assert_allclose(found, over(front, back), rtol=0, atol=1e-14)


HILL = [
    enter(0.0, 0.1),
    up(1.0, 0, 0.4),
    up(1.5, 1, 0.3),
    down(3.0, 1, 0.2),
    down(4.0, 0, 0.5),
    leave(5.0, 0.1),
]
# of its segments in band 0, 1 (a bump) and 0: slopes in bands of 0.2 per segment
HILL_ERROR = sum(
    cubic_rule_error(length, band, hermite(*ends, *(slope * length / 0.2 for slope in slopes)), panels)
    for length, band, ends, slopes, panels in (
        (0.5, 0, (0.0, 1.0), (0.4, 0.3), 1),
        (1.5, 1, (0.0, 0.0), (0.3, -0.2), 2),
        (1.0, 0, (1.0, 0.0), (-0.2, -0.5), 1),
    )
)
TAIL = [enter(6.0, 0.5), up(7.0, 2, 0.2), up(8.0, 3, 0.3), leave(9.0, 0.9)]


@pytest.mark.parametrize("rule", SegmentRule)
def test_a_ray_of_two_spans_is_one_over_the_other(rule: SegmentRule) -> None:
    lists = lists_of([*HILL, *TAIL], HILL, TAIL)
    both, near, far = integrate_lists(lists, ramp(Isosurface(0.4, BLUE, 0.3)), rule=rule, reach=0.0).rgba
    np.testing.assert_allclose(both, over(near, far), rtol=0, atol=1e-14)
    assert far[3] > 0.1


def test_what_lies_outside_the_border_points_is_not_integrated() -> None:
    lists = lists_of([up(-2.0, 0), down(-1.0, 0), *HILL, up(5.5, 1), *TAIL, down(9.5, 3)], [*HILL, *TAIL])
    found = integrate_lists(lists, ramp(), reach=0.0)
    np.testing.assert_array_equal(found.rgba[0], found.rgba[1])
    assert not found.violations.any()


def test_a_list_without_an_end_stops_at_its_last_crossing() -> None:
    lists = lists_of(HILL[:4], HILL)
    found = integrate_lists(lists, ramp(), reach=0.0, visible=[[0.0, 9.0], [0.0, 3.0]])
    np.testing.assert_allclose(found.rgba[0], found.rgba[1], rtol=0, atol=1e-15)
    assert not found.violations.any()


@pytest.mark.parametrize("rule", [SegmentRule.LINEAR, SegmentRule.CUBIC])
@pytest.mark.parametrize("cut", [0.5, 1.0, 1.2, 2.7, 3.9])
def test_two_parts_of_a_ray_make_the_whole(rule: SegmentRule, cut: float) -> None:
    lists = lists_of(HILL, HILL, HILL)
    near, far, whole = integrate_lists(
        lists, ramp(), rule=rule, reach=0.0, visible=[[0.0, cut], [cut, 9.0], [0.0, 9.0]]
    ).rgba
    # A part of a linear course is linear. The cubic rule errs in the whole, and no more than that in both parts
    # together, whose panels are shorter.
    tolerance = 1e-14 if rule is SegmentRule.LINEAR else 2.0 * HILL_ERROR
    np.testing.assert_allclose(over(near, far), whole, rtol=0, atol=tolerance)
    assert abs(over(near, far)[3] - whole[3]) < 1e-14


def test_by_default_what_lies_behind_the_origin_is_cut_away() -> None:
    moved = [(row[0] - 2.0, *row[1:]) for row in HILL]
    behind = integrate_lists(lists_of(moved), ramp(), reach=0.0).rgba
    cut = integrate_lists(lists_of(HILL), ramp(), reach=0.0, visible=[[2.0, np.inf]]).rgba
    np.testing.assert_allclose(behind, cut, rtol=0, atol=1e-15)


def sheet_plan(area: float) -> IsovaluePlan:
    """A sheet and an isosurface at 0.4, nothing else."""
    plan = plan_isovalues(TransferFunction([], [Isosurface(0.4, BLUE, 0.3)]), (0.0, 1.0))
    plan.sheet_area[0], plan.sheet_color[0] = area, RED
    return plan


def test_a_sheet_is_as_opaque_as_the_ray_is_long_in_it_and_lies_before_the_impulse() -> None:
    area, slope = 0.06, 0.25
    lists = lists_of(
        [enter(0.0, 0.3), up(1.0, 0, slope), leave(2.0, 0.5)], [enter(0.0, 0.3), up(1.0, 0), leave(2.0, 0.5)]
    )
    found = integrate_lists(lists, sheet_plan(area), reach=0.0).rgba
    for rgba, steepness in zip(
        found, (slope, 0.1), strict=True
    ):  # where unknown, (0.4 − 0.3) / 1 of the chord
        opacity = -np.expm1(-area / steepness)
        expected = over([*(opacity * np.array(RED)), opacity], [*(0.3 * np.array(BLUE)), 0.3])
        np.testing.assert_allclose(rgba, expected, rtol=0, atol=1e-14)


def test_a_ray_that_stays_on_a_sheet_is_stopped_but_for_the_least_slope() -> None:
    lists = lists_of([enter(0.0, 0.3), up(1.0, 0, 0.0), leave(2.0, 0.5)])
    assert integrate_lists(lists, sheet_plan(0.06), reach=0.0).rgba[0, 3] == 1.0
    found = integrate_lists(lists, sheet_plan(0.06), reach=0.0, least_slope=0.1).rgba[0, 3]
    assert abs(found - (1.0 - 0.7 * np.exp(-0.6))) < 1e-14


def test_sheets_and_impulses_that_are_cut_away_are_not_seen() -> None:
    lists = lists_of([enter(0.0, 0.3), up(1.0, 0, 0.2), leave(2.0, 0.5)])
    for visible, seen in (([0.0, 0.99], False), ([1.01, 2.0], False), ([0.5, 1.0], True), ([1.0, 2.0], True)):
        opacity = integrate_lists(lists, sheet_plan(0.06), reach=0.0, visible=[visible]).rgba[0, 3]
        assert bool(opacity > 0.0) is seen


def test_meshes_that_cut_each_other_are_told_from_lost_crossings_by_the_reach() -> None:
    swapped = [enter(0.0, 0.1), up(1.0, 1), up(1.2, 0), up(3.0, 2), leave(4.0, 0.7)]
    near = integrate_lists(lists_of(swapped), ramp(), reach=0.3)
    assert near.violations[0] == 0
    assert near.reordered[0] >= 2
    far = integrate_lists(lists_of(swapped), ramp(), reach=0.1)
    assert (far.violations[0] > 0, far.reordered[0]) == (True, 0)


def test_lost_crossings_that_cancel_are_found() -> None:
    """Up through 1 and down through 2 are lost. The sums agree, but what is between stands alone or in a long row."""
    lone = [enter(0.0, 0.1), up(1.0, 0), up(2.0, 2), down(3.0, 1), down(4.0, 0), leave(5.0, 0.1)]
    row = [*lone[:3], up(2.2, 3), down(2.4, 3), *lone[3:]]
    for reach, found_out in ((0.0, [True, True]), (0.3, [True, True]), (1.0, [True, False])):
        found = integrate_lists(lists_of(lone, row), ramp(), reach=reach)
        assert (found.violations > 0).tolist() == found_out
    assert found.reordered[1] >= 3  # no longer than where meshes cut each other in a cell


def test_crossings_in_the_wrong_order_lead_to_the_same_band() -> None:
    sorted_, swapped = (
        [enter(0.0, 0.1), up(1.0, k), up(1.001, 1 - k), up(3.0, 2), leave(4.0, 0.7)] for k in (0, 1)
    )
    found = integrate_lists(lists_of(sorted_, swapped), ramp(), reach=0.3)
    # Over 0.001 extinction is off by 0.6 at most.
    np.testing.assert_allclose(found.rgba[1], found.rgba[0], rtol=0, atol=6e-4)


def test_ties_stand_in_the_order_given() -> None:
    tied = [enter(0.0, 0.1), up(1.0, 0, 0.5), up(1.0, 1, 0.5), leave(3.0, 0.5)]
    apart = [enter(0.0, 0.1), up(1.0, 0, 0.5), up(1.0 + 1e-12, 1, 0.5), leave(3.0, 0.5)]
    found = integrate_lists(lists_of(tied, apart), ramp(), reach=0.0)
    assert found.violations.sum() == found.reordered.sum() == 0
    np.testing.assert_allclose(found.rgba[0], found.rgba[1], rtol=0, atol=1e-11)


def test_crossings_of_a_grazed_surface_in_the_wrong_order_are_passed_over() -> None:
    grazed = [enter(0.0, 0.3), down(1.0, 1), up(1.1, 1), leave(3.0, 0.3)]
    found = integrate_lists(lists_of(grazed, [enter(0.0, 0.3), leave(3.0, 0.3)]), ramp(), reach=0.3)
    assert (found.violations[0], found.reordered[0]) == (0, 2)
    np.testing.assert_allclose(found.rgba[0], found.rgba[1], rtol=0, atol=1e-14)


def test_surfaces_decide_where_a_border_value_is_off_by_its_tolerance() -> None:
    rays = [enter(0.0, 0.41), up(1.0, 1), leave(2.0, 0.5)], [enter(0.0, 0.39), up(1.0, 1), leave(2.0, 0.5)]
    lenient = integrate_lists(lists_of(*rays, tolerance=0.02), ramp(), reach=0.0)
    assert not lenient.violations.any()
    assert np.abs(lenient.rgba[0] - lenient.rgba[1]).max() < 0.02
    strict = integrate_lists(lists_of(*rays), ramp(), reach=0.0)
    assert strict.violations.tolist() == [1, 0]


@pytest.mark.parametrize("lost", [2, 3])
def test_a_level_lost_on_a_straight_course_is_put_back_where_it_was(lost: int) -> None:
    plan = ramp(Isosurface(0.4, BLUE, 0.3))
    ray = [enter(1.0, 0.1), *(up(2.0 + 2.0 * k, k, 0.1) for k in range(4)), leave(9.0, 0.9)]
    found = integrate_lists(lists_of(ray, ray[:lost] + ray[lost + 1 :]), plan, reach=0.0)
    np.testing.assert_allclose(found.rgba[1], found.rgba[0], rtol=0, atol=1e-12)
    assert found.violations.tolist() == [0, 1]
    assert not found.unplaced.any()


def test_the_border_of_the_visible_is_put_back_by_the_slope_beside_it() -> None:
    ray = [enter(1.0, 0.0), *(up(2.0 + 2.0 * k, k, 0.1) for k in range(3)), leave(7.0, 0.7)]
    back = [(8.0 - t, level, not rising, slope, value) for t, level, rising, slope, value in reversed(ray)]
    found = integrate_lists(
        lists_of(ray, [ray[0], *ray[2:]], back, [*back[:-2], back[-1]]), ramp(), reach=0.0
    )
    np.testing.assert_allclose(found.rgba[1::2], found.rgba[::2], rtol=0, atol=1e-12)
    assert not found.unplaced.any()
    flat = [
        (*row[:3], np.nan, row[4]) for row in ray
    ]  # without slopes the chord from 0 at 1 meets 0.2 elsewhere
    blind = integrate_lists(lists_of([flat[0], *flat[2:]]), ramp(), reach=0.0).rgba[0]
    assert np.abs(blind - found.rgba[0]).max() > 1e-3


def test_a_crossing_lost_between_two_of_its_own_level_is_counted_as_unplaced() -> None:
    ray = [enter(0.0, 0.3), up(1.0, 1, 0.2), down(2.0, 1, 0.1), up(3.0, 1, 0.2), leave(4.0, 0.5)]
    found = integrate_lists(lists_of(ray, [*ray[:2], *ray[3:]]), ramp(), reach=0.0)
    assert found.unplaced.tolist() == [0, 1]
    np.testing.assert_allclose(
        found.rgba[1], found.rgba[0], rtol=0, atol=0.02
    )  # equal slopes: put in the middle


def test_lists_of_many_blocks_are_those_of_single_rays() -> None:
    single = integrate_lists(lists_of(HILL, [], TAIL), ramp(), reach=0.0)
    done: list[tuple[int, int]] = []
    many = integrate_lists(
        lists_of(*([HILL, [], TAIL] * 500)), ramp(), reach=0.0, progress=lambda k, n: done.append((k, n))
    )
    np.testing.assert_array_equal(many.rgba, np.tile(single.rgba, (500, 1)))
    assert done[-1] == (1500, 1500)
    assert (single.rgba[1] == 0.0).all()
    assert integrate_lists(lists_of(), ramp(), reach=0.0).rgba.shape == (0, 4)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"reach": -1.0}, "reach -1.0"),
        ({"reach": np.nan}, "reach nan"),
        ({"least_slope": np.inf}, "least_slope inf"),
        ({"visible": [[0.0, 1.0, 2.0]]}, "visible has shape"),
        ({"visible": [[0.0, np.nan]]}, "visible has shape"),
    ],
)
def test_numbers_out_of_range_are_refused(change: dict[str, object], message: str) -> None:
    arguments: dict[str, object] = {"reach": 0.0} | change
    with pytest.raises(InputError, match=message):
        integrate_lists(lists_of(HILL), ramp(), **arguments)  # type: ignore[arg-type]

"""The guaranteed interval holds the truth; indicator and mesh estimate say what they promise."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from isosample.compare.exact_crossings import exact_crossing_lists
from isosample.compare.study_scenes import TwoTents
from isosample.integral.crossing_lists import CrossingLists
from isosample.integral.data_centric import integrate_lists
from isosample.integral.field_reference import integrate_field_rays
from isosample.integral.list_errors import judge_lists
from isosample.integral.segment_rule import SegmentRule
from isosample.transfer.control_points import ControlPoint, Isosurface
from isosample.transfer.isovalues import plan_isovalues
from isosample.transfer.transfer_function import TransferFunction
from isosample.volume.analytic import GaussianShell, MarschnerLobb, nucleon_like
from isosample.volume.geometry import Box

if TYPE_CHECKING:
    from isosample.transfer.isovalue_plan import IsovaluePlan
    from isosample.volume.field import Field
    from isosample.volume.grid import F64

# The interval is an inequality of real numbers; both sides are sums of some hundred terms of at most 1, each rounded a
# few times, and the truth is within 1e-10 by its own promise.
ROUNDING = 2e-10

Scene = tuple["Field", TransferFunction, "IsovaluePlan", Box]


def scene(name: str) -> Scene:
    """A field, and a transfer function with slopes, a step, a plateau and an isosurface."""
    fields: dict[str, tuple[Field, float, tuple[float, float]]] = {
        "nucleon-like": (nucleon_like(), 40.0, (0.0, 1.05)),
        "shell": (GaussianShell(centre=(20.0, 18.0, 21.0), radius=12.0, width=4.0), 40.0, (0.0, 1.0)),
        "waves": (MarschnerLobb(frequency=3.0), 1.2, (0.0, 1.0)),
    }
    field, edge, value_range = fields[name]
    corner = np.zeros(3) if edge > 2.0 else np.full(3, -0.5 * edge)
    blue, gold = (0.1, 0.3, 1.0), (1.0, 0.7, 0.1)
    rows = [
        (0.15, blue, 0.0),
        (0.3, gold, 6.0),
        (0.4, gold, 6.0),
        (0.4, blue, 1.0),
        (0.65, gold, 16.0),
        (0.8, blue, 0.0),
    ]
    tf = TransferFunction(
        [ControlPoint(v, color, extinction / edge) for v, color, extinction in rows],
        [Isosurface(0.55, (0.2, 1.0, 0.4), 0.3)],
    )
    return field, tf, plan_isovalues(tf, value_range, per_slope=3), Box(corner=corner, edges=edge * np.eye(3))


def oblique_rays(box: Box, edge: int) -> tuple[F64, F64]:
    """Parallel rays, edge² of them, from outside the box through all of it."""
    direction = np.array([0.31, -0.23, 0.92]) / np.linalg.norm([0.31, -0.23, 0.92])
    right = np.cross(direction, [0.0, 1.0, 0.0])
    right /= np.linalg.norm(right)
    places = 0.7 * np.linalg.norm(box.edges[0]) * (np.arange(edge) - 0.5 * (edge - 1)) * 2.0 / edge
    a, b = np.meshgrid(places, places)
    away = box.centre - 4.0 * np.linalg.norm(box.edges[0]) * direction
    origins = away + a.reshape(-1, 1) * right + b.reshape(-1, 1) * np.cross(right, direction)
    return origins, np.broadcast_to(direction, origins.shape).copy()


def exact(name: str, edge: int = 16) -> tuple[CrossingLists, IsovaluePlan, F64]:
    """Exact lists of a scene, its plan, and the truth."""
    field, tf, plan, box = scene(name)
    rays = oblique_rays(box, edge)
    lists = exact_crossing_lists(field, plan.isovalues, box, *rays)
    return lists, plan, integrate_field_rays(field, tf, box, *rays)


@pytest.mark.parametrize("name", ["nucleon-like", "shell", "waves"])
def test_the_interval_holds_the_truth_and_both_rules_at_every_ray(name: str) -> None:
    lists, plan, truth = exact(name)
    low, high = judge_lists(lists, plan, reach=0.0).interval.swapaxes(0, 1)
    linear, cubic = (
        integrate_lists(lists, plan, rule=rule, reach=0.0).rgba
        for rule in (SegmentRule.LINEAR, SegmentRule.CUBIC)
    )
    for rgba in (truth, linear, cubic):
        assert (rgba >= low - ROUNDING).all()
        assert (rgba <= high + ROUNDING).all()
    assert truth[:, 3].max() > 0.5
    assert (high - low).mean() < 0.2  # it says something
    # It would not hold with longer segments, nor with the mean extinction of each band instead of its ends.
    mean = np.repeat(plan.band_extinction.mean(axis=1, keepdims=True), 2, axis=1)
    for wrong, wrong_plan in (
        (lists._replace(distance=1.5 * lists.distance), plan),
        (lists, replace(plan, band_extinction=mean)),
    ):
        bounds = judge_lists(wrong, wrong_plan, reach=0.0).interval
        assert ((truth < bounds[:, 0] - ROUNDING) | (truth > bounds[:, 1] + ROUNDING)).any()


def test_the_interval_of_a_ray_with_lost_crossings_holds_for_every_ray() -> None:
    lists, plan, truth = exact("shell")
    rng = np.random.default_rng(2)
    damaged = lists.keep((lists.level < 0) | (rng.random(len(lists.level)) > 0.05))
    found, errors = integrate_lists(damaged, plan, reach=0.0), judge_lists(damaged, plan, reach=0.0)
    repaired = found.violations + found.reordered + found.unplaced > 0
    assert repaired.sum() > 20
    np.testing.assert_array_equal(errors.interval[repaired, 0], 0.0)
    np.testing.assert_array_equal(errors.interval[repaired, 1], np.broadcast_to(1.0, (repaired.sum(), 4)))
    untouched = ~repaired & (np.diff(damaged.first) == np.diff(lists.first))
    assert (truth[untouched] <= errors.interval[untouched, 1] + ROUNDING).all()


def test_a_sheet_of_unknown_slope_may_have_any_opacity() -> None:
    lists, plan, _ = exact("shell")
    plan.sheet_area[3], plan.sheet_color[3] = 0.05, (1.0, 1.0, 1.0)
    known = judge_lists(lists, plan, reach=0.0).interval
    crossed = np.isin(np.arange(len(lists.first) - 1), lists.ray[lists.level == 3])
    unknown = judge_lists(lists._replace(slope=np.full(len(lists.level), np.nan)), plan, reach=0.0).interval
    assert (unknown[crossed, 1, 3] == 1.0).all()
    assert (known[crossed, 1, 3] < 1.0).any()
    assert (unknown[:, 0] <= known[:, 0] + 1e-15).all()
    np.testing.assert_array_equal(unknown[~crossed], known[~crossed])
    assert (known[:, 0] <= integrate_lists(lists, plan, reach=0.0).rgba + ROUNDING).all()


def test_the_interval_is_cut_with_the_ray() -> None:
    lists, plan, _ = exact("nucleon-like")
    visible = np.tile([150.0, 165.0], (len(lists.first) - 1, 1))
    low, high = judge_lists(lists, plan, reach=0.0, visible=visible).interval.swapaxes(0, 1)
    rgba = integrate_lists(lists, plan, reach=0.0, visible=visible).rgba
    assert (rgba >= low - ROUNDING).all()
    assert (rgba <= high + ROUNDING).all()
    assert rgba[:, 3].max() > 0.1
    whole = judge_lists(lists, plan, reach=0.0).interval
    assert (high - low).mean() < (whole[:, 1] - whole[:, 0]).mean()


def test_the_indicator_is_the_difference_of_the_rules_and_mostly_exceeds_the_error() -> None:
    lists, plan, truth = exact("nucleon-like", 24)
    linear, cubic = (
        integrate_lists(lists, plan, rule=rule, reach=0.0).rgba
        for rule in (SegmentRule.LINEAR, SegmentRule.CUBIC)
    )
    indicator = judge_lists(lists, plan, reach=0.0).indicator
    np.testing.assert_allclose(indicator, np.abs(cubic - linear).max(axis=1), rtol=0, atol=1e-15)
    error = np.abs(cubic - truth).max(axis=1)
    hit = error > 1e-9
    assert (indicator[hit] >= error[hit]).mean() > 0.95  # an indicator, no bound
    order = np.argsort(np.argsort(indicator[hit])), np.argsort(np.argsort(error[hit]))
    assert np.corrcoef(*order)[0, 1] > 0.7  # Spearman's rank correlation


def test_the_sums_by_band_point_at_the_bands_that_are_wrong() -> None:
    """A ray that turns in one band alone: every other segment is straight, so both rules agree there."""
    plan = plan_isovalues(
        TransferFunction([ControlPoint(0.2, (1.0, 0.0, 0.0), 0.0), ControlPoint(0.8, (0.0, 0.0, 1.0), 0.6)]),
        (0.0, 1.0),
        per_slope=2,
    )
    nan = np.nan
    lists = CrossingLists(
        first=np.array([0, 6]),
        distance=np.array([0.0, 2.0, 4.0, 7.0, 9.0, 11.0]),
        level=np.array([-1, 0, 1, 1, 0, -1]),
        rising=np.array([True, True, True, False, False, False]),
        slope=np.array([nan, 0.1, 0.1, 0.1, 0.1, nan]),
        residual=np.zeros(6),
        value=np.zeros(6),
        tolerance=np.zeros(6),
    )
    errors = judge_lists(lists, plan, reach=0.0)
    through = np.exp(-0.5 * 2.0 * 0.2)  # extinction rises from 0 to 0.2 over 2 units in front
    turning = np.sqrt(errors.by_band[2]) / through
    assert errors.by_band[2] == errors.by_band.max() > 1e-3
    assert (np.sqrt(np.delete(errors.by_band, 2)) < 1e-5).all()
    # Behind the turn there is little, and what is in front is the same for both: the indicator is nearly that alone.
    assert turning * through == pytest.approx(errors.indicator[0], rel=0.2)
    columns = [np.tile(column, 2) for column in lists[1:]]
    doubled: list[Any] = [np.array([0, 6, 12]), *columns]
    twice = judge_lists(CrossingLists._make(doubled), plan, reach=0.0)
    np.testing.assert_allclose(twice.by_band, 2.0 * errors.by_band, rtol=1e-14)


def test_the_mesh_estimate_foretells_the_change_by_displaced_crossings() -> None:
    lists, plan, _ = exact("nucleon-like", 24)
    rng = np.random.default_rng(4)
    crossing = lists.level >= 0
    gaps = np.minimum(np.diff(lists.distance, prepend=-np.inf), np.diff(lists.distance, append=np.inf))
    shift = np.where(crossing, 1e-3 * gaps * rng.choice([-1.0, 1.0], len(gaps)), 0.0)
    moved = lists._replace(distance=lists.distance + shift)
    residual = np.where(crossing, np.abs(shift) * np.nan_to_num(lists.slope), 0.0)
    judged = judge_lists(lists._replace(residual=residual), plan, reach=0.0)
    assert not judge_lists(lists, plan, reach=0.0).mesh.any()
    change = np.abs(
        integrate_lists(moved, plan, reach=0.0).rgba - integrate_lists(lists, plan, reach=0.0).rgba
    ).max(axis=1)
    hit = judged.mesh > 0.0
    assert hit.sum() > 100
    # Signs are random, so displacements cancel; what is behind moves too, which the estimate leaves out.
    assert (change[hit] <= 2.0 * judged.mesh[hit]).mean() > 0.99
    assert np.median(judged.mesh[hit] / np.maximum(change[hit], 1e-300)) < 20.0


def test_the_displacement_is_limited_by_the_longer_segment() -> None:
    lists, plan, _ = exact("shell")
    large, larger = (
        judge_lists(lists._replace(residual=np.full(len(lists.level), residual)), plan, reach=0.0).mesh
        for residual in (1e6, 1e9)
    )
    np.testing.assert_array_equal(large, larger)
    assert 0.0 < large.max() < 100.0


def test_two_tents_are_judged_alike_in_one_block_and_in_many() -> None:
    tents = TwoTents()
    plan = tents.plan(3)
    rays = tents.rays(30)  # 900 rays are two blocks
    lists = exact_crossing_lists(nucleon_like(), plan.isovalues, tents.box, *rays)
    errors = judge_lists(lists, plan, reach=0.0)
    some = slice(lists.first[600], lists.first[800])
    part: list[Any] = [lists.first[600:801] - lists.first[600], *(column[some] for column in lists[1:])]
    alone = judge_lists(CrossingLists._make(part), plan, reach=0.0)
    for whole, single in zip(errors[:3], alone[:3], strict=True):
        np.testing.assert_array_equal(whole[600:800], single)

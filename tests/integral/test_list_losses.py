"""Lost crossings and inexact slopes and distances: what is found, what is repaired, and how much is left."""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import pytest

from isosample.compare.exact_crossings import exact_crossing_lists
from isosample.compare.study_scenes import TwoTents
from isosample.integral.crossing_lists import CrossingLists
from isosample.integral.data_centric import integrate_lists
from isosample.integral.field_reference import integrate_field_rays
from isosample.integral.segment_rule import SegmentRule
from isosample.volume.analytic import nucleon_like

if TYPE_CHECKING:
    import numpy.typing as npt

    from isosample.transfer.isovalue_plan import IsovaluePlan

    Bool = npt.NDArray[np.bool_]
    F64 = npt.NDArray[np.float64]
    I64 = npt.NDArray[np.int64]

CELL = 3.0**0.5  # diagonal of the cells that 41 samples along an edge would have [world]


class Exact(NamedTuple):
    """Exact lists of the nucleon-like field under two tents, the plan, and the picture from them."""

    lists: CrossingLists
    plan: IsovaluePlan
    rgba: F64


@cache
def exact(per_slope: int, edge: int = 48) -> Exact:
    tents = TwoTents()
    plan = tents.plan(per_slope)
    lists = exact_crossing_lists(nucleon_like(), plan.isovalues, tents.box, *tents.rays(edge))
    return Exact(lists, plan, integrate_lists(lists, plan, reach=0.0).rgba)


@cache
def truth(edge: int) -> F64:
    tents = TwoTents()
    return integrate_field_rays(nucleon_like(), tents.transfer_function, tents.box, *tents.rays(edge))


def losing(lists: CrossingLists, share: float, seed: int) -> tuple[CrossingLists, Bool]:
    """The lists without so many of their crossings, and which rays lost some."""
    kept = (lists.level < 0) | (np.random.default_rng(seed).random(len(lists.level)) >= share)
    return lists.keep(kept), np.isin(np.arange(len(lists.first) - 1), lists.ray[~kept])


def losing_one(lists: CrossingLists, seed: int) -> tuple[CrossingLists, I64]:
    """The lists with one crossing less on every ray that has any, and the rows of those."""
    rng, crossings = np.random.default_rng(seed), np.diff(lists.first) - 2
    hit = np.flatnonzero(crossings > 0)
    rows = lists.first[hit] + 1 + rng.integers(0, crossings[hit])
    return lists.keep(~np.isin(np.arange(len(lists.level)), rows)), rows


def bands(lists: CrossingLists, plan: IsovaluePlan) -> tuple[I64, I64]:
    """Band before and band after every entry; of border points both are the band of the value."""
    border = np.searchsorted(plan.isovalues, lists.value, side="right")
    crossing = lists.level >= 0
    rising = lists.rising.astype(np.int64)
    before = np.where(crossing, lists.level + 1 - rising, border)
    return before, np.where(crossing, lists.level + rising, border)


def legal(lists: CrossingLists, plan: IsovaluePlan) -> Bool:
    """(N,) bool, whether every entry of a ray goes on from the band to which the one before it leads."""
    before, after = bands(lists, plan)
    broken = (before[1:] != after[:-1]) & (lists.ray[1:] == lists.ray[:-1])
    breaks = np.bincount(lists.ray[1:], weights=broken, minlength=len(lists.first) - 1)
    return np.asarray(breaks == 0)


def without_repair(lists: CrossingLists, plan: IsovaluePlan) -> CrossingLists:
    """Every segment as a span of its own, in the band of its front end: a course that leaves it stops at its end."""
    front = np.flatnonzero(lists.ray[1:] == lists.ray[:-1])
    band = bands(lists, plan)[1][front]
    value = np.where(lists.level >= 0, plan.isovalues[lists.level], lists.value)
    low, high = plan.band_values[band].T
    top = np.where(band < len(plan.isovalues), np.nextafter(high, -np.inf), high)
    count = len(front)
    nothing = np.zeros(2 * count)

    def pairs(first: Any, last: Any) -> npt.NDArray[Any]:
        return np.stack(np.broadcast_arrays(first, last), axis=1).ravel()

    return CrossingLists(
        first=2 * np.searchsorted(lists.ray[front], np.arange(len(lists.first))),
        distance=pairs(lists.distance[front], lists.distance[front + 1]),
        level=np.full(2 * count, -1),
        rising=pairs(np.ones(count, dtype=bool), False),
        slope=np.full(2 * count, np.nan),
        residual=nothing,
        value=pairs(np.clip(value[front], low, top), np.clip(value[front + 1], low, top)),
        tolerance=nothing,
    )


def rms(difference: F64) -> float:
    """Root of the mean square of the rays' largest differences."""
    return float(np.sqrt((np.abs(difference).max(axis=1) ** 2).mean()))


def test_segments_as_spans_of_their_own_are_the_linear_rule() -> None:
    lists, plan, _ = exact(5)
    apart = integrate_lists(without_repair(lists, plan), plan, reach=0.0)
    whole = integrate_lists(lists, plan, rule=SegmentRule.LINEAR, reach=0.0)
    np.testing.assert_allclose(apart.rgba, whole.rgba, rtol=0, atol=1e-14)


@pytest.mark.parametrize("per_slope", [2, 5])
@pytest.mark.parametrize("share", [1e-3, 1e-2, 1e-1])
def test_a_loss_is_found_unless_what_remains_is_a_legal_walk(share: float, per_slope: int) -> None:
    """Crossings leave no trace exactly if the entries around each gap fit each other.

    That is if the crossings lost from a gap lead from a band back to it: in and out of one level in succession,
    with whatever was lost in between. Nothing in a list tells that from a ray which turned earlier.
    """
    lists, plan, _ = exact(per_slope)
    damaged, affected = losing(lists, share, 3)
    for reach, least in ((0.0, 1.0), (CELL, 0.99)):
        found = integrate_lists(damaged, plan, reach=reach)
        counted = found.violations + found.reordered > 0
        traced = affected & ~legal(damaged, plan)
        assert not counted[~traced].any()
        assert counted[traced].mean() >= least
        assert counted[affected].mean() >= (0.995 if share < 0.1 else 0.99) * least
    lost = np.diff(lists.first) - np.diff(damaged.first)
    assert (lost[affected & ~traced] % 2 == 0).all()
    assert affected.sum() > 10


def test_every_single_loss_is_found() -> None:
    lists, plan, _ = exact(5)
    damaged, rows = losing_one(lists, 5)
    for reach in (0.0, CELL):
        found = integrate_lists(damaged, plan, reach=reach)
        assert (found.violations > 0)[lists.ray[rows]].all()


def test_a_pair_in_and_out_of_one_level_leaves_no_trace() -> None:
    lists, plan, rgba = exact(5)
    innermost = np.flatnonzero(
        (lists.level[:-1] == lists.level[1:]) & (lists.level[:-1] >= 0) & lists.rising[:-1]
    )
    damaged = lists.keep(~np.isin(np.arange(len(lists.level)), [*innermost, *(innermost + 1)]))
    found = integrate_lists(damaged, plan, reach=0.0)
    assert found.violations.sum() == found.reordered.sum() == found.unplaced.sum() == 0
    assert rms(found.rgba - rgba) > 1e-3  # though the picture changes


@pytest.mark.parametrize("per_slope", [2, 5, 9])
def test_a_crossing_lost_on_a_slope_is_repaired_tenfold(per_slope: int) -> None:
    """A crossing between two others in the same direction.

    Without it two bands are taken for one, an error of first order in their width; put in where the cubic of the
    gap, or the slope beside an invisible band, meets it, it is off in a higher order. Measured: 13 to 40.
    """
    lists, plan, rgba = exact(per_slope)
    damaged, rows = losing_one(lists, 5)
    before, after = rows - 1, rows + 1
    alike = (lists.rising[before] == lists.rising[rows]) & (lists.rising[after] == lists.rising[rows])
    on_slope = lists.ray[rows[alike & (lists.level[before] >= 0) & (lists.level[after] >= 0)]]
    repaired = integrate_lists(damaged, plan, reach=0.0).rgba
    left = integrate_lists(without_repair(damaged, plan), plan, reach=0.0).rgba
    assert len(on_slope) > 100
    assert rms((repaired - rgba)[on_slope]) < rms((left - rgba)[on_slope]) / 10.0


@pytest.mark.parametrize("per_slope", [2, 5])
@pytest.mark.parametrize("share", [1e-3, 1e-2])
def test_repair_leaves_less_than_half_of_the_error(share: float, per_slope: int) -> None:
    """Of all losses: also of those whose place nothing tells, next to a crossing of their own level."""
    lists, plan, rgba = exact(per_slope)
    damaged, affected = losing(lists, share, 3)
    repaired = integrate_lists(damaged, plan, reach=0.0).rgba
    left = integrate_lists(without_repair(damaged, plan), plan, reach=0.0).rgba
    assert rms((repaired - rgba)[affected]) < 0.5 * rms((left - rgba)[affected])


def test_crossings_lost_between_two_of_their_own_level_are_unplaced() -> None:
    lists, plan, _ = exact(2)
    between = (
        (lists.level[1:-1] == lists.level[:-2])
        & (lists.level[1:-1] == lists.level[2:])
        & (lists.level[1:-1] >= 0)
    )
    rows = np.flatnonzero(between) + 1
    _, first = np.unique(lists.ray[rows], return_index=True)  # one of every ray
    rows = rows[first]
    damaged = lists.keep(~np.isin(np.arange(len(lists.level)), rows))
    found = integrate_lists(damaged, plan, reach=0.0)
    assert len(rows) > 5
    assert (found.unplaced[lists.ray[rows]] > 0).all()
    assert not integrate_lists(lists, plan, reach=0.0).unplaced.any()


PERTURBED = 24  # rays along an edge


def errors_with(lists: CrossingLists, rule: SegmentRule = SegmentRule.CUBIC) -> float:
    found = integrate_lists(lists, exact(5).plan, rule=rule, reach=0.0)
    assert not found.violations.any()
    return rms(found.rgba - truth(PERTURBED))


def test_errors_grow_with_the_error_of_the_slopes_and_stay_below_the_linear_rule() -> None:
    lists = exact(5, PERTURBED).lists
    noise = np.random.default_rng(8).normal(size=len(lists.level))
    errors = [
        errors_with(lists._replace(slope=np.abs(lists.slope * (1.0 + part * noise))))
        for part in (0.0, 0.05, 0.2, 0.5)
    ]
    assert errors == sorted(errors)
    linear = errors_with(lists, SegmentRule.LINEAR)
    assert 3.0 * errors[0] < errors[2] < 0.5 * linear
    for factor in (0.5, 2.0):  # off together they do not cancel
        wrong = errors_with(lists._replace(slope=factor * lists.slope))
        assert errors[2] < wrong < linear
    none = errors_with(lists._replace(slope=np.full(len(lists.slope), np.nan)))
    assert none == pytest.approx(linear, rel=1e-2)  # chords: the linear rule, but for the quadrature


def test_the_direction_comes_from_the_walk_so_that_slopes_have_no_sign() -> None:
    """A crossing of the wrong direction is a break of the walk: it is found, and leaves less than half its error."""
    lists, plan, rgba = exact(5)
    rng = np.random.default_rng(9)
    flipped = (lists.level >= 0) & (rng.random(len(lists.level)) < 1e-2)
    wrong = lists._replace(rising=lists.rising ^ flipped)
    affected = np.isin(np.arange(len(rgba)), lists.ray[flipped])
    found = integrate_lists(wrong, plan, reach=0.0)
    assert (found.violations > 0)[affected].mean() > 0.99
    assert not found.violations[~affected].any()
    left = integrate_lists(without_repair(wrong, plan), plan, reach=0.0).rgba
    assert rms((found.rgba - rgba)[affected]) < 0.5 * rms((left - rgba)[affected])


@pytest.mark.parametrize("kind", ["half floats", "single distances", "24-bit distances"])
def test_what_the_shaders_store_costs_less_than_a_twentieth(kind: str) -> None:
    lists = exact(5, PERTURBED).lists
    far = float(np.abs(lists.distance).max())
    rounded = {
        # of |df/dt| times the radius of the box, in units of the value range, as the nodes hold it
        "half floats": lists._replace(
            slope=(lists.slope * 34.6).astype(np.float16).astype(np.float64) / 34.6
        ),
        "single distances": lists._replace(distance=lists.distance.astype(np.float32).astype(np.float64)),
        "24-bit distances": lists._replace(distance=np.round(lists.distance / far * 2.0**24) * far / 2.0**24),
    }[kind]
    assert errors_with(rounded) == pytest.approx(errors_with(lists), rel=0.05)
    assert errors_with(rounded) != errors_with(lists)

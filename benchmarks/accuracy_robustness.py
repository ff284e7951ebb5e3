"""What inexact slopes and distances and lost crossings do to pictures from exact crossings."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from benchmarks.accuracy_methods import errors, exact_lists, field_truth, list_picture
from benchmarks.accuracy_scenes import nucleon
from isosample.integral.crossing_lists import BORDER
from isosample.integral.data_centric import integrate_lists
from isosample.integral.segment_rule import SegmentRule

if TYPE_CHECKING:
    from collections.abc import Callable

    from benchmarks.accuracy_scenes import AccuracyScene
    from isosample.integral.crossing_lists import CrossingLists
    from isosample.transfer.isovalue_plan import IsovaluePlan
    from isosample.volume.grid import F64

    Change = Callable[[CrossingLists], CrossingLists]

PIXELS = 64
SEED = 7
CASES = (("T1 two narrow tents", "translucent", 5), ("T2 wide tent", "opaque", 9))
DISTANCE_BITS = 24


@dataclass(frozen=True, eq=False)
class _Case:
    """Exact crossings of one plan, and what the field shows."""

    scene: AccuracyScene
    plan: IsovaluePlan
    lists: CrossingLists
    truth: F64

    @classmethod
    def build(cls, shape: str, opacity: str, count: int) -> _Case:
        scene = nucleon(41)
        rays = scene.rays(PIXELS)
        plan = scene.plan(shape, opacity, count)
        assert scene.field is not None
        truth = field_truth(scene, scene.field, scene.transfer_function(shape, opacity), rays)
        return cls(scene, plan, exact_lists(scene, plan.isovalues, rays), truth)


def rows() -> list[dict[str, Any]]:
    """One row per case and change: errors against the analytic field, clean ones first."""
    found = []
    for shape, opacity, count in CASES:
        case = _Case.build(shape, opacity, count)
        common = {"tf": shape, "opacity": opacity, "K": count}
        for rule in (SegmentRule.LINEAR, SegmentRule.CUBIC):
            picture = list_picture(case.scene, case.lists, case.plan, rule)
            found.append(common | {"change": f"none, {rule.value}"} | errors(picture, case.truth))
        for name, change in CHANGES.items():
            picture = list_picture(case.scene, change(case.lists), case.plan, SegmentRule.CUBIC)
            found.append(common | {"change": name} | errors(picture, case.truth))
        for share in (1e-3, 1e-2):
            for row in _losses(case, share):
                found.append(common | row)  # noqa: PERF401  # a generator of rows, not of columns
        print(f"robustness, {shape}, {opacity}", flush=True)
    return found


def noisy_slopes(lists: CrossingLists, *, share: float) -> CrossingLists:
    """Slopes times 1 + so much normal noise; |df/dt| stays positive."""
    noise = np.random.default_rng(SEED).normal(size=len(lists.slope))
    return lists._replace(slope=np.abs(lists.slope * (1.0 + share * noise)))


def half_slopes(lists: CrossingLists) -> CrossingLists:
    """Slopes as the GPU keeps them: half floats, in value ranges per radius of the box."""
    with np.errstate(under="ignore"):
        return lists._replace(slope=lists.slope.astype(np.float16).astype(np.float64))


def fixed_distances(lists: CrossingLists) -> CrossingLists:
    """Distances in 24-bit fixed point over the range of all rays."""
    low, high = lists.distance.min(), lists.distance.max()
    quantum = (high - low) / 2.0**DISTANCE_BITS
    return lists._replace(distance=low + quantum * np.round((lists.distance - low) / quantum))


def flipped(lists: CrossingLists, *, share: float) -> CrossingLists:
    """So many crossings in the wrong direction."""
    flip = (np.random.default_rng(SEED).random(len(lists.level)) < share) & (lists.level != BORDER)
    return lists._replace(rising=lists.rising ^ flip)


CHANGES: dict[str, Change] = {
    "slopes × (1 ± 5 %)": partial(noisy_slopes, share=0.05),
    "slopes × (1 ± 20 %)": partial(noisy_slopes, share=0.2),
    "slopes as half floats": half_slopes,
    "distances in 24-bit fixed point": fixed_distances,
    "1 % of the directions flipped": partial(flipped, share=0.01),
    "10 % of the directions flipped": partial(flipped, share=0.1),
}


def _losses(case: _Case, share: float) -> list[dict[str, Any]]:
    """Crossings dropped at random: with the repair of the walk, and without any."""
    lists, plan = case.lists, case.plan
    lost = (np.random.default_rng(SEED).random(len(lists.level)) < share) & (lists.level != BORDER)
    damaged = lists.keep(~lost)
    affected = np.isin(np.arange(len(lists.first) - 1), lists.ray[lost])
    found = integrate_lists(damaged, plan, reach=0.0)
    counted = found.violations + found.reordered > 0
    detected = float(counted[affected].mean())
    name = f"{share:.1%} of the crossings lost"
    left = integrate_lists(unrepaired(damaged, plan), plan, reach=0.0).rgba
    return [
        {"change": f"{name}, not repaired"} | errors(left, case.truth),
        {"change": f"{name}, repaired", "detected": round(detected, 4)}
        | {"unplaced": round(float((found.unplaced[affected] > 0).mean()), 4)}
        | errors(found.rgba, case.truth),
    ]


def unrepaired(lists: CrossingLists, plan: IsovaluePlan) -> CrossingLists:
    """Lists that are cut wherever two neighbouring entries do not fit, so that the walk has nothing to repair.

    A gap becomes a span of its own between two border points, linear and in the band behind its front end; the
    legal runs on both sides keep their slopes.
    """
    border, rising = lists.level == BORDER, lists.rising.astype(np.int64)
    at_border = np.searchsorted(plan.isovalues, lists.value, side="right")
    before = np.where(border, at_border, lists.level + 1 - rising)
    after = np.where(border, at_border, lists.level + rising)
    ray = lists.ray
    gap = np.flatnonzero((ray[1:] == ray[:-1]) & (before[1:] != after[:-1]))
    values = np.where(border, lists.value, plan.isovalues[lists.level])
    where, count = np.repeat(gap + 1, 4), 4 * len(gap)
    rows = np.stack([gap, gap, gap + 1, gap + 1], axis=1).ravel()  # out, in, out, in
    bands = np.stack([after[gap], after[gap], after[gap], before[gap + 1]], axis=1).ravel()
    low, high = plan.band_values[bands].T
    top = np.where(bands < len(plan.isovalues), np.nextafter(high, -np.inf), high)
    return lists._replace(
        first=lists.first + 4 * np.searchsorted(gap, lists.first),
        distance=np.insert(lists.distance, where, lists.distance[rows]),
        level=np.insert(lists.level, where, BORDER),
        rising=np.insert(lists.rising, where, np.arange(count) % 2 == 1),
        slope=np.insert(lists.slope, where, np.nan),
        residual=np.insert(lists.residual, where, 0.0),
        value=np.insert(lists.value, where, np.clip(values[rows], low, top)),
        tolerance=np.insert(lists.tolerance, where, 0.0),
    )

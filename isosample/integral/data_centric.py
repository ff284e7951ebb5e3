"""The data-centric integral of one ray in float64: the resolve pass in plain Python.

Twin: ``shaders/pass/resolve.glsl``. Source: Lindholm et al., "Towards data centric sampling for volume
rendering", Algorithm 1 and eqs. 2 and 3.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import numpy.typing as npt

from isosample.integral.optics import opacity_from_depth, segment_weights
from isosample.integral.segment_rule import SegmentRule

if TYPE_CHECKING:
    from collections.abc import Sequence

    from isosample.transfer.isovalue_plan import IsovaluePlan

F64 = npt.NDArray[np.float64]


class Crossing(NamedTuple):
    """Where a ray crosses an isosurface: distance [world], level index, does the value rise along the ray."""

    distance: float
    level: int
    rising: bool

    @property
    def band_before(self) -> int:
        """Band from which the ray comes."""
        return self.level if self.rising else self.level + 1

    @property
    def band_after(self) -> int:
        """Band into which the ray goes."""
        return self.level + 1 if self.rising else self.level


class BorderPoint(NamedTuple):
    """Where a ray enters or leaves the volume.

    Distance [world], the value there, and how far that may lie on the wrong side of an isovalue [data units].
    """

    distance: float
    value: float
    tolerance: float = 0.0


@dataclass(slots=True)
class _Walk:
    """State between two crossings; `position` is 0 at the lower and 1 at the upper end of the band.

    In a balanced walk `band` may leave 0 … K for a moment, where meshes of neighbouring levels cut each other.
    """

    radiance: F64
    transmittance: float
    distance: float
    band: int
    position: float
    balanced: bool = True
    leave_by_value: bool = False
    violations: int = 0

    def end_towards(self, level: int) -> float:
        """End of the current band that is nearer to a level."""
        return 1.0 if level >= self.band else 0.0


def integrate_ray(
    crossings: Sequence[Crossing],
    entry: BorderPoint,
    leave: BorderPoint,
    plan: IsovaluePlan,
    rule: SegmentRule = SegmentRule.LINEAR,
    visible: tuple[float, float] = (0.0, np.inf),
) -> tuple[F64, int]:
    """Radiance and opacity of one ray, from its crossings with the isosurfaces.

    Parameters
    ----------
    crossings : sequence of Crossing
        In order of distance; of crossings at one distance, in the order of travel.
    entry, leave : BorderPoint
        Where the ray enters and leaves the volume.
    plan : IsovaluePlan
        The transfer function in every band, and the impulses.
    rule : SegmentRule
        How the data runs between crossings.
    visible : (start, end)
        Part of the ray that is not cut away [world].

    Returns
    -------
    rgba : (4,) float64
        Premultiplied linear RGBA.
    violations : int
        Crossings that did not continue the walk through the bands of a ray whose crossings do not add up.

    Notes
    -----
    If the crossings lead from the band of the entry to that of the exit, none was lost: the ray is balanced, and
    every crossing moves the walk by one band, in whatever order they stand. Where the value on the box and the
    surfaces disagree about the band within the value's tolerance, the surfaces decide. Anything else is a loss:
    levels are then put in where they are missing, and counted.
    """
    walk = _Walk(np.zeros(3), 1.0, entry.distance, band_of(plan, entry.value), 0.0)
    walk.position = position_in_band(plan, walk.band, entry.value)
    _weigh(walk, crossings, entry, leave, plan)
    for crossing in crossings:
        _cross(walk, crossing, plan, rule, visible)
    target = band_of(plan, leave.value) if walk.leave_by_value else walk.band
    _cross_missing(walk, target, leave.distance, leave.value, plan, rule, visible)
    end = max(leave.distance, walk.distance)
    _advance(walk, end, position_in_band(plan, walk.band, leave.value), plan, rule, visible)
    return np.array([*walk.radiance, 1.0 - walk.transmittance]), walk.violations


def band_of(plan: IsovaluePlan, value: float) -> int:
    """Index of the band that holds a value: as many isovalues lie at or below it."""
    return int(np.searchsorted(plan.isovalues, value, side="right"))


def position_in_band(plan: IsovaluePlan, band: int, value: float) -> float:
    """0 at the lower end of a band, 1 at its upper end; the nearer end for values beside it."""
    low, high = plan.band_values[_real_band(plan, band)]
    return float(np.clip((value - low) / (high - low), 0.0, 1.0)) if high > low else 0.0


def _weigh(
    walk: _Walk, crossings: Sequence[Crossing], entry: BorderPoint, leave: BorderPoint, plan: IsovaluePlan
) -> None:
    """Decide whether the crossings add up, and from which band."""
    if not crossings:
        walk.leave_by_value = True
        slack = entry.tolerance + leave.tolerance
        walk.violations += not _may_be_in(plan, walk.band, leave.value, slack)
        return
    net = sum(1 if crossing.rising else -1 for crossing in crossings)
    first, last = crossings[0].band_before, crossings[-1].band_after
    leaving = band_of(plan, leave.value)
    if walk.band + net == leaving:
        return
    entry_fits = _may_be_in(plan, first, entry.value, entry.tolerance)
    exit_fits = _may_be_in(plan, last, leave.value, leave.tolerance)
    chained = first + net == last and exit_fits
    if entry_fits and (chained or first + net == leaving):
        _move_to(walk, first)
    elif walk.band + net != last or not exit_fits:
        walk.balanced = False
        walk.leave_by_value = not exit_fits
        if entry_fits:
            _move_to(walk, first)
        walk.violations += not exit_fits


def _may_be_in(plan: IsovaluePlan, band: int, value: float, tolerance: float) -> bool:
    """Whether a value on the border may belong to a band: in it, or beside it by the tolerance at most."""
    index = _real_band(plan, band)
    low, high = plan.band_values[index]
    above = index == 0 or value >= low - tolerance
    return bool(above and (index == len(plan.isovalues) or value <= high + tolerance))


def _move_to(walk: _Walk, band: int) -> None:
    """Begin in another band than the one of the value on the box, at its nearer end."""
    if walk.band != band:
        walk.position = 0.0 if walk.band < band else 1.0
        walk.band = band


def _cross(
    walk: _Walk, crossing: Crossing, plan: IsovaluePlan, rule: SegmentRule, visible: tuple[float, float]
) -> None:
    """Walk to a crossing and through it."""
    before = crossing.band_before
    distance = max(crossing.distance, walk.distance)
    if walk.band != before and not walk.balanced:
        walk.violations += 1
        value = float(plan.isovalues[crossing.level])
        _cross_missing(walk, before, distance, value, plan, rule, visible)
    _pass_level(walk, crossing.level, distance, crossing.rising, plan, rule, visible)


def _cross_missing(
    walk: _Walk,
    target: int,
    distance: float,
    value: float,
    plan: IsovaluePlan,
    rule: SegmentRule,
    visible: tuple[float, float],
) -> None:
    """Cross the levels up or down to the band `target`, where a linear course meets them."""
    start = walk.distance
    low, high = plan.band_values[_real_band(plan, walk.band)]
    start_value = low + walk.position * (high - low)
    while walk.band != target:
        rising = walk.band < target
        level = walk.band if rising else walk.band - 1
        rise = value - start_value
        part = np.clip((plan.isovalues[level] - start_value) / rise, 0.0, 1.0) if rise else 0.5
        place = max(walk.distance, start + float(part) * (max(distance, start) - start))
        _pass_level(walk, level, place, rising, plan, rule, visible)


def _pass_level(
    walk: _Walk,
    level: int,
    distance: float,
    rising: bool,
    plan: IsovaluePlan,
    rule: SegmentRule,
    visible: tuple[float, float],
) -> None:
    """Integrate up to a level, composite its impulse if it has one, and enter the next band."""
    _advance(walk, distance, walk.end_towards(level), plan, rule, visible)
    if visible[0] <= distance <= visible[1]:
        opacity = float(plan.impulse_opacity[level])
        _composite(walk, opacity * plan.impulse_color[level], opacity)
    walk.band += 1 if rising else -1
    walk.position = walk.end_towards(level)


def _advance(
    walk: _Walk,
    distance: float,
    position: float,
    plan: IsovaluePlan,
    rule: SegmentRule,
    visible: tuple[float, float],
) -> None:
    """Composite the segment up to `distance`, where the value is at `position` of the current band."""
    start, end = max(walk.distance, visible[0]), min(distance, visible[1])
    if end > start:
        span = distance - walk.distance
        ends = [_mix(walk.position, position, (t - walk.distance) / span) for t in (start, end)]
        if rule is SegmentRule.LINEAR:
            _linear_segment(walk, ends, end - start, plan)
        else:
            _constant_segment(walk, end - start, plan, first_order=rule is SegmentRule.CONSTANT_FIRST_ORDER)
    walk.distance = distance
    walk.position = position


def _linear_segment(walk: _Walk, positions: list[float], length: float, plan: IsovaluePlan) -> None:
    (color_front, front), (color_back, back) = (_optics(plan, walk.band, position) for position in positions)
    weights = segment_weights(front * length, back * length)
    _composite(walk, weights[0] * color_front + weights[1] * color_back, float(weights.sum()))


def _constant_segment(walk: _Walk, length: float, plan: IsovaluePlan, *, first_order: bool) -> None:
    color, extinction = _optics(plan, walk.band, walk.position)
    depth = extinction * length
    opacity = min(depth, 1.0) if first_order else float(opacity_from_depth(depth))
    _composite(walk, opacity * color, opacity)


def _optics(plan: IsovaluePlan, band: int, position: float) -> tuple[F64, float]:
    """Colour and extinction at a position of a band."""
    real = _real_band(plan, band)
    color, extinction = plan.band_color[real], plan.band_extinction[real]
    return (1.0 - position) * color[0] + position * color[1], _mix(extinction[0], extinction[1], position)


def _real_band(plan: IsovaluePlan, band: int) -> int:
    """Nearest band that there is."""
    return min(max(band, 0), len(plan.isovalues))


def _mix(first: float, last: float, part: float) -> float:
    """Linear interpolation that is exact at both ends and never leaves them."""
    return float((1.0 - part) * first + part * last)


def _composite(walk: _Walk, premultiplied: F64, opacity: float) -> None:
    walk.radiance = walk.radiance + walk.transmittance * premultiplied
    walk.transmittance *= 1.0 - opacity

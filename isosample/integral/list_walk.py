"""The walk of one ray through the bands, from crossing to crossing: in which band every segment lies, and its ends.

Lost crossings are found, put in where they are likely to have been, and counted. Nothing is integrated here: the
walk leaves a table of steps, each a segment and the level crossed at its end, for `list_segments`.

Twin: ``shaders/pass/span.glsl`` (`weigh_span`, `band_at`, `step_to`) and ``walk.glsl``. Source: Lindholm et al.,
"Towards data centric sampling for volume rendering", Algorithm 1.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from isosample.compiled import compiled
from isosample.integral.list_spans import (
    BAND_NOW,
    DISTANCE,
    INSIDE,
    POSITION,
    SLOPE,
    STEPS,
    UNPLACED,
    Entry,
    Levels,
    band_at,
    enter,
    passes_over,
    position_in_band,
    read_entry,
    real_band,
    weigh_span,
)
from isosample.integral.segment import limit_slopes, segment_curve

if TYPE_CHECKING:
    from isosample.integral.crossing_lists import CrossingLists

F64 = npt.NDArray[np.float64]
I64 = npt.NDArray[np.int64]

# One step: the segment from START to END [world] in a band, with the positions and slopes (band widths per segment)
# of its ends; then the level crossed at END (−1: none), |df/dt| there [data units/world], whether that is known or else
# the chord's, and the residual.
START, END, BAND, FRONT, BACK, SLOPE_FRONT, SLOPE_BACK, LEVEL, STEEPNESS, SLOPE_KNOWN, RESIDUAL = range(11)
FIRST_ROOM = 64  # steps of a ray; more where they do not suffice
STEP_SIZE = 11

BISECTIONS = 52  # of a gap: to rounding; in float32 24 are enough
SHORTEST = 1e-30  # a step of no length that rises is as steep as can be [world]


@compiled
def walk_ray(lists: CrossingLists, ray: int, levels: Levels, counts: I64, steps: F64) -> F64:
    """Walk along one ray; return the table of its steps.

    Parameters
    ----------
    lists : CrossingLists
    ray : int
    levels : Levels
    counts : (10,) int64
        Receives, at VIOLATIONS, REORDERED, UNPLACED and STEPS, the numbers of entries that do not continue the walk
        of a span that is not balanced; of entries out of order in balanced spans; of levels put in at places that
        are no more than a guess; and of steps.
    steps : (S, 11) float64
        Room for steps; what it holds is lost.

    Returns
    -------
    steps : (S', 11) float64
        `steps`, or a larger table where it was too small.
    """
    state = np.array([0.0, 0.0, math.nan])
    counts[:] = 0
    for i in range(lists.first[ray], lists.first[ray + 1]):
        entry = read_entry(lists, i)
        if entry.level < 0 and entry.rising:
            enter(state, counts, entry, levels)
            weigh_span(state, counts, (lists, i, lists.first[ray + 1]), levels)
        elif counts[INSIDE] and not (entry.level >= 0 and passes_over(counts, entry)):
            steps = _step_to(state, counts, entry, levels, steps)
    return steps


@compiled
def _step_to(state: F64, counts: I64, entry: Entry, levels: Levels, steps: F64) -> F64:
    """Walk through levels that the list does not hold, then to an entry."""
    border = entry.level < 0
    target = band_at(counts, entry, levels)
    band = real_band(levels, counts[BAND_NOW])
    low, high = levels.ends[band, 0], levels.ends[band, 1]
    front = (state[DISTANCE], (1.0 - state[POSITION]) * low + state[POSITION] * high, state[SLOPE])
    end = max(entry.distance, state[DISTANCE])
    slope = entry.slope if entry.rising else -entry.slope
    back = (end, entry.value if border else levels.isovalues[entry.level], slope)
    while counts[BAND_NOW] != target:
        upwards = counts[BAND_NOW] < target
        level = counts[BAND_NOW] if upwards else counts[BAND_NOW] - 1
        place, certain = _place_of(level, upwards, front, back, levels)
        counts[UNPLACED] += not certain
        inside = min(max(place, state[DISTANCE]), end)
        steps = _cross(state, counts, (inside, level, upwards, math.nan, 0.0), levels, steps)
    if border:
        position = position_in_band(levels, real_band(levels, counts[BAND_NOW]), entry.value)
        steps = _advance(state, counts, (end, position, math.nan), levels, steps)
        counts[INSIDE] = 0
        return steps
    crossing = (end, entry.level, entry.rising, entry.slope, entry.residual)
    return _cross(state, counts, crossing, levels, steps)


@compiled
def _place_of(
    level: int,
    upwards: bool,
    front: tuple[float, float, float],
    back: tuple[float, float, float],
    levels: Levels,
) -> tuple[float, bool]:
    """Where a lost crossing was, between two points (distance, value, signed slope); and whether that is certain."""
    (t_front, v_front, s_front), (t_back, v_back, s_back) = front, back
    value = levels.isovalues[level]
    empty_before = not levels.shown[level if upwards else level + 1]
    empty_after = not levels.shown[level + 1 if upwards else level]
    if empty_before and v_back != value and abs(s_back) > 0.0:
        place = t_back - abs(v_back - value) / abs(s_back)
        return place, place >= t_front - levels.reach
    if empty_after and v_front != value and abs(s_front) > 0.0:
        place = t_front + abs(value - v_front) / abs(s_front)
        return place, place <= t_back + levels.reach
    sign = 1.0 if upwards else -1.0
    starts_before = sign * (v_front - value) < 0.0 or (v_front == value and sign * s_front < 0.0)
    ends_beyond = sign * (v_back - value) > 0.0 or (v_back == value and sign * s_back < 0.0)
    if starts_before and ends_beyond and not math.isnan(s_front + s_back):
        length = t_back - t_front
        part = _part_at(value, sign, (v_front, v_back, length * s_front, length * s_back))
        return t_front + part * length, not v_front == v_back == value
    if v_front != v_back and min(v_front, v_back) <= value <= max(v_front, v_back):
        place = t_front + (value - v_front) / (v_back - v_front) * (t_back - t_front)
        return place, value not in (v_front, v_back)
    total = abs(s_front) + abs(s_back)
    part = abs(s_front) / total if total > 0.0 else 0.5
    return t_front + part * (t_back - t_front), False


@compiled
def _part_at(value: float, sign: float, cubic: tuple[float, float, float, float]) -> float:
    """Part of a gap at which its Hermite cubic (two ends, two slopes) goes through a value in a direction."""
    low, high = 0.0, 1.0
    for _ in range(BISECTIONS):
        middle = 0.5 * (low + high)
        if sign * (segment_curve(*cubic, middle) - value) < 0.0:
            low = middle
        else:
            high = middle
    return 0.5 * (low + high)


@compiled
def _cross(
    state: F64,
    counts: I64,
    crossing: tuple[float, int, bool, float, float],
    levels: Levels,
    steps: F64,
) -> F64:
    """Walk up to a crossing (distance, level, rising, |slope|, residual) and into the next band."""
    distance, level, rising, slope, residual = crossing
    position = 1.0 if level >= counts[BAND_NOW] else 0.0
    steps = _advance(state, counts, (distance, position, slope if rising else -slope), levels, steps)
    row = steps[counts[STEPS] - 1]
    row[LEVEL], row[RESIDUAL], row[SLOPE_KNOWN] = level, residual, not math.isnan(slope)
    row[STEEPNESS] = slope if not math.isnan(slope) else _chord_slope(row, levels)
    counts[BAND_NOW] += 1 if rising else -1
    state[POSITION] = 1.0 if level >= counts[BAND_NOW] else 0.0
    return steps


@compiled
def _chord_slope(step: F64, levels: Levels) -> float:
    """|df/dt| of the straight line through a step [data units/world]."""
    band, length = int(step[BAND]), step[END] - step[START]
    rise = abs(step[BACK] - step[FRONT]) * (levels.ends[band, 1] - levels.ends[band, 0])
    return float(rise / max(length, SHORTEST))


@compiled
def _advance(state: F64, counts: I64, target: tuple[float, float, float], levels: Levels, steps: F64) -> F64:
    """Add the segment up to a point (distance, position, signed slope), and move there."""
    distance, position, slope = target
    row = counts[STEPS]
    if row == len(steps):
        larger = np.empty((2 * row + 8, STEP_SIZE))
        larger[:row] = steps
        steps = larger
    counts[STEPS] += 1
    band = real_band(levels, counts[BAND_NOW])
    length, width = distance - state[DISTANCE], levels.ends[band, 1] - levels.ends[band, 0]
    scale, front = (length / width if width > 0.0 else 0.0), state[POSITION]
    first, last = scale * state[SLOPE], scale * slope
    if not (math.isnan(first) or math.isnan(last)):
        first, last = limit_slopes(front, position, first, last)
    step = steps[row]
    step[START], step[END], step[BAND], step[FRONT], step[BACK] = (
        state[DISTANCE],
        distance,
        band,
        front,
        position,
    )
    step[SLOPE_FRONT] = first if not math.isnan(first) else position - front
    step[SLOPE_BACK] = last if not math.isnan(last) else position - front
    step[LEVEL], step[STEEPNESS], step[SLOPE_KNOWN], step[RESIDUAL] = -1.0, 0.0, 0.0, 0.0
    state[DISTANCE], state[POSITION], state[SLOPE] = distance, position, slope
    return steps

"""One span of a ray, from where it enters the volume to where it leaves: what its crossings say together.

Twin: ``shaders/pass/span.glsl`` and ``node.glsl``.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import numpy.typing as npt

from isosample.compiled import compiled

if TYPE_CHECKING:
    from isosample.integral.crossing_lists import CrossingLists

F64 = npt.NDArray[np.float64]
I64 = npt.NDArray[np.int64]

# The state of a ray, floating: where it is [world], the position in its band, the signed slope there (NaN: unknown);
DISTANCE, POSITION, SLOPE = range(3)
# and whole: in a balanced span the band may leave 0 … K for a moment, where meshes of several levels cut each other.
BAND_NOW, INSIDE, BALANCED, LEAVE_BY_VALUE, AHEAD, DEBT, VIOLATIONS, REORDERED, UNPLACED, STEPS = range(10)
COUNTS_SIZE = 10


class Levels(NamedTuple):
    """What the walk has to know of a plan and a picture.

    Attributes
    ----------
    isovalues : (K,) float64
    ends : (K + 1, 2) float64
        Lower and upper end of every band [data units].
    shown : (K + 1,) bool
        Whether a band has extinction.
    reach : float
        Distance within which meshes of several levels may cut each other: a cell's diagonal [world].
    """

    isovalues: F64
    ends: F64
    shown: npt.NDArray[np.bool_]
    reach: float


class Entry(NamedTuple):
    """One entry of the crossing lists."""

    distance: float
    level: int
    rising: bool
    slope: float
    residual: float
    value: float
    tolerance: float


@compiled
def read_entry(lists: CrossingLists, i: int) -> Entry:
    """Return an entry of the lists; the slope at a border point is unknown."""
    slope = math.nan if lists.level[i] < 0 else lists.slope[i]
    place = (lists.distance[i], lists.level[i], lists.rising[i])
    return Entry(*place, slope, lists.residual[i], lists.value[i], lists.tolerance[i])


@compiled
def band_before(level: int, rising: bool) -> int:
    """Band from which a crossing comes."""
    return level if rising else level + 1


@compiled
def band_after(level: int, rising: bool) -> int:
    """Band into which a crossing leads."""
    return level + 1 if rising else level


@compiled
def band_of(levels: Levels, value: float) -> int:
    """Band that holds a value: as many isovalues lie at or below it."""
    return int(np.searchsorted(levels.isovalues, value, side="right"))


@compiled
def real_band(levels: Levels, band: int) -> int:
    """Nearest band that there is."""
    return min(max(band, 0), len(levels.isovalues))


@compiled
def position_in_band(levels: Levels, band: int, value: float) -> float:
    """0 at the lower end of a band, 1 at its upper end; the nearer end for values beside it."""
    low, high = levels.ends[band, 0], levels.ends[band, 1]
    return min(max((value - low) / (high - low), 0.0), 1.0) if high > low else 0.0


@compiled
def _may_be_in(levels: Levels, band: int, value: float, tolerance: float) -> bool:
    """Whether a value on the border may belong to a band: in it, or beside it by the tolerance at most."""
    index = real_band(levels, band)
    above = index == 0 or value >= levels.ends[index, 0] - tolerance
    return above and (index == len(levels.isovalues) or value <= levels.ends[index, 1] + tolerance)


@compiled
def enter(state: F64, counts: I64, entry: Entry, levels: Levels) -> None:
    """Begin a span in the band of the value on the border."""
    counts[INSIDE] = 1
    counts[BAND_NOW] = band_of(levels, entry.value)
    state[DISTANCE] = entry.distance
    state[POSITION] = position_in_band(levels, counts[BAND_NOW], entry.value)
    state[SLOPE] = math.nan


@compiled
def _begin_in(state: F64, counts: I64, band: int) -> None:
    """Begin in the band that the first surface says instead of the one of the value on the border."""
    if counts[BAND_NOW] != band:
        state[POSITION] = 0.0 if counts[BAND_NOW] < band else 1.0
        counts[BAND_NOW] = band


@compiled
def weigh_span(state: F64, counts: I64, place: tuple[CrossingLists, int, int], levels: Levels) -> None:
    """Decide how a span, from an entry to the next border point, is walked: see the notes of `integrate_lists`."""
    lists, start, stop = place
    end, net = start + 1, 0
    while end < stop and lists.level[end] >= 0:
        net += 1 if lists.rising[end] else -1
        end += 1
    entry, bordered = read_entry(lists, start), end < stop
    leave = read_entry(lists, end) if bordered else entry
    counts[BALANCED], counts[LEAVE_BY_VALUE] = 1, 0
    counts[AHEAD], counts[DEBT] = 0, 0
    if end == start + 1:
        slack = entry.tolerance + leave.tolerance
        counts[LEAVE_BY_VALUE] = bordered
        counts[VIOLATIONS] += bordered and not _may_be_in(levels, counts[BAND_NOW], leave.value, slack)
        return
    first = band_before(lists.level[start + 1], lists.rising[start + 1])
    last = band_after(lists.level[end - 1], lists.rising[end - 1])
    entry_fits = _may_be_in(levels, first, entry.value, entry.tolerance)
    exit_fits = not bordered or _may_be_in(levels, last, leave.value, leave.tolerance)
    leaving = band_of(levels, leave.value) if bordered else last
    lost = _loses_pairs(lists, start + 1, end, counts[BAND_NOW], levels.reach)
    if counts[BAND_NOW] + net == leaving and not lost:
        return
    chained = first + net == leaving or (first + net == last and exit_fits)
    if chained and entry_fits and not _loses_pairs(lists, start + 1, end, first, levels.reach):
        _begin_in(state, counts, first)
    elif counts[BAND_NOW] + net != last or not exit_fits or lost:
        counts[BALANCED], counts[LEAVE_BY_VALUE] = 0, not exit_fits
        counts[VIOLATIONS] += not exit_fits
        if entry_fits:
            _begin_in(state, counts, first)


@compiled
def _loses_pairs(lists: CrossingLists, start: int, end: int, band: int, reach: float) -> bool:
    """Whether a walk by one band per crossing tells that two crossings in opposite directions were lost.

    Meshes of neighbouring levels that cut each other inside a cell change the order of two or more crossings
    there. One that does not fit alone, or many over a longer way, are the trace of a loss. A place ends where
    the misfits' distances from the walk [bands] sum to 0, and where none follows within `reach`.
    """
    misfits, shift, place_start, place_end = 0, 0, 0.0, 0.0
    for i in range(start, end):
        off = band_before(lists.level[i], lists.rising[i]) - band
        band += 1 if lists.rising[i] else -1
        if off == 0:
            continue
        if misfits > 0 and lists.distance[i] - place_end > reach:
            if misfits == 1 or place_end - place_start > reach:
                return True
            misfits = 0
        if misfits == 0:
            place_start, shift = lists.distance[i], 0
        misfits += 1
        shift += off
        place_end = lists.distance[i]
        if shift == 0:
            if place_end - place_start > reach:
                return True
            misfits = 0
    return misfits == 1 or (misfits > 0 and place_end - place_start > reach)


@compiled
def passes_over(counts: I64, entry: Entry) -> bool:
    """Whether a balanced walk passes over a crossing.

    Where a ray hardly touches a surface, its two crossings may stand in the wrong order: the walk goes through
    neither. Not so where an earlier crossing came too soon: this is then the one that came too late.
    """
    owed = counts[DEBT] != 0 and (counts[DEBT] > 0) == entry.rising
    beyond = counts[BAND_NOW] - 1 if entry.rising else counts[BAND_NOW]
    if not counts[BALANCED] or not (
        owed or (counts[DEBT] == 0 and counts[AHEAD] == 0 and entry.level == beyond)
    ):
        return False
    counts[DEBT] += -1 if entry.rising else 1
    counts[REORDERED] += 1
    return True


@compiled
def band_at(counts: I64, entry: Entry, levels: Levels) -> int:
    """Band from which the walk goes through an entry; in a span that is not balanced, levels before it were lost."""
    if entry.level < 0:
        return band_of(levels, entry.value) if counts[LEAVE_BY_VALUE] else counts[BAND_NOW]
    before = band_before(entry.level, entry.rising)
    if counts[BAND_NOW] != before:
        if counts[BALANCED]:
            counts[REORDERED] += 1
            counts[AHEAD] += before - counts[BAND_NOW]
            return int(counts[BAND_NOW])
        counts[VIOLATIONS] += 1
    return before

"""Where in a volume its field meets some values: the smallest box of whole cells around all of that."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from isosample.volume.bricks import BRICK_CELLS, brick_ranges, bricks_of
from isosample.volume.scan import SCAN_BUDGET
from isosample.volume.value_ranges import ranges_cross, ranges_meet
from isosample.volume.windows import brick_windows, samples_read

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence

    import numpy.typing as npt

    from isosample.volume.bricks import Brick, Triple
    from isosample.volume.grid import F64, Volume
    from isosample.volume.scan import BrickScan
    from isosample.volume.value_ranges import Bools

    Span = tuple[Triple, Triple]  # first and last sample (x, y, z), both included


class Shown(NamedTuple):
    """What is known about where a volume shows something; where nothing is known, there is no `Shown`.

    Attributes
    ----------
    span : pair of 3 ints, or None
        First and last sample (x, y, z) of the box around it, as of `shown_span`; None where nothing is shown.
    """

    span: Span | None


def shown_span(
    volume: Volume,
    intervals: npt.ArrayLike,
    *,
    levels: npt.ArrayLike = (),
    scan: BrickScan | None = None,
    budget_bytes: int = SCAN_BUDGET,
    progress: Callable[[int, int], None] | None = None,
) -> Span | None:
    """Smallest box of whole cells in which the trilinear field has a value of some intervals, or crosses a level.

    Parameters
    ----------
    volume : Volume
    intervals : (N, 2) array_like of float
        Closed intervals of values, in data units, in any order; they may overlap.
    levels : (N,) array_like of float
        Values of isosurfaces, in data units: of them cells count that have values below one, and values that are not. A
        cell that has just this value everywhere has no surface.
    scan : BrickScan, optional
        Of this volume with bricks of `BRICK_CELLS`, where there is one. Without it all samples are read once more.
    budget_bytes : int
        Samples in memory at once, where they are not there already.
    progress : callable, optional
        Called with (bricks done, bricks in all); those that need not be looked at are done, too.

    Returns
    -------
    span : pair of 3 ints, or None
        First and last sample (x, y, z) of the box, both included; None where no cell has such a value. Cells with a
        sample that is not finite have none.

    Raises
    ------
    InputError
        If the intervals are none, or the budget is too small for a single layer of a single brick.

    Notes
    -----
    The trilinear field of a cell takes every value between the smallest and the largest of its eight samples, and no
    other. Bricks whose range misses the intervals are not looked at, and of the others only those that reach out of
    what is found: at first the outermost along each axis. Of a file the bricks of one face are read together, so that
    what lies between opposite faces is not; or all of them, where its chunks are so large that this is less.
    """
    bricks = bricks_of(volume.size_xyz)
    known = scan is not None and scan.brick_cells == BRICK_CELLS
    told = _Told(progress, len(bricks) if known else 2 * len(bricks))
    ranges = scan.ranges if scan is not None and known else _ranges(volume, bricks, budget_bytes, told)
    meet = _shows(ranges[:, 0], ranges[:, 1], intervals, levels)
    left = [bricks[row] for row in np.flatnonzero(meet).tolist()]
    found: list[Span] = []
    while left:
        outermost = _outermost(left)
        for group in _read_together(volume, outermost, budget_bytes):
            for window in brick_windows(volume, group, budget_bytes=budget_bytes):
                spans = (_shown_in(window.volume, group[row], intervals, levels) for row in window.rows)
                found.extend(span for span in spans if span is not None)
                told.of(len(window.rows))
        looked_at = {brick.index for brick in outermost}
        around = _around(found)
        left = [brick for brick in left if brick.index not in looked_at and not _holds(around, brick)]
    told.all()
    return _around(found)


class _Told:
    """How many bricks are done, for who wants to know."""

    def __init__(self, progress: Callable[[int, int], None] | None, total: int) -> None:
        self._progress, self._done, self._total = progress, 0, total

    def of(self, bricks: int) -> None:
        """Tell of more bricks."""
        self._done += bricks
        if self._progress is not None:
            self._progress(self._done, self._total)

    def all(self) -> None:
        """Tell that there is nothing left to do."""
        self.of(self._total - self._done)


def _ranges(volume: Volume, bricks: Sequence[Brick], budget_bytes: int, told: _Told) -> F64:
    """(B, 2) float64, as `brick_ranges`, each chunk of a file being read once where the budget allows."""
    ranges = np.empty((len(bricks), 2))
    for window in brick_windows(volume, bricks, budget_bytes=budget_bytes):
        rows = list(window.rows)
        ranges[rows] = brick_ranges(window.volume, [bricks[row] for row in rows])
        told.of(len(rows))
    return ranges


def _outermost(bricks: Sequence[Brick]) -> list[Brick]:
    """Those bricks beyond which, along some axis, there are no others."""
    places = np.array([brick.index for brick in bricks])
    outer = ((places == places.min(axis=0)) | (places == places.max(axis=0))).any(axis=1)
    return [bricks[row] for row in np.flatnonzero(outer).tolist()]


def _read_together(volume: Volume, outermost: list[Brick], budget_bytes: int) -> list[list[Brick]]:
    """Those of one face in a group, each in its first; all in one where that reads no more of the file."""
    groups: dict[int, list[Brick]] = {}
    places = np.array([brick.index for brick in outermost])
    sides = np.concatenate([places == places.min(axis=0), places == places.max(axis=0)], axis=1)
    for brick, face in zip(outermost, sides[:, ::-1].argmax(axis=1).tolist(), strict=True):
        groups.setdefault(face, []).append(brick)
    apart = [groups[face] for face in sorted(groups)]
    read = [
        sum(samples_read(volume, group, budget_bytes=budget_bytes) for group in way)
        for way in ([outermost], apart)
    ]
    return apart if read[1] < read[0] else [outermost]


def _shows(low: F64, high: F64, intervals: npt.ArrayLike, levels: npt.ArrayLike) -> Bools:
    """Which ranges of values show something."""
    return ranges_meet(low, high, intervals) | ranges_cross(low, high, levels)


def _shown_in(volume: Volume, brick: Brick, intervals: npt.ArrayLike, levels: npt.ArrayLike) -> Span | None:
    """`shown_span` of the cells of one brick."""
    samples = np.array(volume.array[brick.slices], dtype=np.float64)
    samples[~np.isfinite(samples)] = np.nan
    low = high = samples
    for axis in range(3):
        low, high = _of_pairs(np.minimum, low, axis), _of_pairs(np.maximum, high, axis)
    shown = _shows(low, high, intervals, levels)
    if not shown.any():
        return None
    z, y, x = (np.flatnonzero(shown.any(axis=axes)) for axes in ((1, 2), (0, 2), (0, 1)))
    first = _triple(start + cells[0] for start, cells in zip(brick.start, (x, y, z), strict=True))
    last = _triple(
        min(start + cells[-1] + 1, stop)
        for start, stop, cells in zip(brick.start, brick.stop, (x, y, z), strict=True)
    )
    return first, last


def _of_pairs(ufunc: np.ufunc, values: F64, axis: int) -> F64:
    """Of every sample and the next along an axis; an axis with a single sample has one cell."""
    lines = np.moveaxis(values, axis, 0)
    pairs: F64 = ufunc(lines[:-1], lines[1:]) if len(lines) > 1 else lines
    return np.moveaxis(pairs, 0, axis)


def _around(spans: Sequence[Span]) -> Span | None:
    """The smallest span that holds all of some; None of none."""
    if not spans:
        return None
    firsts, lasts = np.array(spans).swapaxes(0, 1)
    return _triple(firsts.min(axis=0)), _triple(lasts.max(axis=0))


def _holds(span: Span | None, brick: Brick) -> bool:
    """Whether a brick lies in a span."""
    if span is None:
        return False
    return bool(np.less_equal(span[0], brick.start).all() and np.less_equal(brick.stop, span[1]).all())


def _triple(numbers: Iterable[int]) -> Triple:
    x, y, z = (int(number) for number in numbers)
    return x, y, z

"""Ranges of values, as of the field in cells or bricks, against values that are looked for."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from isosample.errors import InputError

if TYPE_CHECKING:
    from isosample.volume.grid import F64

    Bools = npt.NDArray[np.bool_]


def ranges_meet(low: F64, high: F64, intervals: npt.ArrayLike) -> Bools:
    """Tell which ranges have a value in common with one of some intervals.

    Parameters
    ----------
    low, high : (...) float64
        Ends of the ranges, themselves included; one whose low end is NaN, or above its high end, is empty.
    intervals : (N, 2) array_like of float
        Closed intervals, in any order; they may overlap.

    Returns
    -------
    meet : (...) bool

    Raises
    ------
    InputError
        If the array has another shape, or an interval ends before it begins.
    """
    seen = np.asarray(intervals, dtype=np.float64)
    if seen.size == 0:
        return np.zeros(low.shape, dtype=np.bool_)
    if seen.ndim != 2 or seen.shape[1] != 2:
        raise InputError(f"intervals have shape {seen.shape}; expected (N, 2): first and last value.")
    wrong = np.flatnonzero(~(seen[:, 0] <= seen[:, 1]))
    if wrong.size:
        raise InputError(f"intervals[{wrong[0]}] is {seen[wrong[0]].tolist()}; expected first <= last.")
    starts, ends = _merged(seen)
    first = np.searchsorted(ends, low)  # first interval that does not end below the range
    nearest = starts[np.minimum(first, len(starts) - 1)]
    meet: Bools = (first < len(starts)) & (nearest <= high)
    return meet


def ranges_cross(low: F64, high: F64, levels: npt.ArrayLike) -> Bools:
    """Tell which ranges have a part on either side of one of some isovalues, which belong to the upper one.

    As marching cubes tells inside from outside: a field that nowhere is below a value has no isosurface of it.

    Parameters
    ----------
    low, high : (...) float64
        As of `ranges_meet`.
    levels : (N,) array_like of float
        In any order.

    Returns
    -------
    cross : (...) bool
        Whether low < level <= high for one of them.
    """
    ascending = np.sort(np.asarray(levels, dtype=np.float64))
    if ascending.size == 0:
        return np.zeros(low.shape, dtype=np.bool_)
    first = np.searchsorted(ascending, low, side="right")  # the first level above the low end
    cross: Bools = (first < len(ascending)) & (ascending[np.minimum(first, len(ascending) - 1)] <= high)
    return cross


def _merged(intervals: F64) -> tuple[F64, F64]:
    """First and last values of the same intervals joined where they meet, ascending."""
    ordered = intervals[np.argsort(intervals[:, 0], kind="stable")]
    reach = np.maximum.accumulate(ordered[:, 1])
    begins = np.concatenate([[True], ordered[1:, 0] > reach[:-1]])
    return ordered[begins, 0], reach[np.concatenate([begins[1:], [True]])]

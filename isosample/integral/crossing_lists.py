"""The crossings of many rays with the isosurfaces, and where the rays enter and leave the volume."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import numpy.typing as npt

from isosample.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Iterator

F64 = npt.NDArray[np.float64]
I64 = npt.NDArray[np.int64]
Bool = npt.NDArray[np.bool_]

BORDER = -1  # the level of a border point


class CrossingLists(NamedTuple):
    """What N rays meet, ray by ray, in order along each ray: crossings of isosurfaces and border points.

    Attributes
    ----------
    first : (N + 1,) int64
        Entries ``first[n]`` to ``first[n + 1] - 1`` belong to ray n.
    distance : (M,) float64
        Along the ray's unit direction [world], not descending along a ray; entries at one distance stand in
        the order of travel.
    level : (M,) int64
        Level index; −1 at a border point.
    rising : (M,) bool
        Whether the value rises along the ray; at a border point whether the ray enters.
    slope : (M,) float64
        |df/dt| [data units/world], >= 0; NaN where it is not known, and at border points without meaning.
    residual : (M,) float64
        |f − isovalue| of the field at the crossing [data units], >= 0; 0 where the crossing is exact.
    value : (M,) float64
        The field's value at a border point [data units], finite; without meaning at crossings.
    tolerance : (M,) float64
        How far a border point's value may lie on the wrong side of an isovalue [data units], >= 0.
    """

    first: I64
    distance: F64
    level: I64
    rising: Bool
    slope: F64
    residual: F64
    value: F64
    tolerance: F64

    @property
    def ray(self) -> I64:
        """(M,) int64, the ray of every entry."""
        return np.repeat(np.arange(len(self.first) - 1), np.diff(self.first))

    def keep(self, kept: Bool) -> CrossingLists:
        """Return the lists with the entries for which `kept` (M,) is True."""
        count = np.concatenate([[0], np.cumsum(kept)])
        columns: list[Any] = [count[self.first], *(column[kept] for column in self[1:])]
        return CrossingLists._make(columns)


def checked_lists(lists: CrossingLists, level_count: int) -> CrossingLists:
    """Return the lists as contiguous arrays of the documented types.

    Parameters
    ----------
    lists : CrossingLists
    level_count : int
        Number of isovalues K; levels are −1 to K − 1.

    Returns
    -------
    lists : CrossingLists
        The same lists; arrays that are as documented are not copied.

    Raises
    ------
    InputError
        If columns differ in length, a row is out of range (names the first one), or distances descend.
    """
    kinds = (np.int64, np.float64, np.int64, np.bool_, *(np.float64,) * 4)
    pairs: list[tuple[Any, Any]] = list(zip(lists, kinds, strict=True))
    columns = [np.ascontiguousarray(column, dtype=kind) for column, kind in pairs]
    checked = CrossingLists._make(columns)
    first, count = checked.first, len(checked.distance)
    if first.ndim != 1 or not len(first) or first[0] != 0 or first[-1] != count or (np.diff(first) < 0).any():
        raise InputError(f"first must ascend from 0 to the number of entries, {count}; it is {first!r}.")
    for name, column in zip(CrossingLists._fields[1:], columns[1:], strict=True):
        if column.shape != (count,):
            raise InputError(f"{name} has shape {column.shape}; expected ({count},), as distance has.")
    for message, wrong in _faults(checked, level_count):
        if wrong.any():
            row = int(np.flatnonzero(wrong)[0])
            raise InputError(f"entry {row} of the crossing lists {message}.")
    return checked


def _faults(lists: CrossingLists, level_count: int) -> Iterator[tuple[str, Bool]]:
    """What may be wrong with an entry, and at which entries it is."""
    border = lists.level == BORDER
    yield "has a distance that is not finite", ~np.isfinite(lists.distance)
    yield (
        f"has a level that is not -1 to {level_count - 1}",
        (lists.level < BORDER) | (lists.level >= level_count),
    )
    yield "has a slope below 0; give |df/dt|, or NaN", ~border & (lists.slope < 0)
    yield "has an infinite slope", ~border & np.isinf(lists.slope)
    yield (
        "has a residual that is not finite and >= 0",
        ~border & ~((lists.residual >= 0) & np.isfinite(lists.residual)),
    )
    yield "is a border point whose value is not finite", border & ~np.isfinite(lists.value)
    yield "is a border point whose tolerance is not >= 0", border & ~(lists.tolerance >= 0)
    ray, descends = lists.ray, np.zeros(len(border), dtype=np.bool_)
    descends[1:] = (lists.distance[1:] < lists.distance[:-1]) & (ray[1:] == ray[:-1])
    yield "lies in front of the entry before it; sort each ray by distance", descends

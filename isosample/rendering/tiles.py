"""Splitting a picture into tiles whose fragment lists are known to fit."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from isosample.errors import CapacityError

if TYPE_CHECKING:
    from collections.abc import Iterator

I64 = npt.NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class Tile:
    """A rectangle of pixels: first column and row (rows count upwards, as OpenGL does), width, height."""

    x: int
    y: int
    width: int
    height: int

    @property
    def pixel_count(self) -> int:
        """Number of pixels."""
        return self.width * self.height

    def blocks(self, edge: int) -> int:
        """Number of blocks of `edge` pixels a side, counted from the picture's corner, that hold a part of the tile."""
        columns = (self.x + self.width - 1) // edge - self.x // edge + 1
        rows = (self.y + self.height - 1) // edge - self.y // edge + 1
        return columns * rows


def strips(width: int, height: int, max_pixels: int) -> list[Tile]:
    """Cut a picture into strips of whole rows with at most `max_pixels` pixels each.

    Raises
    ------
    CapacityError
        If a single row has more.
    """
    rows = max_pixels // width
    if rows < 1:
        raise CapacityError(
            f"a row of {width} pixels does not fit {max_pixels} list heads; make the picture smaller."
        )
    return [Tile(0, y, width, min(rows, height - y)) for y in range(0, height, rows)]


def tiles_that_fit(tile: Tile, counts: npt.NDArray[np.uint32], capacity: int) -> list[Tile]:
    """Cut a tile so that every part has at most `capacity` fragments.

    Parameters
    ----------
    tile : Tile
    counts : (height, width) uint32
        Fragments per pixel of that tile.
    capacity : int
        Fragments that fit the pool.

    Returns
    -------
    tiles : list of Tile
        They cover `tile`: as many whole rows as fit, or parts of a row where one row is too much.

    Raises
    ------
    CapacityError
        If one pixel alone has more (names it).
    """
    deepest = int(counts.max(initial=0))
    if deepest > capacity:
        row, column = np.unravel_index(int(counts.argmax()), counts.shape)
        raise CapacityError(
            f"pixel ({tile.x + column}, {tile.y + row}) alone has {deepest} fragments, "
            f"but only {capacity} fit; raise the fragment budget or use fewer isovalues."
        )
    per_row = counts.sum(axis=1, dtype=np.int64)
    tiles = []
    for first, last in _runs(per_row, capacity):
        if last - first > 1 or per_row[first] <= capacity:
            tiles.append(Tile(tile.x, tile.y + first, tile.width, last - first))
            continue
        columns = counts[first].astype(np.int64)
        tiles += [Tile(tile.x + a, tile.y + first, b - a, 1) for a, b in _runs(columns, capacity)]
    return tiles


def _runs(counts: I64, capacity: int) -> Iterator[tuple[int, int]]:
    """Greedy runs [first, last) whose sum is at most `capacity`; an entry above it stands alone."""
    first = 0
    total = 0
    for i, count in enumerate(counts.tolist()):
        if i > first and total + count > capacity:
            yield first, i
            first, total = i, 0
        total += count
    yield first, len(counts)

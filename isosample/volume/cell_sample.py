"""A few of a volume's cells, evenly spread: what stands for all of them in estimates."""

from __future__ import annotations

import itertools
import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from isosample.volume.lazy import chunks_of, lazily

if TYPE_CHECKING:
    from collections.abc import Iterator

    from isosample.volume.grid import F64, SampleArray, Volume

NODE = 0.5 - 0.5 / 3.0**0.5
GAUSS = np.array([[1.0 - NODE, NODE], [NODE, 1.0 - NODE]])  # two nodes: exact for squares of linear functions
SLAB_BYTES = 256 << 20  # most of a chunked file that is decoded at once
CELLS = 100_000  # counts of cells are then known to a few percent


class CellSample(NamedTuple):
    """Cells with finite corners, every s-th along each axis.

    Attributes
    ----------
    centre : (N, 3) float64
        Sample index (x, y, z).
    low, high : (N,) float64
        Smallest and largest corner [data units].
    slope : (N,) float64
        Root mean square, over the cell, of the trilinear field's gradient [data units/world].
    share : float
        Cells of the volume that one of them stands for.
    """

    centre: F64
    low: F64
    high: F64
    slope: F64
    share: float


def sample_cells(volume: Volume, most: int = CELLS) -> CellSample:
    """Look at evenly spread cells of a volume, about `most` at most."""
    counts = [max(size - 1, 1) for size in volume.array.shape]
    stride = max(1, math.floor((math.prod(counts) / most) ** (1.0 / 3.0)))
    while math.prod(-(-count // stride) for count in counts) > 2 * most:
        stride += 1
    rows = [_row(corners, z, stride, volume) for z, corners in cell_corners(volume, stride)]
    centre, low, high, slope = (np.concatenate(parts) for parts in zip(*rows, strict=True))
    looked_at = math.prod(-(-count // stride) for count in counts)
    return CellSample(centre, low, high, slope, math.prod(counts) / looked_at)


def cell_corners(volume: Volume, stride: int) -> Iterator[tuple[int, F64]]:
    """Yield the corners of every `stride`-th cell along each axis, in ascending z; one sample is a flat cell.

    Yields
    ------
    z : int
        Of the lower corners.
    corners : (2, 2, 2, R, C) float64
        Samples at the corners [z, y, x] of R by C cells.
    """
    starts = range(0, max(volume.array.shape[0] - 1, 1), stride)
    for z, pair in _pairs(volume, starts):
        yield z, _corners(np.asarray(pair), stride)


def _pairs(volume: Volume, starts: range) -> Iterator[tuple[int, SampleArray]]:
    """Yield pairs of neighbouring slices from every start on; what a chunked file decodes together is read once."""
    samples = lazily(volume.array)
    depth, (count, *edges) = chunks_of(samples)[0], samples.shape
    if depth * math.prod(edges) * samples.dtype.itemsize > SLAB_BYTES:
        depth = 1
    first = last = 0
    for z in starts:
        if min(z + 2, count) > last:
            first, last = z, min(((z + 1) // depth + 1) * depth, count)
            held = samples[first:last]
        yield z, held[z - first : z - first + 2]


def _corners(pair: SampleArray, stride: int) -> F64:
    """(2, 2, 2, R, C) corners of the cells between two slices, or in one."""
    last = [size - 1 for size in pair.shape]
    _, rows, columns = (max(size, 1) for size in last)
    corners = np.empty((2, 2, 2, math.ceil(rows / stride), math.ceil(columns / stride)))
    for z, y, x in itertools.product((0, 1), repeat=3):
        below, left = min(y, last[1]), min(x, last[2])
        corners[z, y, x] = pair[
            min(z, last[0]), below : below + rows : stride, left : left + columns : stride
        ]
    return corners


def _row(corners: F64, z: int, stride: int, volume: Volume) -> tuple[F64, F64, F64, F64]:
    """Centres, smallest and largest corners and slopes of the finite cells at one z."""
    y, x = np.mgrid[: corners.shape[3], : corners.shape[4]] * stride + 0.5
    centre = np.stack([x, y, np.full(x.shape, z + 0.5)], axis=-1)
    finite = np.isfinite(corners).all(axis=(0, 1, 2))
    kept = corners[..., finite]
    squares = np.zeros(kept.shape[3:])
    for axis, spacing in zip((2, 1, 0), volume.spacing, strict=True):
        edges = np.diff(kept, axis=axis).squeeze(axis)
        slopes = np.einsum("aj,bk,jkn->abn", GAUSS, GAUSS, edges)
        squares += np.mean(slopes**2, axis=(0, 1)) / spacing**2
    flat = kept.reshape(8, -1)
    return centre[finite], flat.min(axis=0), flat.max(axis=0), np.sqrt(squares)

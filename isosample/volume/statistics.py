"""Histogram of the finite samples and typical gradients, scanned block by block."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from isosample.errors import InputError
from isosample.volume.cell_sample import cell_corners

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from isosample.volume.grid import F64, Volume

BIN_PER_VALUE = 4096  # an integer volume whose values span no more gets one bin per value
BLOCK_BYTES = 8 << 20  # counting widens samples to 8 bytes: blocks of one-byte samples grow to 64 MiB
GRADIENT_CELLS = 2_000_000  # cells looked at for typical gradients; their median is then known to about 0.1 %


def histogram(volume: Volume, bins: int = 256) -> tuple[npt.NDArray[np.int64], F64]:
    """Count the finite samples in bins of equal width.

    Parameters
    ----------
    volume : Volume
    bins : int
        Number of bins, >= 1. Integer volumes get one bin per value where their values span at most 4096,
        else at most `bins` bins that each hold equally many whole values: unequal ones would show as a comb.

    Returns
    -------
    counts : (B,) int64
    edges : (B + 1,) float64
        In data units; halfway between whole numbers for integers. The last bin includes its upper edge. Bins go
        beyond the range where its values are too close for so many.

    Raises
    ------
    InputError
        If `bins` is below 1 or no sample is finite.
    """
    if bins < 1:
        raise InputError(f"a histogram of {bins} bins is impossible; ask for at least 1.")
    low, high = volume.value_range
    edges = (
        _whole_value_edges(int(low), int(high), bins)
        if volume.array.dtype.kind in "iu"
        else np.linspace(
            low, max(high if high > low else low + 1, low + bins * _least_width(low, high)), bins + 1
        )
    )
    counts = np.zeros(edges.size - 1, dtype=np.int64)
    for block in volume.blocks(BLOCK_BYTES):
        values = block[np.isfinite(block)] if block.dtype.kind == "f" else block.ravel()
        counts += np.histogram(values.astype(np.float64, copy=False), edges.size - 1, (edges[0], edges[-1]))[
            0
        ]
    return counts, edges


def gradient_at_values(volume: Volume, values: Sequence[float]) -> list[float | None]:
    """Return typical gradient magnitudes of the field where it takes given values.

    Parameters
    ----------
    volume : Volume
    values : sequence of N float
        In data units.

    Returns
    -------
    gradients : list of N float or None
        Median over the cells that straddle the value (smallest corner < value <= largest corner) of the
        magnitude of the trilinear field's gradient at the cell's centre, per step from sample to sample
        along each axis [data units/voxel]; None where no cell does.

    Notes
    -----
    At most 2 000 000 cells are looked at: every s-th along each axis, with the smallest s that suffices, so
    that the same volume always gives the same numbers. A value that only a few cells straddle can thus be
    missed in a large volume. Cells with a sample that is not finite are left out.
    """
    found: list[list[F64]] = [[] for _ in values]
    for lowest, highest, magnitude in _sampled_cells(volume):
        for value, slopes in zip(values, found, strict=True):
            slopes.append(magnitude[(lowest < value) & (value <= highest)])
    joined = [np.concatenate([np.empty(0), *slopes]) for slopes in found]
    return [float(np.median(slopes)) if slopes.size else None for slopes in joined]


def _sampled_cells(volume: Volume) -> Iterator[tuple[F64, F64, F64]]:
    """Yield smallest and largest corner and gradient magnitude of the sampled finite cells, slice by slice."""
    cells = [max(size - 1, 1) for size in volume.array.shape]  # a single slice is a cell of no thickness
    stride = 1
    while math.prod(math.ceil(count / stride) for count in cells) > GRADIENT_CELLS:
        stride += 1
    for _, corners in cell_corners(volume, stride):
        kept = corners[..., np.isfinite(corners).all(axis=(0, 1, 2))]
        steps = [np.diff(kept, axis=axis).mean(axis=(0, 1, 2)) for axis in range(3)]
        magnitude: F64 = np.linalg.norm(steps, axis=0)
        yield kept.min(axis=(0, 1, 2)), kept.max(axis=(0, 1, 2)), magnitude


def _least_width(low: float, high: float) -> float:
    """Width of bins whose edges differ in float64, though the sums that give them are rounded."""
    return 4 * float(np.spacing(np.float64(max(abs(low), abs(high)))))


def _whole_value_edges(low: int, high: int, bins: int) -> F64:
    """Edges halfway between whole numbers, equally many whole numbers per bin."""
    span = high - low + 1
    width = 1 if span <= BIN_PER_VALUE else math.ceil(span / bins)
    edges: F64 = low - 0.5 + width * np.arange(math.ceil(span / width) + 1, dtype=np.float64)
    return edges

"""Histogram of the finite samples, scanned block by block."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from isosample.errors import InputError

if TYPE_CHECKING:
    from isosample.volume.grid import F64, Volume

BIN_PER_VALUE = 4096  # an integer volume whose values span no more gets one bin per value
BLOCK_BYTES = 8 << 20  # counting widens samples to 8 bytes: blocks of one-byte samples grow to 64 MiB


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


def _least_width(low: float, high: float) -> float:
    """Width of bins whose edges differ in float64, though the sums that give them are rounded."""
    return 4 * float(np.spacing(np.float64(max(abs(low), abs(high)))))


def _whole_value_edges(low: int, high: int, bins: int) -> F64:
    """Edges halfway between whole numbers, equally many whole numbers per bin."""
    span = high - low + 1
    width = 1 if span <= BIN_PER_VALUE else math.ceil(span / bins)
    edges: F64 = low - 0.5 + width * np.arange(math.ceil(span / width) + 1, dtype=np.float64)
    return edges

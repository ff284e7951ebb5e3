"""One look at blocks of samples: range, and a copy in float64 with a border: compiled, for arrays in memory."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from isosample.compiled import compiled

if TYPE_CHECKING:
    import numpy.typing as npt

    F64 = npt.NDArray[np.float64]
    I64 = npt.NDArray[np.int64]
    Samples = npt.NDArray[Any]

Three = tuple[int, int, int]


@compiled
def block_ranges(samples: Samples, firsts: I64, stops: I64, ranges: F64) -> bool:
    """Fill in the range of each block; tell if all their samples are finite.

    Parameters
    ----------
    samples : (Z, Y, X), C order
    firsts, stops : (B, 3) int64
        First sample (x, y, z) of each block, and the one behind its last.
    ranges : (B, 2) float64
        Out: smallest and largest sample; of any content where not all are finite.

    Notes
    -----
    Smallest and largest samples are looked for column by column, which a core does for many columns at a time, of
    neighbouring blocks together. A number that is not finite shows in the difference to itself.
    """
    all_finite, first = True, 0
    while first < len(ranges):
        x, y, z = firsts[first]
        behind = first + 1
        while behind < len(ranges) and (
            firsts[behind, 0] == stops[behind - 1, 0] - 1
            and firsts[behind, 1] == y
            and firsts[behind, 2] == z
            and stops[behind, 1] == stops[first, 1]
            and stops[behind, 2] == stops[first, 2]
        ):
            behind += 1
        end = stops[behind - 1, 0]
        row = samples[z, y, x:end]
        lows, highs, faults = row.copy(), row.copy(), row - row
        for k in range(z, stops[first, 2]):
            for j in range(y, stops[first, 1]):
                row = samples[k, j, x:end]
                for i in range(len(row)):
                    value = row[i]
                    lows[i] = value if value < lows[i] else lows[i]
                    highs[i] = value if value > highs[i] else highs[i]
                    faults[i] += value - value
        all_finite &= bool((faults == 0).all())
        for block in range(first, behind):
            part = slice(firsts[block, 0] - x, stops[block, 0] - x)
            ranges[block, 0], ranges[block, 1] = lows[part].min(), highs[part].max()
        first = behind
    return all_finite


@compiled
def fill_padded(samples: Samples, first: Three, padded: F64) -> bool:
    """Copy a block of samples; tell if those that were read are finite.

    Parameters
    ----------
    samples : (Z, Y, X), C order
    first : 3 ints
        Sample (x, y, z) that comes first in the copy; it may lie outside.
    padded : (…, …, …) float64
        Out: NaN stands outside the samples and for those that are not finite.
    """
    planes, rows, columns = samples.shape
    depth, height, width = padded.shape
    left, right = max(-first[0], 0), min(columns - first[0], width)
    all_finite = True
    for k in range(depth):
        z = k + first[2]
        for j in range(height):
            y = j + first[1]
            found = padded[k, j]
            if z < 0 or z >= planes or y < 0 or y >= rows:
                found[:] = np.nan
                continue
            found[:left] = np.nan
            found[right:] = np.nan
            row, part = samples[z, y, first[0] + left : first[0] + right], found[left:right]
            faults = 0
            for i in range(len(part)):
                value = np.float64(row[i])
                finite = value - value == 0.0
                part[i] = value if finite else np.nan
                faults += not finite
            all_finite &= faults == 0
    return all_finite

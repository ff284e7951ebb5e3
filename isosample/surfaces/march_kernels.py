"""Marching cubes for all isovalues of a brick at once: compiled, in float64.

Samples are turned into ranks, the number of isovalues that are not above them, once. A cell is crossed by the
isovalues between the smallest and the largest rank of its corners, and a corner is inside isovalue k if its rank
exceeds k: integers, of which a core compares many at a time. Cells that no isovalue crosses are never seen again.

Places of samples are linear indices into the brick with one sample more on each side, so that their neighbours always
exist. Vertices are numbered as they are first met, cell by cell in the order x, y, z, level by level.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from isosample.compiled import compiled
from isosample.surfaces.case_tables import CENTRE_BIT, FACE_CORNERS

if TYPE_CHECKING:
    import numpy.typing as npt

    F64 = npt.NDArray[np.float64]
    I16 = npt.NDArray[np.int16]
    I32 = npt.NDArray[np.int32]
    I64 = npt.NDArray[np.int64]
    U8 = npt.NDArray[np.uint8]

COUNTED_LEVELS = 48  # more isovalues than these are found by bisection, fewer by comparing with each
RANK_BLOCK = 1024  # samples ranked at a time: they and their ranks stay in the first-level cache
COORDINATE_BITS = 6  # of a cell's place along an axis
COORDINATE_MASK = (1 << COORDINATE_BITS) - 1
CASE_SHIFT = 3 * COORDINATE_BITS
FACES: tuple[tuple[int, ...], ...] = tuple(tuple(ring) for ring in FACE_CORNERS.tolist())
CLOSE = 1e-12  # products that differ by less of the larger one are compared with more care,
TINY = 1e-200  # and those that are not larger than this


@compiled
def count_ranks(values: F64, levels: F64, ranks: I16) -> None:
    """Fill in how many of the ascending levels do not exceed each value; 0 for NaN."""
    count = len(levels)
    if count > COUNTED_LEVELS:
        for i in range(len(values)):
            low, high = 0, count
            while low < high:
                middle = (low + high) >> 1
                if values[i] >= levels[middle]:
                    low = middle + 1
                else:
                    high = middle
            ranks[i] = low
        return
    for first in range(0, len(values), RANK_BLOCK):
        part, found = values[first : first + RANK_BLOCK], ranks[first : first + RANK_BLOCK]
        found[:] = 0
        for k in range(count):
            level = levels[k]
            for i in range(len(part)):
                found[i] += part[i] >= level


@compiled
def crossed_cells(
    ranks: I16, usable: U8, extremes: I16, cells: I32, lows: I16, highs: I16, pair_start: I64
) -> int:
    """List the cells that isovalues cross: place, first level, last level + 1; return how many they are.

    Parameters
    ----------
    ranks : (Z + 2, Y + 2, X + 2) int16
    usable : (Z − 1, Y − 1, X − 1) uint8
        Which cells may be crossed; empty where all may.
    extremes : (2, X + 2) int16
        Room for one row.
    cells, lows, highs : (C,) int32, int16, int16
        Out; room for all cells.
    pair_start : (L + 1,) int64
        Out: where the pairs of each level begin among all (cell, level) pairs ordered by level.
    """
    planes, rows, columns = ranks.shape
    smallest, largest = extremes[0], extremes[1]
    pair_start[:] = 0
    count = 0
    for z in range(1, planes - 2):
        for y in range(1, rows - 2):
            a, b = ranks[z, y], ranks[z, y + 1]
            c, d = ranks[z + 1, y], ranks[z + 1, y + 1]
            for x in range(columns):
                smallest[x] = min(min(a[x], b[x]), min(c[x], d[x]))
                largest[x] = max(max(a[x], b[x]), max(c[x], d[x]))
            lowest, highest = smallest[1], largest[1]
            for x in range(1, columns - 1):
                lowest, highest = min(lowest, smallest[x]), max(highest, largest[x])
            if lowest == highest:
                continue
            first = (y - 1) << COORDINATE_BITS | (z - 1) << 2 * COORDINATE_BITS
            for x in range(1, columns - 2):
                low, high = min(smallest[x], smallest[x + 1]), max(largest[x], largest[x + 1])
                if low == high or (usable.size and not usable[z - 1, y - 1, x - 1]):
                    continue
                cells[count] = first + x - 1
                lows[count], highs[count] = low, high
                count += 1
                pair_start[low] += 1
                pair_start[high] -= 1
    crossed = pairs = 0
    for level in range(len(pair_start)):
        crossed += pair_start[level]
        pair_start[level] = pairs
        pairs += crossed
    return count


@compiled
def joined_faces(
    values: F64, first: int, row: int, plane: int, isovalue: float, ambiguous: int, heights: F64
) -> int:
    """Bit `f` is set where the inside corners of ambiguous face `f` of the cell are joined; of others it is any.

    With the isovalue subtracted, a and c on one diagonal and b and d on the other, the saddle of the bilinear
    interpolant is (a c − b d) / (a + c − b − d). The products are the same in both cells at the face.

    `heights` (8,) is room for the values at the corners. What counts is which of the products is larger after
    all four values have been divided by the largest, which keeps the products from overflow and underflow. Each
    rounding moves a product by 2**-53 of it, so that the products of the values themselves tell, unless they agree
    in 12 digits or are tiny (abs(value − isovalue) is below 2**129, see `check_volume`).
    """
    for corner in range(8):
        heights[corner] = values[corner_index(first, row, plane, corner)] - isovalue
    decisions, doubtful = 0, 0
    for face in range(6):
        ring = FACES[face]
        a = heights[ring[0]]
        one, other = a * heights[ring[2]], heights[ring[1]] * heights[ring[3]]
        larger = max(one, other)
        doubtful |= (not (abs(one - other) > CLOSE * larger and larger > TINY)) << face
        decisions |= ((one > other) == (a >= 0.0)) << face
    return decisions if doubtful & ambiguous == 0 else scaled_decisions(heights, ambiguous)


@compiled
def scaled_decisions(heights: F64, ambiguous: int) -> int:
    """Decide as `joined_faces`, by values divided by the largest of the face."""
    decisions = 0
    for face in range(6):
        if ambiguous >> face & 1:
            ring = FACES[face]
            a, b, c, d = heights[ring[0]], heights[ring[1]], heights[ring[2]], heights[ring[3]]
            scale = max(max(abs(a), abs(b)), max(abs(c), abs(d)))
            saddle = (a / scale) * (c / scale) - (b / scale) * (d / scale)
            decisions |= (saddle >= 0.0 if a >= 0.0 else saddle <= 0.0) << face
    return decisions


@compiled
def corner_index(first: int, row: int, plane: int, corner: int) -> int:
    """Place of a corner of the cell whose first sample is given."""
    return first + (corner & 1) + (corner >> 1 & 1) * row + (corner >> 2) * plane


@compiled
def sort_by_level(
    values: F64,
    ranks: I16,
    row: int,
    plane: int,
    levels: F64,
    ambiguous_faces: U8,
    case_of: I16,
    triangle_count: U8,
    cells: I32,
    lows: I16,
    highs: I16,
    pair_start: I64,
    pairs: I32,
    triangle_counts: I64,
) -> int:
    """Order (cell, level) pairs by level, with the case of each, and count triangles.

    Parameters
    ----------
    values, ranks : (N,) float64, int16
    row, plane : int
        From a sample to the next along y and z.
    levels : (L,) float64
    ambiguous_faces, case_of, triangle_count
        Of `MarchTable`.
    cells, lows, highs, pair_start
        As `crossed_cells` leaves them, the first three cut to the number of cells.
    pairs : (P,) int32
        Out: the cell's place with the case in the upper bits.
    triangle_counts : (L,) int64
        Out.

    Returns
    -------
    centre_count : int
        Vertices inside cells, of all levels.
    """
    following, heights = pair_start.copy(), np.empty(8)
    triangle_counts[:] = 0
    centre_count = 0
    for n in range(len(cells)):
        cell = cells[n]
        first = first_sample(cell, row, plane)
        a, b = ranks[first], ranks[first + 1]
        c, d = ranks[first + row], ranks[first + row + 1]
        e, f = ranks[first + plane], ranks[first + plane + 1]
        g, h = ranks[first + plane + row], ranks[first + plane + row + 1]
        for k in range(lows[n], highs[n]):
            signs = (a > k) | (b > k) << 1 | (c > k) << 2 | (d > k) << 3
            signs |= (e > k) << 4 | (f > k) << 5 | (g > k) << 6 | (h > k) << 7
            ambiguous = ambiguous_faces[signs]
            decisions = 0
            if ambiguous:
                decisions = joined_faces(values, first, row, plane, levels[k], ambiguous, heights)
            case = case_of[signs, decisions]
            pairs[following[k]] = cell | np.int32(case) << CASE_SHIFT
            following[k] += 1
            count = triangle_count[case]
            triangle_counts[k] += count & (1 << CENTRE_BIT) - 1
            centre_count += count >> CENTRE_BIT
    return centre_count


@compiled
def first_sample(cell: int, row: int, plane: int) -> int:
    """Place of a cell's first sample in the brick with its border."""
    x = cell & COORDINATE_MASK
    y = cell >> COORDINATE_BITS & COORDINATE_MASK
    z = cell >> 2 * COORDINATE_BITS & COORDINATE_MASK
    return x + 1 + (y + 1) * row + (z + 1) * plane

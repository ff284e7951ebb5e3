"""Marching cubes for all isovalues of a brick at once: compiled, in float64.

Samples are turned into ranks, the number of isovalues that are not above them, once. A cell is crossed by the
isovalues between the smallest and the largest rank of its corners, and a corner is inside isovalue k if its rank
exceeds k: integers, of which a core compares many at a time. Cells that no isovalue crosses are never seen again.

Places of samples are linear indices into the brick with one sample more on each side, so that their neighbours always
exist. Vertices are numbered as they are first met, cell by cell in the order x, y, z, level by level.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from isosample.compiled import compiled
from isosample.surfaces.positions import (
    LARGEST_MANTISSA,
    MANTISSA_BITS,
    POSITION_STEPS,
    SMALLEST_EXPONENT,
    SMALLEST_FRACTION,
)

if TYPE_CHECKING:
    import numpy.typing as npt

    from isosample.surfaces.case_tables import MarchTable

    F32 = npt.NDArray[np.float32]
    F64 = npt.NDArray[np.float64]
    I8 = npt.NDArray[np.int8]
    I16 = npt.NDArray[np.int16]
    I32 = npt.NDArray[np.int32]
    I64 = npt.NDArray[np.int64]
    U8 = npt.NDArray[np.uint8]

COUNTED_LEVELS = 48  # more isovalues than these are found by bisection, fewer by comparing with each
RANK_BLOCK = 1024  # samples ranked at a time: they and their ranks stay in the first-level cache
COORDINATE_BITS = 6  # of a cell's place along an axis
COORDINATE_MASK = (1 << COORDINATE_BITS) - 1
CASE_SHIFT = 3 * COORDINATE_BITS
ROUNDER = 1.5 * 2.0**52  # float64 holds no fractions up there
BOUND = float(LARGEST_MANTISSA)


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
    ranks: I16, usable: U8, smallest: I16, largest: I16, cells: I32, lows: I16, highs: I16, steps: I64
) -> tuple[int, int]:
    """List the cells that isovalues cross: place, first level, last level + 1.

    Parameters
    ----------
    ranks : (Z + 2, Y + 2, X + 2) int16
    usable : (Z − 1, Y − 1, X − 1) uint8
        Which cells may be crossed; empty where all may.
    smallest, largest : (X + 2,) int16
        Room for one row.
    cells, lows, highs : (C,) int32, int16, int16
        Out; room for all cells.
    steps : (L + 1,) int64
        Out, from zeros: their running sum is the number of cells that each level crosses.

    Returns
    -------
    cell_count : int
    crossing_count : int
        How often levels cut the edges between samples.
    """
    planes, rows, columns = ranks.shape
    cell_count, crossing_count = 0, 0
    for z in range(1, planes - 1):
        for y in range(1, rows - 1):
            behind, above = min(y + 1, rows - 2), min(z + 1, planes - 2)  # the row itself behind the last one
            a, b = ranks[z, y], ranks[z, behind]
            c, d = ranks[above, y], ranks[above, behind]
            for x in range(columns):
                smallest[x] = min(min(a[x], b[x]), min(c[x], d[x]))
                largest[x] = max(max(a[x], b[x]), max(c[x], d[x]))
            crossings = np.int32(0)
            for x in range(1, columns - 1):
                crossings += abs(np.int32(b[x]) - np.int32(a[x])) + abs(np.int32(c[x]) - np.int32(a[x]))
            differing = np.int16(0)
            for x in range(1, columns - 2):
                crossings += abs(np.int32(a[x + 1]) - np.int32(a[x]))
                smallest[x] = min(smallest[x], smallest[x + 1])
                largest[x] = max(largest[x], largest[x + 1])
                differing |= smallest[x] ^ largest[x]
            crossing_count += int(crossings)
            if differing == 0 or behind == y or above == z:
                continue
            for x in range(1, columns - 2):
                low, high = smallest[x], largest[x]
                if low == high or (usable.size and not usable[z - 1, y - 1, x - 1]):
                    continue
                cells[cell_count] = x - 1 | y - 1 << COORDINATE_BITS | z - 1 << 2 * COORDINATE_BITS
                lows[cell_count], highs[cell_count] = low, high
                cell_count += 1
                steps[low] += 1
                steps[high] -= 1
    return cell_count, crossing_count


@compiled
def joined_faces(
    values: F64, first: int, row: int, plane: int, isovalue: float, ambiguous: int, faces: I8
) -> int:
    """Bit `f` is set where the inside corners of ambiguous face `f` of the cell are joined.

    With the isovalue subtracted, a and c on one diagonal and b and d on the other, the saddle of the bilinear
    interpolant is (a c − b d) / (a + c − b − d). The products are the same in both cells at the face.
    """
    decisions = 0
    for face in range(6):
        if not ambiguous >> face & 1:
            continue
        a = values[corner_index(first, row, plane, faces[face, 0])] - isovalue
        b = values[corner_index(first, row, plane, faces[face, 1])] - isovalue
        c = values[corner_index(first, row, plane, faces[face, 2])] - isovalue
        d = values[corner_index(first, row, plane, faces[face, 3])] - isovalue
        scale = max(max(abs(a), abs(b)), max(abs(c), abs(d)))
        saddle = (a / scale) * (c / scale) - (b / scale) * (d / scale)
        if (saddle >= 0.0) if a >= 0.0 else (saddle <= 0.0):
            decisions |= 1 << face
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
    table: MarchTable,
    cells: I32,
    lows: I16,
    highs: I16,
    following: I64,
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
    table : MarchTable
    cells, lows, highs
        As `crossed_cells` leaves them, cut to the number of cells.
    following : (L,) int64
        Where the pairs of each level begin; changed.
    pairs : (P,) int32
        Out: the cell's place with the case in the upper bits.
    triangle_counts : (L,) int64
        Out, from zeros.

    Returns
    -------
    centre_count : int
        Vertices inside cells, of all levels.
    """
    ambiguous_faces, case_of, faces = table.ambiguous_faces, table.case_of, table.faces
    triangle_start, centre_edges = table.triangle_start, table.centre_edges
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
                decisions = joined_faces(values, first, row, plane, levels[k], ambiguous, faces)
            case = case_of[signs, decisions]
            pairs[following[k]] = cell | np.int32(case) << CASE_SHIFT
            following[k] += 1
            triangle_counts[k] += triangle_start[case + 1] - triangle_start[case]
            centre_count += centre_edges[case] != 0
    return centre_count


@compiled
def first_sample(cell: int, row: int, plane: int) -> int:
    """Place of a cell's first sample in the brick with its border."""
    x = cell & COORDINATE_MASK
    y = cell >> COORDINATE_BITS & COORDINATE_MASK
    z = cell >> 2 * COORDINATE_BITS & COORDINATE_MASK
    return x + 1 + (y + 1) * row + (z + 1) * plane

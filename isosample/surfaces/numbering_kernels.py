"""Numbers of the vertices of all isovalues of a brick, and the triangles between them: compiled, without any sample."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from isosample.compiled import compiled
from isosample.surfaces.march_kernels import CASE_SHIFT, COORDINATE_BITS, COORDINATE_MASK

if TYPE_CHECKING:
    import numpy.typing as npt

    from isosample.surfaces.case_tables import MarchTable

    I8 = npt.NDArray[np.int8]
    I16 = npt.NDArray[np.int16]
    I32 = npt.NDArray[np.int32]
    I64 = npt.NDArray[np.int64]
    U8 = npt.NDArray[np.uint8]

CELL_MASK = (1 << CASE_SHIFT) - 1
INNER_EDGES = 1 << 3 | 1 << 7 | 1 << 11  # that a cell with cells behind it on all sides has alone
CENTRE_AXIS = 3  # stands for the axis of a vertex inside a cell
POSITIVE = 0xFFFFFF  # spares the compiler the question whether an index counts from the end
RING = 14  # what is kept of a vertex inside a cell: its number, how many surround it, and their numbers
SLOT_PLANES = 6  # edges along x, y in two planes of samples, along z between them, and insides of cells


@compiled
def number_vertices(
    row: int,
    plane: int,
    table: MarchTable,
    fresh_of_cell: I16,
    pairs: I32,
    pair_start: I64,
    slots: I32,
    codes: I32,
    rings: I32,
    triangles: I32,
    vertex_start: I64,
) -> int:
    """Number the vertices of some levels, and fill in the triangles.

    Parameters
    ----------
    row, plane : int
        From a sample to the next along y and z.
    table : MarchTable
    fresh_of_cell : (Z − 1, Y − 1, X − 1) int16
        As `find_fresh_edges` leaves it; empty where all cells may be crossed.
    pairs, pair_start
        As `sort_by_level` leaves them; L + 1 of the latter.
    slots : (6 · plane,) int32
        Room, of any content.
    codes : (V + 1,) int32
        Out: place of the sample below each vertex, with the axis of its grid edge in the upper bits.
    rings : (C, 14) int32
        Out: vertices inside cells, with those around them, counted from the first one of these levels.
    triangles : (T, 3) int32
        Out; vertices are numbered within the level.
    vertex_start : (L + 1,) int64
        Out.

    Returns
    -------
    ring_count : int

    Notes
    -----
    The vertices of grid edges are looked up in slots, of two planes of samples and of the edges between them. A
    grid edge gets its vertex in the first of its cells, of those that may be crossed; which edges these are does
    not depend on the isovalue. So slots need neither be cleared nor asked, and those of edges that are not cut may
    hold anything.
    """
    of_edge, below = np.empty((2, 13), dtype=np.int64), np.empty(13, dtype=np.int32)
    edge_places(table.lower_corner, row, plane, of_edge, below)
    cut_edges, centre_edges, fresh_edges = table.cut_edges, table.centre_edges, table.fresh_edges
    triangle_start, rows = table.triangle_start, table.triangles
    vertex, triangle, ring = 0, 0, 0
    for level in range(len(pair_start) - 1):
        level_start = vertex
        vertex_start[level] = vertex
        for n in range(pair_start[level], pair_start[level + 1]):
            code = pairs[n]
            case, cell = code >> CASE_SHIFT, code & CELL_MASK
            x = code & COORDINATE_MASK
            y = code >> COORDINATE_BITS & COORDINATE_MASK
            z = cell >> 2 * COORDINATE_BITS
            across, odd = y * row + x, z & 1
            if fresh_of_cell.size:
                fresh = int(fresh_of_cell[z, y, x])
            else:
                fresh = int(fresh_edges[(x > 0) | (y > 0) << 1 | (z > 0) << 2])
            cut = int(cut_edges[case])
            if fresh == INNER_EDGES:
                number = vertex - level_start
                codes[vertex] = cell + below[3]
                slots[(of_edge[odd, 3] + across) & POSITIVE] = number
                second = number + (cut >> 3 & 1)
                codes[level_start + second] = cell + below[7]
                slots[(of_edge[odd, 7] + across) & POSITIVE] = second
                third = second + (cut >> 7 & 1)
                codes[level_start + third] = cell + below[11]
                slots[(of_edge[odd, 11] + across) & POSITIVE] = third
                vertex = level_start + third + (cut >> 11 & 1)
            else:
                for edge in range(12):
                    if (fresh & cut) >> edge & 1:
                        codes[vertex] = cell + below[edge]
                        slots[of_edge[odd, edge] + across] = vertex - level_start
                        vertex += 1
            around = int(centre_edges[case])
            if around:
                codes[vertex] = cell + below[12]
                slots[of_edge[odd, 12] + across] = vertex - level_start
                rings[ring, 0] = vertex
                count = 0
                for edge in range(12):
                    if around >> edge & 1:
                        rings[ring, 2 + count] = slots[of_edge[odd, edge] + across] + level_start
                        count += 1
                rings[ring, 1] = count
                vertex += 1
                ring += 1
            for r in range(triangle_start[case], triangle_start[case + 1]):
                triangles[triangle, 0] = slots[(of_edge[odd, rows[r, 0]] + across) & POSITIVE]
                triangles[triangle, 1] = slots[(of_edge[odd, rows[r, 1]] + across) & POSITIVE]
                triangles[triangle, 2] = slots[(of_edge[odd, rows[r, 2]] + across) & POSITIVE]
                triangle += 1
    vertex_start[len(pair_start) - 1] = vertex
    return ring


@compiled
def edge_places(lower_corner: I8, row: int, plane: int, of_edge: I64, below: I32) -> None:
    """Fill in the slots (2, 13) and codes (13,) of a cell's edges and its inside, relative to the cell.

    Slots depend on whether the cell's layer is even or odd.
    """
    for edge in range(12):
        axis, corner = edge >> 2, int(lower_corner[edge])
        x, y, z = corner & 1, corner >> 1 & 1, corner >> 2
        below[edge] = x | y << COORDINATE_BITS | z << 2 * COORDINATE_BITS | axis << CASE_SHIFT
        for odd in range(2):
            which = 4 if axis == 2 else 2 * (odd + z & 1) + axis
            of_edge[odd, edge] = which * plane + y * row + x
    of_edge[:, 12] = 5 * plane
    below[12] = CENTRE_AXIS << CASE_SHIFT


@compiled
def find_fresh_edges(usable: U8, lower_corner: I8, fresh: I16) -> None:
    """Set bit `e` where no cell before this one, of those that may be crossed, has its edge `e`.

    Parameters
    ----------
    usable : (Z − 1, Y − 1, X − 1) uint8
    lower_corner : (12,) int8
    fresh : (Z − 1, Y − 1, X − 1) int16
        Out.
    """
    planes, rows, columns = usable.shape
    for z in range(planes):
        for y in range(rows):
            for x in range(columns):
                found = 0
                for edge in range(12):
                    axis, corner = edge >> 2, int(lower_corner[edge])
                    met = False
                    for other in range(1, 8):
                        if other >> axis & 1:
                            continue
                        i = x + (other & 1) * (2 * (corner & 1) - 1)
                        j = y + (other >> 1 & 1) * (2 * (corner >> 1 & 1) - 1)
                        k = z + (other >> 2) * (2 * (corner >> 2) - 1)
                        before = (k - z) * 4 + (j - y) * 2 + (i - x) < 0
                        if before and i >= 0 and j >= 0 and k >= 0 and i < columns and j < rows:
                            met |= usable[k, j, i] != 0
                    found |= (not met) << edge
                fresh[z, y, x] = found

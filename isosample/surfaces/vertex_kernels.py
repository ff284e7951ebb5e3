"""Vertices and triangles of all isovalues of a brick: compiled, in float64.

First all vertices get their numbers and the triangles are made of them, which needs no sample; then positions and
gradients are computed vertex by vertex, from samples that stand beside their central differences.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from isosample.compiled import compiled
from isosample.surfaces.march_kernels import CASE_SHIFT, COORDINATE_BITS, COORDINATE_MASK
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

CELL_MASK = (1 << CASE_SHIFT) - 1
BLOCK = 128  # vertices that are interpolated at a time, a core taking many at once
INNER_EDGES = 1 << 3 | 1 << 7 | 1 << 11  # that a cell with cells behind it on all sides has alone
CENTRE_AXIS = 3  # stands for the axis of a vertex inside a cell
POSITIVE = 0xFFFFFF  # spares the compiler the question whether an index counts from the end
RING = 14  # what is kept of such a vertex: its number, how many surround it, and their numbers
SLOT_PLANES = (
    6  # edges along x and y in two planes of samples, those along z between them, and insides of cells
)
ROUNDER = 1.5 * 2.0**52  # float64 holds no fractions up there
BOUND = float(LARGEST_MANTISSA)


@compiled
def fill_nodes(padded: F64, nodes: F64) -> None:
    """Put samples and their differences along x, y, z side by side.

    Parameters
    ----------
    padded : (Z + 2, Y + 2, X + 2) float64
        Samples of the brick with its border; NaN outside the volume and where masked.
    nodes : (Z, Y, X, 4) float64
        Out.
    """
    for z in range(nodes.shape[0]):
        for y in range(nodes.shape[1]):
            here, found = padded[z + 1, y + 1], nodes[z, y]
            front, back = padded[z + 1, y], padded[z + 1, y + 2]
            low, high = padded[z, y + 1], padded[z + 2, y + 1]
            for x in range(nodes.shape[2]):
                value = here[x + 1]
                found[x, 0] = value
                found[x, 1] = slope(here[x], value, here[x + 2])
                found[x, 2] = slope(front[x + 1], value, back[x + 1])
                found[x, 3] = slope(low[x + 1], value, high[x + 1])


@compiled
def slope(behind: float, here: float, ahead: float) -> float:
    """Central difference per sample step, one-sided next to NaN, 0 between two NaN."""
    one_sided = (0.0 if math.isnan(behind) else here - behind) if math.isnan(ahead) else ahead - here
    central = 0.5 * (ahead - behind)
    return one_sided if math.isnan(central) else central


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


@compiled
def put_vertices(
    nodes: F64,
    levels: F64,
    codes: I32,
    rings: I32,
    vertex_start: I64,
    start: tuple[int, int, int],
    size: tuple[int, int, int],
    positions: F32,
    gradients: F32,
    keys: I64,
) -> None:
    """Fill in positions, gradients and names of the vertices of all levels.

    Parameters
    ----------
    nodes : (Z, Y, X, 4) float64
        As `fill_nodes` leaves them.
    levels : (L,) float64
    codes, rings, vertex_start
        As `number_vertices` leaves them, cut to their number.
    start, size : 3 ints
        First sample (x, y, z) of the brick, and the number of samples of the volume: they name the vertices.
    positions, gradients, keys
        Out; (V, 3) float32, (V, 3) float32, (V,) int64.
    """
    row = nodes.shape[2]
    plane = nodes.shape[1] * row
    samples = nodes.reshape(-1, 4)
    first = start[0] + size[0] * (start[1] + size[1] * start[2])
    block, strides = np.zeros(8 * BLOCK), np.array([1, row, plane, 0])
    for level in range(len(levels)):
        isovalue = levels[level]
        for begin in range(vertex_start[level], vertex_start[level + 1], BLOCK):
            count = min(BLOCK, vertex_start[level + 1] - begin)
            for i in range(count):
                code = codes[begin + i]
                axis = code >> CASE_SHIFT
                x = code & COORDINATE_MASK
                y = code >> COORDINATE_BITS & COORDINATE_MASK
                z = code >> 2 * COORDINATE_BITS & COORDINATE_MASK
                keys[begin + i] = axis + 3 * (first + x + size[0] * (y + size[1] * z))
                a = x + row * y + plane * z
                b = a + strides[axis]
                for c in range(4):
                    block[i + c * BLOCK] = samples[a, c]
                    block[i + (4 + c) * BLOCK] = samples[b, c]
            interpolate(isovalue, block)
            for i in range(count):
                n = begin + i
                code = codes[n]
                axis = min(code >> CASE_SHIFT, 2)  # of a vertex inside a cell any: it gets its place below
                positions[n, 0] = code & COORDINATE_MASK
                positions[n, 1] = code >> COORDINATE_BITS & COORDINATE_MASK
                positions[n, 2] = code >> 2 * COORDINATE_BITS & COORDINATE_MASK
                positions[n, axis] += np.float32(block[i])
                gradients[n, 0] = block[i + BLOCK]
                gradients[n, 1] = block[i + 2 * BLOCK]
                gradients[n, 2] = block[i + 3 * BLOCK]
    inner_keys = 3 * size[0] * size[1] * size[2]
    for m in range(len(rings)):
        n = rings[m, 0]
        x = codes[n] & COORDINATE_MASK
        y = codes[n] >> COORDINATE_BITS & COORDINATE_MASK
        z = codes[n] >> 2 * COORDINATE_BITS & COORDINATE_MASK
        keys[n] = inner_keys + first + x + size[0] * (y + size[1] * z)
        put_mean(n, rings[m, 2 : 2 + rings[m, 1]], (x, y, z), positions, gradients)


@compiled
def interpolate(isovalue: float, block: F64) -> None:
    """Replace samples and slopes at the ends of edges by the fractions of the way and the gradients there.

    Rows of `BLOCK` numbers: sample and slopes along x, y, z at the lower ends, and the same at the upper ones. In
    the first four rows are the fraction and the gradient afterwards, rounded as vertices are.
    """
    for i in range(BLOCK):
        low = block[i]
        fraction = (isovalue - low) / (block[i + 4 * BLOCK] - low)
        fraction = min(max(fraction, SMALLEST_FRACTION), 1.0 - SMALLEST_FRACTION)
        fraction = whole(fraction * POSITION_STEPS) / POSITION_STEPS
        ax, ay, az = block[i + BLOCK], block[i + 2 * BLOCK], block[i + 3 * BLOCK]
        gx = ax + fraction * (block[i + 5 * BLOCK] - ax)
        gy = ay + fraction * (block[i + 6 * BLOCK] - ay)
        gz = az + fraction * (block[i + 7 * BLOCK] - az)
        bits = np.float64(max(abs(gx), max(abs(gy), abs(gz)))).view(np.int64)
        exponent = max(int(bits >> 52) - 1022, SMALLEST_EXPONENT)
        steps = np.int64((1023 + MANTISSA_BITS - exponent) << 52).view(np.float64)
        step = np.int64((1023 - MANTISSA_BITS + exponent) << 52).view(np.float64)
        block[i] = fraction
        block[i + BLOCK] = mantissa_of(gx * steps) * step + 0.0
        block[i + 2 * BLOCK] = mantissa_of(gy * steps) * step + 0.0
        block[i + 3 * BLOCK] = mantissa_of(gz * steps) * step + 0.0


@compiled
def put_mean(vertex: int, around: I32, corner: tuple[int, int, int], positions: F32, gradients: F32) -> None:
    """Give a vertex inside a cell the means of the positions (rounded) and gradients around it."""
    x, y, z, gx, gy, gz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    count = len(around)
    for m in range(count):
        n = around[m]
        x += positions[n, 0] - corner[0]
        y += positions[n, 1] - corner[1]
        z += positions[n, 2] - corner[2]
        gx += gradients[n, 0]
        gy += gradients[n, 1]
        gz += gradients[n, 2]
    positions[vertex, 0] = corner[0] + whole(x / count * POSITION_STEPS) / POSITION_STEPS
    positions[vertex, 1] = corner[1] + whole(y / count * POSITION_STEPS) / POSITION_STEPS
    positions[vertex, 2] = corner[2] + whole(z / count * POSITION_STEPS) / POSITION_STEPS
    put_gradient(gradients, vertex, gx / count, gy / count, gz / count)


@compiled
def put_gradient(gradients: F32, vertex: int, gx: float, gy: float, gz: float) -> None:
    """Store a gradient rounded to a shared exponent; `positions.round_gradients` is its twin."""
    bits = np.float64(max(abs(gx), max(abs(gy), abs(gz)))).view(np.int64)
    exponent = max(int(bits >> 52) - 1022, SMALLEST_EXPONENT)
    steps = np.int64((1023 + MANTISSA_BITS - exponent) << 52).view(np.float64)
    step = np.int64((1023 - MANTISSA_BITS + exponent) << 52).view(np.float64)
    gradients[vertex, 0] = mantissa_of(gx * steps) * step + 0.0
    gradients[vertex, 1] = mantissa_of(gy * steps) * step + 0.0
    gradients[vertex, 2] = mantissa_of(gz * steps) * step + 0.0


@compiled
def whole(number: float) -> float:
    """Nearest whole number, ties to even, of a number below 2**51."""
    return (number + ROUNDER) - ROUNDER


@compiled
def mantissa_of(steps: float) -> float:
    """Nearest whole number of steps, ties to even, of at most 15 bits."""
    return min(max(whole(steps), -BOUND), BOUND)

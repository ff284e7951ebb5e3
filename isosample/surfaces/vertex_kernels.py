"""Positions and gradients of the vertices of all isovalues of a brick: compiled, in float64.

They are computed vertex by vertex, for the numbers of `numbering_kernels`, from samples that stand beside their central
differences.
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

    F32 = npt.NDArray[np.float32]
    F64 = npt.NDArray[np.float64]
    I32 = npt.NDArray[np.int32]
    I64 = npt.NDArray[np.int64]

BLOCK = 128  # vertices that are interpolated at a time, a core taking many at once
# Samples of a brick for each of its vertices up to which `fill_nodes` pays: it computes the slopes of all samples once,
# without it those of a vertex's two samples are computed with the vertex.
NODES_PER_VERTEX = 2
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
def put_vertices(
    padded: F64,
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
    padded : (Z + 2, Y + 2, X + 2) float64
        As for `fill_nodes`.
    nodes : (Z, Y, X, 4) float64
        As `fill_nodes` leaves them, or empty: then slopes are computed where vertices are, which takes less time
        where there are more than some `NODES_PER_VERTEX` samples for each.
    levels : (L,) float64
    codes, rings, vertex_start
        As `numbering_kernels.number_vertices` leaves them, cut to their number.
    start, size : 3 ints
        First sample (x, y, z) of the brick, and the number of samples of the volume: they name the vertices.
    positions, gradients, keys
        Out; (V, 3) float32, (V, 3) float32, (V,) int64.
    """
    row, plane = padded.shape[2] - 2, (padded.shape[1] - 2) * (padded.shape[2] - 2)
    samples, values = nodes.reshape(-1, 4), padded.reshape(-1)
    first = start[0] + size[0] * (start[1] + size[1] * start[2])
    block, strides = np.zeros(8 * BLOCK), np.array([1, row, plane, 0])
    around, wide = np.zeros(14 * BLOCK), (padded.shape[2], padded.shape[1] * padded.shape[2])
    for level in range(len(levels)):
        isovalue = levels[level]
        for begin in range(vertex_start[level], vertex_start[level + 1], BLOCK):
            count = min(BLOCK, vertex_start[level + 1] - begin)
            part = codes[begin : begin + count]
            if not nodes.size:
                put_around(values, wide, part, around)
                put_slopes(around, block)
            for i in range(count):
                code = part[i]
                axis = code >> CASE_SHIFT
                x = code & COORDINATE_MASK
                y = code >> COORDINATE_BITS & COORDINATE_MASK
                z = code >> 2 * COORDINATE_BITS & COORDINATE_MASK
                keys[begin + i] = axis + 3 * (first + x + size[0] * (y + size[1] * z))
                a = x + row * y + plane * z
                b = a + strides[axis]
                for c in range(4 if nodes.size else 0):
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
def put_around(values: F64, strides: tuple[int, int], codes: I32, around: F64) -> None:
    """Put what slopes at the ends of edges need into columns, one per vertex.

    Seven rows of `BLOCK` numbers for the lower ends, and seven for the upper ones: the sample, and its neighbours
    behind and ahead along x, y, z. `strides` leads from a sample to the next along y and z.
    """
    row, plane = strides
    along = np.array([1, row, plane, 0])
    for i in range(len(codes)):
        code = codes[i]
        x = code & COORDINATE_MASK
        y = code >> COORDINATE_BITS & COORDINATE_MASK
        z = code >> 2 * COORDINATE_BITS & COORDINATE_MASK
        place = x + 1 + row * (y + 1) + plane * (z + 1)
        for end in range(2):
            column = i + end * 7 * BLOCK
            around[column] = values[place]
            around[column + BLOCK] = values[place - 1]
            around[column + 2 * BLOCK] = values[place + 1]
            around[column + 3 * BLOCK] = values[place - row]
            around[column + 4 * BLOCK] = values[place + row]
            around[column + 5 * BLOCK] = values[place - plane]
            around[column + 6 * BLOCK] = values[place + plane]
            place += along[code >> CASE_SHIFT]


@compiled
def put_slopes(around: F64, found: F64) -> None:
    """Fill in samples and slopes along x, y, z at both ends, eight rows, from what `put_around` put side by side."""
    for end in range(2):
        source, target = around[end * 7 * BLOCK :], found[end * 4 * BLOCK :]
        for i in range(BLOCK):
            target[i] = source[i]
        for axis in range(3):
            behind, ahead = (1 + 2 * axis) * BLOCK, (2 + 2 * axis) * BLOCK
            for i in range(BLOCK):
                target[i + (1 + axis) * BLOCK] = slope(source[i + behind], source[i], source[i + ahead])


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
        steps, step = shared_steps(gx, gy, gz)
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
    steps, step = shared_steps(gx, gy, gz)
    gradients[vertex, 0] = mantissa_of(gx * steps) * step + 0.0
    gradients[vertex, 1] = mantissa_of(gy * steps) * step + 0.0
    gradients[vertex, 2] = mantissa_of(gz * steps) * step + 0.0


@compiled
def shared_steps(gx: float, gy: float, gz: float) -> tuple[float, float]:
    """Steps per unit, and the length of a step, of three numbers that share the exponent of the largest."""
    bits = np.float64(max(abs(gx), max(abs(gy), abs(gz)))).view(np.int64)
    exponent = max(int(bits >> 52) - 1022, SMALLEST_EXPONENT)
    steps = np.int64((1023 + MANTISSA_BITS - exponent) << 52).view(np.float64)
    step = np.int64((1023 - MANTISSA_BITS + exponent) << 52).view(np.float64)
    return steps, step


@compiled
def whole(number: float) -> float:
    """Nearest whole number, ties to even, of a number below 2**51."""
    return (number + ROUNDER) - ROUNDER


@compiled
def mantissa_of(steps: float) -> float:
    """Nearest whole number of steps, ties to even, of at most 15 bits."""
    return min(max(whole(steps), -BOUND), BOUND)

"""Vertices and triangles of a brick as small integers: compiled."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from isosample.compiled import compiled
from isosample.surfaces.chunk_numbers import (
    EDGE_NUMBERS,
    EXPLICIT,
    FREE,
    NEGATIVE_ZERO,
    SPARE_BITS,
    STEPS,
    shifted,
    zigzag,
)

if TYPE_CHECKING:
    import numpy.typing as npt

    from isosample.surfaces.mesh import F32, I32, I64

    U8 = npt.NDArray[np.uint8]


@compiled
def find_lattice(positions: F32, keys: I64, lattice: I64) -> None:
    """Fill (first, row, slab, centre): how keys follow from grid samples; 0 where nothing tells."""
    first = row = slab = centre = 0
    previous = reference = -1
    for i in range(len(keys)):
        axis = edge_axis(positions, i)
        if axis < 0 or keys[i] < 0:
            continue
        reference = i if reference < 0 else reference
        if previous >= 0 and row == 0:
            steps = floors(positions, i), floors(positions, previous)
            dy = steps[0][1] - steps[1][1]
            if steps[0][2] == steps[1][2] and dy != 0:
                row = (keys[i] // 3 - keys[previous] // 3 - steps[0][0] + steps[1][0]) // dy
        previous = i
    if reference >= 0:
        x, y, z = floors(positions, reference)
        for i in range(len(keys)):
            u, v, w = floors(positions, i)
            if keys[i] >= 0 and w != z and edge_axis(positions, i) >= 0:
                slab = (keys[i] // 3 - keys[reference] // 3 - (u - x) - row * (v - y)) // (w - z)
                break
        first = keys[reference] // 3 - x - row * y - slab * z
    for i in range(len(keys)):
        if keys[i] >= 0 and edge_axis(positions, i) < 0:
            u, v, w = floors(positions, i)
            centre = keys[i] - (first + u + row * v + slab * w)
            break
    lattice[0], lattice[1], lattice[2], lattice[3] = first, row, slab, centre


@compiled
def floors(positions: F32, i: int) -> tuple[int, int, int]:
    """Whole parts of a position (not negative)."""
    return int(positions[i, 0]), int(positions[i, 1]), int(positions[i, 2])


@compiled
def edge_axis(positions: F32, i: int) -> int:
    """Axis along which alone a position is no whole number; -1 if there is none such, or several."""
    axis = -1
    for a in range(3):
        if positions[i, a] != int(positions[i, a]):
            if axis >= 0:
                return -1
            axis = a
    return axis


@compiled
def vertex_slots(
    positions: F32, keys: I64, lattice: I64, size: I64, slots: I64, fractions: I64
) -> tuple[int, int]:
    """Fill the slots (V,), and one fraction per vertex on an edge or three of others, one after the other.

    Returns the number of fractions and of explicit keys; -1, and a row, for a position between the steps.
    """
    samples = size[0] * size[1] * size[2]
    used = explicit = 0
    for i in range(len(keys)):
        x, y, z = floors(positions, i)
        linear = x + size[0] * (y + size[1] * z)
        place = lattice[0] + x + lattice[1] * y + lattice[2] * z
        kind = edge_axis(positions, i)
        if kind < 0 or keys[i] != 3 * place + kind:
            known = kind < 0 and keys[i] == lattice[3] + place
            kind = FREE if known else EXPLICIT
            explicit += 0 if known else 1
        slots[i] = kind * samples + linear
        for a in range(3):
            if kind < FREE and a != kind:
                continue
            steps = float(positions[i, a]) * STEPS
            whole = int(steps)
            if whole != steps:
                return -1, i
            fractions[used] = whole % STEPS << SPARE_BITS
            used += 1
    return used, explicit


@compiled
def gradient_mantissas(gradients: F32, exponents: I64, mantissas: I64) -> bool:
    """Write gradients as mantissa · 2^(exponent - 15), as differences to the vertex before; tell if that is exact."""
    last = 0
    before = np.zeros(3, dtype=np.int64)
    for i in range(len(gradients)):
        largest = 0.0
        for a in range(3):
            largest = max(largest, abs(float(gradients[i, a])))
        if not largest < math.inf:
            return False
        exponent = math.frexp(largest)[1] if largest > 0.0 else last
        scale = math.ldexp(1.0, 15 - exponent)
        for a in range(3):
            scaled = float(gradients[i, a]) * scale
            whole = int(scaled)
            if whole != scaled:
                return False
            stored = NEGATIVE_ZERO if whole == 0 and math.copysign(1.0, scaled) < 0.0 else whole
            mantissas[a, i] = (stored - shifted(before[a], last - exponent)) & 0xFFFF
            before[a] = whole
        exponents[i] = zigzag(int(exponent - last))
        last = exponent
    return True


@compiled
def cell_codes(triangles: I32, slots: I64, size: I64, cells: I64, codes: I64) -> bool:
    """Write triangles as cells (steps to the next one) and triples of edge numbers; tell if all can be."""
    samples = size[0] * size[1] * size[2]
    corner = np.zeros((3, 4), dtype=np.int64)
    last = 0
    for t in range(len(triangles)):
        for c in range(3):
            slot = int(slots[triangles[t, c]])
            corner[c, 3] = slot // samples
            corner[c, 0], corner[c, 1], corner[c, 2] = coordinates(slot % samples, size)
            if corner[c, 3] > FREE:
                return False
        x, y, z = corner[:, 0].min(), corner[:, 1].min(), corner[:, 2].min()
        code = 0
        for c in range(2, -1, -1):
            u, v, w = corner[c, 0] - x, corner[c, 1] - y, corner[c, 2] - z
            number = edge_number(corner[c, 3], u, v, w)
            if number < 0:
                return False
            code = code * EDGE_NUMBERS + number
        cell = x + size[0] * (y + size[1] * z)
        cells[t] = zigzag(cell - last)
        codes[t] = code
        last = cell
    return True


@compiled
def coordinates(linear: int, size: I64) -> tuple[int, int, int]:
    """Coordinates x, y, z of a linear index."""
    rest = linear // size[0]
    return linear - rest * size[0], rest % size[1], rest // size[1]


@compiled
def edge_number(kind: int, u: int, v: int, w: int) -> int:
    """Number (0 to 11) of the cell's edge along an axis from a corner, 12 of its inside, -1 if there is none."""
    if kind == FREE:
        return 12 if u == 0 and v == 0 and w == 0 else -1
    along = u if kind == 0 else (v if kind == 1 else w)
    first = v if kind == 0 else u
    second = v if kind == 2 else w
    if along != 0 or first > 1 or second > 1:
        return -1
    return 4 * kind + first + 2 * second


@compiled
def corner_steps(triangles: I32, steps: I64) -> None:
    """Write every corner as the difference to the corner before it."""
    last = 0
    for t in range(len(triangles)):
        for c in range(3):
            steps[t, c] = zigzag(int(triangles[t, c]) - last)
            last = int(triangles[t, c])


@compiled
def differences(values: I64, steps: I64) -> None:
    """Write every number as the difference to the one before."""
    last = 0
    for i in range(len(values)):
        steps[i] = zigzag(int(values[i]) - last)
        last = int(values[i])


@compiled
def write_planes(values: I64, width: int, out: U8) -> None:
    """Write the bytes of numbers >= 0, all lowest bytes first, then all next ones."""
    count = len(values)
    for plane in range(width):
        for i in range(count):
            out[plane * count + i] = (values[i] >> (8 * plane)) & 0xFF

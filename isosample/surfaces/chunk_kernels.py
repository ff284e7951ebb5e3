"""Kernels of the chunk codec: vertices and triangles of a brick as small integers, and back.

A vertex is named inside its chunk by a slot: class · (samples of the brick) + (linear index of its grid sample).
Classes 0, 1, 2 lie on the grid edge along that axis from the sample on, 3 and 4 in the cell that starts there; those
of class 4 carry the key that names them in the whole volume, the others have the key that follows from the slot.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from isosample.compiled import compiled

if TYPE_CHECKING:
    import numpy.typing as npt

    from isosample.surfaces.mesh import F32, I32, I64
    from isosample.volume.grid import F64

    U8 = npt.NDArray[np.uint8]

STEPS = 2**19  # positions are multiples of 1/STEPS [voxel]
SPARE_BITS = 5  # three bytes hold a fraction and these
FRACTION_STEP = 2.0**-24
EXPLICIT = 4  # class of vertices whose key is stored
FREE = 3  # class of vertices inside cells
EDGE_NUMBERS = 13  # 12 edges of a cell and its inside
LOWEST_EXPONENT = 200  # of a gradient, with the sign turned
NEGATIVE_ZERO = -(2**15)  # the mantissa that stands for -0.0: others are less than 2^15 in size


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
def shifted(mantissa: int, places: int) -> int:
    """Return mantissa · 2^places, cut at 16 places."""
    if places >= 0:
        return mantissa << min(places, 16)
    return mantissa >> min(-places, 16)


@compiled
def zigzag(value: int) -> int:
    """Small numbers of either sign as small numbers >= 0."""
    return (value << 1) ^ (value >> 63)


@compiled
def unzigzag(code: int) -> int:
    """Undo `zigzag`."""
    return (code >> 1) ^ -(code & 1)


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


@compiled
def step_code(content: U8, at: int, count: int, i: int, width: int) -> int:
    """The i-th of `count` numbers of one or two bytes, whose planes begin at a place of the content."""
    if width == 1:
        return int(content[at + i])
    return int(content[at + i]) | int(content[at + count + i]) << 8


@compiled
def escaped(content: U8, at: int) -> int:
    """The number of four bytes at a place of the content."""
    return (
        int(content[at]) | int(content[at + 1]) << 8 | int(content[at + 2]) << 16 | int(content[at + 3]) << 24
    )


@compiled
def restore_steps(content: U8, at: int, width: int, values: I64) -> None:
    """Undo `differences`; numbers that are too large for their bytes follow behind all others."""
    count, escape = len(values), (1 << 8 * width) - 1
    after = at + width * count
    last = 0
    for i in range(count):
        code = step_code(content, at, count, i, width)
        if code == escape:
            code = escaped(content, after)
            after += 4
        last += unzigzag(code)
        values[i] = last


@compiled
def restore_vertices(
    content: U8, plan: I64, lattice: I64, size: I64, room: I32, positions: F32, keys: I64
) -> bool:
    """Fill positions and keys, and `room` with the vertex of each slot; tell if all is within its bounds.

    `plan` holds the places in the content of slots, fractions and explicit keys, the bytes of a slot, and the
    numbers of fractions and explicit keys. `room` has 4 times the samples of the brick, of any content.
    """
    count, at, width = len(keys), plan[0], plan[3]
    fraction_at, fraction_count, key_at, key_count = plan[1], plan[4], plan[2], plan[5]
    escape, after = (1 << 8 * width) - 1, at + width * count
    size_x, size_y = size[0], size[1]
    samples = size[0] * size[1] * size[2]
    slot = x = y = z = kind = used = explicit = place = 0
    place = lattice[0]
    for i in range(count):
        code = step_code(content, at, count, i, width)
        if code == escape:
            code = escaped(content, after)
            after += 4
        step = unzigzag(code)
        slot += step
        x += step
        if x < 0 or x >= size_x:
            if slot < 0 or slot >= (EXPLICIT + 1) * samples:
                return False
            kind = slot // samples
            rest = slot - kind * samples
            z = rest // (size_x * size_y)
            rest -= z * size_x * size_y
            y = rest // size_x
            x = rest - y * size_x
            place = lattice[0] + lattice[1] * y + lattice[2] * z
        if used + (1 if kind < FREE else 3) > fraction_count:
            return False
        positions[i, 0], positions[i, 1], positions[i, 2] = x, y, z
        if kind < FREE:
            room[slot] = i
            keys[i] = 3 * (place + x) + kind
            positions[i, kind] += fraction_of(content, fraction_at, fraction_count, used)
            used += 1
            continue
        for a in range(3):
            positions[i, a] += fraction_of(content, fraction_at, fraction_count, used + a)
        used += 3
        if kind == FREE:
            room[slot] = i
            keys[i] = lattice[3] + place + x
            continue
        if explicit >= key_count:
            return False
        key = 0
        for plane in range(8):
            key |= int(content[key_at + plane * key_count + explicit]) << (8 * plane)
        keys[i] = key
        explicit += 1
    return True


@compiled
def fraction_of(content: U8, at: int, count: int, i: int) -> float:
    """The i-th fraction [voxel], of three bytes."""
    steps = int(content[at + i]) | int(content[at + count + i]) << 8 | int(content[at + 2 * count + i]) << 16
    return steps * FRACTION_STEP


@compiled
def restore_gradients(
    content: U8, at: int, width: int, mantissa_at: int, powers: F64, gradients: F32
) -> bool:
    """Undo `gradient_mantissas`; `powers` holds 2^(exponent - 15) from the exponent -`LOWEST_EXPONENT` on."""
    x = y = z = last = 0
    count = len(gradients)
    high_at = mantissa_at + 3 * count
    escape, after = (1 << 8 * width) - 1, at + width * count
    for i in range(count):
        code = step_code(content, at, count, i, width)
        if code == escape:
            code = escaped(content, after)
            after += 4
        step = unzigzag(code)
        if step != 0:
            x, y, z = shifted(x, -step), shifted(y, -step), shifted(z, -step)
            last += step
            if last < -LOWEST_EXPONENT or last + LOWEST_EXPONENT >= len(powers):
                return False
        low, high = mantissa_at + i, high_at + i
        x = signed(x + (int(content[low]) | int(content[high]) << 8))
        y = signed(y + (int(content[low + count]) | int(content[high + count]) << 8))
        z = signed(z + (int(content[low + 2 * count]) | int(content[high + 2 * count]) << 8))
        power = powers[last + LOWEST_EXPONENT]
        gradients[i, 0], gradients[i, 1], gradients[i, 2] = x * power, y * power, z * power
        if x == NEGATIVE_ZERO or y == NEGATIVE_ZERO or z == NEGATIVE_ZERO:
            x = write_zero(gradients, i, 0, x)
            y = write_zero(gradients, i, 1, y)
            z = write_zero(gradients, i, 2, z)
    return True


@compiled
def write_zero(gradients: F32, i: int, a: int, mantissa: int) -> int:
    """Write -0.0 where the mantissa says so; return the mantissa, which is then 0."""
    if mantissa != NEGATIVE_ZERO:
        return mantissa
    gradients[i, a] = -0.0
    return 0


@compiled
def signed(code: int) -> int:
    """Lowest 16 bits as a number from -2^15 to 2^15 - 1."""
    return ((code & 0xFFFF) ^ 0x8000) - 0x8000


@compiled
def restore_triangles(
    content: U8, at: int, width: int, code_at: int, vertex_count: int, room: I32, corners: I32, triangles: I32
) -> bool:
    """Undo `cell_codes`; tell if every corner is a vertex.

    `room` holds the vertex of each slot, `corners` (13³, 3) how far the slots of each triple are from the cell.
    """
    count, slots = len(triangles), len(room)
    escape, after = (1 << 8 * width) - 1, at + width * count
    cell = 0
    for t in range(count):
        code = step_code(content, at, count, t, width)
        if code == escape:
            code = escaped(content, after)
            after += 4
        cell += unzigzag(code)
        triple = int(content[code_at + t]) | int(content[code_at + count + t]) << 8
        if triple >= len(corners) or cell < 0:
            return False
        for c in range(3):
            slot = cell + corners[triple, c]
            if slot >= slots:
                return False
            vertex = room[slot]
            if vertex >= vertex_count:
                return False
            triangles[t, c] = vertex
    return True

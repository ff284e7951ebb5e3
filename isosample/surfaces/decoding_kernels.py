"""Vertices and triangles of a brick from small integers: compiled."""

from __future__ import annotations

from typing import TYPE_CHECKING

from isosample.compiled import compiled
from isosample.surfaces.chunk_numbers import (
    EXPLICIT,
    FRACTION_STEP,
    FREE,
    LOWEST_EXPONENT,
    NEGATIVE_ZERO,
    shifted,
    unzigzag,
)

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt

    from isosample.surfaces.mesh import F32, I32, I64
    from isosample.volume.grid import F64

    U8 = npt.NDArray[np.uint8]


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
            if vertex < 0 or vertex >= vertex_count:  # room may hold anything
                return False
            triangles[t, c] = vertex
    return True

"""Vertices and triangles of a brick from small integers: compiled."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from isosample.compiled import compiled
from isosample.surfaces.chunk_numbers import (
    EDGE_NUMBERS,
    EXPLICIT,
    FRACTION_STEP,
    FREE,
    LOWEST_EXPONENT,
    NEGATIVE_ZERO,
    shifted,
    unzigzag,
)

if TYPE_CHECKING:
    import numpy.typing as npt

    from isosample.surfaces.mesh import F32, I32, I64
    from isosample.volume.grid import F64

    Header = Any  # a row of `HEADER_ROW`
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
def restore_vertices(
    content: U8, header: Header, at: int, fraction_at: int, key_at: int, room: I32, positions: F32, keys: I64
) -> bool:
    """Fill positions and keys, and `room` with the vertex of each slot; tell if all is within its bounds.

    `at`, `fraction_at` and `key_at` are the places in the content of slots, fractions and explicit keys. `room` has
    4 times the samples of the brick, of any content.
    """
    count, width = len(keys), int(header.slot_width)
    fraction_count, key_count = int(header.fraction_count), int(header.key_count)
    lattice_row, lattice_slab, lattice_centre = header.lattice[1], header.lattice[2], header.lattice[3]
    escape, after = (1 << 8 * width) - 1, at + width * count
    size_x, size_y = int(header.size[0]), int(header.size[1])
    samples = size_x * size_y * int(header.size[2])
    slot = x = y = z = kind = used = explicit = place = 0
    place = first = header.lattice[0]
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
            place = first + lattice_row * y + lattice_slab * z
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
            keys[i] = lattice_centre + place + x
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
def restore_residuals(content: U8, at: int, packed: bool, residuals: F32) -> None:
    """Fill in residuals, of whose bits the planes are there from `at` on: all, or the upper 16 after the sign."""
    count = len(residuals)
    for i in range(count):
        for a in range(2):
            low = at + a * count + i
            bits = np.uint32(content[low]) | np.uint32(content[low + 2 * count]) << np.uint32(8)
            if packed:
                bits = bits << np.uint32(15)
            else:
                bits |= np.uint32(content[low + 4 * count]) << np.uint32(16)
                bits |= np.uint32(content[low + 6 * count]) << np.uint32(24)
            residuals[i, a] = np.uint32(bits).view(np.float32)


@compiled
def restore_floats(content: U8, at: int, vectors: F32) -> None:
    """Fill in vectors of three numbers, of whose bytes the planes are there from `at` on."""
    count = 3 * len(vectors)
    for i in range(len(vectors)):
        for a in range(3):
            low = at + 3 * i + a
            bits = np.uint32(content[low]) | np.uint32(content[low + count]) << np.uint32(8)
            bits |= np.uint32(content[low + 2 * count]) << np.uint32(16)
            bits |= np.uint32(content[low + 3 * count]) << np.uint32(24)
            vectors[i, a] = np.uint32(bits).view(np.float32)


@compiled
def restore_corners(content: U8, at: int, width: int, vertex_count: int, triangles: I32) -> bool:
    """Undo `corner_steps`; numbers that are too large for their bytes follow behind all others."""
    count, escape = 3 * len(triangles), (1 << 8 * width) - 1
    after = at + width * count
    corner = 0
    for i in range(count):
        code = step_code(content, at, count, i, width)
        if code == escape:
            code = escaped(content, after)
            after += 4
        corner += unzigzag(code)
        if corner < 0 or corner >= vertex_count:
            return False
        triangles[i // 3, i % 3] = corner
    return True


@compiled
def restore_triangles(
    content: U8,
    header: Header,
    at: int,
    code_at: int,
    triples: U8,
    room: I32,
    triangles: I32,
) -> bool:
    """Undo `cell_codes`; tell if every corner is a vertex.

    `room` holds the vertex of each slot, `triples` (13³, 3) the edge numbers of each triple.
    """
    count, width, vertex_count = len(triangles), int(header.step_width), int(header.vertex_count)
    escape, after = (1 << 8 * width) - 1, at + width * count
    row = int(header.size[0])
    plane = row * int(header.size[1])
    slots = 4 * plane * int(header.size[2])
    offsets = np.empty(EDGE_NUMBERS, dtype=np.int64)
    edge_slots(row, plane, slots >> 2, offsets)
    cell = 0
    for t in range(count):
        code = step_code(content, at, count, t, width)
        if code == escape:
            code = escaped(content, after)
            after += 4
        cell += unzigzag(code)
        triple = int(content[code_at + t]) | int(content[code_at + count + t]) << 8
        if triple >= len(triples) or cell < 0 or cell >= slots:
            return False
        for c in range(3):
            slot = cell + offsets[triples[triple, c]]
            if slot >= slots:
                return False
            vertex = room[slot]
            if vertex < 0 or vertex >= vertex_count:  # room may hold anything
                return False
            triangles[t, c] = vertex
    return True


@compiled
def edge_slots(row: int, plane: int, samples: int, offsets: I64) -> None:
    """Fill in how far the slots of a cell's twelve edges and of its inside (13,) are from the cell."""
    for number in range(4):
        first, second = number & 1, number >> 1
        offsets[number] = first * row + second * plane
        offsets[4 + number] = samples + first + second * plane
        offsets[8 + number] = 2 * samples + first + second * row
    offsets[12] = 3 * samples

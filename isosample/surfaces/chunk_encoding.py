"""One brick's piece of one isosurface as a few bytes.

A chunk is a header with the format version, a name and a checksum of its own, and one frame of Zstandard whose
checksum covers the rest. Inside, a vertex on a grid edge is the edge and a fraction in steps of 2^-19 voxel (in a
cell: three fractions); its key follows from the edge; a gradient is three 15-bit mantissas with signs and one
exponent, each as the difference to the vertex before; a triangle is its cell and which edges of the cell it joins,
or, where meshes are refined, three differences of indices. Bytes of the same rank stand together.
"""

from __future__ import annotations

import functools
import struct
import threading
from dataclasses import astuple
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from isosample.errors import InputError
from isosample.surfaces.chunk_header import NO_NAME, check_mesh
from isosample.surfaces.chunk_layout import (
    ABSENT,
    CHUNK_VERSION,
    ERROR_COUNT,
    MAGIC,
    PACKED,
    RAW,
    USUAL_SAMPLES,
    ChunkHeader,
)
from isosample.surfaces.chunk_numbers import EXPLICIT
from isosample.surfaces.scratch import SCRATCH

if TYPE_CHECKING:
    from isosample.surfaces.mesh import F32, I32, I64, BrickMesh

U8 = npt.NDArray[np.uint8]

COMPRESSION_LEVEL = 3


class _Tools(threading.local):
    """A thread's own compressor."""

    def __init__(self) -> None:
        import zstandard

        self.compressor = zstandard.ZstdCompressor(level=COMPRESSION_LEVEL, write_checksum=True)


@functools.cache
def _tools() -> _Tools:
    return _Tools()


def encode(mesh: BrickMesh, *, name: bytes = NO_NAME) -> bytes:
    """Return a mesh as a chunk.

    Parameters
    ----------
    mesh : BrickMesh
        May be empty. Positions are multiples of 2^-19 voxel, not negative.
    name : 32 bytes
        Kept in the chunk; `decode` can check it.

    Raises
    ------
    InputError
        If a position is none of these.

    Notes
    -----
    Whatever the gradients, residuals and keys are, they come back bit for bit. They need few bytes where gradients
    have 15-bit mantissas relative to their largest component, residuals 8-bit mantissas, and keys name grid edges
    (see `BrickMesh`): as extraction makes them.
    """
    from isosample.surfaces import encoding_kernels as kernels

    vertex_count, triangle_count = len(mesh.positions), len(mesh.triangles)
    check_mesh(mesh)
    size = np.full(3, USUAL_SAMPLES, dtype=np.int64)
    if vertex_count:
        size = np.maximum(size, mesh.positions.max(axis=0).astype(np.int64) + 1)
    lattice = np.zeros(4, dtype=np.int64)
    kernels.find_lattice(mesh.positions, mesh.edge_keys, lattice)
    slots, fractions = np.empty(vertex_count, np.int64), np.empty(3 * vertex_count, np.int64)
    used, explicit = kernels.vertex_slots(mesh.positions, mesh.edge_keys, lattice, size, slots, fractions)
    if used < 0:
        raise InputError(
            f"vertex {explicit} at {mesh.positions[explicit].tolist()} is not on a multiple of 2^-19 voxel; "
            "only meshes as extraction makes them can be kept."
        )
    slot_steps = np.empty_like(slots)
    kernels.differences(slots, slot_steps)
    slot_width, slot_escapes, slot_planes = _steps(slot_steps)
    gradient_mode, exponent_width, exponent_escapes, gradient_planes = _gradient_planes(mesh.gradients)
    residual_mode, residual_planes = _residual_planes(mesh.residuals)
    triangle_mode, step_width, step_escapes, triangle_planes = _triangle_planes(mesh.triangles, slots, size)
    sections = [
        slot_planes,
        _planes(fractions[:used], 3),
        gradient_planes,
        residual_planes,
        _byte_planes(mesh.edge_keys[slots >= EXPLICIT * int(size.prod())]),
        triangle_planes,
        np.frombuffer(struct.pack(f"<{ERROR_COUNT}d", *astuple(mesh.error)) if mesh.error else b"", np.uint8),
    ]
    frame, content_bytes = _compressed(sections)
    header = ChunkHeader(
        magic=MAGIC,
        version=CHUNK_VERSION,
        gradients=gradient_mode,
        residuals=residual_mode,
        triangles=triangle_mode,
        has_error=int(mesh.error is not None),
        slot_width=slot_width,
        exponent_width=exponent_width,
        step_width=step_width,
        name=name,
        isovalue=mesh.isovalue,
        brick=mesh.brick,
        start=mesh.start,
        lattice=tuple(lattice.tolist()),
        size=tuple(size.tolist()),
        vertex_count=vertex_count,
        triangle_count=triangle_count,
        fraction_count=used,
        key_count=explicit,
        slot_escapes=slot_escapes,
        exponent_escapes=exponent_escapes,
        step_escapes=step_escapes,
        content_bytes=content_bytes,
        frame_bytes=len(frame),
    )
    return header.packed() + frame


def _planes(values: I64, width: int) -> U8:
    """Return the bytes of numbers >= 0 by rank, as many ranks as are asked for."""
    from isosample.surfaces import encoding_kernels as kernels

    out = np.empty(width * values.size, dtype=np.uint8)
    kernels.write_planes(values.reshape(-1), width, out)
    return out


def _steps(values: I64) -> tuple[int, int, U8]:
    """Return differences in one or two bytes each: how many, and of how many the bytes follow behind all others."""
    escapes = values[values >= 255]
    width = 1
    if 8 * escapes.size > values.size:
        escapes, width = values[values >= 65535], 2
    planes = _planes(np.minimum(values, (1 << 8 * width) - 1), width)
    return width, escapes.size, np.concatenate([planes, escapes.astype("<u4").view(np.uint8)])


def _byte_planes(values: npt.NDArray[np.generic]) -> U8:
    """Return the bytes of any numbers by rank."""
    flat = np.ascontiguousarray(values).reshape(-1)
    return np.ascontiguousarray(flat.view(np.uint8).reshape(flat.size, flat.itemsize).T).reshape(-1)


def _gradient_planes(gradients: F32) -> tuple[int, int, int, U8]:
    """Return how gradients are stored, the bytes per exponent, how many exponents need more, and all bytes."""
    from isosample.surfaces import encoding_kernels as kernels

    exponents, mantissas = np.empty(len(gradients), np.int64), np.empty((3, len(gradients)), np.int64)
    if not kernels.gradient_mantissas(gradients, exponents, mantissas):
        return RAW, 1, 0, _byte_planes(gradients)
    width, escapes, planes = _steps(exponents)
    return PACKED, width, escapes, np.concatenate([planes, _planes(mantissas, 2)])


def _residual_planes(residuals: F32) -> tuple[int, U8]:
    """Return how residuals are stored, and their bytes."""
    if not residuals.any() and not np.signbit(residuals).any():
        return ABSENT, np.empty(0, np.uint8)
    bits = np.ascontiguousarray(residuals.T).view(np.uint32)
    if ((bits & 0x80007FFF) == 0).all():
        return PACKED, _byte_planes((bits >> 15).astype(np.uint16))
    return RAW, _byte_planes(bits)


def _triangle_planes(triangles: I32, slots: I64, size: I64) -> tuple[int, int, int, U8]:
    """Return how triangles are stored, the bytes per step, how many steps need more, and all bytes."""
    from isosample.surfaces import encoding_kernels as kernels

    cells, codes = np.empty(len(triangles), np.int64), np.empty(len(triangles), np.int64)
    if kernels.cell_codes(triangles, slots, size, cells, codes) and _all_different(slots, size):
        width, escapes, planes = _steps(cells)
        return PACKED, width, escapes, np.concatenate([planes, _planes(codes, 2)])
    steps = np.empty((len(triangles), 3), np.int64)
    kernels.corner_steps(triangles, steps)
    return (RAW, *_steps(steps.reshape(-1)))


def _all_different(slots: I64, size: I64) -> bool:
    """Tell whether every vertex has a slot of its own that names it."""
    room, numbers = (
        SCRATCH.room("vertex of slot", 4 * int(size.prod()), np.int32),
        np.arange(len(slots), dtype=np.int32),
    )
    if slots.size and slots.max() >= len(room):
        return False
    room[slots] = numbers
    return bool((room[slots] == numbers).all())


def _compressed(sections: list[U8]) -> tuple[bytes, int]:
    """Return one frame of all sections, each in blocks of its own, and the bytes before compression."""
    import zstandard

    total = sum(section.size for section in sections)
    compressor = _tools().compressor.compressobj(size=total)
    parts = []
    for section in sections:
        if section.size:
            parts.append(compressor.compress(section.data))
            parts.append(compressor.flush(zstandard.COMPRESSOBJ_FLUSH_BLOCK))
    parts.append(compressor.flush())
    return b"".join(parts), total

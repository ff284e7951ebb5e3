"""One brick's piece of one isosurface as a few bytes, and back bit for bit.

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
from typing import TYPE_CHECKING, NamedTuple, TypeVar

import numpy as np
import numpy.typing as npt

from isosample.errors import CacheError, InputError
from isosample.surfaces.chunk_header import (
    CHECK,
    ERROR_NAMES,
    NO_NAME,
    check_mesh,
    check_name,
    mesh_error,
    sealed,
    unsealed,
)
from isosample.surfaces.mesh import BrickMesh, no_residuals

if TYPE_CHECKING:
    from isosample.surfaces.mesh import F32, I32, I64

U8 = npt.NDArray[np.uint8]
N = TypeVar("N", bound=np.generic)

CHUNK_VERSION = 3
COMPRESSION_LEVEL = 3
USUAL_SAMPLES = 33  # along each axis of a brick
_MAGIC = b"isochunk"
_ERRORS = len(ERROR_NAMES)
_HEADER = struct.Struct("<8sH7B32sd3i3i4q3H9I")
_HEAD_BYTES = _HEADER.size + CHECK.size
_RAW, _PACKED, _ABSENT = 0, 1, 2  # how gradients, residuals and triangles are stored


class _Header(NamedTuple):
    """What the first bytes of a chunk say, in their order."""

    magic: bytes
    version: int
    gradients: int
    residuals: int
    triangles: int
    has_error: int
    slot_width: int
    exponent_width: int
    step_width: int
    name: bytes
    isovalue: float
    brick: tuple[int, int, int]
    start: tuple[int, int, int]
    lattice: tuple[int, ...]
    size: tuple[int, ...]
    vertex_count: int
    triangle_count: int
    fraction_count: int
    key_count: int
    slot_escapes: int
    exponent_escapes: int
    step_escapes: int
    content_bytes: int
    frame_bytes: int

    def packed(self) -> bytes:
        flat = (*self[:11], *self.brick, *self.start, *self.lattice, *self.size, *self[15:])
        return sealed(_HEADER.pack(*flat))

    @classmethod
    def read(cls, data: bytes) -> _Header:
        """Return the header of a chunk; raise `CacheError` if it is none, of another version or damaged."""
        flat = unsealed(data, _HEADER, magic=_MAGIC, version=CHUNK_VERSION)
        header = cls._make((*flat[:11], flat[11:14], flat[14:17], flat[17:21], flat[21:24], *flat[24:]))
        if len(data) != _HEAD_BYTES + header.frame_bytes:
            raise CacheError(f"it has {len(data)} bytes, expected {_HEAD_BYTES + header.frame_bytes}.")
        return header


class ChunkSummary(NamedTuple):
    """What a chunk's header tells without decoding it."""

    name: bytes
    isovalue: float
    brick: tuple[int, int, int]
    vertex_count: int
    triangle_count: int


class _Tools(threading.local):
    """A thread's own (de)compressor, and room that every chunk uses again."""

    def __init__(self) -> None:
        import zstandard

        self.compressor = zstandard.ZstdCompressor(level=COMPRESSION_LEVEL, write_checksum=True)
        self.decompressor = zstandard.ZstdDecompressor()
        self.vertex_of_slot: I32 = np.empty(0, dtype=np.int32)

    def room(self, count: int) -> I32:
        if len(self.vertex_of_slot) < count:
            self.vertex_of_slot = np.zeros(count, dtype=np.int32)
        return self.vertex_of_slot[:count]


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
    from isosample.surfaces import chunk_kernels as kernels

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
        _byte_planes(mesh.edge_keys[slots >= kernels.EXPLICIT * int(size.prod())]),
        triangle_planes,
        np.frombuffer(struct.pack(f"<{_ERRORS}d", *astuple(mesh.error)) if mesh.error else b"", np.uint8),
    ]
    frame, content_bytes = _compressed(sections)
    header = _Header(
        magic=_MAGIC,
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


def summary(data: bytes) -> ChunkSummary:
    """Return what the header of a chunk tells; raises as `decode` for a header that is damaged."""
    header = _Header.read(data)
    return ChunkSummary(
        header.name, header.isovalue, header.brick, header.vertex_count, header.triangle_count
    )


def decode(data: bytes, *, name: bytes | None = None) -> BrickMesh:
    """Return the mesh of a chunk.

    Parameters
    ----------
    data : bytes
        What `encode` gave.
    name : 32 bytes, optional
        That the chunk must have.

    Raises
    ------
    OtherVersionError
        If the chunk is of another format version.
    CacheError
        If it is damaged, or has another name.
    """
    import zstandard

    from isosample.surfaces import chunk_kernels as kernels

    header = _Header.read(data)
    check_name(header.name, name)
    frame = memoryview(data)[_HEAD_BYTES:]
    try:
        size_bytes = zstandard.frame_content_size(frame)  # before so much is allocated
        content = _tools().decompressor.decompress(frame) if size_bytes == header.content_bytes else b""
    except zstandard.ZstdError as error:
        raise CacheError(f"its content does not match its checksum ({error}).") from error
    if len(content) != header.content_bytes:
        raise CacheError(f"its content has {size_bytes} bytes, expected {header.content_bytes}.")
    reader = _Reader(content)
    count, size = header.vertex_count, np.array(header.size, dtype=np.int64)
    slots = reader.skip(count * header.slot_width + 4 * header.slot_escapes)
    fractions = reader.skip(3 * header.fraction_count)
    gradients = _gradients(header, reader)
    residuals = _residuals(header, reader)
    explicit = reader.skip(8 * header.key_count)
    positions, keys = np.empty((count, 3), np.float32), np.empty(count, np.int64)
    room = _tools().room(4 * int(size.prod()))
    plan = np.array(
        (slots, fractions, explicit, header.slot_width, header.fraction_count, header.key_count),
        dtype=np.int64,
    )
    lattice = np.array(header.lattice, dtype=np.int64)
    if not kernels.restore_vertices(reader.content, plan, lattice, size, room, positions, keys):
        raise CacheError("its vertices do not fit together.")
    triangles = _triangles(header, reader, room)
    measured = None
    if header.has_error:
        figures = struct.unpack(f"<{_ERRORS}d", reader.take(8 * _ERRORS).tobytes())
        measured = mesh_error(figures)
    return BrickMesh(
        isovalue=header.isovalue,
        brick=header.brick,
        start=header.start,
        positions=positions,
        gradients=gradients,
        edge_keys=keys,
        triangles=triangles,
        residuals=residuals,
        error=measured,
    )


class _Reader:
    """Takes sections off the content, one after the other."""

    def __init__(self, content: bytes) -> None:
        self.content = np.frombuffer(content, dtype=np.uint8)
        self.at = 0

    def skip(self, count: int) -> int:
        """Return where a section begins, and go behind it."""
        self.at += count
        if self.at > len(self.content):
            raise CacheError(f"its content has {len(self.content)} bytes, fewer than its header says.")
        return self.at - count

    def take(self, count: int) -> U8:
        """Return a section, and go behind it."""
        start = self.skip(count)
        return self.content[start : start + count]


def _planes(values: I64, width: int) -> U8:
    """Return the bytes of numbers >= 0 by rank, as many ranks as are asked for."""
    from isosample.surfaces import chunk_kernels as kernels

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


def _from_bytes(reader: _Reader, count: int, dtype: type[N]) -> npt.NDArray[N]:
    """Undo `_byte_planes`."""
    width = np.dtype(dtype).itemsize
    return np.ascontiguousarray(reader.take(count * width).reshape(width, count).T).reshape(-1).view(dtype)


def _gradient_planes(gradients: F32) -> tuple[int, int, int, U8]:
    """Return how gradients are stored, the bytes per exponent, how many exponents need more, and all bytes."""
    from isosample.surfaces import chunk_kernels as kernels

    exponents, mantissas = np.empty(len(gradients), np.int64), np.empty((3, len(gradients)), np.int64)
    if not kernels.gradient_mantissas(gradients, exponents, mantissas):
        return _RAW, 1, 0, _byte_planes(gradients)
    width, escapes, planes = _steps(exponents)
    return _PACKED, width, escapes, np.concatenate([planes, _planes(mantissas, 2)])


def _gradients(header: _Header, reader: _Reader) -> F32:
    """Undo `_gradient_planes`."""
    from isosample.surfaces import chunk_kernels as kernels

    count = header.vertex_count
    if header.gradients == _RAW:
        return _from_bytes(reader, 3 * count, np.float32).reshape(count, 3)
    exponents = reader.skip(count * header.exponent_width + 4 * header.exponent_escapes)
    mantissas = reader.skip(6 * count)
    gradients = np.empty((count, 3), dtype=np.float32)
    if not kernels.restore_gradients(
        reader.content, exponents, header.exponent_width, mantissas, _powers(), gradients
    ):
        raise CacheError("a gradient of it is no float32.")
    return gradients


@functools.cache
def _powers() -> npt.NDArray[np.float64]:
    """2^(exponent - 15) of every exponent that a float32 can have."""
    from isosample.surfaces.chunk_kernels import LOWEST_EXPONENT

    return np.ldexp(1.0, np.arange(-LOWEST_EXPONENT, 130) - 15)


def _residual_planes(residuals: F32) -> tuple[int, U8]:
    """Return how residuals are stored, and their bytes."""
    if not residuals.any() and not np.signbit(residuals).any():
        return _ABSENT, np.empty(0, np.uint8)
    bits = np.ascontiguousarray(residuals.T).view(np.uint32)
    if ((bits & 0x80007FFF) == 0).all():
        return _PACKED, _byte_planes((bits >> 15).astype(np.uint16))
    return _RAW, _byte_planes(bits)


def _residuals(header: _Header, reader: _Reader) -> F32:
    """Undo `_residual_planes`."""
    count = header.vertex_count
    if header.residuals == _ABSENT:
        return no_residuals(count)
    bits: npt.NDArray[np.uint32]
    if header.residuals == _PACKED:
        bits = _from_bytes(reader, 2 * count, np.uint16).astype(np.uint32) << np.uint32(15)
    else:
        bits = _from_bytes(reader, 2 * count, np.uint32)
    return np.ascontiguousarray(bits.view(np.float32).reshape(2, count).T)


def _triangle_planes(triangles: I32, slots: I64, size: I64) -> tuple[int, int, int, U8]:
    """Return how triangles are stored, the bytes per step, how many steps need more, and all bytes."""
    from isosample.surfaces import chunk_kernels as kernels

    cells, codes = np.empty(len(triangles), np.int64), np.empty(len(triangles), np.int64)
    if kernels.cell_codes(triangles, slots, size, cells, codes) and _all_different(slots, size):
        width, escapes, planes = _steps(cells)
        return _PACKED, width, escapes, np.concatenate([planes, _planes(codes, 2)])
    steps = np.empty((len(triangles), 3), np.int64)
    kernels.corner_steps(triangles, steps)
    return (_RAW, *_steps(steps.reshape(-1)))


def _all_different(slots: I64, size: I64) -> bool:
    """Tell whether every vertex has a slot of its own that names it."""
    room, numbers = _tools().room(4 * int(size.prod())), np.arange(len(slots), dtype=np.int32)
    if slots.size and slots.max() >= len(room):
        return False
    room[slots] = numbers
    return bool((room[slots] == numbers).all())


def _triangles(header: _Header, reader: _Reader, room: I32) -> I32:
    """Undo `_triangle_planes`; `room` holds the vertex of each slot."""
    from isosample.surfaces import chunk_kernels as kernels

    count, width = header.triangle_count, header.step_width
    triangles = np.empty((count, 3), dtype=np.int32)
    if header.triangles == _RAW:
        corners = np.empty(3 * count, np.int64)
        steps = reader.skip(3 * count * width + 4 * header.step_escapes)
        kernels.restore_steps(reader.content, steps, width, corners)
        triangles.reshape(-1)[:] = corners
        return triangles
    cells = reader.skip(count * width + 4 * header.step_escapes)
    codes = reader.skip(2 * count)
    table = _corner_table(header.size)
    if not kernels.restore_triangles(
        reader.content, cells, width, codes, header.vertex_count, room, table, triangles
    ):
        raise CacheError("a triangle of it has a corner that is no vertex.")
    return triangles


@functools.lru_cache(maxsize=16)
def _corner_table(size: tuple[int, ...]) -> I32:
    """(13³, 3) int32, slots of the corners of a triple of edge numbers, relative to the cell."""
    from isosample.surfaces.chunk_kernels import EDGE_NUMBERS

    samples = size[0] * size[1] * size[2]
    steps = (1, size[0], size[0] * size[1])
    offsets = []
    for axis in range(3):
        first, second = (steps[other] for other in range(3) if other != axis)
        offsets += [axis * samples + a * first + b * second for b in (0, 1) for a in (0, 1)]
    codes = np.arange(EDGE_NUMBERS**3)
    numbers = np.stack([codes // EDGE_NUMBERS**corner % EDGE_NUMBERS for corner in range(3)], axis=1)
    table: I32 = np.array([*offsets, 3 * samples], dtype=np.int32)[numbers]
    return table


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

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
import zlib
from dataclasses import astuple, fields
from typing import TYPE_CHECKING, NamedTuple, TypeVar

import numpy as np
import numpy.typing as npt

from isosample.errors import CacheError, InputError
from isosample.surfaces.mesh import BrickMesh
from isosample.surfaces.mesh_error import MeshError

if TYPE_CHECKING:
    from isosample.surfaces.mesh import F32, I32, I64

U8 = npt.NDArray[np.uint8]
N = TypeVar("N", bound=np.generic)

CHUNK_VERSION = 3
NO_NAME = b"\0" * 32
COMPRESSION_LEVEL = 3
_MAGIC = b"isochunk"
_ERROR_NAMES = tuple(field.name for field in fields(MeshError))
_ERRORS = len(_ERROR_NAMES)
_HEADER = struct.Struct("<8sH7B32sd3i3i4q3H6I")
_CHECK = struct.Struct("<I")
_HEAD_BYTES = _HEADER.size + _CHECK.size
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
    content_bytes: int
    frame_bytes: int

    def packed(self) -> bytes:
        flat = (*self[:11], *self.brick, *self.start, *self.lattice, *self.size, *self[15:])
        data = _HEADER.pack(*flat)
        return data + _CHECK.pack(zlib.crc32(data))

    @classmethod
    def read(cls, data: bytes) -> _Header:
        """Return the header of a chunk; raise `CacheError` if it is none, of another version or damaged."""
        if len(data) < _HEAD_BYTES or data[:8] != _MAGIC:
            raise CacheError(
                f"it has {len(data)} bytes and is no chunk of a mesh cache, or its start is lost."
            )
        version = int.from_bytes(data[8:10], "little")
        if version != CHUNK_VERSION:
            raise OtherVersionError(
                f"it has format version {version}; this program reads and writes {CHUNK_VERSION}."
            )
        if _CHECK.unpack_from(data, _HEADER.size)[0] != zlib.crc32(data[: _HEADER.size]):
            raise CacheError("its header does not match its checksum.")
        flat = _HEADER.unpack_from(data)
        header = cls._make((*flat[:11], flat[11:14], flat[14:17], flat[17:21], flat[21:24], *flat[24:]))
        if len(data) != _HEAD_BYTES + header.frame_bytes:
            raise CacheError(f"it has {len(data)} bytes, expected {_HEAD_BYTES + header.frame_bytes}.")
        return header


class OtherVersionError(CacheError):
    """A chunk is of another format version."""


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
    _check_mesh(mesh)
    size = (
        np.ones(3, dtype=np.int64) if vertex_count == 0 else mesh.positions.max(axis=0).astype(np.int64) + 1
    )
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
    slot_width, slot_planes = _planes(slot_steps)
    gradient_mode, exponent_width, gradient_planes = _gradient_planes(mesh.gradients)
    residual_mode, residual_planes = _residual_planes(mesh.residuals)
    triangle_mode, step_width, triangle_planes = _triangle_planes(mesh.triangles, slots, size)
    sections = [
        slot_planes,
        _planes(fractions[:used], 3)[1],
        gradient_planes,
        residual_planes,
        _byte_planes(mesh.edge_keys[slots >= kernels.EXPLICIT * int(size.prod())]),
        triangle_planes,
        np.frombuffer(struct.pack(f"<{_ERRORS}d", *astuple(mesh.error)) if mesh.error else b"", np.uint8),
    ]
    frame, content_bytes = _compressed(sections)
    header = _Header(
        _MAGIC,
        CHUNK_VERSION,
        gradient_mode,
        residual_mode,
        triangle_mode,
        int(mesh.error is not None),
        slot_width,
        exponent_width,
        step_width,
        name,
        mesh.isovalue,
        mesh.brick,
        mesh.start,
        tuple(lattice.tolist()),
        tuple(size.tolist()),
        vertex_count,
        triangle_count,
        used,
        explicit,
        content_bytes,
        len(frame),
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
    if name is not None and header.name != name:
        raise CacheError(f"it is named {header.name.hex()}, expected {name.hex()}.")
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
    slots = np.empty(count, np.int64)
    kernels.read_steps(reader.planes(count, header.slot_width), header.slot_width, slots)
    fractions = np.empty(header.fraction_count, np.int64)
    kernels.read_planes(reader.planes(header.fraction_count, 3), 3, fractions)
    positions, keys = np.empty((count, 3), np.float32), np.empty(count, np.int64)
    gradients = _gradients(header, reader)
    residuals = _residuals(header, reader)
    explicit = _from_bytes(reader, header.key_count, np.int64)
    kernels.place_vertices(
        slots, fractions, np.array(header.lattice, dtype=np.int64), size, explicit, positions, keys
    )
    triangles = _triangles(header, reader, slots, size)
    measured = None
    if header.has_error:
        figures = struct.unpack(f"<{_ERRORS}d", reader.take(8 * _ERRORS).tobytes())
        measured = MeshError(**dict(zip(_ERROR_NAMES, figures, strict=True)))
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

    def take(self, count: int) -> U8:
        self.at += count
        return self.content[self.at - count : self.at]

    def planes(self, count: int, width: int) -> U8:
        return self.take(count * width)


def _check_mesh(mesh: BrickMesh) -> None:
    if len(mesh.positions) and not (mesh.positions.min() >= 0.0 and mesh.positions.max() < 1024.0):
        raise InputError("positions outside 0 to 1024 voxels of a brick's start cannot be kept.")
    if mesh.triangles.size and not 0 <= mesh.triangles.min() <= mesh.triangles.max() < len(mesh.positions):
        raise InputError(f"a triangle has a corner that is none of the {len(mesh.positions)} vertices.")


def _planes(values: I64, width: int = 0) -> tuple[int, U8]:
    """Return the bytes of numbers >= 0 by rank, as many ranks as they need, and how many that are."""
    from isosample.surfaces import chunk_kernels as kernels

    if not width:
        largest = int(values.max()) if values.size else 0
        width = max(1, (largest.bit_length() + 7) // 8)
    out = np.empty(width * values.size, dtype=np.uint8)
    kernels.write_planes(values.reshape(-1), width, out)
    return width, out


def _byte_planes(values: npt.NDArray[np.generic]) -> U8:
    """Return the bytes of any numbers by rank."""
    flat = np.ascontiguousarray(values).reshape(-1)
    return np.ascontiguousarray(flat.view(np.uint8).reshape(flat.size, flat.itemsize).T).reshape(-1)


def _from_bytes(reader: _Reader, count: int, dtype: type[N]) -> npt.NDArray[N]:
    """Undo `_byte_planes`."""
    width = np.dtype(dtype).itemsize
    return np.ascontiguousarray(reader.take(count * width).reshape(width, count).T).reshape(-1).view(dtype)


def _gradient_planes(gradients: F32) -> tuple[int, int, U8]:
    """Return how gradients are stored, the bytes per exponent, and all bytes."""
    from isosample.surfaces import chunk_kernels as kernels

    exponents, mantissas = np.empty(len(gradients), np.int64), np.empty((3, len(gradients)), np.int64)
    if not kernels.gradient_mantissas(gradients, exponents, mantissas):
        return _RAW, 1, _byte_planes(gradients)
    width, planes = _planes(exponents)
    return _PACKED, width, np.concatenate([planes, _planes(mantissas, 2)[1]])


def _gradients(header: _Header, reader: _Reader) -> F32:
    """Undo `_gradient_planes`."""
    from isosample.surfaces import chunk_kernels as kernels

    count = header.vertex_count
    if header.gradients == _RAW:
        return _from_bytes(reader, 3 * count, np.float32).reshape(count, 3)
    exponents, mantissas = np.empty(count, np.int64), np.empty((3, count), np.int64)
    kernels.read_planes(reader.planes(count, header.exponent_width), header.exponent_width, exponents)
    kernels.read_planes(reader.planes(3 * count, 2), 2, mantissas.reshape(-1))
    gradients = np.empty((count, 3), dtype=np.float32)
    kernels.restore_gradients(exponents, mantissas, _powers(), gradients)
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
        return np.zeros((count, 2), dtype=np.float32)
    bits: npt.NDArray[np.uint32]
    if header.residuals == _PACKED:
        bits = _from_bytes(reader, 2 * count, np.uint16).astype(np.uint32) << np.uint32(15)
    else:
        bits = _from_bytes(reader, 2 * count, np.uint32)
    return np.ascontiguousarray(bits.view(np.float32).reshape(2, count).T)


def _triangle_planes(triangles: I32, slots: I64, size: I64) -> tuple[int, int, U8]:
    """Return how triangles are stored, the bytes per step, and all bytes."""
    from isosample.surfaces import chunk_kernels as kernels

    cells, codes = np.empty(len(triangles), np.int64), np.empty(len(triangles), np.int64)
    if kernels.cell_codes(triangles, slots, size, cells, codes) and _all_different(slots, size):
        width, planes = _planes(cells)
        return _PACKED, width, np.concatenate([planes, _planes(codes, 2)[1]])
    steps = np.empty((len(triangles), 3), np.int64)
    kernels.corner_steps(triangles, steps)
    return (_RAW, *_planes(steps))


def _all_different(slots: I64, size: I64) -> bool:
    """Tell whether every vertex has a slot of its own that names it."""
    room, numbers = _tools().room(4 * int(size.prod())), np.arange(len(slots), dtype=np.int32)
    if slots.size and slots.max() >= len(room):
        return False
    room[slots] = numbers
    return bool((room[slots] == numbers).all())


def _triangles(header: _Header, reader: _Reader, slots: I64, size: I64) -> I32:
    """Undo `_triangle_planes`."""
    from isosample.surfaces import chunk_kernels as kernels

    count, width = header.triangle_count, header.step_width
    triangles = np.empty((count, 3), dtype=np.int32)
    if header.triangles == _RAW:
        corners = np.empty(3 * count, np.int64)
        kernels.read_steps(reader.planes(3 * count, width), width, corners)
        triangles.reshape(-1)[:] = corners
        return triangles
    cells, codes = np.empty(count, np.int64), np.empty(count, np.int64)
    kernels.read_planes(reader.planes(count, width), width, cells)
    kernels.read_planes(reader.planes(count, 2), 2, codes)
    room = _tools().room(4 * int(size.prod()))
    if not kernels.restore_triangles(cells, codes, slots, room, _edge_offsets(header.size), triangles):
        raise CacheError("a triangle of it has a corner that is no vertex.")
    return triangles


@functools.lru_cache(maxsize=64)
def _edge_offsets(size: tuple[int, ...]) -> I64:
    """(13,) int64, slot of each of a cell's edges, and of its inside, relative to the cell."""
    samples = size[0] * size[1] * size[2]
    steps = (1, size[0], size[0] * size[1])
    offsets = []
    for axis in range(3):
        first, second = (steps[other] for other in range(3) if other != axis)
        offsets += [axis * samples + a * first + b * second for b in (0, 1) for a in (0, 1)]
    return np.array([*offsets, 3 * samples], dtype=np.int64)


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

"""A packed chunk back to the mesh that it was, bit for bit; `chunk_encoding` says what its bytes are."""

from __future__ import annotations

import functools
import struct
import threading
from typing import TYPE_CHECKING, TypeVar

import numpy as np
import numpy.typing as npt

from isosample.errors import CacheError
from isosample.surfaces.chunk_header import check_name, mesh_error
from isosample.surfaces.chunk_layout import ABSENT, ERROR_COUNT, HEAD_BYTES, PACKED, RAW, ChunkHeader
from isosample.surfaces.mesh import BrickMesh, no_residuals
from isosample.surfaces.scratch import SCRATCH

if TYPE_CHECKING:
    from isosample.surfaces.mesh import F32, I32

U8 = npt.NDArray[np.uint8]
N = TypeVar("N", bound=np.generic)


class _Tools(threading.local):
    """A thread's own decompressor."""

    def __init__(self) -> None:
        import zstandard

        self.decompressor = zstandard.ZstdDecompressor()


@functools.cache
def _tools() -> _Tools:
    return _Tools()


def decode(data: bytes, *, name: bytes | None = None) -> BrickMesh:
    """Return the mesh of a chunk.

    Parameters
    ----------
    data : bytes
        What `chunk_encoding.encode` gave.
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

    from isosample.surfaces import decoding_kernels as kernels

    header = ChunkHeader.read(data)
    check_name(header.name, name)
    frame = memoryview(data)[HEAD_BYTES:]
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
    room = SCRATCH.room("vertex of slot", 4 * int(size.prod()), np.int32)
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
        figures = struct.unpack(f"<{ERROR_COUNT}d", reader.take(8 * ERROR_COUNT).tobytes())
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


def _from_bytes(reader: _Reader, count: int, dtype: type[N]) -> npt.NDArray[N]:
    """Undo `_byte_planes`."""
    width = np.dtype(dtype).itemsize
    return np.ascontiguousarray(reader.take(count * width).reshape(width, count).T).reshape(-1).view(dtype)


def _gradients(header: ChunkHeader, reader: _Reader) -> F32:
    """Undo `_gradient_planes`."""
    from isosample.surfaces import decoding_kernels as kernels

    count = header.vertex_count
    if header.gradients == RAW:
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
    from isosample.surfaces.chunk_numbers import LOWEST_EXPONENT

    return np.ldexp(1.0, np.arange(-LOWEST_EXPONENT, 130) - 15)


def _residuals(header: ChunkHeader, reader: _Reader) -> F32:
    """Undo `_residual_planes`."""
    count = header.vertex_count
    if header.residuals == ABSENT:
        return no_residuals(count)
    bits: npt.NDArray[np.uint32]
    if header.residuals == PACKED:
        bits = _from_bytes(reader, 2 * count, np.uint16).astype(np.uint32) << np.uint32(15)
    else:
        bits = _from_bytes(reader, 2 * count, np.uint32)
    return np.ascontiguousarray(bits.view(np.float32).reshape(2, count).T)


def _triangles(header: ChunkHeader, reader: _Reader, room: I32) -> I32:
    """Undo `_triangle_planes`; `room` holds the vertex of each slot."""
    from isosample.surfaces import decoding_kernels as kernels

    count, width = header.triangle_count, header.step_width
    triangles = np.empty((count, 3), dtype=np.int32)
    if header.triangles == RAW:
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
    from isosample.surfaces.chunk_numbers import EDGE_NUMBERS

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

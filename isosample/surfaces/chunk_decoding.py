"""Packed chunks back to the meshes that they were, bit for bit; `chunk_encoding` says what their bytes are.

Chunks are decoded in batches: what Python does for a chunk is to have its frame decompressed and to make a mesh of
parts of arrays. Between these, one compiled call restores the arrays of a whole batch.
"""

from __future__ import annotations

import functools
import struct
import threading
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from isosample.errors import CacheError
from isosample.surfaces.chunk_header import check_name, mesh_error
from isosample.surfaces.chunk_layout import ABSENT, ERROR_COUNT, HEADER_ROW, ChunkHeader
from isosample.surfaces.chunk_layout import HEAD_BYTES as HEAD_BYTES
from isosample.surfaces.mesh import BrickMesh, no_residuals
from isosample.surfaces.scratch import SCRATCH

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

U8 = npt.NDArray[np.uint8]

TOGETHER = 1 << 13  # triangles whose arrays are one: below 128 kB the allocator uses memory again
_FIGURES = struct.Struct(f"<{ERROR_COUNT}d")
_FAULTS = (
    "",
    "its content has {} bytes, other than its header says.",
    "its vertices do not fit together.",
    "a gradient of it is no float32.",
    "a triangle of it has a corner that is no vertex.",
)


class _Tools(threading.local):
    """A thread's own decompressor."""

    def __init__(self) -> None:
        import zstandard

        self.decompressor = zstandard.ZstdDecompressor()


@functools.cache
def _tools() -> _Tools:
    return _Tools()


class _Opened:
    """A chunk whose frame is decompressed: its header, the bytes of it, and the content."""

    __slots__ = ("content", "head", "header")

    def __init__(self, data: bytes, name: bytes | None) -> None:
        import zstandard

        self.header = header = ChunkHeader.read(data)
        check_name(header.name, name)
        self.head = data[: HEADER_ROW.itemsize]
        frame = memoryview(data)[HEAD_BYTES:]
        try:
            size_bytes = zstandard.frame_content_size(frame)  # before so much is allocated
            content = _tools().decompressor.decompress(frame) if size_bytes == header.content_bytes else b""
        except zstandard.ZstdError as error:
            raise CacheError(f"its content does not match its checksum ({error}).") from error
        if len(content) != header.content_bytes:
            raise CacheError(f"its content has {size_bytes} bytes, expected {header.content_bytes}.")
        self.content = content


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
    (found,) = decode_all([data], [name])
    if isinstance(found, CacheError):
        raise found
    return found


def decode_all(chunks: Sequence[bytes], names: Sequence[bytes | None]) -> list[BrickMesh | CacheError]:
    """Return for each chunk its mesh, or what `decode` would raise; the arrays of several are parts of one.

    Parameters
    ----------
    chunks : sequence of bytes
    names : sequence of (32 bytes or None)
        That the chunks must have.
    """
    found: list[BrickMesh | CacheError] = []
    batch: list[_Opened] = []
    places: list[int] = []
    triangles = 0

    def finish() -> None:
        for place, mesh in zip(places, _restored(batch), strict=True):
            found[place] = mesh
        batch.clear()
        places.clear()

    for place, (data, name) in enumerate(zip(chunks, names, strict=True)):
        try:
            opened = _Opened(data, name)
        except CacheError as error:
            found.append(error)
            continue
        found.append(_UNFINISHED)
        if batch and triangles + opened.header.triangle_count > TOGETHER:
            finish()
            triangles = 0
        batch.append(opened)
        places.append(place)
        triangles += opened.header.triangle_count
    if batch:
        finish()
    return found


_UNFINISHED = CacheError("it is not decoded yet.")


def _restored(batch: Sequence[_Opened]) -> Iterator[BrickMesh | CacheError]:
    """Yield the meshes of some chunks, or what is wrong with them, restored by one call."""
    from isosample.surfaces.batch_kernels import restore_chunks

    headers = [opened.header for opened in batch]
    vertex_start, triangle_start, residual_start = [0], [0], [0]
    for header in headers:
        count = header.vertex_count
        vertex_start.append(vertex_start[-1] + count)
        triangle_start.append(triangle_start[-1] + header.triangle_count)
        residual_start.append(residual_start[-1] + (0 if header.residuals == ABSENT else count))
    samples = max(header.size[0] * header.size[1] * header.size[2] for header in headers)
    positions = np.empty((vertex_start[-1], 3), dtype=np.float32)
    gradients = np.empty((vertex_start[-1], 3), dtype=np.float32)
    keys = np.empty(vertex_start[-1], dtype=np.int64)
    residuals = np.empty((residual_start[-1], 2), dtype=np.float32)
    triangles = np.empty((triangle_start[-1], 3), dtype=np.int32)
    faults = np.empty(len(batch), dtype=np.uint8)
    restore_chunks(
        np.frombuffer(b"".join([opened.content for opened in batch]), dtype=np.uint8),
        np.frombuffer(b"".join([opened.head for opened in batch]), dtype=HEADER_ROW),
        _powers(),
        _triples(),
        SCRATCH.room("vertex of slot", 4 * samples, np.int32),
        positions,
        gradients,
        keys,
        residuals,
        triangles,
        faults,
    )
    spans = zip(*(pairwise(starts) for starts in (vertex_start, triangle_start, residual_start)), strict=True)
    for opened, fault, ((v, w), (t, u), (r, s)) in zip(batch, faults.tolist(), spans, strict=True):
        header = opened.header
        if fault:
            yield CacheError(_FAULTS[fault].format(header.content_bytes))
            continue
        measured = None
        if header.has_error:
            measured = mesh_error(_FIGURES.unpack(opened.content[-_FIGURES.size :]))
        yield BrickMesh(
            isovalue=header.isovalue,
            brick=header.brick,
            start=header.start,
            positions=positions[v:w],
            gradients=gradients[v:w],
            edge_keys=keys[v:w],
            triangles=triangles[t:u],
            residuals=residuals[r:s] if s > r else no_residuals(header.vertex_count),
            error=measured,
        )


@functools.cache
def _powers() -> npt.NDArray[np.float64]:
    """2^(exponent - 15) of every exponent that a float32 can have."""
    from isosample.surfaces.chunk_numbers import LOWEST_EXPONENT

    return np.ldexp(1.0, np.arange(-LOWEST_EXPONENT, 130) - 15)


@functools.cache
def _triples() -> U8:
    """(13³, 3) uint8, edge numbers of the corners of each triple of them."""
    from isosample.surfaces.chunk_numbers import EDGE_NUMBERS

    codes = np.arange(EDGE_NUMBERS**3)
    triples: U8 = np.stack([codes // EDGE_NUMBERS**corner % EDGE_NUMBERS for corner in range(3)], axis=1)
    return triples.astype(np.uint8)

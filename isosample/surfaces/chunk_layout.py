"""The header of a packed chunk: what its bytes say before anything is decoded."""

from __future__ import annotations

import struct
from typing import NamedTuple

import numpy as np

from isosample.errors import CacheError
from isosample.surfaces.chunk_header import CHECK, ERROR_NAMES, sealed, unsealed

CHUNK_VERSION = 3
USUAL_SAMPLES = 33  # along each axis of a brick
MAGIC = b"isochunk"
ERROR_COUNT = len(ERROR_NAMES)
RAW, PACKED, ABSENT = 0, 1, 2  # how gradients, residuals and triangles are stored
_HEADER = struct.Struct("<8sH7B32sd3i3i4q3H9I")
HEADER_ROW = np.dtype(  # the same for kernels, whose integers all have a sign
    [
        ("magic", "S8"),
        ("version", "<i2"),
        ("gradients", "i1"),
        ("residuals", "i1"),
        ("triangles", "i1"),
        ("has_error", "i1"),
        ("slot_width", "i1"),
        ("exponent_width", "i1"),
        ("step_width", "i1"),
        ("name", "S32"),
        ("isovalue", "<f8"),
        ("brick", "<i4", 3),
        ("start", "<i4", 3),
        ("lattice", "<i8", 4),
        ("size", "<i2", 3),
        ("vertex_count", "<i4"),
        ("triangle_count", "<i4"),
        ("fraction_count", "<i4"),
        ("key_count", "<i4"),
        ("slot_escapes", "<i4"),
        ("exponent_escapes", "<i4"),
        ("step_escapes", "<i4"),
        ("content_bytes", "<i4"),
        ("frame_bytes", "<i4"),
    ]
)
HEAD_BYTES = _HEADER.size + CHECK.size


class ChunkHeader(NamedTuple):
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
        """Return the first bytes of the chunk, with their checksum."""
        flat = (*self[:11], *self.brick, *self.start, *self.lattice, *self.size, *self[15:])
        return sealed(_HEADER.pack(*flat))

    @classmethod
    def read(cls, data: bytes) -> ChunkHeader:
        """Return the header of a chunk; raise `CacheError` if it is none, of another version or damaged."""
        flat = unsealed(data, _HEADER, magic=MAGIC, version=CHUNK_VERSION)
        header = cls._make((*flat[:11], flat[11:14], flat[14:17], flat[17:21], flat[21:24], *flat[24:]))
        if len(data) != HEAD_BYTES + header.frame_bytes:
            raise CacheError(f"it has {len(data)} bytes, expected {HEAD_BYTES + header.frame_bytes}.")
        return header

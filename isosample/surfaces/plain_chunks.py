"""One brick's piece of one isosurface as its arrays in a row: larger than a packed chunk, and no decoding.

A plain chunk is a header with a checksum of its own, then positions, gradients, keys, residuals where there are some,
and triangles, each from a multiple of 64 bytes on. Its arrays are used where the file is mapped into memory; all that
is done to load it is to look at every byte once, for the checksum.
"""

from __future__ import annotations

import struct
from dataclasses import astuple
from typing import TYPE_CHECKING

import numpy as np

from isosample.errors import CacheError
from isosample.surfaces.chunk_header import (
    CHECK,
    NO_NAME,
    check_mesh,
    check_name,
    mesh_error,
    sealed,
    unsealed,
)
from isosample.surfaces.mesh import BrickMesh, no_residuals
from isosample.surfaces.mesh_error import MeshError

if TYPE_CHECKING:
    import mmap

    import numpy.typing as npt

    F32 = npt.NDArray[np.float32]
    U64 = npt.NDArray[np.uint64]

PLAIN_VERSION = 1
PLAIN_MAGIC = b"isoplain"
_HEADER = struct.Struct("<8sHBB32sd3i3iqqQ5d")
_HEAD_BYTES = 256
ALIGNMENT = 64  # eight words of the checksum


def encode_plain(mesh: BrickMesh, *, name: bytes = NO_NAME) -> bytes:
    """Return a mesh as a plain chunk.

    Parameters
    ----------
    mesh : BrickMesh
        May be empty; comes back bit for bit.
    name : 32 bytes
        Kept in the chunk; `decode_plain` can check it.

    Raises
    ------
    InputError
        If a triangle has a corner that is no vertex, or a position is outside 0 to 1024 voxels.
    """
    check_mesh(mesh)
    arrays = [mesh.positions, mesh.gradients, mesh.edge_keys]
    has_residuals = bool(mesh.residuals.any() or np.signbit(mesh.residuals).any())
    if has_residuals:
        arrays.append(mesh.residuals)
    parts = [np.ascontiguousarray(array).tobytes() for array in (*arrays, mesh.triangles)]
    body = b"".join(part + bytes(-len(part) % ALIGNMENT) for part in parts)
    head = _HEADER.pack(
        PLAIN_MAGIC,
        PLAIN_VERSION,
        mesh.error is not None,
        has_residuals,
        name,
        mesh.isovalue,
        *mesh.brick,
        *mesh.start,
        len(mesh.positions),
        len(mesh.triangles),
        _checksum(np.frombuffer(body, dtype=np.uint64)),
        *astuple(mesh.error or MeshError()),
    )
    head = sealed(head)
    return head + bytes(_HEAD_BYTES - len(head)) + body


def decode_plain(data: bytes | mmap.mmap, *, name: bytes | None = None) -> BrickMesh:
    """Return the mesh of a plain chunk, whose arrays are parts of the given memory and cannot be written.

    Parameters
    ----------
    data : bytes or mmap
        What `encode_plain` gave.
    name : 32 bytes, optional
        That the chunk must have.

    Raises
    ------
    OtherVersionError
        If the chunk is of another format version.
    CacheError
        If it is damaged, or has another name.
    """
    found = unsealed(data, _HEADER, magic=PLAIN_MAGIC, version=PLAIN_VERSION)
    if any(data[_HEADER.size + CHECK.size : _HEAD_BYTES]):
        raise CacheError("its header does not match its checksum.")
    has_error, has_residuals, own_name, isovalue = found[2:6]
    vertex_count, triangle_count, checksum = found[12:15]
    check_name(own_name, name)
    sizes = [12 * vertex_count, 12 * vertex_count, 8 * vertex_count]
    sizes += [8 * vertex_count * has_residuals, 12 * triangle_count]
    starts = [_HEAD_BYTES]
    for size in sizes:
        starts.append(starts[-1] + size + -size % ALIGNMENT)
    if len(data) != starts[-1]:
        raise CacheError(f"it has {len(data)} bytes, expected {starts[-1]}.")
    if _checksum(np.frombuffer(data, dtype=np.uint64, offset=_HEAD_BYTES)) != checksum:
        raise CacheError("its content does not match its checksum.")

    def floats(part: int, width: int) -> F32:
        count = width * vertex_count
        return np.frombuffer(data, dtype=np.float32, count=count, offset=starts[part]).reshape(-1, width)

    triangles = np.frombuffer(data, dtype=np.int32, count=3 * triangle_count, offset=starts[4])
    return BrickMesh(
        isovalue=isovalue,
        brick=found[6:9],
        start=found[9:12],
        positions=floats(0, 3),
        gradients=floats(1, 3),
        edge_keys=np.frombuffer(data, dtype=np.int64, count=vertex_count, offset=starts[2]),
        triangles=triangles.reshape(-1, 3),
        residuals=floats(3, 2) if has_residuals else no_residuals(vertex_count),
        error=mesh_error(found[15:]) if has_error else None,
    )


def _checksum(words: U64) -> int:
    """Return 64 bits that change with every bit of some memory."""
    from isosample.surfaces.checksum_kernel import checksum

    return int(checksum(words))

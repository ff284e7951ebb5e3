"""What chunks of either kind have in common: a header that is checked by itself, a name, and which meshes they keep."""

from __future__ import annotations

import struct
import zlib
from dataclasses import fields
from typing import TYPE_CHECKING, Any

from isosample.errors import CacheError, InputError
from isosample.surfaces.mesh_error import MeshError

if TYPE_CHECKING:
    import mmap
    from collections.abc import Iterable

    from isosample.surfaces.mesh import BrickMesh

NO_NAME = b"\0" * 32
ERROR_NAMES = tuple(field.name for field in fields(MeshError))
CHECK = struct.Struct("<I")


class OtherVersionError(CacheError):
    """A chunk is of another format version."""


def check_mesh(mesh: BrickMesh) -> None:
    """Raise `InputError` if a mesh is none that can be kept: positions out of range, corners that are no vertices."""
    if len(mesh.positions) and not (mesh.positions.min() >= 0.0 and mesh.positions.max() < 1024.0):
        raise InputError("positions outside 0 to 1024 voxels of a brick's start cannot be kept.")
    if mesh.triangles.size and not 0 <= mesh.triangles.min() <= mesh.triangles.max() < len(mesh.positions):
        raise InputError(f"a triangle has a corner that is none of the {len(mesh.positions)} vertices.")


def sealed(header: bytes) -> bytes:
    """Return a header, which begins with eight bytes of magic and a 16-bit version, with its checksum behind it."""
    return header + CHECK.pack(zlib.crc32(header))


def unsealed(
    data: bytes | mmap.mmap, layout: struct.Struct, *, magic: bytes, version: int
) -> tuple[Any, ...]:
    """Return what the sealed header of a chunk holds.

    Raises
    ------
    OtherVersionError
        If the chunk is of another format version.
    CacheError
        If it is no chunk, or its header is damaged.
    """
    if len(data) < layout.size + CHECK.size or data[: len(magic)] != magic:
        raise CacheError(f"it has {len(data)} bytes and is no chunk of a mesh cache, or its start is lost.")
    found = int.from_bytes(data[8:10], "little")
    if found != version:
        raise OtherVersionError(f"it has format version {found}; this program reads and writes {version}.")
    if CHECK.unpack_from(data, layout.size)[0] != zlib.crc32(data[: layout.size]):
        raise CacheError("its header does not match its checksum.")
    return layout.unpack_from(data)


def check_name(found: bytes, expected: bytes | None) -> None:
    """Raise `CacheError` if a chunk has another name than it must have; None: any."""
    if expected is not None and found != expected:
        raise CacheError(f"it is named {found.hex()}, expected {expected.hex()}.")


def mesh_error(figures: Iterable[float]) -> MeshError:
    """Return the figures of a `MeshError`, as `dataclasses.astuple` gave them."""
    return MeshError(**dict(zip(ERROR_NAMES, figures, strict=True)))

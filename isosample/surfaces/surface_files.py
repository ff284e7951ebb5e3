"""One isosurface of the mesh cache as one file: its name, its arrays, its pieces."""

from __future__ import annotations

from dataclasses import astuple, fields
from typing import TYPE_CHECKING, Any

import numpy as np

from isosample.errors import CacheError
from isosample.surfaces.cache_files import FORMAT_VERSION, Arrays, digest_of, read_arrays, write_arrays
from isosample.surfaces.mesh import BrickMesh
from isosample.surfaces.mesh_error import MeshError

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from isosample.surfaces.extract import ExtractionSettings

_NO_MESH: Arrays = {
    "positions": np.empty((0, 3), dtype=np.float32),
    "gradients": np.empty((0, 3), dtype=np.float32),
    "edge_keys": np.empty(0, dtype=np.int64),
    "triangles": np.empty((0, 3), dtype=np.int32),
    "residuals": np.empty((0, 2), dtype=np.float32),
}
_ERRORS = len(fields(MeshError))


def surface_key(content_hash: str, isovalue: float, settings: ExtractionSettings) -> str:
    """Return the name of one isosurface's file: a digest of everything that decides about its meshes."""
    named = {"content_hash": content_hash, "isovalue": (isovalue + 0.0).hex(), "version": FORMAT_VERSION}
    return digest_of({**named, "settings": settings.to_dict()})


def surface_path(folder: Path, key: str) -> Path:
    """Return where a cache folder keeps the isosurface of a key."""
    return folder / "surfaces" / f"{key}.npz"


def write_surface(path: Path, key: str, meshes: Sequence[BrickMesh]) -> str:
    """Write the pieces of one isosurface, and return the digest of its arrays."""
    arrays: Arrays = {
        field: np.concatenate([empty, *(getattr(mesh, field) for mesh in meshes)])
        for field, empty in _NO_MESH.items()
    }
    arrays["bricks"] = np.array([mesh.brick for mesh in meshes], dtype=np.int64).reshape(-1, 3)
    arrays["starts"] = np.array([mesh.start for mesh in meshes], dtype=np.int64).reshape(-1, 3)
    arrays["vertex_counts"] = np.array([len(mesh.positions) for mesh in meshes], dtype=np.int64)
    arrays["triangle_counts"] = np.array([len(mesh.triangles) for mesh in meshes], dtype=np.int64)
    errors = [astuple(mesh.error) for mesh in meshes if mesh.error is not None]
    arrays["errors"] = np.array(errors, dtype=np.float64).reshape(-1, _ERRORS)  # of all pieces or of none
    return write_arrays(path, {"key": key}, arrays)


def read_surface(folder: Path, key: str, isovalue: float, digest: str | None) -> list[BrickMesh]:
    """Return the pieces of one isosurface in the order of the bricks.

    Raises
    ------
    CacheError
        If the file is missing (names the isovalue) or damaged, or its arrays have another `digest`.
    """
    path = surface_path(folder, key)
    if not path.exists():
        raise CacheError(
            f"{folder} has no isosurface {isovalue!r} for these settings ({path.name} is missing). "
            "Add it with `isosample precompute`."
        )
    arrays, _ = read_arrays(path, {"key": key}, digest=digest)
    vertex_ends = np.cumsum(arrays["vertex_counts"].astype(np.int64))[:-1]
    triangle_ends = np.cumsum(arrays["triangle_counts"].astype(np.int64))[:-1]
    parts: dict[str, list[Any]] = {
        field: np.split(arrays[field], vertex_ends)
        for field in ("positions", "gradients", "edge_keys", "residuals")
    }
    parts["triangles"] = np.split(arrays["triangles"], triangle_ends)
    names = [field.name for field in fields(MeshError)]
    errors = [MeshError(**dict(zip(names, row, strict=True))) for row in arrays["errors"].tolist()]
    return [
        BrickMesh(
            isovalue=isovalue,
            brick=tuple(brick),
            start=tuple(start),
            error=errors[number] if errors else None,
            **{field: pieces[number] for field, pieces in parts.items()},
        )
        for number, (brick, start) in enumerate(
            zip(arrays["bricks"].tolist(), arrays["starts"].tolist(), strict=True)
        )
    ]

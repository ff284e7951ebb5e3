"""The faces of a volume in the mesh cache: one file per reconstruction."""

from __future__ import annotations

import contextlib
from dataclasses import fields
from typing import TYPE_CHECKING, Any

import numpy as np

from isosample.errors import CacheError
from isosample.surfaces.boundary import BoundarySlices
from isosample.surfaces.cache_files import Arrays, read_arrays, write_arrays
from isosample.surfaces.mask_faces import MaskFaces

if TYPE_CHECKING:
    from pathlib import Path

    from isosample.surfaces.settings import ExtractionSettings
    from isosample.surfaces.stored_surfaces import StoredSurfaces
    from isosample.surfaces.surface_set import SurfaceSet


def boundary_path(folder: Path, settings: ExtractionSettings) -> Path:
    """Return the file of the faces; every smooth reconstruction has its own."""
    suffix = f"-{settings.reconstruction.value}" if settings.reconstruction.smooth else ""
    return folder / f"boundary{suffix}.npz"


def write_boundary(folder: Path, content_hash: str, surfaces: SurfaceSet | StoredSurfaces) -> str:
    """Write faces and value range, unless they are there undamaged; return the digest of the arrays."""
    path, header = boundary_path(folder, surfaces.settings), _header(content_hash, surfaces.settings)
    if path.exists():
        with contextlib.suppress(CacheError):  # damaged: written anew
            return read_arrays(path, header)[1]
    return write_arrays(path, header, _arrays(surfaces))


def read_boundary(
    folder: Path, content_hash: str, settings: ExtractionSettings, digest: str | None
) -> tuple[BoundarySlices, tuple[float, float]]:
    """Return faces and value range.

    Raises
    ------
    CacheError
        If the file is missing (names the reconstruction) or damaged, of another volume or another `digest`.
    """
    path = boundary_path(folder, settings)
    if not path.exists():
        raise CacheError(
            f"{folder} has no surfaces of the {settings.reconstruction.value} reconstruction ({path.name} is "
            "missing). Add them with `isosample precompute`."
        )
    arrays, _ = read_arrays(path, _header(content_hash, settings), digest=digest)
    low, high = arrays["value_range"].astype(np.float64).tolist()
    mask = {name.removeprefix("mask_"): array for name, array in arrays.items() if name.startswith("mask_")}
    boundary = BoundarySlices(
        faces=tuple(arrays[f"face_{number}"] for number in range(6)),
        mask_faces=MaskFaces(**mask) if mask else None,  # type: ignore[arg-type]  # checked when read
        kernel=arrays["kernel"].astype(np.float64) if "kernel" in arrays else None,
    )
    return boundary, (low, high)


def _header(content_hash: str, settings: ExtractionSettings) -> dict[str, Any]:
    return {"content_hash": content_hash, "reconstruction": settings.reconstruction.value}


def _arrays(surfaces: SurfaceSet | StoredSurfaces) -> Arrays:
    """Return the faces, the kernel and the mask's border where there are such, and the value range."""
    boundary = surfaces.boundary
    arrays: Arrays = {f"face_{number}": face for number, face in enumerate(boundary.faces)}
    arrays["value_range"] = np.array(surfaces.value_range)
    if boundary.kernel is not None:
        arrays["kernel"] = boundary.kernel
    if boundary.mask_faces is not None:
        arrays |= {
            f"mask_{field.name}": getattr(boundary.mask_faces, field.name)
            for field in fields(boundary.mask_faces)
        }
    return arrays

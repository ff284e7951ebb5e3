"""Surfaces of a cache folder: opened by their lists, piece by piece or all in memory."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from isosample.errors import CacheError
from isosample.surfaces.boundary_files import read_boundary
from isosample.surfaces.cache_files import REMEDY
from isosample.surfaces.cache_levels import load_pieces
from isosample.surfaces.chunk_table import ChunkTable
from isosample.surfaces.settings import ExtractionSettings, check_isovalues
from isosample.surfaces.store import MeshStore
from isosample.surfaces.stored_surfaces import StoredSurfaces
from isosample.surfaces.surface_files import listed_key, read_rows, surface_path
from isosample.surfaces.surface_set import ExtractionStatistics, SurfaceSet
from isosample.surfaces.volume_file import read_volume
from isosample.volume.bricks import bricks_of
from isosample.volume.geometry import GridGeometry

if TYPE_CHECKING:
    from collections.abc import Sequence

    from isosample.surfaces.mesh import BrickMesh
    from isosample.volume.grid import F64


def load_surface_set(
    folder: str | Path, isovalues: Sequence[float] | F64, settings: ExtractionSettings | None = None
) -> SurfaceSet:
    """Return surfaces of a cache folder, which were extracted with the same settings, all in memory.

    Raises
    ------
    InputError
        If the isovalues are not finite and strictly ascending.
    CacheError
        As `load_cache`; also if a surface is not there (names the isovalue).
    """
    return in_memory(open_surface_set(folder, isovalues, settings or ExtractionSettings()))


def open_surface_set(
    folder: str | Path, isovalues: Sequence[float] | F64, settings: ExtractionSettings
) -> StoredSurfaces:
    """Return surfaces of a cache folder, loaded when they are asked for; raises as `load_surface_set`."""
    folder = Path(folder)
    return listed_surfaces(folder, read_volume(folder), check_isovalues(isovalues), settings, {})


def lists_surfaces(
    folder: str | Path, isovalues: Sequence[float] | F64, settings: ExtractionSettings
) -> bool:
    """Tell whether a cache folder lists every one of some surfaces; the lists may be damaged.

    Raises
    ------
    InputError
        If the isovalues are not finite and strictly ascending.
    CacheError
        If the folder is not a cache.
    """
    folder = Path(folder)
    volume_hash = read_volume(folder)["content_hash"]
    keys = (
        listed_key(folder, volume_hash, isovalue, settings)
        for isovalue in check_isovalues(isovalues).tolist()
    )
    return all(surface_path(folder, key).exists() for key in keys)


def listed_surfaces(
    folder: Path, volume: dict[str, Any], levels: F64, settings: ExtractionSettings, digests: dict[str, str]
) -> StoredSurfaces:
    """Return the surfaces of all levels; `digests` by key, and of the boundary, where a scene pins them."""
    volume_hash = volume["content_hash"]
    rows = []
    for isovalue in levels.tolist():
        key = listed_key(folder, volume_hash, isovalue, settings, digests)
        rows.append(read_rows(folder, key, isovalue, digests.get(key))[0])
    table = ChunkTable.of(levels, rows)
    boundary, value_range = read_boundary(folder, volume_hash, settings, digests.get("boundary"))
    geometry = GridGeometry.from_dict(volume["geometry"])
    return StoredSurfaces(
        geometry=geometry,
        isovalues=levels,
        boundary=boundary,
        value_range=value_range,
        settings=settings,
        store=MeshStore(folder, read_only=True),
        chunk_table=table,
        statistics=ExtractionStatistics(
            bricks_total=len(bricks_of(geometry.size_xyz, settings.brick_cells)),
            brick_visits=0,
            brick_visits_skipped=0,
            levels_reused=len(levels),
            chunks_reused=len(table),
            triangles=table.per_level("triangles"),
            vertices=table.per_level("vertices"),
        ),
    )


def in_memory(stored: StoredSurfaces) -> SurfaceSet:
    """Load all meshes; raise `CacheError` naming the first chunk that is missing or damaged."""
    store, table = stored.store, stored.chunk_table
    assert isinstance(store, MeshStore)
    keys = [key.decode() for key in table["key"].tolist()]
    meshes: list[BrickMesh] = []
    for key, isovalue, mesh in zip(keys, table["isovalue"].tolist(), load_pieces(store, keys), strict=True):
        if mesh is None:
            what = store.reasons.get(key, f"{store.path(key)} is missing")
            raise CacheError(f"{what.rstrip('.')}, and isosurface {isovalue!r} with it. {REMEDY}")
        meshes.append(mesh)
    return SurfaceSet(
        geometry=stored.geometry,
        isovalues=stored.isovalues,
        meshes=tuple(meshes),
        boundary=stored.boundary,
        value_range=stored.value_range,
        settings=stored.settings,
        statistics=stored.statistics,
        details=tuple(in_memory(part) for part in stored.details),
    )

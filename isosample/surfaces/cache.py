"""The mesh cache: a folder per volume from which a scene is rendered again without the volume.

    volume.json             geometry and content hash of the volume
    boundary.npz            samples on its six faces, value range; boundary-cubic.npz etc.: of a reconstruction
    chunks/<k>/<key>.chunk  one isosurface in one brick; the key names the brick's content, isovalue and settings
    surfaces/<key>.npz      which chunks make up one isosurface, with their sizes and boxes
    scene.json              transfer function, plan, and the surfaces that they need

Every file is replaced whole, carries the format's version, and is checked when read. Chunks that are missing or
damaged are extracted again, and only they; without the volume they are named, and never rendered.
"""

from __future__ import annotations

import contextlib
import warnings
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from isosample.errors import CacheError, InputError
from isosample.surfaces.boundary import BoundarySlices
from isosample.surfaces.boundary_files import boundary_path, read_boundary, write_boundary
from isosample.surfaces.cache_files import REMEDY, digest_of, read_json, write_json
from isosample.surfaces.cache_levels import (
    Field,
    Piece,
    content_in_place,
    extract_pieces,
    load_pieces,
    refuses_writing,
    rows_of,
    wanted_pieces,
)
from isosample.surfaces.chunk_table import ChunkTable
from isosample.surfaces.settings import ExtractionSettings, check_isovalues, check_volume
from isosample.surfaces.store import MeshStore, chunk_key, full_disk_explained
from isosample.surfaces.stored_surfaces import StoredSurfaces
from isosample.surfaces.surface_files import listed_key, read_rows, surface_key, surface_path, write_rows
from isosample.surfaces.surface_set import ExtractionStatistics, SurfaceSet, count_per_level
from isosample.tally import EXTRACTIONS, tally
from isosample.transfer.isovalues import IsovaluePlan
from isosample.transfer.transfer_function import TransferFunction
from isosample.volume.bricks import BRICK_CELLS, bricks_of
from isosample.volume.geometry import GridGeometry
from isosample.volume.reconstruction import Reconstruction
from isosample.volume.scan import scan_volume

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from isosample.surfaces.chunk_table import Rows
    from isosample.surfaces.mesh import BrickMesh
    from isosample.volume.grid import F64, Volume
    from isosample.volume.scan import BrickScan


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CachedScene:
    """A scene as `load_cache` gives it back.

    Attributes
    ----------
    surfaces : SurfaceSet
    transfer_function : TransferFunction
    plan : IsovaluePlan
    name : str
        Name of the volume.
    """

    surfaces: SurfaceSet
    transfer_function: TransferFunction
    plan: IsovaluePlan
    name: str


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class OpenedScene:
    """A scene as `open_cache` gives it: as `CachedScene`, but meshes stay in the folder until they are asked for."""

    surfaces: StoredSurfaces
    transfer_function: TransferFunction
    plan: IsovaluePlan
    name: str


def content_hash(volume: Volume, scan: BrickScan | None = None) -> str:
    """Return a sha256 of a volume's geometry, dtype and samples, hexadecimal.

    Parameters
    ----------
    volume : Volume
        Read once, block by block.
    scan : BrickScan, optional
        Of this volume with bricks of `BRICK_CELLS`, where there is one: then nothing is read.
    """
    if scan is None or scan.brick_cells != BRICK_CELLS:
        scan = scan_volume(volume)
    return digest_of({"geometry": volume.geometry.to_dict(), "samples": scan.content})


def write_cache(
    folder: str | Path,
    surfaces: SurfaceSet | StoredSurfaces,
    *,
    content_hash: str,
    transfer_function: TransferFunction,
    plan: IsovaluePlan,
    name: str = "volume",
) -> None:
    """Write a scene into a folder, next to surfaces of the same volume that are there already.

    Parameters
    ----------
    folder : path
        Made if absent.
    surfaces : SurfaceSet or StoredSurfaces
        The latter's store must be in this folder.
    content_hash : str
        What `content_hash(volume)` gave.
    transfer_function : TransferFunction
    plan : IsovaluePlan
    name : str
        Name of the volume, for messages and titles.

    Raises
    ------
    CacheError
        If the folder belongs to another volume or format version, is damaged, or cannot be written.
    """
    folder = Path(folder)
    store = MeshStore(folder)
    claim_folder(folder, surfaces.geometry, content_hash, name)
    boundary = write_boundary(folder, content_hash, surfaces)
    details = [
        {"settings": part.settings.to_dict(), "surfaces": _written(folder, store, part, content_hash)}
        for part in surfaces.details
    ]
    scene = {
        "content_hash": content_hash,
        "settings": surfaces.settings.to_dict(),
        "boundary_sha256": boundary,
        "transfer_function": transfer_function.to_dict(),
        "plan": plan.to_dict(),
        "surfaces": _written(folder, store, surfaces, content_hash),
        "details": details,
    }
    write_json(folder / "scene.json", "scene", scene)


def _written(
    folder: Path, store: MeshStore, surfaces: SurfaceSet | StoredSurfaces, content_hash: str
) -> list[dict[str, str]]:
    """Write what the folder lacks of some surfaces; return what a scene says of each."""
    files = []
    for level, isovalue in enumerate(surfaces.isovalues.tolist()):
        key = listed_key(folder, content_hash, isovalue, surfaces.settings)
        digest = _listed(folder, store, key, isovalue)
        if digest is None:
            by_place = isinstance(surfaces, SurfaceSet)
            key = surface_key(content_hash, isovalue, surfaces.settings, by_place=by_place)
            digest = write_rows(folder, key, _kept_rows(store, surfaces, level, content_hash))
        files.append({"key": key, "isovalue": isovalue.hex(), "sha256": digest})
    return files


def load_cache(folder: str | Path) -> CachedScene:
    """Return the scene of a cache folder, bit for bit as it was written, without its volume.

    Raises
    ------
    CacheError
        If the folder is not a cache, has no scene, or a file is missing, damaged or of another version.
    """
    opened = open_cache(folder)
    return CachedScene(
        surfaces=_in_memory(opened.surfaces),
        transfer_function=opened.transfer_function,
        plan=opened.plan,
        name=opened.name,
    )


def open_cache(folder: str | Path) -> OpenedScene:
    """Return the scene of a cache folder, whose meshes are loaded when they are asked for; raises as `load_cache`."""
    folder = Path(folder)
    volume = _read_volume(folder)
    scene = read_json(folder / "scene.json", "scene")
    if scene["content_hash"] != volume["content_hash"]:
        raise CacheError(f"{folder / 'scene.json'} is of another volume than volume.json. {REMEDY}")
    levels = check_isovalues([float.fromhex(entry["isovalue"]) for entry in scene["surfaces"]])

    def opened(part: dict[str, Any]) -> StoredSurfaces:
        digests = {entry["key"]: entry["sha256"] for entry in part["surfaces"]}
        digests["boundary"] = scene["boundary_sha256"]
        return _open_surfaces(folder, volume, levels, ExtractionSettings.from_dict(part["settings"]), digests)

    details = tuple(opened(part) for part in scene.get("details", []))
    return OpenedScene(
        surfaces=replace(opened(scene), details=details),
        transfer_function=TransferFunction.from_dict(scene["transfer_function"]),
        plan=IsovaluePlan.from_dict(scene["plan"]),
        name=volume["name"],
    )


def load_surface_set(
    folder: str | Path,
    isovalues: Sequence[float] | F64,
    *,
    brick_cells: int = BRICK_CELLS,
    nan_masked: bool = False,
    reconstruction: Reconstruction = Reconstruction.TRILINEAR,
    refine: int = 1,
    residuals: bool = False,
    detail: int = 0,
) -> SurfaceSet:
    """Return surfaces of a cache folder, which were extracted with the same settings, all in memory.

    Raises
    ------
    InputError
        If the isovalues are not finite and strictly ascending, or the settings are impossible.
    CacheError
        As `load_cache`; also if a surface is not there (names the isovalue).
    """
    settings = ExtractionSettings(
        brick_cells=brick_cells,
        nan_masked=nan_masked,
        reconstruction=reconstruction,
        refine=refine,
        residuals=residuals,
        detail=detail,
    )
    return _in_memory(open_surface_set(folder, isovalues, settings))


def open_surface_set(
    folder: str | Path, isovalues: Sequence[float] | F64, settings: ExtractionSettings
) -> StoredSurfaces:
    """Return surfaces of a cache folder, loaded when they are asked for; raises as `load_surface_set`."""
    folder = Path(folder)
    return _open_surfaces(folder, _read_volume(folder), check_isovalues(isovalues), settings, {})


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
    volume_hash = _read_volume(folder)["content_hash"]
    keys = (
        listed_key(folder, volume_hash, isovalue, settings)
        for isovalue in check_isovalues(isovalues).tolist()
    )
    return all(surface_path(folder, key).exists() for key in keys)


def extract_with_cache(
    volume: Volume,
    isovalues: Sequence[float] | F64,
    folder: str | Path,
    *,
    brick_cells: int = BRICK_CELLS,
    nan_masked: bool = False,
    reconstruction: Reconstruction = Reconstruction.TRILINEAR,
    refine: int = 1,
    residuals: bool = False,
    detail: int = 0,
    budget_bytes: int | None = None,
    plain: bool = False,
    extracted: SurfaceSet | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> SurfaceSet:
    """Return the isosurfaces of a volume, of which those in the folder are read and the others added to it.

    Parameters
    ----------
    volume, isovalues, brick_cells, nan_masked, reconstruction, refine, residuals, detail, progress
        As for `extract_surfaces`.
    folder : path
        The volume's cache folder, made if absent. One that cannot be written is read, with a warning where
        something would have been added.
    budget_bytes : int, optional
        Largest size of all chunks in the folder; those that were used longest ago, and not by this call, make room.
    plain : bool
        Add chunks that need no decoding, four to six times as large and loaded several times as fast.
    extracted : SurfaceSet, optional
        What `extract_surfaces` gives for these isovalues and settings, if it is at hand: what the folder lacks is
        taken from it.

    Returns
    -------
    surfaces : SurfaceSet
        The same, bit for bit, as `extract_surfaces` gives; ``statistics.levels_reused`` says of how many levels
        nothing was extracted, ``brick_visits`` how many (brick, isovalue) pairs were extracted now and
        ``chunks_reused`` how many were read.

    Raises
    ------
    InputError
        As `extract_surfaces`; also if `extracted` has other isovalues or settings.
    CacheError
        If the folder belongs to another volume or format version, or cannot be written. What was extracted until
        then is kept: the same call goes on from there.
    """
    folder = Path(folder)
    settings = ExtractionSettings(
        brick_cells=brick_cells,
        nan_masked=nan_masked,
        reconstruction=reconstruction,
        refine=refine,
        residuals=residuals,
        detail=detail,
    )
    levels = check_isovalues(isovalues)
    _check_extracted(extracted, levels, settings)
    scan = scan_volume(volume, brick_cells)
    scan.tell(volume)
    check_volume(volume, settings)
    volume_hash = content_hash(volume, scan)
    claim_folder(folder, volume.geometry, volume_hash, volume.name)
    store = MeshStore(folder, budget_bytes=budget_bytes, plain=plain)
    field = Field.of(volume, settings, scan, volume_hash, extracted)
    pieces, unlisted = wanted_pieces(folder, field, levels)
    found = dict(zip(pieces, load_pieces(store, [piece.key for piece in pieces]), strict=True))
    missing = [piece for piece, mesh in found.items() if mesh is None]
    if missing and extracted is None:
        tally(EXTRACTIONS)
    found.update(extract_pieces(field, levels, missing, store, progress))
    meshes = {piece: mesh for piece, mesh in sorted(found.items()) if mesh is not None}
    surfaces = _surface_set(folder, field, levels, meshes, missing)
    try:
        with full_disk_explained():
            write_boundary(folder, volume_hash, surfaces)
            for level in unlisted:
                rows = rows_of({piece: mesh for piece, mesh in meshes.items() if piece.level == level})
                write_rows(folder, surface_key(volume_hash, float(levels[level]), settings), rows)
    except CacheError as error:
        if not refuses_writing(error):
            raise
        store.read_only = True
    _tell(store)
    return surfaces


def _surface_set(
    folder: Path, field: Field, levels: F64, meshes: dict[Piece, BrickMesh], extracted: Sequence[Piece]
) -> SurfaceSet:
    """Put the meshes together, with the boundary of the folder where it is there."""
    boundary, value_range = _boundary(folder, field)
    shown = tuple(mesh for mesh in meshes.values() if len(mesh.triangles))
    return SurfaceSet(
        geometry=field.volume.geometry,
        isovalues=levels,
        meshes=shown,
        boundary=boundary,
        value_range=value_range,
        settings=field.settings,
        statistics=ExtractionStatistics(
            bricks_total=len(field.bricks),
            brick_visits=len(extracted),
            brick_visits_skipped=len(field.bricks) * len(levels) - len(meshes),
            levels_reused=len(levels) - len({piece.level for piece in extracted}),
            chunks_reused=len(meshes) - len(extracted),
            triangles=count_per_level(levels, shown, "triangles"),
            vertices=count_per_level(levels, shown, "positions"),
        ),
    )


def _check_extracted(extracted: SurfaceSet | None, levels: F64, settings: ExtractionSettings) -> None:
    """Raise unless surfaces that are at hand are those that are asked for."""
    if extracted is None:
        return
    if extracted.settings != settings or not np.array_equal(extracted.isovalues, levels):
        raise InputError(
            f"the extracted surfaces have {len(extracted.isovalues)} isovalues and {extracted.settings}; "
            f"{len(levels)} isovalues with {settings} are asked for. Pass what extract_surfaces gives for these."
        )


def _tell(store: MeshStore) -> None:
    """Warn once about damaged chunks, and once about a folder that takes nothing more."""
    if store.damaged:
        warnings.warn(
            f"{store.damaged} damaged chunks of {store.folder} were extracted again; the first: {store.notes[0]}",
            UserWarning,
            stacklevel=3,
        )
    if store.read_only:
        warnings.warn(
            f"{store.folder} cannot be written: what it lacks was extracted, and will be again the next time.",
            UserWarning,
            stacklevel=3,
        )


def _boundary(folder: Path, field: Field) -> tuple[BoundarySlices, tuple[float, float]]:
    """Return faces and value range, read where they are there and whole."""
    if boundary_path(folder, field.settings).exists():
        with contextlib.suppress(CacheError):  # damaged: made anew, as if it were absent
            return read_boundary(folder, field.content_hash, field.settings, None)
    value_range = field.volume.value_range if field.spline is None else field.spline.value_range
    return BoundarySlices.from_volume(field.volume, field.spline), value_range


def _check_owner(folder: Path, content_hash: str) -> bool:
    """Tell whether a folder is the volume's already; raise `CacheError` if it is another one's."""
    if not (folder / "volume.json").exists():
        return False
    found = _read_volume(folder)["content_hash"]
    if found != content_hash:
        raise CacheError(
            f"{folder} holds surfaces of another volume (content {found[:12]}…, this one has "
            f"{content_hash[:12]}…). Choose another --cache folder."
        )
    return True


def claim_folder(folder: Path, geometry: GridGeometry, content_hash: str, name: str) -> None:
    """Write volume.json unless it is there; refuse another volume's folder."""
    if not _check_owner(folder, content_hash):
        entries = {"name": name, "content_hash": content_hash, "geometry": geometry.to_dict()}
        write_json(folder / "volume.json", "cache", entries)


def _read_volume(folder: Path) -> dict[str, Any]:
    if not (folder / "volume.json").is_file():
        raise CacheError(
            f"{folder} is not a mesh cache: it has no volume.json. "
            "Make one with `isosample precompute VOLUME --tf TF --cache FOLDER`."
        )
    return read_json(folder / "volume.json", "cache")


def _listed(folder: Path, store: MeshStore, key: str, isovalue: float) -> str | None:
    """Return the digest of the list of a surface's chunks, where it is there and all of them are."""
    try:
        rows, digest = read_rows(folder, key, isovalue)
    except CacheError:  # absent or damaged: it is written anew
        return None
    return digest if all(store.has(name.decode()) for name in rows["key"].tolist()) else None


def _kept_rows(
    store: MeshStore, surfaces: SurfaceSet | StoredSurfaces, level: int, content_hash: str
) -> Rows:
    """Return the rows of one level, whose chunks are put into the store where they are not there."""
    if isinstance(surfaces, StoredSurfaces):
        found: Rows = surfaces.chunk_table.rows[surfaces.chunk_table.level == level]
        return found
    geometry, settings = surfaces.geometry, surfaces.settings
    bricks = bricks_of(geometry.size_xyz, settings.brick_cells)
    row_of = {brick.index: row for row, brick in enumerate(bricks)}
    mirrored = geometry.left_handed
    kept: dict[Piece, BrickMesh] = {}
    for mesh in surfaces.pieces(level):
        row = row_of[mesh.brick]
        content = content_in_place(content_hash, row)
        key = chunk_key(content, mesh.isovalue, geometry.spacing, settings, mirrored=mirrored)
        kept[Piece(level, row, key)] = mesh
        if not store.has(key):
            store.put(key, mesh)
    return rows_of(kept)


def _open_surfaces(
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


def _in_memory(stored: StoredSurfaces) -> SurfaceSet:
    """Load all meshes; raise `CacheError` naming the first chunk that is missing or damaged."""
    store, table = stored.store, stored.chunk_table
    assert isinstance(store, MeshStore)
    keys = [key.decode() for key in table["key"].tolist()]
    meshes: list[BrickMesh] = []
    for key, isovalue, mesh in zip(keys, table["isovalue"].tolist(), load_pieces(store, keys), strict=True):
        if mesh is None:
            what = store.notes[0] if store.notes else f"{store.path(key)} is missing"
            raise CacheError(
                f"{what.rstrip('.')}, and isosurface {isovalue!r} with it. Run `isosample precompute` with this "
                "--cache again: it extracts only what is not there."
            )
        meshes.append(mesh)
    return SurfaceSet(
        geometry=stored.geometry,
        isovalues=stored.isovalues,
        meshes=tuple(meshes),
        boundary=stored.boundary,
        value_range=stored.value_range,
        settings=stored.settings,
        statistics=stored.statistics,
        details=tuple(_in_memory(part) for part in stored.details),
    )

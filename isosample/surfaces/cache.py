"""The mesh cache: a folder per volume from which a scene is rendered again without the volume.

    volume.json             geometry and content hash of the volume
    boundary.npz            samples on its six faces, value range; boundary-cubic.npz etc.: of a reconstruction
    chunks/<k>/<key>.chunk  one isosurface in one brick; the key names the brick's content, isovalue and settings
    surfaces/<key>.npz      which chunks make up one isosurface, with their sizes and boxes
    scene.json              transfer function, plan, the surfaces that they need, and the cells that show something

Every file is replaced whole, carries the format's version, and is checked when read. Chunks that are missing or
damaged are extracted again, and only they; without the volume they are named, and never rendered.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from isosample.errors import CacheError
from isosample.surfaces.boundary_files import write_boundary
from isosample.surfaces.cache_files import understood, write_json
from isosample.surfaces.cache_levels import (
    Piece,
    content_in_place,
    rows_of,
)
from isosample.surfaces.cached_extraction import extract_with_cache as extract_with_cache
from isosample.surfaces.cached_surfaces import in_memory, listed_surfaces
from isosample.surfaces.cached_surfaces import lists_surfaces as lists_surfaces
from isosample.surfaces.cached_surfaces import load_surface_set as load_surface_set
from isosample.surfaces.cached_surfaces import open_surface_set as open_surface_set
from isosample.surfaces.settings import ExtractionSettings, check_isovalues
from isosample.surfaces.store import MeshStore, chunk_key
from isosample.surfaces.stored_surfaces import StoredSurfaces
from isosample.surfaces.surface_files import listed_key, read_rows, surface_key, write_rows
from isosample.surfaces.surface_set import SurfaceSet
from isosample.surfaces.volume_file import claim_folder as claim_folder
from isosample.surfaces.volume_file import content_hash as content_hash
from isosample.surfaces.volume_file import read_scene, read_volume
from isosample.transfer.isovalues import IsovaluePlan
from isosample.transfer.transfer_function import TransferFunction
from isosample.volume.bricks import bricks_of
from isosample.volume.reconstruction import Reconstruction
from isosample.volume.shown_cells import Shown

if TYPE_CHECKING:
    from isosample.surfaces.chunk_table import Rows
    from isosample.surfaces.mesh import BrickMesh


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
    mesh_distance : float or None
    visible : Shown or None
        As of `write_cache`.
    """

    surfaces: SurfaceSet
    transfer_function: TransferFunction
    plan: IsovaluePlan
    name: str
    mesh_distance: float | None = None
    visible: Shown | None = None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class OpenedScene:
    """A scene as `open_cache` gives it: as `CachedScene`, but meshes stay in the folder until they are asked for."""

    surfaces: StoredSurfaces
    transfer_function: TransferFunction
    plan: IsovaluePlan
    name: str
    mesh_distance: float | None = None
    visible: Shown | None = None


def write_cache(
    folder: str | Path,
    surfaces: SurfaceSet | StoredSurfaces,
    *,
    content_hash: str,
    transfer_function: TransferFunction,
    plan: IsovaluePlan,
    name: str = "volume",
    mesh_distance: float | None = None,
    visible: Shown | None = None,
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
    mesh_distance : float, optional
        Of an automatic refinement: largest rms distance of a level from its isosurface [voxel].
    visible : Shown, optional
        Where the transfer function shows something of the volume (`visible_span`); None: not known.

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
    scene: dict[str, Any] = {
        "content_hash": content_hash,
        "settings": surfaces.settings.to_dict(),
        "boundary_sha256": boundary,
        "transfer_function": transfer_function.to_dict(),
        "plan": plan.to_dict(),
        "surfaces": _written(folder, store, surfaces, content_hash),
        "details": details,
    }
    if mesh_distance is not None:
        scene["mesh_distance"] = mesh_distance
    if visible is not None:
        scene["visible"] = visible.span  # null: nothing is
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
    return load_opened(open_cache(folder))


def load_opened(opened: OpenedScene) -> CachedScene:
    """Return an opened scene with all meshes in memory; raises `CacheError` where one is missing or damaged."""
    return CachedScene(
        surfaces=in_memory(opened.surfaces),
        transfer_function=opened.transfer_function,
        plan=opened.plan,
        name=opened.name,
        mesh_distance=opened.mesh_distance,
        visible=opened.visible,
    )


def open_cache(folder: str | Path) -> OpenedScene:
    """Return the scene of a cache folder, whose meshes are loaded when they are asked for; raises as `load_cache`."""
    folder = Path(folder)
    volume = read_volume(folder)
    scene = read_scene(folder, volume["content_hash"])
    with understood(folder / "scene.json", "scene"):
        return _opened(folder, volume, scene)


def _opened(folder: Path, volume: dict[str, Any], scene: dict[str, Any]) -> OpenedScene:
    """Return a scene of which both documents are read."""
    levels = check_isovalues([float.fromhex(entry["isovalue"]) for entry in scene["surfaces"]])

    def opened(part: dict[str, Any]) -> StoredSurfaces:
        digests = {entry["key"]: entry["sha256"] for entry in part["surfaces"]}
        digests["boundary"] = scene["boundary_sha256"]
        return listed_surfaces(
            folder, volume, levels, ExtractionSettings.from_dict(part["settings"]), digests
        )

    details = tuple(opened(part) for part in scene.get("details", []))
    return OpenedScene(
        surfaces=replace(opened(scene), details=details),
        transfer_function=TransferFunction.from_dict(scene["transfer_function"]),
        plan=IsovaluePlan.from_dict(scene["plan"]),
        name=volume["name"],
        mesh_distance=scene.get("mesh_distance"),
        visible=_shown(scene),
    )


def known_visible(folder: str | Path, content_hash: str, transfer_function: TransferFunction) -> Shown | None:
    """Return what the scene of a folder tells about where a transfer function shows something of the trilinear field.

    None where there is no such scene of this volume and transfer function, or it does not tell.
    """
    wanted = Reconstruction.TRILINEAR.value, transfer_function.to_dict()
    try:
        scene = read_scene(Path(folder), content_hash)
        with understood(Path(folder) / "scene.json", "scene"):
            found = scene["settings"]["reconstruction"], scene["transfer_function"]
            return _shown(scene) if found == wanted else None
    except CacheError:  # none, or none that can be used: it is written anew
        return None


def _shown(scene: dict[str, Any]) -> Shown | None:
    """Return where something is visible; scenes of older folders do not tell."""
    if "visible" not in scene:
        return None
    if scene["visible"] is None:
        return Shown(None)
    (a, b, c), (d, e, f) = scene["visible"]
    return Shown(((a, b, c), (d, e, f)))


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

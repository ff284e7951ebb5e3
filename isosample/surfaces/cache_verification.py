"""Whether a cache folder is whole: what is damaged or missing, and whether its scene needs it."""

from __future__ import annotations

import contextlib
from typing import TYPE_CHECKING, Any, NamedTuple

from isosample.errors import CacheError
from isosample.surfaces.boundary_files import boundary_path, read_boundary
from isosample.surfaces.cache_files import read_arrays, understood
from isosample.surfaces.cache_folders import has_scene
from isosample.surfaces.chunk_folder import ChunkFolder, DamagedChunk
from isosample.surfaces.settings import ExtractionSettings
from isosample.surfaces.surface_files import AbsentSurfaceError, read_rows, rows_of_arrays, surface_path
from isosample.surfaces.volume_file import read_scene, volume_entries
from isosample.transfer.isovalues import IsovaluePlan
from isosample.transfer.transfer_function import TransferFunction

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping
    from pathlib import Path

OWNER_FILE = "volume.json"


class FolderVerified(NamedTuple):
    """What `verify_folder` found.

    Attributes
    ----------
    volume : str
        Name of the volume; empty where volume.json cannot be used.
    looked_through : bool
        Whether all files were read: not where volume.json is there and cannot be used, whose remedy comes first.
    damaged : tuple of DamagedChunk
        Files that cannot be used, or that a scene needs and that are missing.
    pieces, pieces_missing : int
        Pieces of isosurfaces that are listed, and those whose chunk is not there, because it made room for others or
        was removed. That is no damage: they are extracted again when they are needed.
    scene_missing : int or None
        Of the latter, those that the folder's scene needs; None where there is no scene that can be read.
    scene_isovalues : tuple of float
        Of the folder's scene, ascending; empty where there is none that can be used.
    scene_needs : bool
        Whether the folder's scene needs anything that is damaged or missing.
    others_need : tuple of float
        Isovalues, ascending, of the pieces that are damaged or missing and that the scene is not known to need: of
        other transfer functions or options, or of coarser tries of an automatic refinement. A folder keeps such
        pieces, but not what they were made for.
    unlisted : int
        Damaged files of which nothing tells who needs them: chunks in no list, lists and boundaries of no scene.
    """

    volume: str
    looked_through: bool
    damaged: tuple[DamagedChunk, ...]
    pieces: int
    pieces_missing: int
    scene_missing: int | None
    scene_isovalues: tuple[float, ...]
    scene_needs: bool
    others_need: tuple[float, ...]
    unlisted: int


class _Listed(NamedTuple):
    """Isovalues of all pieces by the keys of their chunks: those that the scene needs, and all others."""

    scene: dict[str, float]
    others: dict[str, float]


def verify_folder(folder: Path) -> FolderVerified:
    """Read every file of a cache folder, and tell which are damaged and why, what is missing, and whose."""
    damaged: dict[Path, str] = {}
    volume: dict[str, Any] = {}
    isovalues: tuple[float, ...] = ()
    needed = {folder / "scene.json"}
    with _noting(damaged, folder / OWNER_FILE):
        volume = volume_entries(folder)
    if damaged and (folder / OWNER_FILE).exists():
        return _not_looked_through(folder / OWNER_FILE, damaged[folder / OWNER_FILE])
    if has_scene(folder):  # else it was never rendered as a scene
        with _noting(damaged, folder / "scene.json"):
            scene = read_scene(folder, volume.get("content_hash"))
            with understood(folder / "scene.json", "scene"):
                isovalues = tuple(float.fromhex(entry["isovalue"]) for entry in scene["surfaces"])
                needed |= _verify_scene(folder, scene, damaged)
                TransferFunction.from_dict(scene["transfer_function"])
                IsovaluePlan.from_dict(scene["plan"])
    scene_known = has_scene(folder) and folder / "scene.json" not in damaged
    listed = _listed(folder, needed if scene_known else set(), damaged)
    store = ChunkFolder(folder, read_only=True)
    there = set(store.keys())
    files = [DamagedChunk(path, reason) for path, reason in damaged.items()]
    chunks = store.verify().damaged
    lost = {chunk.path.stem for chunk in chunks}
    of_scene = lost | (listed.scene.keys() - there)
    of_others = lost | (listed.others.keys() - there)
    unlisted = lost - listed.scene.keys() - listed.others.keys()
    ownerless = damaged.keys() - needed - {folder / OWNER_FILE}
    return FolderVerified(
        volume=volume.get("name", ""),
        looked_through=True,
        damaged=(*files, *chunks),
        pieces=len(listed.scene) + len(listed.others),
        pieces_missing=len((listed.scene.keys() | listed.others.keys()) - there),
        scene_missing=len(listed.scene.keys() - there) if scene_known else None,
        scene_isovalues=isovalues,
        scene_needs=bool(damaged.keys() & needed or listed.scene.keys() & of_scene),
        others_need=tuple(sorted({listed.others[key] for key in listed.others.keys() & of_others})),
        unlisted=len(unlisted) + len(ownerless),
    )


def _not_looked_through(path: Path, reason: str) -> FolderVerified:
    """Of a folder whose volume.json cannot be used: what else is wrong with it depends on what that says."""
    return FolderVerified(
        volume="",
        looked_through=False,
        damaged=(DamagedChunk(path, reason),),
        pieces=0,
        pieces_missing=0,
        scene_missing=None,
        scene_isovalues=(),
        scene_needs=False,
        others_need=(),
        unlisted=0,
    )


def _listed(folder: Path, needed: set[Path], damaged: dict[Path, str]) -> _Listed:
    """Read all lists and boundaries; a piece that the scene needs is the scene's, whoever else needs it."""
    scene: dict[str, float] = {}
    others: dict[str, float] = {}
    for path in sorted([*folder.glob("*.npz"), *folder.glob("surfaces/*.npz")]):
        with _noting(damaged, path):
            arrays, _ = read_arrays(path, {})
            if path.parent.name == "surfaces":
                rows = rows_of_arrays(arrays, path)
                keys = (key.decode() for key in rows["key"].tolist())
                (scene if path in needed else others).update(
                    zip(keys, rows["isovalue"].tolist(), strict=True)
                )
    return _Listed(scene, {key: value for key, value in others.items() if key not in scene})


def _verify_scene(folder: Path, scene: Mapping[str, Any], damaged: dict[Path, str]) -> set[Path]:
    """Read what a scene and its details need, and hold it against the digests that it pins; return which files."""
    needed: set[Path] = set()
    for part in (scene, *scene.get("details", [])):
        settings = ExtractionSettings.from_dict(part["settings"])
        needed.add(boundary_path(folder, settings))
        with _noting(damaged, boundary_path(folder, settings)):
            read_boundary(folder, scene["content_hash"], settings, scene["boundary_sha256"])
        detail = f", detail {settings.detail}," if settings.detail else ""
        for entry in part["surfaces"]:
            path, isovalue = surface_path(folder, entry["key"]), float.fromhex(entry["isovalue"])
            needed.add(path)
            with _noting(damaged, path, f"isosurface {isovalue!r}{detail} of scene.json is missing."):
                read_rows(folder, entry["key"], isovalue, entry["sha256"])
    return needed


@contextlib.contextmanager
def _noting(damaged: dict[Path, str], path: Path, absent: str | None = None) -> Iterator[None]:
    """Note a file that turns out to be damaged, by its first reason; `absent` is told of a list that is missing."""
    try:
        yield
    except CacheError as error:
        told = absent if absent and isinstance(error, AbsentSurfaceError) else str(error)
        damaged.setdefault(path, told)

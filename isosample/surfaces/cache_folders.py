"""All cache folders of a place: what they hold, whether it is whole, and making room."""

from __future__ import annotations

import contextlib
from typing import TYPE_CHECKING, Any, NamedTuple

from isosample.errors import CacheError, InputError
from isosample.surfaces.boundary_files import boundary_path, read_boundary
from isosample.surfaces.cache_files import read_arrays, read_json
from isosample.surfaces.chunk_folder import CHUNK_FOLDER, ChunkFolder, DamagedChunk
from isosample.surfaces.settings import ExtractionSettings
from isosample.surfaces.surface_files import AbsentSurfaceError, read_rows, rows_of_arrays, surface_path
from isosample.surfaces.volume_file import read_scene

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping
    from pathlib import Path


class FolderSummary(NamedTuple):
    """What a cache folder holds.

    Attributes
    ----------
    folder : Path
    name : str
        Of the volume; empty where volume.json cannot be used.
    size_xyz : 3 ints
        Samples of the volume.
    isovalues, details : int
        Isosurfaces of the scene, and the coarser details of each.
    surfaces, chunks : int
        Lists of chunks, one per isosurface and detail, of this scene and others; and chunks.
    size_bytes : int
        Of all files.
    used : float
        When a chunk was last used [s since 1970]; 0 where there is none.
    finished : bool
        Whether there is a scene: without one, `isosample precompute` was interrupted and will go on.
    problem : str
        Why the folder cannot be used; empty where it can.
    """

    folder: Path
    name: str
    size_xyz: tuple[int, ...]
    isovalues: int
    details: int
    surfaces: int
    chunks: int
    size_bytes: int
    used: float
    finished: bool
    problem: str


class FolderVerified(NamedTuple):
    """What `verify_folder` found.

    Attributes
    ----------
    damaged : tuple of DamagedChunk
        Files that cannot be used, or that a scene needs and that are missing.
    pieces, pieces_missing : int
        Pieces of isosurfaces that are listed, and those whose chunk is not there, because it made room for others or
        was removed. That is no damage: they are extracted again when they are needed.
    """

    damaged: tuple[DamagedChunk, ...]
    pieces: int
    pieces_missing: int


def cache_folders(place: Path) -> list[Path]:
    """Return the place itself where it is a cache folder, else those directly in it, sorted.

    Raises
    ------
    CacheError
        If the place is no folder, or there is no cache folder.
    """
    if not place.is_dir():
        state = "is not a folder" if place.exists() else "does not exist"
        raise CacheError(
            f"{place} {state}. Name a folder that `isosample precompute` made, or one of such folders."
        )
    found = [place] if _is_cache(place) else sorted(path for path in place.iterdir() if _is_cache(path))
    if not found:
        raise CacheError(
            f"{place} is not a mesh cache, and there is none in it. Make one with `isosample precompute`."
        )
    return found


def summarise(folder: Path) -> FolderSummary:
    """Look through a cache folder; nothing is decoded."""
    name, problem = "", ""
    size_xyz: tuple[int, ...] = ()
    scene: dict[str, Any] = {"surfaces": []}
    finished = has_scene(folder)
    try:
        volume = read_json(folder / "volume.json", "cache")
        name, size_xyz = volume["name"], tuple(volume["geometry"]["size_xyz"])
        if finished:
            scene = read_json(folder / "scene.json", "scene")
    except CacheError as error:
        problem = str(error)
    chunks = ChunkFolder(folder, read_only=True).chunks()
    return FolderSummary(
        folder=folder,
        name=name,
        size_xyz=size_xyz,
        isovalues=len(scene["surfaces"]),
        details=len(scene.get("details", [])),
        surfaces=len(list(folder.glob("surfaces/*.npz"))),
        chunks=len(chunks),
        size_bytes=folder_bytes(folder),
        used=chunks[-1].used if chunks else 0.0,
        finished=finished,
        problem=problem,
    )


def has_scene(folder: Path) -> bool:
    """Tell whether a cache folder holds a scene, damaged or not; an interrupted `isosample precompute` leaves none."""
    return (folder / "scene.json").exists()


def folder_bytes(folder: Path) -> int:
    """Return the size of all files in a folder, as far as they are still there when they are looked at."""
    total = 0
    for path in folder.rglob("*"):
        try:
            total += path.stat().st_size if path.is_file() else 0
        except FileNotFoundError:  # another process made room
            continue
    return total


def verify_folder(folder: Path) -> FolderVerified:
    """Read every file of a cache folder, and tell which are damaged, with the reason each, and what is missing."""
    damaged: dict[Path, str] = {}
    volume: dict[str, Any] = {}
    with _noting(damaged, folder / "volume.json"):
        volume = read_json(folder / "volume.json", "cache")
    if has_scene(folder):  # else it was never rendered as a scene
        with _noting(damaged, folder / "scene.json"):
            _verify_scene(folder, read_scene(folder, volume.get("content_hash")), damaged)
    listed: set[bytes] = set()
    for path in sorted([*folder.glob("*.npz"), *folder.glob("surfaces/*.npz")]):
        with _noting(damaged, path):
            arrays, _ = read_arrays(path, {})
            if path.parent.name == "surfaces":
                listed.update(rows_of_arrays(arrays, path)["key"].tolist())
    store = ChunkFolder(folder, read_only=True)
    there = {key.encode() for key in store.keys()}  # noqa: SIM118  # a store is no mapping
    files = (DamagedChunk(path, reason) for path, reason in damaged.items())
    return FolderVerified((*files, *store.verify().damaged), len(listed), len(listed - there))


def _verify_scene(folder: Path, scene: Mapping[str, Any], damaged: dict[Path, str]) -> None:
    """Read what a scene and its details need, and hold it against the digests that the scene pins."""
    for part in (scene, *scene.get("details", [])):
        settings = ExtractionSettings.from_dict(part["settings"])
        with _noting(damaged, boundary_path(folder, settings)):
            read_boundary(folder, scene["content_hash"], settings, scene["boundary_sha256"])
        detail = f", detail {settings.detail}," if settings.detail else ""
        for entry in part["surfaces"]:
            path, isovalue = surface_path(folder, entry["key"]), float.fromhex(entry["isovalue"])
            with _noting(damaged, path, f"isosurface {isovalue!r}{detail} of scene.json is missing."):
                read_rows(folder, entry["key"], isovalue, entry["sha256"])


@contextlib.contextmanager
def _noting(damaged: dict[Path, str], path: Path, absent: str | None = None) -> Iterator[None]:
    """Note a file that turns out to be damaged, by its first reason; `absent` is told of a list that is missing."""
    try:
        yield
    except (CacheError, InputError) as error:  # the latter where a scene has settings that are unknown here
        told = absent if absent and isinstance(error, AbsentSurfaceError) else str(error)
        damaged.setdefault(path, told)


def scene_lacks(folder: Path) -> int:
    """Return how many pieces of a folder's scene, of all details, are not there; 0 without a scene.

    Raises
    ------
    CacheError
        If the scene, or a list of its chunks, is damaged.
    """
    from isosample.surfaces.cache import open_cache

    if not has_scene(folder):
        return 0
    there = set(ChunkFolder(folder, read_only=True).keys())
    tables = [one.chunk_table for one in open_cache(folder).surfaces.by_detail]
    return len({key.decode() for table in tables for key in table["key"].tolist()} - there)


def _is_cache(folder: Path) -> bool:
    """Tell whether a folder is or was a mesh cache."""
    return (folder / "volume.json").is_file() or (folder / CHUNK_FOLDER).is_dir()

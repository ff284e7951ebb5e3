"""All cache folders of a place: what they hold, whether it is whole, and making room."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

from isosample.errors import CacheError
from isosample.surfaces.cache_files import read_arrays, read_json
from isosample.surfaces.chunk_folder import CHUNK_FOLDER, ChunkFolder, DamagedChunk, remove
from isosample.surfaces.surface_files import rows_of_arrays, surface_path

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
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


class FolderPruned(NamedTuple):
    """What was removed from a folder, or would be: chunks, and their bytes."""

    folder: Path
    chunks: int
    size_bytes: int


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
    damaged = []
    listed: set[bytes] = set()
    for name, kind in (("volume.json", "cache"), ("scene.json", "scene")):
        path = folder / name
        if name == "scene.json" and not path.exists():
            continue  # a folder that was never rendered as a scene
        try:
            document = read_json(path, kind)
        except CacheError as error:
            damaged.append(DamagedChunk(path, str(error)))
            continue
        if name == "scene.json":
            damaged += _missing_lists(folder, document)
    store = ChunkFolder(folder, read_only=True)
    for path in sorted([*folder.glob("*.npz"), *folder.glob("tables/*.npz"), *folder.glob("surfaces/*.npz")]):
        try:
            arrays, _ = read_arrays(path, {})
            if path.parent.name == "surfaces":
                listed.update(rows_of_arrays(arrays, path)["key"].tolist())
        except CacheError as error:
            damaged.append(DamagedChunk(path, str(error)))
    there = {key.encode() for key in store.keys()}  # noqa: SIM118  # a store is no mapping
    return FolderVerified((*damaged, *store.verify().damaged), len(listed), len(listed - there))


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


def _missing_lists(folder: Path, scene: Mapping[str, Any]) -> list[DamagedChunk]:
    """Return the lists of chunks that a scene names, of its surfaces and their details, and that are not there."""
    named = [(part, entry) for part in (scene, *scene.get("details", [])) for entry in part["surfaces"]]
    damaged = []
    for part, entry in named:
        path = surface_path(folder, entry["key"])
        if not path.exists():
            detail = part["settings"].get("detail", 0)
            what = f"isosurface {float.fromhex(entry['isovalue'])!r}" + (
                f", detail {detail}," if detail else ""
            )
            damaged.append(DamagedChunk(path, f"{what} of scene.json is missing."))
    return damaged


def prune_folders(folders: Sequence[Path], budget_bytes: int, *, pretend: bool = False) -> list[FolderPruned]:
    """Remove the chunks of all folders that were used longest ago, until all together take at most so many bytes.

    Parameters
    ----------
    folders : sequence of Path
    budget_bytes : int
    pretend : bool
        Remove nothing, and tell what would be.

    Raises
    ------
    CacheError
        If a file cannot be removed.
    """
    stores = [ChunkFolder(folder) for folder in folders]
    there = [(chunk.used, number, chunk) for number, store in enumerate(stores) for chunk in store.chunks()]
    excess = sum(chunk.size_bytes for _, _, chunk in there) - budget_bytes
    counts, freed = [0] * len(stores), [0] * len(stores)
    for _, number, chunk in sorted(there):
        if excess <= 0:
            break
        if not pretend:
            remove(stores[number].path(chunk.key))
        excess -= chunk.size_bytes
        counts[number] += 1
        freed[number] += chunk.size_bytes
    return [FolderPruned(*row) for row in zip(folders, counts, freed, strict=True)]


def _is_cache(folder: Path) -> bool:
    """Tell whether a folder is or was a mesh cache."""
    return (folder / "volume.json").is_file() or (folder / CHUNK_FOLDER).is_dir()

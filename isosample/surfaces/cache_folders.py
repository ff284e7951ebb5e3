"""All cache folders of a place, and what they hold."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

from isosample.errors import CacheError
from isosample.surfaces.cache_files import read_json
from isosample.surfaces.chunk_folder import CHUNK_FOLDER, ChunkFolder
from isosample.surfaces.volume_file import volume_entries

if TYPE_CHECKING:
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
    pieces_missing : int
        Pieces that the scene, of all details, needs and that are not there: evicted, or removed.
    problem : str
        Why the folder cannot be used; empty where it can, as far as that can be told without decoding a chunk.
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
    pieces_missing: int
    problem: str

    @property
    def state(self) -> str:
        """In one word, what a picture from the folder alone comes to; `complete` where all that it needs is there."""
        if self.problem:
            return "unusable"
        if not self.finished:
            return "unfinished"
        return "incomplete" if self.pieces_missing else "complete"


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
    name, problem, missing = "", "", 0
    size_xyz: tuple[int, ...] = ()
    scene: dict[str, Any] = {"surfaces": []}
    finished = has_scene(folder)
    try:
        volume = volume_entries(folder)
        name, size_xyz = volume["name"], tuple(volume["geometry"]["size_xyz"])
        if finished:
            scene = read_json(folder / "scene.json", "scene")
            missing = scene_lacks(folder)
    except CacheError as error:
        problem = str(error)
    chunks = ChunkFolder(folder, read_only=True).chunks()
    return FolderSummary(
        folder=folder,
        name=name,
        size_xyz=size_xyz,
        isovalues=len(scene.get("surfaces", [])),
        details=len(scene.get("details", [])),
        surfaces=len(list(folder.glob("surfaces/*.npz"))),
        chunks=len(chunks),
        size_bytes=folder_bytes(folder),
        used=chunks[-1].used if chunks else 0.0,
        finished=finished,
        pieces_missing=missing,
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

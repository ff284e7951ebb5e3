"""Files of chunks in a folder: which are there, making room among them, and whether they are whole.

Nothing is stale, and nothing expires by age; where room is made, the chunks that were used longest ago go. A chunk's
time of change says when it was last used.
"""

from __future__ import annotations

import contextlib
from typing import TYPE_CHECKING, NamedTuple

from isosample.errors import CacheError
from isosample.files import leftovers
from isosample.surfaces.chunk_decoding import decode
from isosample.surfaces.plain_chunks import PLAIN_MAGIC, decode_plain

if TYPE_CHECKING:
    import mmap
    from collections.abc import Collection, Iterator, Sequence
    from pathlib import Path

    from isosample.surfaces.mesh import BrickMesh

CHUNK_FOLDER = "chunks"
CHUNK_SUFFIX = ".chunk"


class StoredChunk(NamedTuple):
    """A chunk in a folder: its key, its bytes, and when it was last used [s since 1970]."""

    key: str
    size_bytes: int
    used: float


class DamagedChunk(NamedTuple):
    """A chunk that cannot be used, and why."""

    path: Path
    reason: str


class Pruned(NamedTuple):
    """What `prune` took away from one folder, and left.

    Attributes
    ----------
    chunks, size_bytes : int
        Chunks that made room, and their bytes.
    leftovers, leftover_bytes : int
        Temporary files of processes that were killed while they wrote, and their bytes.
    chunks_left, bytes_left : int
        Chunks that stay, and their bytes.
    """

    chunks: int
    size_bytes: int
    leftovers: int
    leftover_bytes: int
    chunks_left: int
    bytes_left: int


class Verified(NamedTuple):
    """What `ChunkFolder.verify` found: chunks and bytes looked at, and those that cannot be used."""

    chunks: int
    size_bytes: int
    damaged: tuple[DamagedChunk, ...]


class ChunkFolder:
    """Chunks in `folder`/chunks.

    Parameters
    ----------
    folder : Path
    read_only : bool
        Remove nothing; `prune` raises.
    """

    def __init__(self, folder: Path, *, read_only: bool = False) -> None:
        self.folder = folder
        self.read_only = read_only

    def path(self, key: str) -> Path:
        """Return the file of a chunk."""
        return self.folder / CHUNK_FOLDER / key[:2] / f"{key}{CHUNK_SUFFIX}"

    def keys(self) -> list[str]:
        """Return the names of all chunks, sorted."""
        return sorted(path.stem for path in self._files())

    def chunks(self) -> list[StoredChunk]:
        """Return all chunks, those used longest ago first."""
        found = []
        for path in self._files():
            with contextlib.suppress(FileNotFoundError):  # another process made room
                state = path.stat()
                found.append(StoredChunk(path.stem, state.st_size, state.st_mtime))
        return sorted(found, key=lambda chunk: (chunk.used, chunk.key))

    def prune(self, budget_bytes: int, *, keep: Collection[str] = ()) -> Pruned:
        """Make room in this folder alone, as `prune` does."""
        return prune([self], budget_bytes, keep=keep)[0]

    def leftovers(self) -> list[tuple[Path, int]]:
        """Return the temporary files that killed processes left anywhere in the folder, with their bytes."""
        places = (
            self.folder,
            *self.folder.glob("surfaces"),
            *self.folder.glob(f"{CHUNK_FOLDER}/[0-9a-f][0-9a-f]"),
        )
        return [found for place in places for found in leftovers(place)]

    def verify(self) -> Verified:
        """Decode every chunk; nothing is removed."""
        damaged: list[DamagedChunk] = []
        count = total = 0
        for path in sorted(self._files()):
            try:
                data = path.read_bytes()
            except FileNotFoundError:  # another process made room
                continue
            except OSError as error:
                damaged.append(DamagedChunk(path, f"it cannot be read ({error.strerror})."))
                continue
            count, total = count + 1, total + len(data)
            try:
                _decoded(data, _name_of(path))
            except CacheError as error:
                damaged.append(DamagedChunk(path, str(error)))
        return Verified(count, total, tuple(damaged))

    def _files(self) -> Iterator[Path]:
        """Yield the files of all chunks."""
        folder = self.folder / CHUNK_FOLDER
        return (path for path in folder.glob(f"[0-9a-f][0-9a-f]/*{CHUNK_SUFFIX}"))


def prune(
    stores: Sequence[ChunkFolder], budget_bytes: int, *, keep: Collection[str] = (), pretend: bool = False
) -> list[Pruned]:
    """Remove the chunks that were used longest ago, wherever they are, until all together take at most so many bytes.

    What killed processes left half-written is removed, whatever the budget.

    Parameters
    ----------
    stores : sequence of ChunkFolder
    budget_bytes : int
    keep : collection of str
        Keys of chunks that stay, whatever the budget.
    pretend : bool
        Remove nothing, and tell what would be.

    Returns
    -------
    pruned : list of Pruned
        One for each folder.

    Raises
    ------
    CacheError
        If a folder is read-only or a file cannot be removed.
    """
    for store in stores:
        if store.read_only and not pretend:
            raise CacheError(f"{store.folder} was opened for reading only; nothing can be removed from it.")
    left_over = [store.leftovers() for store in stores]
    there = [store.chunks() for store in stores]
    oldest = sorted((chunk.used, place, chunk) for place, found in enumerate(there) for chunk in found)
    excess = sum(chunk.size_bytes for _, _, chunk in oldest) - budget_bytes
    gone: list[list[int]] = [[] for _ in stores]  # sizes of chunks
    condemned = [path for found in left_over for path, _ in found]
    for _, place, chunk in oldest:
        if excess <= 0:
            break
        if chunk.key in keep:
            continue
        condemned.append(stores[place].path(chunk.key))
        gone[place].append(chunk.size_bytes)
        excess -= chunk.size_bytes
    if not pretend:
        for path in condemned:
            remove(path)
    return [
        Pruned(
            chunks=len(sizes),
            size_bytes=sum(sizes),
            leftovers=len(temporary),
            leftover_bytes=sum(size for _, size in temporary),
            chunks_left=len(found) - len(sizes),
            bytes_left=sum(chunk.size_bytes for chunk in found) - sum(sizes),
        )
        for found, sizes, temporary in zip(there, gone, left_over, strict=True)
    ]


def remove(path: Path) -> None:
    """Remove a file that another process may have removed already.

    Raises
    ------
    CacheError
        If it cannot be removed.
    """
    try:
        path.unlink(missing_ok=True)
    except OSError as error:
        raise CacheError(f"{path} cannot be removed: {error.strerror}. Check who owns the folder.") from error


def _decoded(data: bytes | mmap.mmap, name: bytes) -> BrickMesh:
    """Return the mesh of a chunk of either kind; raises as `decode` does."""
    if isinstance(data, bytes) and data[: len(PLAIN_MAGIC)] != PLAIN_MAGIC:
        return decode(data, name=name)
    return decode_plain(data, name=name)


def _name_of(path: Path) -> bytes:
    """Return the name that a chunk's file says it has; raise `CacheError` if that is none."""
    try:
        name = bytes.fromhex(path.stem)
    except ValueError:
        name = b""
    if len(name) != 32:
        raise CacheError(f"{path.name} is not the name of a chunk.")
    return name

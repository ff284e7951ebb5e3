"""Files of chunks in a folder: which are there, making room among them, and whether they are whole.

Nothing is stale, and nothing expires by age; where room is made, the chunks that were used longest ago go. A chunk's
time of change says when it was last used.
"""

from __future__ import annotations

import contextlib
import time
from typing import TYPE_CHECKING, NamedTuple

from isosample.errors import CacheError
from isosample.surfaces.chunk_decoding import decode
from isosample.surfaces.plain_chunks import PLAIN_MAGIC, decode_plain

if TYPE_CHECKING:
    import mmap
    from collections.abc import Collection, Iterator
    from pathlib import Path

    from isosample.surfaces.mesh import BrickMesh

CHUNK_FOLDER = "chunks"
CHUNK_SUFFIX = ".chunk"
STALE_SECONDS = 3600.0  # a temporary file as old as that was left by a process that was killed


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
    """What `ChunkFolder.prune` took away and left."""

    chunks: int
    size_bytes: int
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
        """Remove the chunks that were used longest ago, until all take at most so many bytes.

        Parameters
        ----------
        budget_bytes : int
        keep : collection of str
            Keys of chunks that stay, whatever the budget.

        Raises
        ------
        CacheError
            If the store is read-only or a file cannot be removed.
        """
        if self.read_only:
            raise CacheError(f"{self.folder} was opened for reading only; nothing can be removed from it.")
        self._remove_leftovers()
        there = self.chunks()
        total, removed, freed = sum(chunk.size_bytes for chunk in there), 0, 0
        for chunk in there:
            if total - freed <= budget_bytes:
                break
            if chunk.key in keep:
                continue
            remove(self.path(chunk.key))
            removed, freed = removed + 1, freed + chunk.size_bytes
        return Pruned(removed, freed, len(there) - removed, total - freed)

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

    def _remove_leftovers(self) -> None:
        """Remove temporary files of processes that were killed while they wrote."""
        for path in (self.folder / CHUNK_FOLDER).glob("[0-9a-f][0-9a-f]/.*.tmp"):
            with contextlib.suppress(OSError):
                if time.time() - path.stat().st_mtime > STALE_SECONDS:
                    path.unlink()


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

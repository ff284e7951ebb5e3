"""A folder of chunks, one per (isovalue, brick), named by all that decides about them.

Each chunk is a file of its own that appears whole or not at all, so any number of processes may read and write one
folder at once: the same name means the same content. Nothing is stale, and nothing expires by age; where a budget is
given, the chunks that were used longest ago make room. A chunk's time of change says when it was last used.
"""

from __future__ import annotations

import contextlib
import errno
import os
import stat
import threading
import time
from typing import TYPE_CHECKING

from isosample.errors import CacheError
from isosample.files import replacing
from isosample.surfaces.cache_files import digest_of
from isosample.surfaces.chunk_decoding import decode_all
from isosample.surfaces.chunk_encoding import encode
from isosample.surfaces.chunk_folder import CHUNK_FOLDER, CHUNK_SUFFIX, ChunkFolder
from isosample.surfaces.chunk_header import OtherVersionError
from isosample.surfaces.chunk_layout import CHUNK_VERSION
from isosample.surfaces.chunk_reading import TooManyFilesError, chunk_content
from isosample.surfaces.plain_chunks import PLAIN_MAGIC, decode_plain, encode_plain

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from pathlib import Path

    from isosample.surfaces.mesh import BrickMesh
    from isosample.surfaces.settings import ExtractionSettings

TOUCH_SECONDS = 60.0  # a chunk whose last use is noted as more recent is not noted again
FULL = (errno.ENOSPC, errno.EDQUOT)
PRUNE_TO = 0.9  # of the budget: so that not every new chunk makes the store look through the folder


def chunk_key(
    content: str,
    isovalue: float,
    spacing: Sequence[float],
    settings: ExtractionSettings,
    version: int = CHUNK_VERSION,
    *,
    mirrored: bool = False,
) -> str:
    """Return the name of a chunk: a sha256 of everything that decides about it, hexadecimal.

    Parameters
    ----------
    content : str
        Digest of the brick's samples with those around it, of their type, and of the brick's place in the volume
        (`BrickScan.digests`); of the whole volume and the brick's place where a reconstruction is smooth.
    isovalue : float
        In data units; -0.0 is 0.0.
    spacing : 3 floats
        Distance of samples along x, y, z [world].
    settings : ExtractionSettings
    version : int
        Of the format.
    mirrored : bool
        Whether index coordinates are left-handed in world space, which turns the triangles round.
    """
    return digest_of(
        {
            "content": content,
            "isovalue": (isovalue + 0.0).hex(),
            "spacing": [float(step).hex() for step in spacing],
            "settings": settings.to_dict(),
            "version": version,
            "mirrored": mirrored,
        }
    )


class MeshStore(ChunkFolder):
    """Chunks in `folder`/chunks.

    Parameters
    ----------
    folder : Path
        Made when the first chunk is written.
    budget_bytes : int, optional
        Chunks that were used longest ago are removed when all together take more; never those that this store wrote
        or read itself, so one run may go beyond its budget and never loses what it needs.
    read_only : bool
        Write, remove and touch nothing; `put` raises.
    plain : bool
        Write chunks that need no decoding (`plain_chunks`), four to six times as large. Both kinds are always read.

    Attributes
    ----------
    hits, misses, written, damaged, evicted : int
        Chunks that `get` found and did not find, that `put` wrote, that `get` could not use, and that made room.
    notes : list of str
        One line per damaged chunk: which, and why.
    reasons : dict of str to str
        The same by key, of each the latest.
    """

    def __init__(
        self,
        folder: Path,
        *,
        budget_bytes: int | None = None,
        read_only: bool = False,
        plain: bool = False,
    ) -> None:
        super().__init__(folder, read_only=read_only)
        self.plain = plain
        self._chunks = str(folder / CHUNK_FOLDER)
        self.budget_bytes = budget_bytes
        self.hits = self.misses = self.written = self.damaged = self.evicted = 0
        self.notes: list[str] = []
        self.reasons: dict[str, str] = {}
        self._lock = threading.Lock()  # of the counts, and of making room
        self._used: set[str] = set()
        self._bytes: int | None = None  # of all chunks, as far as this store knows

    def has(self, key: str) -> bool:
        """Tell whether a chunk is there, which counts as a use; it may still be damaged, or be gone a moment later."""
        try:
            state = os.stat(self._file(key))  # noqa: PTH116
        except OSError:
            return False
        if not stat.S_ISREG(state.st_mode):
            return False
        self._used.add(key)
        self._note_use(key, state.st_mtime)
        return True

    def get(self, key: str) -> BrickMesh | None:
        """Return a mesh, bit for bit as it was put; None where it is absent, or cannot be used.

        A chunk that cannot be used is counted in `damaged`, named in `notes`, and removed unless the store is
        read-only, so that whoever extracts it again can put it in its place.
        """
        return self.get_all([key])[0]

    def get_all(self, keys: Sequence[str]) -> list[BrickMesh | None]:
        """Return meshes as `get` does, decoded together; the arrays of small ones are parts of one array.

        Raises
        ------
        TooManyFilesError
            If a chunk cannot be opened because too many files are open; that says nothing about the chunk.
        """
        self._used.update(keys)
        found: dict[str, BrickMesh] = {}
        packed: dict[str, bytes] = {}
        changed: dict[str, float] = {}
        failed: dict[str, OSError | CacheError] = {}
        for key in keys:
            try:
                data, changed[key] = chunk_content(self._file(key))
                if isinstance(data, bytes) and data[: len(PLAIN_MAGIC)] != PLAIN_MAGIC:
                    packed[key] = data
                else:
                    found[key] = decode_plain(data, name=bytes.fromhex(key))
            except FileNotFoundError:
                continue
            except TooManyFilesError:
                raise
            except (OSError, CacheError) as error:
                failed[key] = error
        decoded = decode_all(list(packed.values()), [bytes.fromhex(key) for key in packed])
        for key, mesh in zip(packed, decoded, strict=True):
            if isinstance(mesh, CacheError):
                failed[key] = mesh
            else:
                found[key] = mesh
        for key, reason in failed.items():
            self._give_up(key, reason)
        meshes = [found.get(key) for key in keys]
        missed = sum(mesh is None for mesh in meshes)
        with self._lock:
            self.hits += len(meshes) - missed
            self.misses += missed
        for key in found:
            self._note_use(key, changed[key])
        return meshes

    def _file(self, key: str) -> str:
        """Return the file of a chunk; pathlib takes longer than a small chunk."""
        return f"{self._chunks}/{key[:2]}/{key}{CHUNK_SUFFIX}"

    def _note_use(self, key: str, noted: float) -> None:
        """Note that a chunk is used now, unless its last use was noted a moment ago."""
        if not self.read_only and time.time() - noted > TOUCH_SECONDS:
            with contextlib.suppress(OSError):  # of another user, or a folder that became read-only
                os.utime(self._file(key))

    def put(self, key: str, mesh: BrickMesh) -> None:
        """Keep a mesh, which may be empty.

        Raises
        ------
        CacheError
            If the store is read-only or the file cannot be written; what stood there before stays.
        InputError
            As `encode`.
        """
        if self.read_only:
            raise CacheError(f"{self.folder} was opened for reading only; nothing can be added to it.")
        name = bytes.fromhex(key)
        data = encode_plain(mesh, name=name) if self.plain else encode(mesh, name=name)
        self._used.add(key)  # before it is there: another thread may be making room
        with (
            full_disk_explained(),
            replacing(self.path(key), error_class=CacheError, make_folder=True) as file,
        ):
            file.write(data)
        with self._lock:
            self.written += 1
            if self.budget_bytes is not None:
                self._keep_to_budget(self.budget_bytes, len(data))

    def _keep_to_budget(self, budget_bytes: int, added: int) -> None:
        """Make room where the chunks have outgrown the budget; the lock is held."""
        if self._bytes is None:
            self._bytes = sum(chunk.size_bytes for chunk in self.chunks())
        else:
            self._bytes += added
        if self._bytes <= budget_bytes:
            return
        removed = self.prune(int(PRUNE_TO * budget_bytes), keep=self._used)
        self.evicted += removed.chunks
        # where all that is left is in use, look again only when a tenth of the budget has been added
        self._bytes = min(removed.bytes_left, int(PRUNE_TO * budget_bytes))

    def _give_up(self, key: str, error: OSError | CacheError) -> None:
        """Count and name a chunk that cannot be used; remove it where it is damaged."""
        path = self.path(key)
        reason = f"it cannot be read ({error.strerror})." if isinstance(error, OSError) else str(error)
        with self._lock:
            self.damaged += 1
            self.reasons[key] = f"{path} is damaged: {reason}"
            self.notes.append(self.reasons[key])
        if isinstance(error, OtherVersionError | OSError) or self.read_only:
            return
        with contextlib.suppress(OSError):
            path.unlink(missing_ok=True)


@contextlib.contextmanager
def full_disk_explained() -> Iterator[None]:
    """Tell in a `CacheError` about a full disk what to do."""
    try:
        yield
    except CacheError as error:
        cause = error.__cause__
        if isinstance(cause, OSError) and cause.errno in FULL:
            what = str(error).removesuffix(" Choose another path.")
            raise CacheError(
                f"{what} Make room (`isosample cache prune`) and run the same command again: it goes on from here, "
                "for all that was extracted before is kept."
            ) from cause
        raise

"""Which isosurfaces are complete in a store, and the sizes of their pieces: remembered beside it in a file."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from isosample.errors import CacheError
from isosample.surfaces.cache_files import digest_of, read_arrays, write_arrays
from isosample.surfaces.chunk_table import CHUNK_ROW, ChunkTable

if TYPE_CHECKING:
    from pathlib import Path

    from isosample.surfaces.chunk_table import Rows
    from isosample.surfaces.settings import ExtractionSettings
    from isosample.volume.grid import F64

HEADER = {"kind": "known chunks"}


def known_path(folder: Path, content: str, settings: ExtractionSettings) -> Path:
    """Return the file for one volume content and settings in a cache folder."""
    name = digest_of({"content": content, "settings": settings.to_dict()})
    return folder / "tables" / f"{name}.npz"


@dataclass(frozen=True, kw_only=True, eq=False)
class KnownChunks:
    """Pieces of isosurfaces that were all extracted once.

    Attributes
    ----------
    isovalues : (M,) float64
        Of the complete surfaces.
    rows : (N,) `CHUNK_ROW`
        Their pieces with triangles.
    """

    isovalues: F64
    rows: Rows

    @classmethod
    def nothing(cls) -> KnownChunks:
        """Return a memory of no surface."""
        return cls(isovalues=np.empty(0), rows=np.empty(0, dtype=CHUNK_ROW))

    @classmethod
    def read(cls, path: Path) -> KnownChunks:
        """Return what a file remembers; nothing where it is absent, damaged or of another version."""
        try:
            arrays, _ = read_arrays(path, HEADER)
        except CacheError:
            return cls.nothing()  # it only saves time: the store itself tells what it has
        if arrays["rows"].dtype != CHUNK_ROW:
            return cls.nothing()
        return cls(isovalues=arrays["isovalues"].astype(np.float64), rows=arrays["rows"].astype(CHUNK_ROW))

    def write(self, path: Path) -> None:
        """Write the file, whole or not at all; raises `CacheError` if it cannot be written."""
        write_arrays(path, HEADER, {"isovalues": self.isovalues, "rows": self.rows})

    def with_(self, table: ChunkTable) -> KnownChunks:
        """Return a memory of these surfaces and those of a table, which is newer."""
        kept = ~np.isin(self.isovalues, table.isovalues)
        kept_rows = ~np.isin(self.rows["isovalue"], table.isovalues)
        return KnownChunks(
            isovalues=np.concatenate([self.isovalues[kept], table.isovalues]),
            rows=np.concatenate([self.rows[kept_rows], table.rows]),
        )

    def complete(self, isovalue: float) -> bool:
        """Tell whether all pieces of a surface were extracted once."""
        return isovalue in self._complete

    def row(self, key: str) -> Rows:
        """(1,) row of a piece, (0,) where it has no triangles."""
        place = self._places.get(key.encode())
        return self.rows[:0] if place is None else self.rows[place : place + 1]

    @cached_property
    def _complete(self) -> frozenset[float]:
        return frozenset(self.isovalues.tolist())

    @cached_property
    def _places(self) -> dict[bytes, int]:
        return {key: place for place, key in enumerate(self.rows["key"].tolist())}

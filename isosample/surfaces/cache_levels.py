"""Isosurfaces between memory and a cache folder: read what is there, extract and add what is missing."""

from __future__ import annotations

import errno
import hashlib
import os
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from isosample.errors import CacheError
from isosample.surfaces.chunk_table import ChunkTable, chunk_row
from isosample.surfaces.store import chunk_key
from isosample.surfaces.surface_files import listed_key, read_rows
from isosample.volume.bricks import bricks_of

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence
    from pathlib import Path

    from isosample.surfaces.chunk_table import Rows
    from isosample.surfaces.field import Bool, Field
    from isosample.surfaces.mesh import BrickMesh
    from isosample.surfaces.settings import ExtractionSettings
    from isosample.surfaces.store import MeshStore
    from isosample.volume.bricks import Brick
    from isosample.volume.grid import F64
    from isosample.volume.scan import BrickScan

GROUP = 32  # chunks that a thread loads in a row: what it costs to hand them over is shared
SHARES = 8  # at least so many groups per thread, so that all end at about the same time
NO_WRITING = (errno.EROFS, errno.EACCES, errno.EPERM)


class Piece(NamedTuple):
    """One (isovalue, brick) pair: the place of the isovalue, the row of the brick, the key of its chunk."""

    level: int
    row: int
    key: str


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ScannedField:
    """The field of a scanned volume, whose pieces have names.

    Attributes
    ----------
    field : Field
    scan : BrickScan
        Of the field's volume, for bricks of the field's settings.
    content_hash : str
        Of the volume.
    """

    field: Field
    scan: BrickScan
    content_hash: str

    @property
    def settings(self) -> ExtractionSettings:
        """The settings of the field."""
        return self.field.settings

    @property
    def bricks(self) -> list[Brick]:
        """The bricks of the volume; rows are counted in these."""
        return bricks_of(self.field.volume.size_xyz, self.settings.brick_cells)

    def active(self, levels: F64) -> Bool:
        """(B, K) bool, whether an isosurface passes through a brick."""
        return self.field.active(self.bricks, levels, self.scan.ranges)

    def key(self, row: int, isovalue: float) -> str:
        """Return the key of one chunk; a spline depends on all samples, so it is named by them all."""
        content = self.scan.digests[row].tobytes().hex()
        if self.settings.reconstruction.smooth:
            content = content_in_place(self.content_hash, row)
        geometry = self.field.volume.geometry
        return chunk_key(content, isovalue, geometry.spacing, self.settings, mirrored=geometry.left_handed)


def wanted_pieces(folder: Path, scanned: ScannedField, levels: F64) -> tuple[list[Piece], list[int]]:
    """Return the pieces of all levels, and the levels whose list of chunks is not in the folder yet.

    Of a level that is listed these are the chunks with triangles, under the keys they have there.
    """
    pieces: list[Piece] = []
    unlisted: list[int] = []
    for level, isovalue in enumerate(levels.tolist()):
        key = listed_key(folder, scanned.content_hash, isovalue, scanned.settings)
        try:
            rows, _ = read_rows(folder, key, isovalue)
        except CacheError:  # absent, or damaged: then it is written anew
            unlisted.append(level)
            continue
        names = zip(rows["row"].tolist(), rows["key"].tolist(), strict=True)
        pieces += [Piece(level, row, name.decode()) for row, name in names]
    if unlisted:
        active = scanned.active(levels[unlisted])
        for row, place in zip(*(found.tolist() for found in np.nonzero(active)), strict=True):
            level = unlisted[place]
            pieces.append(Piece(level, row, scanned.key(row, float(levels[level]))))
    return pieces, unlisted


def load_pieces(store: MeshStore, keys: Sequence[str]) -> list[BrickMesh | None]:
    """Return the chunks of a store, None where one is missing or damaged; decoded by one thread per core."""
    workers = os.cpu_count() or 1
    group = max(1, min(GROUP, len(keys) // (SHARES * workers)))
    groups = [keys[first : first + group] for first in range(0, len(keys), group)]
    with ThreadPoolExecutor(max_workers=workers) as pool:
        return [mesh for part in pool.map(store.get_all, groups) for mesh in part]


def extract_pieces(
    scanned: ScannedField,
    levels: F64,
    pieces: Sequence[Piece],
    store: MeshStore,
    progress: Callable[[int, int], None] | None,
) -> dict[Piece, BrickMesh]:
    """Extract pieces, brick by brick, and keep each in the store as soon as it is there."""
    by_row: dict[int, list[Piece]] = {}
    field, bricks = scanned.field, scanned.bricks
    for piece in pieces:
        by_row.setdefault(piece.row, []).append(piece)

    def visit(row: int) -> list[tuple[Piece, BrickMesh]]:
        chosen = sorted(by_row[row])
        meshes = field.pieces(bricks[row], levels[[piece.level for piece in chosen]])
        found = list(zip(chosen, meshes, strict=True))
        for piece, mesh in found:
            keep(store, piece.key, mesh)
        return found

    if by_row:
        field.prepare()  # once, before the threads
    done: dict[Piece, BrickMesh] = {}
    pool = ThreadPoolExecutor(max_workers=os.cpu_count())
    try:
        for count, found in enumerate(pool.map(visit, sorted(by_row)), start=1):
            done.update(found)
            if progress is not None:
                progress(count, len(by_row))
    finally:
        pool.shutdown(cancel_futures=True)
    return done


def keep(store: MeshStore, key: str, mesh: BrickMesh) -> None:
    """Put a mesh into a store; a folder that turns out to be read-only makes the store read-only."""
    if store.read_only:
        return
    try:
        store.put(key, mesh)
    except CacheError as error:
        if not refuses_writing(error):
            raise
        store.read_only = True


def refuses_writing(error: CacheError) -> bool:
    """Tell whether a file could not be written because its place is read-only."""
    return isinstance(error.__cause__, OSError) and error.__cause__.errno in NO_WRITING


def rows_of(meshes: Mapping[Piece, BrickMesh]) -> Rows:
    """Return the rows of the meshes that have triangles, ordered by (isovalue, brick)."""
    rows = [chunk_row(mesh, piece.row, piece.key) for piece, mesh in meshes.items()]
    return ChunkTable.of(np.empty(0), rows).rows


def content_in_place(content_hash: str, row: int) -> str:
    """Return what names a brick by the whole volume's content and its place."""
    return hashlib.sha256(f"{content_hash} {row}".encode()).hexdigest()

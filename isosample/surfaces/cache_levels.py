"""Isosurfaces between memory and a cache folder: read what is there, extract and add what is missing."""

from __future__ import annotations

import errno
import hashlib
import os
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from isosample.errors import CacheError
from isosample.surfaces.brick_meshes import extract_brick
from isosample.surfaces.brick_samples import load_brick, spline_brick
from isosample.surfaces.chunk_table import ChunkTable, chunk_row
from isosample.surfaces.mesh import BrickMesh
from isosample.surfaces.store import chunk_key
from isosample.surfaces.surface_files import listed_key, read_rows
from isosample.volume.bricks import brick_ranges, bricks_of
from isosample.volume.reconstruction import GridSpline

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence
    from pathlib import Path

    from isosample.surfaces.chunk_table import Rows
    from isosample.surfaces.settings import ExtractionSettings
    from isosample.surfaces.store import MeshStore
    from isosample.surfaces.surface_set import SurfaceSet
    from isosample.volume.bricks import Brick
    from isosample.volume.grid import F64, Volume
    from isosample.volume.scan import BrickScan

    Bool = np.ndarray[tuple[int, ...], np.dtype[np.bool_]]

GROUP = 32  # chunks that a thread loads in a row: what it costs to hand them over is shared
SHARES = 8  # at least so many groups per thread, so that all end at about the same time
NO_WRITING = (errno.EROFS, errno.EACCES, errno.EPERM)


class Piece(NamedTuple):
    """One (isovalue, brick) pair: the place of the isovalue, the row of the brick, the key of its chunk."""

    level: int
    row: int
    key: str


@dataclass(frozen=True, kw_only=True, eq=False)
class Field:
    """A volume with its reconstruction, brick by brick; the spline is built when it is first needed.

    Where its surfaces were extracted before (`extracted`, by isovalue and brick), nothing is extracted again.
    """

    volume: Volume
    settings: ExtractionSettings
    scan: BrickScan
    content_hash: str
    bricks: list[Brick]
    extracted: Mapping[tuple[float, tuple[int, int, int]], BrickMesh] | None = None
    _built: list[tuple[Volume, GridSpline | None]] = field(default_factory=list)

    @classmethod
    def of(
        cls,
        volume: Volume,
        settings: ExtractionSettings,
        scan: BrickScan,
        content_hash: str,
        extracted: SurfaceSet | None = None,
    ) -> Field:
        """Return the field of a scanned volume, of which surfaces with these settings may be at hand."""
        meshes = () if extracted is None else extracted.meshes
        pieces = {(mesh.isovalue, mesh.brick): mesh for mesh in meshes}
        return cls(
            volume=volume,
            settings=settings,
            scan=scan,
            content_hash=content_hash,
            bricks=bricks_of(volume.size_xyz, settings.brick_cells),
            extracted=None if extracted is None else pieces,
        )

    @property
    def spline(self) -> GridSpline | None:
        """The spline of a smooth reconstruction."""
        return self._nodes_and_spline()[1]

    def active(self, levels: F64) -> Bool:
        """(B, K) bool, whether a brick has samples on both sides: low < isovalue <= high, equal being inside."""
        smooths = not self.settings.reconstruction.interpolates
        ranges = brick_ranges(self._nodes_and_spline()[0], self.bricks) if smooths else self.scan.ranges
        found: Bool = (ranges[:, :1] < levels) & (levels <= ranges[:, 1:])
        return found

    def key(self, row: int, isovalue: float) -> str:
        """Return the key of one chunk; a spline depends on all samples, so it is named by them all."""
        content = self.scan.digests[row].tobytes().hex()
        if self.settings.reconstruction.smooth:
            content = content_in_place(self.content_hash, row)
        mirrored = self.volume.geometry.left_handed
        return chunk_key(content, isovalue, self.volume.spacing, self.settings, mirrored=mirrored)

    def extract(self, row: int, isovalues: F64) -> list[BrickMesh]:
        """Return the pieces of isosurfaces in one brick, those without triangles too."""
        brick = self.bricks[row]
        if self.extracted is not None:
            known = ((value, self.extracted.get((value, brick.index))) for value in isovalues.tolist())
            return [mesh or no_mesh(value, brick) for value, mesh in known]
        nodes, spline = self._nodes_and_spline()
        samples = (
            load_brick(nodes, brick, passing=True) if spline is None else spline_brick(nodes, spline, brick)
        )
        found = {
            mesh.isovalue: mesh for mesh in extract_brick(samples, isovalues, brick, nodes, self.settings)
        }
        return [found.get(value) or no_mesh(value, brick) for value in isovalues.tolist()]

    def prepare(self) -> None:
        """Build the spline where there is one and it is needed."""
        if self.extracted is None:
            self._nodes_and_spline()

    def _nodes_and_spline(self) -> tuple[Volume, GridSpline | None]:
        """Return the volume of the values at the samples, and the spline."""
        if not self._built:
            reconstruction = self.settings.reconstruction
            spline = GridSpline.build(self.volume, reconstruction) if reconstruction.smooth else None
            keeps = spline is None or reconstruction.interpolates
            nodes = self.volume if keeps else replace(self.volume, array=spline.samples())  # type: ignore[union-attr]
            self._built.append((nodes, spline))
        return self._built[0]


def no_mesh(isovalue: float, brick: Brick) -> BrickMesh:
    """Return a piece without triangles."""
    return BrickMesh(
        isovalue=isovalue,
        brick=brick.index,
        start=brick.start,
        positions=np.empty((0, 3), dtype=np.float32),
        gradients=np.empty((0, 3), dtype=np.float32),
        edge_keys=np.empty(0, dtype=np.int64),
        triangles=np.empty((0, 3), dtype=np.int32),
        residuals=np.empty((0, 2), dtype=np.float32),
    )


def wanted_pieces(folder: Path, field: Field, levels: F64) -> tuple[list[Piece], list[int]]:
    """Return the pieces of all levels, and the levels whose list of chunks is not in the folder yet.

    Of a level that is listed these are the chunks with triangles, under the keys they have there.
    """
    pieces: list[Piece] = []
    unlisted: list[int] = []
    for level, isovalue in enumerate(levels.tolist()):
        key = listed_key(folder, field.content_hash, isovalue, field.settings)
        try:
            rows, _ = read_rows(folder, key, isovalue)
        except CacheError:  # absent, or damaged: then it is written anew
            unlisted.append(level)
            continue
        names = zip(rows["row"].tolist(), rows["key"].tolist(), strict=True)
        pieces += [Piece(level, row, name.decode()) for row, name in names]
    if unlisted:
        active = field.active(levels[unlisted])
        for row, place in zip(*(found.tolist() for found in np.nonzero(active)), strict=True):
            level = unlisted[place]
            pieces.append(Piece(level, row, field.key(row, float(levels[level]))))
    return pieces, unlisted


def load_pieces(store: MeshStore, keys: Sequence[str]) -> list[BrickMesh | None]:
    """Return the chunks of a store, None where one is missing or damaged; decoded by one thread per core."""
    workers = os.cpu_count() or 1
    group = max(1, min(GROUP, len(keys) // (SHARES * workers)))
    groups = [keys[first : first + group] for first in range(0, len(keys), group)]
    with ThreadPoolExecutor(max_workers=workers) as pool:
        return [mesh for part in pool.map(store.get_all, groups) for mesh in part]


def extract_pieces(
    field: Field,
    levels: F64,
    pieces: Sequence[Piece],
    store: MeshStore,
    progress: Callable[[int, int], None] | None,
) -> dict[Piece, BrickMesh]:
    """Extract pieces, brick by brick, and keep each in the store as soon as it is there."""
    by_row: dict[int, list[Piece]] = {}
    for piece in pieces:
        by_row.setdefault(piece.row, []).append(piece)

    def visit(row: int) -> list[tuple[Piece, BrickMesh]]:
        chosen = sorted(by_row[row])
        meshes = field.extract(row, levels[[piece.level for piece in chosen]])
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

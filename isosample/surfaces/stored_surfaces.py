"""The isosurfaces of one volume that stay in a store of meshes, and are loaded piece by piece."""

from __future__ import annotations

import os
from collections import deque
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

from isosample.errors import CacheError, InputError
from isosample.surfaces.cache_files import REMEDY
from isosample.surfaces.mesh import Mesh, weld

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from concurrent.futures import Future

    from isosample.surfaces.boundary import BoundarySlices
    from isosample.surfaces.chunk_table import ChunkTable
    from isosample.surfaces.mesh import BrickMesh
    from isosample.surfaces.mesh_error import MeshError
    from isosample.surfaces.settings import ExtractionSettings
    from isosample.surfaces.surface_set import ExtractionStatistics
    from isosample.volume.geometry import GridGeometry
    from isosample.volume.grid import F64

AHEAD_BYTES = 64 << 20  # of pieces that are loaded before they are asked for


class ChunkStore(Protocol):
    """Keeps pieces by their keys; safe with several threads and processes."""

    def get(self, key: str) -> BrickMesh | None:
        """Return a piece, or None where it is not there or damaged."""
        ...

    def put(self, key: str, mesh: BrickMesh) -> object:
        """Keep a piece, which may have no triangles."""
        ...

    def has(self, key: str) -> bool:
        """Tell whether a piece is there, which counts as a use of it: it makes no room for others in this run."""
        ...


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StoredSurfaces:
    """The isosurfaces of one volume, in a store; takes the place of a `SurfaceSet` that memory cannot hold.

    Attributes
    ----------
    geometry, isovalues, boundary, value_range, settings, statistics
        As those of a `SurfaceSet`.
    store : ChunkStore
    chunk_table : ChunkTable
        One row per piece, in the order of `SurfaceSet.meshes`.
    details : tuple of StoredSurfaces
        As those of a `SurfaceSet`.
    """

    geometry: GridGeometry
    isovalues: F64
    boundary: BoundarySlices
    value_range: tuple[float, float]
    settings: ExtractionSettings
    statistics: ExtractionStatistics
    store: ChunkStore
    chunk_table: ChunkTable
    details: tuple[StoredSurfaces, ...] = ()

    def chunks(
        self, levels: Sequence[int] | None = None, bricks: Sequence[tuple[int, int, int]] | None = None
    ) -> Iterator[BrickMesh]:
        """Yield the pieces of some levels in some bricks, None: of all, in the order of the table."""
        return self.load(self.chunk_table.select(levels, bricks).tolist())

    def load(self, places: Sequence[int]) -> Iterator[BrickMesh]:
        """Yield pieces by their places in the table, in the order asked for, a few being loaded ahead.

        Raises
        ------
        CacheError
            If a piece is missing or damaged (names isovalue and brick).
        """
        sizes = self.chunk_table["bytes"]
        ahead: deque[tuple[int, Future[BrickMesh]]] = deque()
        loading = 0
        pool = ThreadPoolExecutor(max_workers=os.cpu_count())
        try:
            for place in places:
                ahead.append((place, pool.submit(self.chunk, place)))
                loading += int(sizes[place])
                while loading > AHEAD_BYTES:
                    first, coming = ahead.popleft()
                    yield coming.result()
                    del coming
                    loading -= int(sizes[first])
            while ahead:
                yield ahead.popleft()[1].result()
        finally:
            pool.shutdown(cancel_futures=True)

    def chunk(self, place: int) -> BrickMesh:
        """Load one piece by its place in the table; raises as `load` does."""
        row = self.chunk_table.rows[place]
        mesh = self.store.get(bytes(row["key"]).decode())
        if mesh is None:
            raise CacheError(
                f"the piece of isosurface {float(row['isovalue'])!r} in brick {tuple(row['brick'].tolist())} is "
                f"missing or damaged. {REMEDY}"
            )
        return mesh

    @property
    def meshes(self) -> tuple[BrickMesh, ...]:
        """All pieces in memory at once, ordered by (level, brick)."""
        return tuple(self.chunks())

    @property
    def by_detail(self) -> tuple[StoredSurfaces, ...]:
        """The finest meshes, which these are, and the coarser details."""
        return (self, *self.details)

    def pieces(self, level: int) -> tuple[BrickMesh, ...]:
        """Return the meshes of one level, in the order of the bricks, all in memory; raises as `SurfaceSet` does."""
        if not 0 <= level < len(self.isovalues):
            raise InputError(
                f"level {level} does not exist; there are {len(self.isovalues)}, counted from 0."
            )
        return tuple(self.chunks([level]))

    def mesh(self, level: int) -> Mesh:
        """Return one level as a welded mesh in world space."""
        return weld(self.pieces(level), self.geometry, isovalue=float(self.isovalues[level]))

    @property
    def mesh_errors(self) -> tuple[MeshError | None, ...]:
        """Distance of every level's triangles from its isosurface; None without `settings.residuals`."""
        if not self.settings.residuals:
            return (None,) * len(self.isovalues)
        return tuple(self.chunk_table.mesh_error(level) for level in range(len(self.isovalues)))

"""The isosurfaces of one volume: what a renderer needs in place of the volume."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from isosample.errors import InputError
from isosample.surfaces.mesh import Mesh, weld
from isosample.surfaces.mesh_error import MeshError, combined

if TYPE_CHECKING:
    from collections.abc import Sequence

    from isosample.surfaces.boundary import BoundarySlices
    from isosample.surfaces.mesh import BrickMesh
    from isosample.surfaces.settings import ExtractionSettings
    from isosample.volume.geometry import GridGeometry
    from isosample.volume.grid import F64


@dataclass(frozen=True, slots=True, kw_only=True)
class ExtractionStatistics:
    """What an extraction did and what it skipped.

    Attributes
    ----------
    bricks_total : int
        Bricks of the volume.
    brick_visits : int
        (brick, isovalue) pairs whose samples lie on both sides of the isovalue: these were extracted.
    brick_visits_skipped : int
        (brick, isovalue) pairs that the range of the brick ruled out.
    triangles, vertices : tuple of int
        Per level, summed over the bricks; a vertex that bricks share counts in each.
    levels_reused : int
        Levels that came from a cache and were not extracted.
    chunks_reused : int
        (brick, isovalue) pairs that came from a cache, of levels that did so wholly or in part.
    """

    bricks_total: int
    brick_visits: int
    brick_visits_skipped: int
    triangles: tuple[int, ...]
    vertices: tuple[int, ...]
    levels_reused: int = 0
    chunks_reused: int = 0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SurfaceSet:
    """The isosurfaces of one volume, with all that a renderer needs in place of the volume.

    Attributes
    ----------
    geometry : GridGeometry
        Places the samples in world space.
    isovalues : (K,) float64
        Strictly ascending, in data units.
    meshes : tuple of BrickMesh
        Ordered by (level, brick); pieces without triangles are left out.
    boundary : BoundarySlices
        Samples on the faces of the volume, or the spline there.
    value_range : 2 floats
        Smallest and largest finite sample, in data units; of a smooth reconstruction `GridSpline.value_range`.
    settings : ExtractionSettings
    statistics : ExtractionStatistics
    details : tuple of SurfaceSet
        The same isosurfaces at detail 1, 2, …, with the pieces that get coarser; see `isosample.surfaces.detail`.
    """

    geometry: GridGeometry
    isovalues: F64
    meshes: tuple[BrickMesh, ...]
    boundary: BoundarySlices
    value_range: tuple[float, float]
    settings: ExtractionSettings
    statistics: ExtractionStatistics
    details: tuple[SurfaceSet, ...] = ()

    @property
    def by_detail(self) -> tuple[SurfaceSet, ...]:
        """The finest meshes, which these are, and the coarser details."""
        return (self, *self.details)

    def pieces(self, level: int) -> tuple[BrickMesh, ...]:
        """Return the meshes of one level, in the order of the bricks.

        Raises
        ------
        InputError
            If there is no such level.
        """
        if not 0 <= level < len(self.isovalues):
            raise InputError(
                f"level {level} does not exist; there are {len(self.isovalues)}, counted from 0."
            )
        isovalue = float(self.isovalues[level])
        return tuple(mesh for mesh in self.meshes if mesh.isovalue == isovalue)

    def mesh(self, level: int) -> Mesh:
        """Return one level as a welded mesh in world space; raises as `pieces` does."""
        return weld(self.pieces(level), self.geometry, isovalue=float(self.isovalues[level]))

    @property
    def mesh_errors(self) -> tuple[MeshError | None, ...]:
        """Distance of every level's triangles from its isosurface; None without `settings.residuals`."""
        if not self.settings.residuals:
            return (None,) * len(self.isovalues)
        pieces = (self.pieces(level) for level in range(len(self.isovalues)))
        return tuple(combined([mesh.error for mesh in level if mesh.error]) for level in pieces)


def count_per_level(levels: F64, meshes: Sequence[BrickMesh], field: str) -> tuple[int, ...]:
    """Return the rows of a field of the meshes per level, summed over the bricks."""
    level_of = np.searchsorted(levels, [mesh.isovalue for mesh in meshes]).astype(np.int64)
    totals = np.zeros(len(levels), dtype=np.int64)
    np.add.at(totals, level_of, np.array([len(getattr(mesh, field)) for mesh in meshes], dtype=np.int64))
    return tuple(totals.tolist())

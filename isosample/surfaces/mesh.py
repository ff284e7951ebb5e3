"""Isosurface meshes: one per (isovalue, brick) as extracted, and one per isovalue welded in world space."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from isosample.errors import CapacityError, InputError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from isosample.surfaces.mesh_error import MeshError
    from isosample.volume.geometry import GridGeometry
    from isosample.volume.grid import F64

F32 = npt.NDArray[np.float32]
I32 = npt.NDArray[np.int32]
I64 = npt.NDArray[np.int64]

_zeros: F32 = np.zeros((0, 2), dtype=np.float32)  # what `no_residuals` gives parts of


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class BrickMesh:
    """The piece of one isosurface that lies in one brick.

    Attributes
    ----------
    isovalue : float
        In data units.
    brick : 3 ints
        Place (bx, by, bz) in the grid of bricks.
    start : 3 ints
        First sample (x, y, z) of the brick.
    positions : (V, 3) float32
        Index coordinates (x, y, z) relative to `start` [voxel], multiples of 2**-19: the same point has the
        same coordinates in every brick and for every brick size, bit for bit.
    gradients : (V, 3) float32
        Derivative of the field per sample step along x, y, z [data units / voxel], not normalised.
    edge_keys : (V,) int64
        Names the vertex in the whole volume: axis + 3 · (linear index of the grid edge's lower sample), or
        3 · (sample count) + (linear index of the cell's first sample) for a vertex inside a cell. A vertex that
        divides a side of the mesh has a negative key, a digest of the keys of its two ends, see `refine`.
    triangles : (T, 3) int32
        Rows of `positions`, counter-clockwise in world space seen from the side of falling values.
    residuals : (V, 2) float32
        Largest abs(field − isovalue) [data units] that was sampled inside the triangles of this brick around
        the vertex, on the flat triangles and with their quadratic correction; 0 where the extraction was not
        asked for residuals.
    error : MeshError or None
        Distance of the triangles from the isosurface; None where the extraction was not asked for residuals.
    """

    isovalue: float
    brick: tuple[int, int, int]
    start: tuple[int, int, int]
    positions: F32
    gradients: F32
    edge_keys: I64
    triangles: I32
    residuals: F32
    error: MeshError | None = None

    def vertices_world(self, geometry: GridGeometry) -> F64:
        """(V, 3) float64, world positions; a vertex that bricks share is bit-identical in all of them."""
        index = self.positions.astype(np.float64) + np.asarray(self.start, dtype=np.float64)
        matrix = geometry.world_from_index
        return _combine(index, matrix[:3, :3]) + matrix[:3, 3]

    def gradients_world(self, geometry: GridGeometry) -> F64:
        """(V, 3) float64, derivative of the field per world unit (covariant) [data units / world unit]."""
        return _combine(self.gradients.astype(np.float64), geometry.world_gradient_from_index_gradient)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Mesh:
    """One isosurface in world space, every vertex once.

    Attributes
    ----------
    isovalue : float
        In data units.
    vertices : (V, 3) float64
        World positions.
    gradients : (V, 3) float64
        Derivative of the field per world unit [data units / world unit], not normalised.
    triangles : (T, 3) int32
        Rows of `vertices`, counter-clockwise seen from the side of falling values.
    """

    isovalue: float
    vertices: F64
    gradients: F64
    triangles: I32

    @property
    def normals(self) -> F64:
        """(V, 3) float64, unit, towards falling values.

        Where the gradient is zero (a plateau on both sides) the mean of the triangles' normals, weighted by
        area; zero only where these cancel too.
        """
        normals = -self.gradients
        flat = ~normals.any(axis=1)
        if flat.any():
            normals[flat] = self._area_vectors()[flat]
        largest = np.abs(normals).max(axis=1, keepdims=True, initial=0.0)
        normals = np.divide(normals, largest, out=np.zeros_like(normals), where=largest > 0)
        length = np.linalg.norm(normals, axis=1, keepdims=True)
        unit: F64 = np.divide(normals, length, out=np.zeros_like(normals), where=length > 0)
        return unit

    def _area_vectors(self) -> F64:
        """(V, 3) float64, sum of the adjoining triangles' right-hand normals, twice their area long."""
        a, b, c = (self.vertices[self.triangles[:, corner]] for corner in range(3))
        cross = np.cross(b - a, c - a)
        total = np.zeros_like(self.vertices)
        for corner in range(3):
            np.add.at(total, self.triangles[:, corner], cross)
        return total


def no_residuals(vertex_count: int) -> F32:
    """(V, 2) float32, zeros that cannot be written, for a mesh whose distance was not measured.

    All such meshes share them.
    """
    global _zeros
    zeros = _zeros
    if len(zeros) < vertex_count:
        zeros = np.zeros((2 * vertex_count, 2), dtype=np.float32)
        zeros.setflags(write=False)
        _zeros = zeros
    return zeros[:vertex_count]


def weld(meshes: Sequence[BrickMesh], geometry: GridGeometry, *, isovalue: float | None = None) -> Mesh:
    """Return one mesh in which vertices with the same edge key are one vertex.

    Parameters
    ----------
    meshes : sequence of BrickMesh
        Pieces of one isosurface, of different bricks.
    geometry : GridGeometry
        Places the samples in world space.
    isovalue : float, optional
        The isovalue of the result; needed only where there are no pieces.

    Raises
    ------
    InputError
        If the pieces have different isovalues, or none is given and there are no pieces.
    CapacityError
        If two vertices at different places have the same key.

    Notes
    -----
    Keys are integers and name the grid edge, so nothing is ever merged because it is merely close. Those of
    vertices that refinement made are digests of 63 bits: among n of them some two agree with a probability of
    about n² / 2⁶⁴, 5e-8 for a million and 5e-4 for a hundred million vertices of one isosurface.
    """
    isovalues = {mesh.isovalue for mesh in meshes} | ({isovalue} if isovalue is not None else set())
    if len(isovalues) != 1:
        raise InputError(
            f"meshes of the isovalues {sorted(isovalues)} cannot be welded; pass the pieces of one isovalue."
        )
    if not meshes:
        empty = np.empty((0, 3))
        triangles = np.empty((0, 3), dtype=np.int32)
        return Mesh(isovalue=isovalues.pop(), vertices=empty, gradients=empty, triangles=triangles)
    keys = np.concatenate([mesh.edge_keys for mesh in meshes])
    _, first, vertex_of_row = np.unique(keys, return_index=True, return_inverse=True)
    starts = np.cumsum([0, *(len(mesh.positions) for mesh in meshes[:-1])])
    rows = np.concatenate([mesh.triangles + start for mesh, start in zip(meshes, starts, strict=True)])
    vertices = np.concatenate([mesh.vertices_world(geometry) for mesh in meshes])
    gradients = np.concatenate([mesh.gradients_world(geometry) for mesh in meshes])
    if (vertices != vertices[first][vertex_of_row]).any():
        raise CapacityError(
            "two vertices of the refined mesh have the same name, which happens to about one mesh of a hundred "
            "million vertices in 2000. Take another refine, or leave out a slice of the volume's border."
        )
    return Mesh(
        isovalue=isovalues.pop(),
        vertices=vertices[first],
        gradients=gradients[first],
        triangles=vertex_of_row[rows].astype(np.int32),
    )


def _combine(vectors: F64, matrix: F64) -> F64:
    """Return matrix · vector for every row, rounded the same in every row.

    A matrix product may round rows differently according to their place in a block; three products and two
    sums per component do not, which is what keeps shared vertices of bricks bit-identical.
    """
    x, y, z = vectors.T
    return np.stack([row[0] * x + row[1] * y + row[2] * z for row in matrix], axis=1)

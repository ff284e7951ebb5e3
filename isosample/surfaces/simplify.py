"""Meshes with fewer triangles, and how far they are from what they were made of, measured."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from isosample.errors import InputError, MissingDependencyError
from isosample.surfaces.mesh import Mesh

if TYPE_CHECKING:
    from collections.abc import Callable

    from isosample.volume.geometry import GridGeometry

F64 = npt.NDArray[np.float64]

SAMPLES = (100_000, 2_000_000)  # points that are measured besides the vertices: least, most
SAMPLES_PER_TRIANGLE = 8
LEAST_TRIANGLES = 4  # a tetrahedron
REFINEMENTS = 5  # halvings of the interval of ratios, in their logarithm, for a largest deviation
NEIGHBOURS = 3  # vertices of the original from which a new vertex has its gradient


@dataclass(frozen=True, slots=True, kw_only=True)
class Deviation:
    """Distance between two meshes, in both directions, measured at their vertices and at points on them.

    Attributes
    ----------
    hausdorff : float
        Largest distance of any of the points from the other mesh [voxel]: the Hausdorff distance, but for what
        lies between the points.
    rms : float
        Root of the mean square [voxel], the larger of the two directions.
    points : int
        How many were measured.
    """

    hausdorff: float = 0.0
    rms: float = 0.0
    points: int = 0


@dataclass(frozen=True, slots=True, kw_only=True)
class Simplified:
    """A simplified mesh, and how it compares with the original.

    Attributes
    ----------
    mesh : Mesh
    triangles_before : int
    deviation : Deviation
    """

    mesh: Mesh
    triangles_before: int
    deviation: Deviation

    @property
    def ratio(self) -> float:
        """Share of the triangles that is left."""
        return len(self.mesh.triangles) / self.triangles_before if self.triangles_before else 1.0


def simplify(
    mesh: Mesh,
    geometry: GridGeometry,
    *,
    ratio: float | None = None,
    max_deviation: float | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Simplified:
    """Return a mesh with fewer triangles by edge collapses, and its measured distance from the original.

    Parameters
    ----------
    mesh : Mesh
    geometry : GridGeometry
        Of the volume: distances are measured in its index coordinates.
    ratio : float
        Share of the triangles to keep, above 0 and below 1. Where the topology does not allow so few, more stay.
    max_deviation : float
        In place of `ratio`: as few triangles as a search finds whose measured Hausdorff distance is at most so
        large [voxel], > 0. The mesh as it is if there are none.
    progress : callable, optional
        Called with steps done and steps in all; of a search, the most that are still to come.

    Returns
    -------
    simplified : Simplified
        Topology and borders are preserved: a closed mesh stays closed. Gradients are those of the nearest
        vertices of the original.

    Raises
    ------
    MissingDependencyError
        If pymeshlab is not installed.
    InputError
        If not exactly one of `ratio` and `max_deviation` is given, or it is out of range.

    Notes
    -----
    M. Garland and P. Heckbert, "Surface simplification using quadric error metrics", SIGGRAPH 1997, as MeshLab has
    it.
    """
    check_target(ratio, max_deviation)
    check_available()
    before = len(mesh.triangles)
    if before <= LEAST_TRIANGLES:
        return Simplified(mesh=mesh, triangles_before=before, deviation=Deviation())
    work = _Work.of(mesh, geometry, _Steps(progress))
    if ratio is not None:
        work.steps.expect(1)
        chosen = work.tried(max(round(ratio * before), LEAST_TRIANGLES), work.shape)
    else:
        assert max_deviation is not None
        chosen = work.search(max_deviation)
    work.steps.expect(0)
    shape, deviation = chosen
    left = work.mesh_of(shape) if shape is not work.shape else mesh
    return Simplified(mesh=left, triangles_before=before, deviation=deviation)


def check_target(ratio: float | None, max_deviation: float | None) -> None:
    """Raise `InputError` unless exactly one is given and in range."""
    if (ratio is None) == (max_deviation is None):
        raise InputError(
            f"ratio {ratio!r} and max_deviation {max_deviation!r}: give one of them, and not the other."
        )
    if ratio is not None and not 0.0 < ratio < 1.0:
        raise InputError(
            f"ratio {ratio!r} must be above 0 and below 1: the share of the triangles to keep, such as 0.25."
        )
    if max_deviation is not None and not 0.0 < max_deviation < np.inf:
        raise InputError(f"max_deviation {max_deviation!r} must be a finite number of voxels above 0.")


def check_available() -> None:
    """Raise `MissingDependencyError` unless pymeshlab is installed."""
    _pymeshlab()


@dataclass(frozen=True, slots=True, eq=False)
class _Shape:
    """Vertices (V, 3) in voxels of the mean size, along the world's axes, and triangles (T, 3)."""

    vertices: F64
    triangles: npt.NDArray[np.int32]


@dataclass(slots=True)
class _Steps:
    """Tells how far the work has come: a trial is two steps, a collapse and a measurement."""

    progress: Callable[[int, int], None] | None
    done: int = 0
    total: int = 0

    def expect(self, trials: int) -> None:
        """Take how many trials are still to come at most."""
        self.total = self.done + 2 * trials
        self._tell()

    def step(self) -> None:
        self.done += 1
        self._tell()

    def _tell(self) -> None:
        if self.progress is not None and self.total:
            self.progress(self.done, self.total)


@dataclass(frozen=True, slots=True, eq=False)
class _Work:
    """A mesh as MeshLab takes it, near the origin and of the size of its voxels."""

    mesh: Mesh
    shape: _Shape
    centre: F64
    scale: float
    index_from_shape: F64
    steps: _Steps

    @classmethod
    def of(cls, mesh: Mesh, geometry: GridGeometry, steps: _Steps) -> _Work:
        centre = geometry.box.centre
        scale = float(np.prod(geometry.spacing) ** (1.0 / 3.0))
        shape = _Shape((mesh.vertices - centre) / scale, mesh.triangles)
        index_from_shape: F64 = np.multiply(np.linalg.inv(geometry.world_from_index[:3, :3]), scale)
        return cls(mesh, shape, centre, scale, index_from_shape, steps)

    def tried(self, triangles: int, start: _Shape) -> tuple[_Shape, Deviation]:
        """Collapse a shape to so many triangles, and measure what comes of it."""
        found = self.collapse(triangles, start)
        self.steps.step()
        deviation = self.measure(found)
        self.steps.step()
        return found, deviation

    def collapse(self, triangles: int, start: _Shape) -> _Shape:
        """Collapse edges until so many triangles are left, or topology and normals allow no more."""
        meshes = _mesh_set(start)
        meshes.meshing_decimation_quadric_edge_collapse(
            targetfacenum=triangles, preserveboundary=True, preservenormal=True, preservetopology=True
        )
        found = meshes.current_mesh()
        return _Shape(np.array(found.vertex_matrix()), np.array(found.face_matrix(), dtype=np.int32))

    def measure(self, shape: _Shape) -> Deviation:
        """Distance from the original, in both directions, in index coordinates."""
        pair = [
            _Shape(part.vertices @ self.index_from_shape.T, part.triangles) for part in (shape, self.shape)
        ]
        meshes = _mesh_set(*pair)
        largest, rms, points = 0.0, 0.0, 0
        for sampled, target in ((0, 1), (1, 0)):
            wanted = SAMPLES_PER_TRIANGLE * len(pair[sampled].triangles)
            found = meshes.get_hausdorff_distance(
                sampledmesh=sampled,
                targetmesh=target,
                samplevert=True,
                sampleedge=True,
                sampleface=True,
                samplenum=min(max(wanted, SAMPLES[0]), SAMPLES[1]),
                maxdist=_pymeshlab().PercentageValue(100),
            )
            largest, rms = max(largest, float(found["max"])), max(rms, float(found["RMS"]))
            points += int(found["n_samples"])
        return Deviation(hausdorff=largest, rms=rms, points=points)

    def search(self, max_deviation: float) -> tuple[_Shape, Deviation]:
        """Fewest triangles that are found within a deviation: halved while they are, then between."""
        good, deviation = self.shape, Deviation()
        bad = LEAST_TRIANGLES - 1
        triangles = len(good.triangles) // 2
        refinements = 0
        while triangles > bad and refinements < REFINEMENTS:
            self.steps.expect(_most_trials(len(good.triangles), bad, refinements))
            found, measured = self.tried(triangles, good)
            if measured.hausdorff <= max_deviation and len(found.triangles) < len(good.triangles):
                good, deviation = found, measured
                stuck = len(found.triangles) > triangles
            else:
                bad, stuck = triangles, len(found.triangles) > triangles
            if stuck or len(good.triangles) <= LEAST_TRIANGLES:
                break
            narrowed = bad >= LEAST_TRIANGLES
            refinements += narrowed
            between = round(np.sqrt(len(good.triangles) * bad))
            triangles = between if narrowed else max(len(good.triangles) // 2, LEAST_TRIANGLES)
        return good, deviation

    def mesh_of(self, shape: _Shape) -> Mesh:
        """The shape in the world, with gradients from the nearest vertices of the original."""
        from scipy.spatial import cKDTree

        count = min(NEIGHBOURS, len(self.mesh.vertices))
        distance, near = cKDTree(self.shape.vertices).query(shape.vertices, k=[*range(1, count + 1)])
        weights = 1.0 / np.maximum(distance, 1e-9)
        weights /= weights.sum(axis=1, keepdims=True)
        gradients = (weights[..., None] * self.mesh.gradients[near]).sum(axis=1)
        return Mesh(
            isovalue=self.mesh.isovalue,
            vertices=shape.vertices * self.scale + self.centre,
            gradients=gradients,
            triangles=shape.triangles,
        )


def _most_trials(good: int, bad: int, refinements: int) -> int:
    """How many trials a search makes at most from here on: halvings to the fewest triangles, and what lies between."""
    if bad >= LEAST_TRIANGLES:
        return REFINEMENTS - refinements
    return math.ceil(math.log2(good / LEAST_TRIANGLES)) + REFINEMENTS - 1


def _mesh_set(*shapes: _Shape) -> Any:
    """MeshLab's own copy of some meshes; the last one is the current."""
    pymeshlab = _pymeshlab()
    meshes = pymeshlab.MeshSet(verbose=False)
    for shape in shapes:
        meshes.add_mesh(pymeshlab.Mesh(shape.vertices, shape.triangles))
    return meshes


def _pymeshlab() -> Any:
    try:
        import pymeshlab
    except ImportError as error:
        raise MissingDependencyError(
            'simplification needs pymeshlab. Install it with: pip install "isosample[simplify]", '
            "or export the mesh as it is."
        ) from error
    return pymeshlab

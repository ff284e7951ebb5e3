"""Closed fields and mesh measures that several tests share."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from isosample.surfaces.extract import extract_surfaces
from isosample.volume.reconstruction import Reconstruction

if TYPE_CHECKING:
    from isosample.surfaces.mesh import Mesh
    from isosample.volume.grid import Volume

F64 = npt.NDArray[np.float64]


def index_grid(size_xyz: tuple[int, int, int]) -> tuple[F64, F64, F64]:
    """Index coordinates x, y, z of every sample, each (Z, Y, X)."""
    z, y, x = np.meshgrid(*(np.arange(n, dtype=np.float64) for n in size_xyz[::-1]), indexing="ij")
    return x, y, z


def closed_noise(seed: int, size: int = 12) -> npt.NDArray[np.float64]:
    """Independent normal noise, full of saddles, inside a border far below every isovalue."""
    return np.pad(np.random.default_rng(seed).standard_normal((size, size, size)), 1, constant_values=-9.0)


def noise_with_holes(seed: int, size: int = 9) -> npt.NDArray[np.float64]:
    """Noise of which one sample in 40 is not finite: the surface meets many masked cells."""
    samples = np.random.default_rng(seed).standard_normal((size, size, size))
    holes = np.random.default_rng(seed + 1).choice(samples.size, samples.size // 40, replace=False)
    samples.reshape(-1)[holes] = np.where(holes % 2, np.nan, np.inf)
    return samples


def extract_mesh(
    volume: Volume,
    isovalue: float,
    *,
    brick_cells: int = 32,
    nan_masked: bool = False,
    reconstruction: Reconstruction = Reconstruction.TRILINEAR,
    refine: int = 1,
) -> Mesh:
    return extract_surfaces(
        volume,
        [isovalue],
        brick_cells=brick_cells,
        nan_masked=nan_masked,
        reconstruction=reconstruction,
        refine=refine,
    ).mesh(0)


def directed_edges(mesh: Mesh) -> npt.NDArray[np.int64]:
    """(3 T,) int64, one number per directed triangle side."""
    sides = mesh.triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2).astype(np.int64)
    numbers: npt.NDArray[np.int64] = sides[:, 0] * len(mesh.vertices) + sides[:, 1]
    return numbers


def open_edges(mesh: Mesh) -> F64:
    """(E, 2, 3) float64, ends of the sides that no second triangle runs along in the other direction."""
    forward = directed_edges(mesh)
    first, second = np.divmod(forward, len(mesh.vertices))
    alone = ~np.isin(forward, second * len(mesh.vertices) + first)
    return np.stack([mesh.vertices[first[alone]], mesh.vertices[second[alone]]], axis=1)


def assert_watertight(mesh: Mesh) -> None:
    """Every side is shared by exactly two triangles that run along it in opposite directions."""
    forward = directed_edges(mesh)
    assert len(forward), "an empty mesh proves nothing"
    assert len(np.unique(forward)) == len(forward), "a directed side occurs twice"
    assert len(open_edges(mesh)) == 0


def euler_characteristic(mesh: Mesh) -> int:
    """Vertices − edges + triangles; every vertex belongs to a triangle."""
    assert np.array_equal(np.unique(mesh.triangles), np.arange(len(mesh.vertices)))
    ends = np.sort(mesh.triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    return len(mesh.vertices) - len(np.unique(ends, axis=0)) + len(mesh.triangles)


def assert_same_mesh(first: Mesh, second: Mesh) -> None:
    """Same vertices, gradients and triangles bit for bit; the order of the triangles is free."""
    assert np.array_equal(first.vertices, second.vertices)
    assert np.array_equal(first.gradients, second.gradients)
    ordered = [mesh.triangles[np.lexsort(mesh.triangles.T)] for mesh in (first, second)]
    assert np.array_equal(ordered[0], ordered[1])


def area_vectors(mesh: Mesh) -> F64:
    """(T, 3) float64, right-hand normals of the triangles, as long as their areas."""
    a, b, c = (mesh.vertices[mesh.triangles[:, corner]] for corner in range(3))
    return 0.5 * np.cross(b - a, c - a)


def enclosed_volume(mesh: Mesh) -> float:
    """Signed volume inside, positive when triangles face outwards."""
    a, b, c = (mesh.vertices[mesh.triangles[:, corner]] for corner in range(3))
    return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6.0)

"""Closed fields and mesh measures that several tests share."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from isosample.surfaces.extract import extract_surfaces

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


def extract_mesh(volume: Volume, isovalue: float, *, brick_cells: int = 64, nan_masked: bool = False) -> Mesh:
    return extract_surfaces(volume, [isovalue], brick_cells=brick_cells, nan_masked=nan_masked).mesh(0)


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


def area_vectors(mesh: Mesh) -> F64:
    """(T, 3) float64, right-hand normals of the triangles, as long as their areas."""
    a, b, c = (mesh.vertices[mesh.triangles[:, corner]] for corner in range(3))
    return 0.5 * np.cross(b - a, c - a)


def enclosed_volume(mesh: Mesh) -> float:
    """Signed volume inside, positive when triangles face outwards."""
    a, b, c = (mesh.vertices[mesh.triangles[:, corner]] for corner in range(3))
    return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6.0)

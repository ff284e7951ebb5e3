"""Simplified meshes: as many triangles as asked for, closed, and as far away as they say."""

from __future__ import annotations

import sys
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from mesh_checks import enclosed_volume, extract_mesh

from isosample.errors import InputError, MissingDependencyError
from isosample.surfaces.export import open_edge_count
from isosample.surfaces.simplify import simplify
from isosample.volume.grid import Volume

if TYPE_CHECKING:
    from isosample.surfaces.mesh import Mesh
    from isosample.volume.geometry import GridGeometry

RADIUS = 7.3
SPACING = (0.5, 0.5, 1.5)


def ball(spacing: tuple[float, float, float] = (1.0, 1.0, 1.0)) -> tuple[Mesh, GridGeometry]:
    """A ball in index coordinates, which the spacing stretches."""
    z, y, x = np.mgrid[0:20, 0:20, 0:20] - 9.5
    volume = Volume(-np.sqrt(x * x + y * y + z * z), spacing=spacing, origin=(1e3, 0.0, -50.0))
    return extract_mesh(volume, -RADIUS), volume.geometry


def radii(mesh: Mesh, geometry: GridGeometry) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
    """Distances of the vertices from the ball's centre [voxel]."""
    away: np.ndarray[tuple[int, ...], np.dtype[np.float64]] = (
        mesh.vertices - geometry.box.centre
    ) / geometry.spacing
    found: np.ndarray[tuple[int, ...], np.dtype[np.float64]] = np.linalg.norm(away, axis=1)
    return found


@pytest.mark.parametrize("spacing", [(1.0, 1.0, 1.0), SPACING])
def test_a_share_of_the_triangles_stays_closed_and_near(spacing: tuple[float, float, float]) -> None:
    pytest.importorskip("pymeshlab")
    mesh, geometry = ball(spacing)
    found = simplify(mesh, geometry, ratio=0.2)
    assert found.triangles_before == len(mesh.triangles)
    assert found.ratio == pytest.approx(0.2, abs=2 / len(mesh.triangles))
    assert open_edge_count(found.mesh.triangles) == 0
    # What is enclosed differs by less than the area of the ball times the distance in voxels, all in index units.
    voxel = float(np.prod(spacing))
    change = abs(enclosed_volume(found.mesh) - enclosed_volume(mesh)) / voxel
    assert change < 4 * np.pi * (RADIUS + 1) ** 2 * found.deviation.hausdorff
    # The original lies within 0.1 voxel of the ball (a chord of sqrt(3) voxels at this radius sags by 0.05).
    far = np.abs(radii(found.mesh, geometry) - RADIUS).max()
    assert far <= found.deviation.hausdorff + 0.1
    assert 0 < found.deviation.rms < found.deviation.hausdorff < 0.5
    assert found.deviation.points > 100_000


def test_the_measured_distance_is_not_below_that_of_a_vertex_from_the_other_mesh() -> None:
    pytest.importorskip("pymeshlab")
    trimesh = pytest.importorskip("trimesh")
    mesh, geometry = ball()
    found = simplify(mesh, geometry, ratio=0.1)
    largest = 0.0
    for one, other in ((mesh, found.mesh), (found.mesh, mesh)):
        corners = other.vertices[other.triangles]
        for point in one.vertices:
            near = trimesh.triangles.closest_point(corners, np.broadcast_to(point, (len(corners), 3)))
            largest = max(largest, float(np.linalg.norm(near - point, axis=1).min()))
    # MeshLab's grid of the other mesh is in float64, but its boxes are not: 7 digits.
    assert found.deviation.hausdorff >= largest * (1 - 1e-6)
    assert found.deviation.hausdorff < 2 * largest


@pytest.mark.parametrize("allowed", [0.05, 0.3])
def test_a_deviation_is_kept_and_used(allowed: float) -> None:
    pytest.importorskip("pymeshlab")
    mesh, geometry = ball()
    found = simplify(mesh, geometry, max_deviation=allowed)
    assert 0.3 * allowed < found.deviation.hausdorff <= allowed
    assert len(found.mesh.triangles) < 0.8 * len(mesh.triangles)
    assert open_edge_count(found.mesh.triangles) == 0


@pytest.mark.parametrize(
    "target", [{"ratio": 0.2}, {"max_deviation": 0.05}, {"max_deviation": 1e-9}, {"max_deviation": 50.0}]
)
def test_progress_is_told_from_the_start_to_the_end_and_never_falls_back(target: dict[str, Any]) -> None:
    """By every collapse and every measurement, of which a search for a deviation makes a number that it finds out."""
    pytest.importorskip("pymeshlab")
    mesh, geometry = ball()
    told: list[tuple[int, int]] = []
    simplify(mesh, geometry, **target, progress=lambda done, total: told.append((done, total)))
    assert told[0][0] == 0
    assert told[-1][0] == told[-1][1] > 1
    shares = [done / total for done, total in told]
    assert shares == sorted(shares)
    assert {later - earlier for (earlier, _), (later, _) in pairwise(told)} <= {0, 1}


def test_a_deviation_that_allows_nothing_leaves_the_mesh_as_it_is() -> None:
    pytest.importorskip("pymeshlab")
    mesh, geometry = ball()
    found = simplify(mesh, geometry, max_deviation=1e-9)
    assert found.mesh is mesh
    assert (found.ratio, found.deviation.hausdorff) == (1.0, 0.0)


def test_normals_of_a_simplified_ball_point_outwards() -> None:
    pytest.importorskip("pymeshlab")
    mesh, geometry = ball()
    found = simplify(mesh, geometry, ratio=0.3)
    outward = found.mesh.vertices - geometry.box.centre
    outward /= np.linalg.norm(outward, axis=1, keepdims=True)
    # The three nearest vertices are at most a voxel and a half away, which is arcsin(1.5 / 7.3) = 12 degrees.
    assert (found.mesh.normals * outward).sum(axis=1).min() > np.cos(np.radians(12))


def test_an_open_mesh_keeps_its_border() -> None:
    pytest.importorskip("pymeshlab")
    z, y, x = np.mgrid[0:12, 0:12, 0:12].astype(np.float64)
    volume = Volume(z + 0.3 * np.sin(0.5 * x) * np.sin(0.4 * y))
    mesh = extract_mesh(volume, 5.5)
    found = simplify(mesh, volume.geometry, ratio=0.2)
    assert found.ratio < 0.25
    for axis in (0, 1):
        assert found.mesh.vertices[:, axis].min() == pytest.approx(0.0, abs=0.01)
        assert found.mesh.vertices[:, axis].max() == pytest.approx(11.0, abs=0.01)


@pytest.mark.parametrize(
    ("target", "named"),
    [
        ({}, "give one of them"),
        ({"ratio": 0.5, "max_deviation": 0.1}, "give one of them"),
        ({"ratio": 1.0}, "ratio 1.0 must be above 0 and below 1"),
        ({"ratio": float("nan")}, "ratio nan"),
        ({"max_deviation": 0.0}, "max_deviation 0.0 must be"),
        ({"max_deviation": float("inf")}, "max_deviation inf"),
    ],
)
def test_impossible_targets_are_refused(target: dict[str, Any], named: str) -> None:
    mesh, geometry = ball()
    with pytest.raises(InputError, match=named):
        simplify(mesh, geometry, **target)


def test_a_missing_pymeshlab_is_named_with_its_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    mesh, geometry = ball()
    monkeypatch.setitem(sys.modules, "pymeshlab", None)
    with pytest.raises(MissingDependencyError, match=r"isosample\[simplify\]"):
        simplify(mesh, geometry, ratio=0.5)

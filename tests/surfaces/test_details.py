"""Coarser meshes: within their tolerance, of the same vertices and topology, and without cracks between details."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt
import pytest
from cache_scenes import assert_same_bits, scene_transfer, scene_volume, written_scene
from mesh_checks import assert_watertight, euler_characteristic, index_grid, noise_with_holes
from scipy.ndimage import map_coordinates

from isosample.errors import InputError
from isosample.surfaces.brick_samples import BrickSamples, gradients_at, load_brick
from isosample.surfaces.cache import content_hash, extract_with_cache, load_cache, open_cache, write_cache
from isosample.surfaces.collapse_kernels import collapse
from isosample.surfaces.detail import (
    FEWEST_TRIANGLES,
    MOST_DETAILS,
    ORDERED,
    coarsened,
    detail_tolerance,
)
from isosample.surfaces.detail_sets import extract_details, with_details
from isosample.surfaces.extract import extract_surfaces
from isosample.surfaces.mesh import weld
from isosample.surfaces.out_of_core import extract_into_store
from isosample.surfaces.refine import NamedMesh
from isosample.surfaces.residual_kernels import POINTS, largest_distance
from isosample.surfaces.ring_kernels import keeps_topology
from isosample.surfaces.settings import ExtractionSettings
from isosample.surfaces.store import MeshStore
from isosample.volume.analytic import GaussianMixture, sample_field
from isosample.volume.bricks import bricks_of
from isosample.volume.grid import Volume
from isosample.volume.reconstruction import GridSpline, Reconstruction

if TYPE_CHECKING:
    from pathlib import Path

    from isosample.surfaces.mesh import BrickMesh
    from isosample.surfaces.surface_set import SurfaceSet

F64 = npt.NDArray[np.float64]
DETAILS = tuple(range(1, MOST_DETAILS + 1))
EDGE = 40  # samples; bricks of 16 cells meet inside


def blobs() -> Volume:
    """Two Gaussians, smooth over many cells, whose isosurface at 0.4 is closed."""
    field = GaussianMixture(
        centres=((-0.3, 0, 0.1), (0.35, 0.1, 0)), widths=(0.3, 0.25), amplitudes=(1.0, 0.9)
    )
    return sample_field(field, (EDGE,) * 3, lower=(-1.0,) * 3, upper=(1.0,) * 3)


def ring() -> Volume:
    """A torus: Euler characteristic 0."""
    x, y, z = (grid - (EDGE - 1) / 2 for grid in index_grid((EDGE,) * 3))
    return Volume((8.0**2 - (np.hypot(x, y) - 11.0) ** 2 - z**2).astype(np.float32))


def extracted(volume: Volume, isovalue: float, detail: int, **options: object) -> SurfaceSet:
    return extract_surfaces(volume, [isovalue], brick_cells=16, detail=detail, **options)  # type: ignore[arg-type]


def points_of(mesh: BrickMesh, triangles: npt.NDArray[np.int32]) -> F64:
    """(7 T, 3) the places that are looked at, in the volume's index coordinates."""
    shares = np.array([point[:3] for point in POINTS])
    corners = mesh.positions.astype(np.float64)[triangles] + np.array(mesh.start)
    points: F64 = np.einsum("pk,tkc->tpc", shares, corners).reshape(-1, 3)
    return points


def distances(volume: Volume, mesh: BrickMesh, triangles: npt.NDArray[np.int32]) -> F64:
    """Of the places that are looked at, see `first_order`."""
    return first_order(volume, mesh.isovalue, points_of(mesh, triangles))


def first_order(volume: Volume, isovalue: float, points: F64) -> F64:
    """First-order distances from the isosurface of the trilinear field, by scipy and differences over 2e-6 voxel."""
    samples = np.asarray(volume.array, dtype=np.float64)

    def field(places: F64) -> F64:
        found: F64 = map_coordinates(samples, places.T[::-1], order=1, mode="nearest")
        return found

    slopes = [(field(points + 1e-6 * axis) - field(points - 1e-6 * axis)) / 2e-6 for axis in np.eye(3)]
    found: F64 = np.abs(field(points) - isovalue) / np.linalg.norm(slopes, axis=0)
    return found


def vertex_rows(mesh: BrickMesh) -> npt.NDArray[np.void]:
    """(V,) position, gradient and name of every vertex as one value that can be compared."""
    columns = [
        mesh.positions.view(np.uint8),
        mesh.gradients.view(np.uint8),
        mesh.edge_keys[:, None].view(np.uint8),
    ]
    joined = np.ascontiguousarray(np.concatenate(columns, axis=1))
    return joined.view(f"V{joined.shape[1]}").ravel()


def border_of(mesh: BrickMesh) -> set[tuple[int, int]]:
    """Directed sides, by the vertices' names, that no triangle runs along in the other direction."""
    keys = mesh.edge_keys[mesh.triangles]
    sides = {(a, b) for t in keys.tolist() for a, b in zip(t, t[1:] + t[:1], strict=True)}
    return {side for side in sides if side[::-1] not in sides}


@pytest.mark.parametrize("detail", DETAILS)
def test_new_triangles_are_within_the_tolerance_of_the_isosurface(detail: int) -> None:
    volume = blobs()
    fine = {mesh.brick: mesh for mesh in extracted(volume, 0.4, 0).meshes}
    coarse = extracted(volume, 0.4, detail).meshes
    assert len(coarse) >= 3  # at detail 1 some would hardly get coarser
    for mesh in coarse:
        known = {frozenset(t) for t in fine[mesh.brick].edge_keys[fine[mesh.brick].triangles].tolist()}
        new = np.array([frozenset(t) not in known for t in mesh.edge_keys[mesh.triangles].tolist()])
        # the central differences over 1e-6 are wrong by 1e-16 / 1e-6 = 1e-10 of the field's size (1) where
        # they do not cross a grid plane; where one does, the slope is a mean of both sides': those points,
        # within 1e-6 of a plane, are left out
        points = points_of(mesh, mesh.triangles[new])
        clear = (np.abs(points - np.rint(points)) > 2e-6).all(axis=1)
        found = distances(volume, mesh, mesh.triangles[new])[clear]
        assert found.size > 0
        assert found.max() <= detail_tolerance(detail) * (1 + 1e-6)


@pytest.mark.parametrize("detail", DETAILS[1:])
def test_between_the_places_that_were_looked_at_the_surface_is_not_much_farther(detail: int) -> None:
    """At random points: radii are 6 voxels at least, so that the surface rises 1² / (8 * 6) between two places."""
    volume, rng = blobs(), np.random.default_rng(detail)
    for mesh in extracted(volume, 0.4, detail).meshes:
        shares = rng.dirichlet((1.0, 1.0, 1.0), size=40)
        corners = mesh.positions.astype(np.float64)[mesh.triangles] + np.array(mesh.start)
        points = np.einsum("pk,tkc->tpc", shares, corners).reshape(-1, 3)
        assert first_order(volume, mesh.isovalue, points).max() <= detail_tolerance(detail) + 1.0 / 48.0


def test_a_bump_does_not_get_lost_below_a_large_triangle() -> None:
    """A plane with a bump 1.5 voxels wide and 0.6 high, between the seven points of any large triangle."""
    x, y, z = index_grid((32,) * 3)
    height = 15.3 + 0.6 * np.exp(-((x - 13.2) ** 2 + (y - 17.4) ** 2) / (2 * 1.5**2))
    volume = Volume((height - z).astype(np.float32))
    for detail in (3, 4):
        (mesh,) = extract_surfaces(volume, [0.0], detail=detail).meshes
        assert mesh.positions[:, 2].max() > 15.3 + 0.6 - 2 * detail_tolerance(detail)
        seen = np.hypot(mesh.positions[:, 0] - 13.2, mesh.positions[:, 1] - 17.4) < 4.0
        assert seen.sum() < 0.2 * np.pi * 16 * 3  # three vertices per cell of the mesh as extracted


def test_each_detail_is_coarser_than_the_one_before() -> None:
    # A side of length h lies h² / 8 R from a surface of radius R ~ 10: within 1/16 voxel for h = 2.2, within 1/2 for
    # 6.3, against 0.7 in a cell. That would leave a tenth and a hundredth; borders stay, so at least half must go.
    counts = [
        sum(extracted(blobs(), 0.4, detail).statistics.triangles) for detail in (0, *DETAILS[1:])
    ]  # of all pieces
    assert sorted(counts, reverse=True) == counts
    assert counts[1] < 0.5 * counts[0]


@pytest.mark.parametrize("detail", DETAILS)
def test_vertices_are_some_of_the_finest_ones_bit_for_bit(detail: int) -> None:
    fine = {mesh.brick: mesh for mesh in extracted(blobs(), 0.4, 0).meshes}
    for mesh in extracted(blobs(), 0.4, detail).meshes:
        assert np.isin(vertex_rows(mesh), vertex_rows(fine[mesh.brick])).all()
        assert len(np.unique(mesh.triangles)) == len(mesh.positions) < len(fine[mesh.brick].positions)


def test_triangles_stand_in_the_order_of_their_size_block_by_block() -> None:
    (mesh,) = extract_surfaces(blobs(), [0.4], detail=1).meshes
    corners = mesh.positions.astype(np.float64)[mesh.triangles]
    doubled = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    assert len(doubled) > 2 * ORDERED
    # Ordered by positions in float64. Stored ones are rounded to 2^-19 voxel: a side is off by 3^0.5 2^-19 at most, an
    # area of two sides by twice that times the longer one, and the difference of two areas by twice as much.
    longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max()
    falls = np.flatnonzero(np.diff(doubled) < -4.0 * 3.0**0.5 * 2.0**-19 * longest)
    assert np.all((falls + 1) % ORDERED == 0)
    assert len(falls) > 0  # blocks, not the whole mesh


@pytest.mark.parametrize("detail", DETAILS)
def test_the_border_of_a_brick_stays(detail: int) -> None:
    fine = {mesh.brick: mesh for mesh in extracted(blobs(), 0.4, 0).meshes}
    for mesh in extracted(blobs(), 0.4, detail).meshes:
        assert border_of(mesh) == border_of(fine[mesh.brick]) != set()


@pytest.mark.parametrize("seed", range(4))
def test_bricks_of_any_details_fit_together(seed: int) -> None:
    volume = ring()
    by_detail = [{mesh.brick: mesh for mesh in extracted(volume, 30.0, d).meshes} for d in (0, *DETAILS)]
    rng = np.random.default_rng(seed)
    chosen = []
    for brick in by_detail[0]:
        there = [meshes[brick] for meshes in by_detail if brick in meshes]
        chosen.append(there[rng.integers(len(there))])
    mesh = weld(chosen, volume.geometry)
    assert len(mesh.triangles) < sum(len(one.triangles) for one in by_detail[0].values())
    assert_watertight(mesh)
    assert euler_characteristic(mesh) == 0


def test_a_small_ball_does_not_vanish() -> None:
    x, y, z = (grid - 7.3 for grid in index_grid((16,) * 3))
    volume = Volume((3.0 - np.sqrt(x**2 + y**2 + z**2)).astype(np.float32))
    for detail in DETAILS[2:]:
        mesh = extract_surfaces(volume, [0.5], detail=detail).mesh(0)
        assert_watertight(mesh)
        assert euler_characteristic(mesh) == 2


def test_the_topology_is_kept_whatever_the_tolerance() -> None:
    """Thin tubes, where neighbours of a vertex are neighbours of each other across the tube."""
    x, y, z = (grid - 11.5 for grid in index_grid((24,) * 3))
    tube = Volume((1.1**2 - (np.hypot(x, y) - 7.0) ** 2 - z**2).astype(np.float32))
    (mesh,) = extract_surfaces(tube, [0.0]).meshes
    assert euler_characteristic(weld([mesh], tube.geometry)) == 0
    left = collapsed(load_brick(tube, bricks_of(tube.size_xyz, 32)[0]), mesh, 1e3)
    assert len(left) < 0.7 * len(mesh.triangles)
    coarse = weld([replace(mesh, triangles=left)], tube.geometry)
    used, triangles = np.unique(coarse.triangles, return_inverse=True)
    coarse = replace(
        coarse, vertices=coarse.vertices[used], triangles=triangles.reshape(-1, 3).astype(np.int32)
    )
    assert_watertight(coarse)
    assert euler_characteristic(coarse) == 0


@pytest.mark.parametrize(
    ("triangles", "ring", "allowed"),
    [
        # vertex 0 over the square 1 2 3 4, whose diagonal 1-3 divides the base: 0 on 1 would join 0-3 with 1-3
        (
            [(0, 1, 2), (0, 2, 3), (0, 3, 4), (0, 4, 1), (1, 3, 2), (1, 4, 3)],
            [1, 2, 3, 4],
            [False, True, False, True],
        ),
        # an octahedron becomes a double tetrahedron
        (
            [(0, 1, 2), (0, 2, 3), (0, 3, 4), (0, 4, 1), (5, 2, 1), (5, 3, 2), (5, 4, 3), (5, 1, 4)],
            [1, 2, 3, 4],
            [True, True, True, True],
        ),
        # a tetrahedron would become two triangles that lie on each other
        ([(0, 1, 2), (0, 2, 3), (0, 3, 1), (1, 3, 2)], [1, 2, 3], [False, False, False]),
    ],
)
def test_a_collapse_that_would_change_the_topology_is_not_made(
    triangles: list[tuple[int, int, int]], ring: list[int], allowed: list[bool]
) -> None:
    corners = np.array(triangles, dtype=np.int32)
    first = np.full(6, -1, dtype=np.int32)
    following = np.full(corners.size, -1, dtype=np.int32)
    for corner, vertex in enumerate(corners.ravel().tolist()):
        following[corner], first[vertex] = first[vertex], corner
    marked = np.full(6, -1, dtype=np.int32)
    marked[ring] = 7
    around = np.array(ring + [0] * (24 - len(ring)), dtype=np.int32)
    found = [
        keeps_topology(0, around, len(ring), onto, corners, first, following, marked, 7)
        for onto in range(len(ring))
    ]
    assert found == allowed


def distance_of_a_large_triangle(samples: F64) -> float:
    """Of one in the plane z = 1.4 of 24 × 24 voxels, with a limit that nothing reaches."""
    corners = np.array([[1.0, 1.0, 1.4], [23.0, 1.0, 1.4], [1.0, 23.0, 1.4]])
    triangle = np.array([[0, 1, 2]], dtype=np.int32)
    padded = np.pad(samples, 1, mode="edge")
    found: float = largest_distance(padded, np.zeros((4, 4)), False, np.zeros(3), 0.0, corners, triangle, 9.0)
    return found


def test_a_triangle_is_looked_at_everywhere() -> None:
    """A bump of 1/2 voxel, 1 voxel wide, anywhere below it, is seen by half at the least: places are 1/2 voxel away."""
    x, y, z = index_grid((26, 26, 4))
    for column, row in ((4.3, 4.8), (12.1, 3.4), (6.6, 13.7), (2.5, 19.2)):
        height = 1.4 + 0.5 * np.exp(-((x - column) ** 2 + (y - row) ** 2) / 2)
        found = distance_of_a_large_triangle(height - z)
        # the steepest slope of the bump is 0.5 / sqrt(e) = 0.3, which makes the first-order distance that much shorter
        assert 0.25 / np.hypot(1.0, 0.3) < found <= 0.5
    assert distance_of_a_large_triangle(1.4 - z) < 1e-15


def test_a_triangle_in_a_plateau_lies_on_no_isosurface() -> None:
    assert distance_of_a_large_triangle(np.zeros((4, 26, 26))) > 1.0


def test_where_there_is_no_field_a_triangle_is_too_far_away() -> None:
    samples = np.full((6, 6, 6), np.nan)
    corners = np.array([[0.5, 0.5, 1.5], [2.5, 0.5, 1.5], [0.5, 2.5, 1.5]])
    triangle = np.array([[0, 1, 2]], dtype=np.int32)
    far = largest_distance(samples, np.zeros((4, 4)), False, np.zeros(3), 0.0, corners, triangle, 0.1)
    assert far > 0.1


def test_a_plateau_at_the_isovalue_is_no_isosurface_to_lie_on() -> None:
    """A ball cut off at the isovalue: inside it the field equals the isovalue and has no gradient."""
    x, y, z = index_grid((24,) * 3)
    ball = np.minimum(8.0 - np.sqrt((x - 11.6) ** 2 + (y - 11.6) ** 2 + (z - 11.6) ** 2), 0.0)
    volume = Volume(ball.astype(np.float32))
    finest = extract_surfaces(volume, [0.0]).mesh(0)
    for detail in DETAILS:
        coarse = extract_surfaces(volume, [0.0], detail=detail)
        if coarse.meshes:
            # chords of the finest mesh already are (1/2)² / 16 inside; tolerance and as much again are allowed
            away = np.linalg.norm(
                coarse.mesh(0).vertices[coarse.mesh(0).triangles].mean(axis=1) - 11.6, axis=1
            )
            near = np.linalg.norm(finest.vertices[finest.triangles].mean(axis=1) - 11.6, axis=1)
            assert away.min() >= near.min() - 2 * detail_tolerance(detail)


def test_extract_details_gives_all_and_refuses_what_there_cannot_be() -> None:
    surfaces = extract_details(blobs(), [0.4], 2, brick_cells=16)
    assert [one.settings.detail for one in surfaces.by_detail] == [0, 1, 2]
    assert extract_details(blobs(), [0.4], 0).details == ()
    for details in (-1, 6, True):
        with pytest.raises(InputError, match="must be a whole number from 0 to 5"):
            extract_details(blobs(), [0.4], details)


def test_what_would_hardly_get_coarser_is_left_out() -> None:
    rng = np.random.default_rng(1)
    noise = Volume(rng.standard_normal((18,) * 3).astype(np.float32))
    assert extract_surfaces(noise, [0.0], detail=1).meshes == ()
    corner = np.zeros((4, 4, 4), dtype=np.float32)
    corner[0, 0, 0] = 1.0  # one triangle
    assert extract_surfaces(Volume(corner), [0.5], detail=MOST_DETAILS).meshes == ()
    assert FEWEST_TRIANGLES > 1


def test_no_triangle_spans_cells_that_are_masked() -> None:
    x, _, z = index_grid((30,) * 3)
    samples = (z + 0.3 * x).astype(np.float32)  # a plane, which would collapse across any hole
    samples[10:25, 12:17, 12:17] = np.nan
    volume = Volume(samples)
    (fine,) = extract_surfaces(volume, [19.7], nan_masked=True).meshes
    (mesh,) = extract_surfaces(volume, [19.7], nan_masked=True, detail=MOST_DETAILS).meshes
    assert len(mesh.triangles) < 0.5 * len(fine.triangles)
    assert border_of(mesh) == border_of(fine)
    cells = np.floor(points_of(mesh, mesh.triangles)).astype(np.int64)
    i, j = cells[:, 0], cells[:, 1]
    assert not ((i >= 11) & (i <= 16) & (j >= 11) & (j <= 16)).any()


def test_holes_in_noise_keep_their_borders() -> None:
    volume = Volume(noise_with_holes(3, size=20))
    fine = {mesh.brick: mesh for mesh in extracted(volume, 0.2, 0, nan_masked=True).meshes}
    smooth = coarse_of_all(volume, fine)
    for mesh, coarse in smooth:
        assert border_of(coarse) == border_of(mesh)


def coarse_of_all(
    volume: Volume, meshes: dict[tuple[int, int, int], BrickMesh]
) -> list[tuple[BrickMesh, BrickMesh]]:
    """Every mesh with its coarser one, where collapses of any number are taken."""
    bricks = {brick.index: brick for brick in bricks_of(volume.size_xyz, 16)}
    found = []
    for index, mesh in meshes.items():
        samples = load_brick(volume, bricks[index])
        left = collapsed(samples, mesh, 0.5)
        assert 0 < len(left) <= len(mesh.triangles)
        found.append((mesh, replace(mesh, triangles=left)))
    return found


def collapsed(samples: BrickSamples, mesh: BrickMesh, tolerance: float) -> npt.NDArray[np.int32]:
    """The triangles that are left, of the same vertices."""
    triangles = mesh.triangles.copy()
    arrays = (samples.coefficients, samples.kernel, samples.smooth, samples.origin)
    positions, gradients = mesh.positions.astype(np.float64), mesh.gradients.astype(np.float64)
    collapse(*arrays, mesh.isovalue, positions, gradients, triangles, tolerance)
    return triangles[triangles[:, 0] >= 0]


def test_a_smooth_reconstruction_is_coarsened_on_its_own_isosurface() -> None:
    volume = blobs()
    fine = extracted(volume, 0.4, 0, reconstruction=Reconstruction.CUBIC)
    coarse = extracted(volume, 0.4, 2, reconstruction=Reconstruction.CUBIC)
    spline = GridSpline.build(volume, Reconstruction.CUBIC)
    known = {
        mesh.brick: {frozenset(t) for t in mesh.edge_keys[mesh.triangles].tolist()} for mesh in fine.meshes
    }
    for mesh in coarse.meshes:
        new = [frozenset(t) not in known[mesh.brick] for t in mesh.edge_keys[mesh.triangles].tolist()]
        values, slopes = spline.evaluate(points_of(mesh, mesh.triangles[new]))
        # evaluated in another order: some 1e-14 of the values
        away = np.abs(values - 0.4) / np.linalg.norm(slopes, axis=-1)
        assert away.max() <= detail_tolerance(2) * (1 + 1e-10)
    assert sum(coarse.statistics.triangles) < 0.5 * sum(fine.statistics.triangles)


def test_refined_meshes_are_coarsened_too() -> None:
    fine = extracted(ring(), 30.0, 0, refine=2)
    coarse = extracted(ring(), 30.0, 3, refine=2)
    assert sum(coarse.statistics.triangles) < 0.25 * sum(fine.statistics.triangles)
    for mesh in coarse.meshes:
        finest = next(one for one in fine.meshes if one.brick == mesh.brick)
        assert np.isin(vertex_rows(mesh), vertex_rows(finest)).all()


def test_triangles_face_falling_values_in_a_mirrored_volume() -> None:
    direction = np.diag([1.0, 1.0, -1.0])
    volume = replace(blobs(), direction=direction)
    mesh = weld(extracted(volume, 0.4, 2).meshes, volume.geometry)
    a, b, c = (mesh.vertices[mesh.triangles[:, corner]] for corner in range(3))
    towards = np.einsum("ij,ij->i", np.cross(b - a, c - a), mesh.gradients[mesh.triangles].sum(axis=1))
    assert (towards < 0).all()


def test_a_flat_field_without_slope_is_left_alone() -> None:
    samples = np.zeros((6, 6, 6), dtype=np.float32)
    samples[3:] = 1.0
    plane = extract_surfaces(Volume(samples), [0.5], detail=1).meshes
    assert all(np.isfinite(mesh.positions).all() for mesh in plane)
    brick = bricks_of((6, 6, 6), 32)[0]
    loaded = load_brick(Volume(np.zeros((6, 6, 6), dtype=np.float32)), brick)
    x, y = (grid.ravel() for grid in np.mgrid[0:5, 0:5].astype(np.float64))
    positions = np.stack([x, y, np.full(25, 2.5)], axis=1)
    corner = np.array(
        [[r * 5 + c, r * 5 + c + 1, r * 5 + c + 5] for r in range(4) for c in range(4)], np.int32
    )
    mesh = NamedMesh(positions, gradients_at(loaded, positions), np.arange(25), corner)
    assert coarsened(mesh, loaded, 0.5, MOST_DETAILS) is None  # no gradient says where the isosurface is


@pytest.mark.parametrize("detail", [-1, 6, True, 1.5])
def test_an_impossible_detail_is_refused(detail: int) -> None:
    with pytest.raises(InputError, match=r"detail .* is not possible; choose 0 \(finest\) to 5"):
        ExtractionSettings(detail=detail)


def test_settings_without_detail_are_written_as_before() -> None:
    assert not {"detail", "flatness"} & ExtractionSettings().to_dict().keys()
    settings = ExtractionSettings(detail=3, refine=2, flatness=4e-3)
    assert ExtractionSettings.from_dict(settings.to_dict()) == settings
    with pytest.raises(InputError, match="entries"):
        ExtractionSettings.from_dict({**settings.to_dict(), "details": 1})


def smooth_scene() -> Volume:
    x, y, z = index_grid((30, 26, 28))
    samples = np.sin(0.2 * x) + np.sin(0.23 * y) + np.cos(0.19 * z)
    return replace(scene_volume(), array=samples.astype(np.float32))


def test_a_scene_keeps_its_details_in_its_folder(tmp_path: Path) -> None:
    volume = smooth_scene()
    fine = written_scene(tmp_path, volume)
    assert load_cache(tmp_path).surfaces.details == ()

    def at(detail: int) -> SurfaceSet:
        return extract_surfaces(volume, fine.isovalues, brick_cells=16, detail=detail)

    surfaces = with_details(at, 2)
    written_details(tmp_path / "details", volume, surfaces)
    loaded = load_cache(tmp_path / "details").surfaces
    opened = open_cache(tmp_path / "details").surfaces
    assert len(loaded.details) == len(opened.details) == 2
    for found, stored, expected in zip(loaded.by_detail, opened.by_detail, surfaces.by_detail, strict=True):
        assert_same_bits(found, expected)
        assert stored.statistics.triangles == expected.statistics.triangles


def written_details(folder: Path, volume: Volume, surfaces: SurfaceSet) -> None:
    transfer, plan = scene_transfer(volume)
    write_cache(
        folder,
        surfaces,
        content_hash=content_hash(volume),
        transfer_function=transfer,
        plan=plan,
        name="smooth",
    )


def test_details_are_extracted_once(tmp_path: Path) -> None:
    volume = blobs()
    first = extract_with_cache(
        volume, [0.4, 0.6], tmp_path, settings=ExtractionSettings(brick_cells=16, detail=2)
    )
    again = extract_with_cache(
        volume, [0.4, 0.6], tmp_path, settings=ExtractionSettings(brick_cells=16, detail=2)
    )
    assert first.statistics.brick_visits > 0
    assert again.statistics.brick_visits == 0
    assert_same_bits(again, first)
    other = extract_with_cache(
        volume, [0.4, 0.6], tmp_path, settings=ExtractionSettings(brick_cells=16, detail=3)
    )
    assert other.statistics.brick_visits == first.statistics.brick_visits


def test_details_within_a_memory_budget_are_the_same(tmp_path: Path) -> None:
    volume = blobs()
    settings = ExtractionSettings(brick_cells=16, detail=2)
    stored = extract_into_store(volume, [0.4], MeshStore(tmp_path), settings=settings)
    expected = extracted(volume, 0.4, 2)
    assert len(stored.meshes) == len(expected.meshes) > 0
    for one, other in zip(stored.meshes, expected.meshes, strict=True):
        assert np.array_equal(vertex_rows(one), vertex_rows(other))
        assert np.array_equal(one.triangles, other.triangles)

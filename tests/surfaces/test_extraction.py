"""Extracted isosurfaces: watertight, on the isosurface, wound and placed in world space, for any bricks."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hypothesis_numpy
from mesh_checks import (
    area_vectors,
    assert_watertight,
    closed_noise,
    enclosed_volume,
    extract_mesh,
    index_grid,
    open_edges,
)

from isosample.errors import InputError
from isosample.surfaces.extract import extract_surfaces
from isosample.surfaces.positions import POSITION_STEPS, SMALLEST_FRACTION
from isosample.volume.grid import Volume

if TYPE_CHECKING:
    from pathlib import Path

EPS = SMALLEST_FRACTION
ROUNDING = 0.5 / POSITION_STEPS
SHARED = 2.0**-15  # rounding of a gradient to a shared exponent, of its largest component
F64 = npt.NDArray[np.float64]


def sphere(radius: float, size: int, h: float = 1.0) -> Volume:
    """Radius minus distance from the middle of a cube of (size − 1) h, sampled h apart."""
    x, y, z = (h * (axis - 0.5 * (size - 1)) for axis in index_grid((size, size, size)))
    return Volume(
        radius - np.sqrt(x**2 + y**2 + z**2), spacing=(h, h, h), origin=(-0.5 * h * (size - 1),) * 3
    )


@pytest.mark.parametrize("brick_cells", [3, 32])
@pytest.mark.parametrize("seed", range(4))
def test_noise_full_of_saddles_is_watertight(seed: int, brick_cells: int) -> None:
    mesh = extract_mesh(Volume(closed_noise(seed)), 0.2, brick_cells=brick_cells)
    assert_watertight(mesh)


@pytest.mark.parametrize("dtype", [np.uint8, np.int16, np.float32])
@pytest.mark.parametrize("level", [1.0, 2.0, 2.5, 3.0])
def test_levels_equal_to_integer_samples_leave_no_hole(dtype: type[np.generic], level: float) -> None:
    samples = np.pad(np.random.default_rng(7).integers(0, 4, (10, 11, 12)), 1).astype(dtype)
    mesh = extract_mesh(Volume(samples), level, brick_cells=4)
    assert_watertight(mesh)
    assert (np.linalg.norm(area_vectors(mesh), axis=1) > 0).all()


@pytest.mark.parametrize("level", [1.0, 0.5, 1e-9])
def test_a_checkerboard_is_watertight(level: float) -> None:
    x, y, z = index_grid((8, 8, 8))
    samples = np.pad(((x + y + z) % 2).astype(np.uint8), 1)
    assert_watertight(extract_mesh(Volume(samples), level))


def test_a_plateau_at_the_level_has_one_surface_around_it() -> None:
    samples = np.zeros((9, 9, 9), dtype=np.int16)
    samples[2:7, 2:7, 2:7] = 5
    mesh = extract_mesh(Volume(samples), 5.0)
    assert_watertight(mesh)
    # values >= 5 are inside: the surface hugs the 4-voxel cube from outside, at EPS (to 1 part in 2**3 of it)
    assert enclosed_volume(mesh) == pytest.approx(4.0**3, rel=0, abs=6 * 4**2 * 1.2 * EPS)
    assert enclosed_volume(mesh) > 4.0**3


@given(
    samples=hypothesis_numpy.arrays(np.uint8, (4, 3, 5), elements=st.integers(0, 3)),
    level=st.sampled_from([1.0, 1.5, 2.0, 3.0]),
)
def test_small_integer_volumes_are_watertight(samples: npt.NDArray[np.uint8], level: float) -> None:
    samples[1, 1, 1] = 3
    mesh = extract_mesh(Volume(np.pad(samples, 1)), level, brick_cells=2)
    assert_watertight(mesh)


def test_trimesh_agrees_that_a_mesh_is_watertight_and_consistently_wound() -> None:
    trimesh = pytest.importorskip("trimesh")
    mesh = extract_mesh(Volume(closed_noise(3)), 0.0)
    judged = trimesh.Trimesh(mesh.vertices, mesh.triangles, process=False)
    assert judged.is_watertight
    assert judged.is_winding_consistent
    assert judged.volume == pytest.approx(enclosed_volume(mesh))


@pytest.mark.parametrize("h", [1.0, 0.5])
def test_the_volume_of_a_sphere_lies_within_the_derived_bounds(h: float) -> None:
    """Distance from the centre is convex, so vertices and triangles never lie outside the sphere (plus eps).

    A vertex: linear interpolation on an edge of length h errs by at most h²/8 · max f'' <= h²/(8 (r − √3 h)).
    A point p of a triangle with vertices at radius >= r1: |p|² >= r1² − D²/3, D <= √3 h the cell's diagonal.
    """
    r = 8.3
    mesh = extract_mesh(sphere(r, round(20 / h) + 1, h), 0.0)
    assert_watertight(mesh)
    nearest_vertex = r - h**2 / (8 * (r - np.sqrt(3) * h)) - EPS * h
    ball = 4.0 / 3.0 * np.pi
    assert ball * (nearest_vertex**2 - h**2) ** 1.5 < enclosed_volume(mesh) < ball * (r + EPS * h) ** 3


def test_the_error_of_a_sphere_falls_with_the_square_of_the_spacing() -> None:
    r = 8.3
    errors = [
        4 / 3 * np.pi * r**3 - enclosed_volume(extract_mesh(sphere(r, n, 20 / (n - 1)), 0.0))
        for n in (21, 41)
    ]
    assert 1.8 < np.log2(errors[0] / errors[1]) < 2.2  # order 2


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("side", [0, 1])
@pytest.mark.parametrize("flip", [False, True])
@pytest.mark.parametrize(("corner", "triangles"), [(1.5, 4), (1.0, 4), (0.5, 2)])
def test_an_ambiguous_face_follows_the_bilinear_saddle(
    axis: int, side: int, flip: bool, corner: float, triangles: int
) -> None:
    """Inside corners 1 and c, outside −1: the saddle (1 · c − 1)/(c + 3) is inside from c = 1 on.

    Inside corners that are joined lie in one ring of six cut edges, 4 triangles; apart, in 2 of one each.
    """
    face = np.array([[1.0, -1.0], [-1.0, corner]])
    cell = np.full((2, 2, 2), -1.0)
    cell[(slice(None),) * axis + (side,)] = face[::-1] if flip else face
    assert len(extract_mesh(Volume(cell), 0.0).triangles) == triangles


def test_a_vertex_inside_a_cell_is_the_mean_of_its_neighbours() -> None:
    volume = Volume(closed_noise(6))
    (mesh,) = extract_surfaces(volume, [0.2]).meshes
    inner = np.flatnonzero(mesh.edge_keys >= 3 * volume.array.size)
    assert len(inner) > 10
    for vertex in inner:
        around = mesh.triangles[(mesh.triangles == vertex).any(axis=1)]
        ring = np.setdiff1d(around, [vertex])
        mean = mesh.positions[ring].astype(np.float64).mean(axis=0)
        assert np.abs(mesh.positions[vertex] - mean).max() <= ROUNDING + 2.0**-50
        gradient = mesh.gradients[ring].astype(np.float64).mean(axis=0)
        assert np.abs(mesh.gradients[vertex] - gradient).max() <= SHARED * np.abs(gradient).max() + 2.0**-50
        x, y, z = np.floor(mesh.positions[vertex]).astype(np.int64)
        size_x, size_y, _ = volume.size_xyz
        assert mesh.edge_keys[vertex] - 3 * volume.array.size == x + size_x * (y + size_y * z)


def test_vertices_lie_on_the_linear_interpolant_of_their_edge() -> None:
    volume = Volume(closed_noise(11))
    surfaces = extract_surfaces(volume, [0.3])
    (mesh,) = surfaces.meshes
    edge = mesh.edge_keys < 3 * volume.array.size
    position = mesh.positions[edge].astype(np.float64)
    axis, lower = mesh.edge_keys[edge] % 3, np.floor(position).astype(np.int64)
    upper = lower.copy()
    upper[np.arange(len(axis)), axis] += 1
    fraction = (position - lower)[np.arange(len(axis)), axis]
    low, high = (volume.array[tuple(end.T[::-1])].astype(np.float64) for end in (lower, upper))
    exact = np.clip((0.3 - low) / (high - low), EPS, 1 - EPS)
    assert np.abs(fraction - exact).max() <= ROUNDING
    assert np.count_nonzero((position - lower).any(axis=1)) == len(position)


def test_an_offset_of_a_million_changes_no_bit_of_the_geometry() -> None:
    samples = np.rint(closed_noise(5) * 2.0**20) / 2.0**20  # adding 1e6 needs 20 + 20 bits: exact in float64
    plain, offset = extract_mesh(Volume(samples), 0.25), extract_mesh(Volume(samples + 1e6), 1e6 + 0.25)
    assert np.array_equal(plain.triangles, offset.triangles)
    assert np.array_equal(plain.vertices, offset.vertices)
    assert np.array_equal(plain.gradients, offset.gradients)


@pytest.mark.parametrize("dtype", [np.float64, np.uint8])
def test_geometry_does_not_depend_on_the_bricks(dtype: type[np.generic]) -> None:
    samples = closed_noise(2, size=17)
    array = samples if dtype is np.float64 else np.clip(samples + 3, 0, 6).astype(dtype)
    volume, level = (
        Volume(array, spacing=(0.3, 0.7, 1.1), origin=(5.0, -3.0, 0.1)),
        3.0 if dtype is np.uint8 else 0.1,
    )
    whole, parts = extract_mesh(volume, level, brick_cells=32), extract_mesh(volume, level, brick_cells=8)
    assert np.array_equal(whole.vertices, parts.vertices)
    assert np.array_equal(whole.gradients, parts.gradients)
    ordered = [mesh.triangles[np.lexsort(mesh.triangles.T)] for mesh in (whole, parts)]
    assert np.array_equal(ordered[0], ordered[1])


def test_vertices_on_shared_brick_borders_are_bit_identical() -> None:
    volume = Volume(closed_noise(9, size=15), spacing=(0.31, 0.77, 1.13), origin=(0.1, 0.2, 0.3))
    pieces = extract_surfaces(volume, [0.0], brick_cells=4).meshes
    seen: dict[int, tuple[bytes, bytes]] = {}
    shared = 0
    for mesh in pieces:
        vertices, gradients = mesh.vertices_world(volume.geometry), mesh.gradients_world(volume.geometry)
        for key, vertex, gradient in zip(mesh.edge_keys.tolist(), vertices, gradients, strict=True):
            shared += key in seen
            assert seen.setdefault(key, (vertex.tobytes(), gradient.tobytes())) == (
                vertex.tobytes(),
                gradient.tobytes(),
            )
    assert shared > 1000


@pytest.mark.parametrize("mirror", [1.0, -1.0])
def test_normals_and_winding_point_towards_falling_values(mirror: float) -> None:
    turn = np.array([[0.8, -0.6, 0.0], [0.6, 0.8, 0.0], [0.0, 0.0, 1.0]]) @ np.diag([1.0, mirror, 1.0])
    x, y, z = index_grid((17, 17, 17))
    field = 6.3 - np.sqrt((x - 8) ** 2 + (y - 8) ** 2 + (z - 8) ** 2)
    mesh = extract_mesh(Volume(field, spacing=(1.0, 2.0, 0.5), direction=turn), 0.0, brick_cells=5)
    assert_watertight(mesh)
    assert enclosed_volume(mesh) > 0
    facing = np.einsum("ij,ij->i", mesh.normals[mesh.triangles[:, 0]], area_vectors(mesh))
    assert (facing > 0).all()


def test_the_gradient_of_a_ramp_is_exact_at_a_spacing_of_1_to_10() -> None:
    spacing, world_gradient = (0.1, 1.0, 0.5), np.array([3.0, -2.0, 0.5])
    x, y, z = index_grid((12, 9, 10))
    field = sum(g * s * axis for g, s, axis in zip(world_gradient, spacing, (x, y, z), strict=True))
    mesh = extract_mesh(Volume(np.asarray(field), spacing=spacing), -3.05, brick_cells=4)
    # relative 2**-15 of the largest index gradient, 2.0, over each spacing
    assert (np.abs(mesh.gradients - world_gradient) <= SHARED * 2.0 / np.array(spacing)).all()
    height = mesh.vertices @ world_gradient + 3.05
    assert np.abs(height).max() <= np.abs(world_gradient * spacing).max() * (EPS + ROUNDING)
    normal = -world_gradient / np.linalg.norm(world_gradient)
    # a normal turns by no more than the error of the gradient over its length
    turn = np.linalg.norm(SHARED * 2.0 / np.array(spacing)) / np.linalg.norm(world_gradient)
    assert np.abs(mesh.normals - normal).max() < turn


def test_normals_of_a_sphere_are_radial_at_a_spacing_of_1_to_10() -> None:
    """Central differences err by h²/6 · max |f'''| per axis; |f'''| <= 3/r² for a distance."""
    h, r = np.array([0.1, 1.0, 0.5]), 8.0
    size = (201, 21, 41)
    x, y, z = (s * axis - 10.0 for s, axis in zip(h, index_grid(size), strict=True))
    mesh = extract_mesh(
        Volume(r - np.sqrt(x**2 + y**2 + z**2), spacing=tuple(h.tolist()), origin=(-10.0,) * 3), 0.0
    )
    radial = mesh.vertices / np.linalg.norm(mesh.vertices, axis=1, keepdims=True)
    # + linear interpolation along the edge: h²/8 · max |∇f''|, the same third derivatives
    third = 3.0 / (r - 2 * h.max()) ** 2
    bound = np.linalg.norm(h**2) * third * (1 / 6 + np.sqrt(3) / 8) * np.sqrt(3)
    assert np.abs(np.linalg.norm(mesh.normals - radial, axis=1)).max() < bound
    assert bound < 0.15  # radians: the bound itself says something


def test_a_zero_gradient_takes_the_normal_of_the_triangles() -> None:
    samples = np.zeros((5, 5, 6))
    samples[:, :, 1::2] = 1.0  # alternating planes: central differences vanish along x
    mesh = extract_mesh(Volume(samples), 0.5)
    inner = (mesh.vertices[:, 0] > 1) & (mesh.vertices[:, 0] < 4)
    assert not mesh.gradients[inner].any()
    assert np.allclose(np.abs(mesh.normals[inner]), [1.0, 0.0, 0.0], atol=1e-12)


def test_surfaces_are_open_only_where_they_meet_the_volumes_faces() -> None:
    samples = np.random.default_rng(1).standard_normal((9, 10, 11))
    ends = open_edges(extract_mesh(Volume(samples), 0.0, brick_cells=4))
    last = np.array([10.0, 9.0, 8.0])
    on_one_face = ((ends[:, 0] == ends[:, 1]) & ((ends[:, 0] == 0) | (ends[:, 0] == last))).any(axis=1)
    assert len(ends) > 100
    assert on_one_face.all()


def test_masked_samples_end_the_surface_without_a_wall() -> None:
    x, y, _ = index_grid((12, 12, 12))
    ramp = x + 0.25 * y
    ramp[6, 6, 6], ramp[2:4, 3, :] = np.nan, np.inf
    volume = Volume(ramp)
    plain, masked = extract_mesh(Volume(x + 0.25 * y), 6.1), extract_mesh(volume, 6.1, nan_masked=True)
    kept = {
        tuple(sorted(corners))
        for corners in masked.vertices[masked.triangles].round(4).reshape(-1, 9).tolist()
    }
    every = {
        tuple(sorted(corners)) for corners in plain.vertices[plain.triangles].round(4).reshape(-1, 9).tolist()
    }
    assert kept < every
    cells = np.floor(masked.vertices[masked.triangles].mean(axis=1)).astype(int)
    corners = cells[:, None, :] + (np.arange(8)[:, None] >> np.arange(3) & 1)
    assert np.isfinite(ramp[corners[..., 2], corners[..., 1], corners[..., 0]]).all()
    assert (
        np.abs(masked.gradients - [1.0, 0.25, 0.0]).max() < 1e-6
    )  # one-sided next to the mask: no NaN, no jump


def test_samples_that_are_not_finite_are_refused_with_their_counts() -> None:
    samples = np.zeros((4, 4, 4))
    samples[0, 0, :3], samples[1, 1, 1] = np.nan, np.inf
    with pytest.raises(InputError, match=r"3 NaN and 1 infinite samples.*--nan masked"):
        extract_surfaces(Volume(samples), [0.5])


def test_a_single_slice_is_refused() -> None:
    with pytest.raises(InputError, match="at least 2 samples along each axis"):
        extract_surfaces(Volume(np.zeros((1, 4, 4))), [0.5])


@pytest.mark.parametrize(
    ("isovalues", "message"),
    [
        ([1.0, 1.0], "ascending"),
        ([2.0, 1.0], "isovalue 1.0 at place 1"),
        ([np.nan], "finite"),
        ([[1.0]], "list"),
        (["a"], r"isovalues \['a'\] must be a list of finite numbers"),
        (object(), "list of finite numbers"),
    ],
)
def test_isovalues_out_of_order_are_refused(isovalues: Any, message: str) -> None:
    with pytest.raises(InputError, match=message):
        extract_surfaces(Volume(np.zeros((2, 2, 2))), isovalues)


@pytest.mark.parametrize("brick_cells", [0, 33])
def test_brick_sizes_that_float32_cannot_hold_are_refused(brick_cells: int) -> None:
    with pytest.raises(InputError, match="1 to 32"):
        extract_surfaces(Volume(np.zeros((2, 2, 2))), [0.5], brick_cells=brick_cells)


def test_data_that_overflow_float32_gradients_are_refused() -> None:
    samples = np.zeros((3, 3, 3))
    samples[0, 0, 0], samples[1, 1, 1] = -1e308, 1e308
    with pytest.raises(InputError, match="Rescale"):
        extract_surfaces(Volume(samples), [0.5])


def test_a_brick_without_usable_cells_has_an_empty_surface() -> None:
    samples = np.zeros((3, 3, 3))
    samples[1, 1, 1], samples[0, 0, 0] = np.nan, 1.0
    surfaces = extract_surfaces(Volume(samples), [0.5], nan_masked=True)
    assert (surfaces.meshes, surfaces.statistics.brick_visits) == ((), 1)


def test_integers_beyond_float64_are_refused() -> None:
    samples = np.full((3, 3, 3), 2**60, dtype=np.int64)
    samples[1, 1, 1] += 1  # would round to its neighbours
    with pytest.raises(InputError, match=r"2\^53"):
        extract_surfaces(Volume(samples), [2.0**60 + 256.0])


def test_an_error_of_the_progress_callback_ends_the_extraction() -> None:
    def stop(done: int, total: int) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        extract_surfaces(Volume(closed_noise(0)), [0.0], brick_cells=2, progress=stop)


def test_bricks_that_miss_an_isovalue_are_skipped_and_counted() -> None:
    samples = np.zeros((9, 9, 17))
    samples[4, 4, 12] = 1.0
    surfaces = extract_surfaces(Volume(samples), [-1.0, 0.0, 0.5, 1.0, 2.0], brick_cells=8)
    # 2 bricks: samples x 0..8 all zero, and x 8..16 with the one; at 0.0 all samples count as inside
    assert surfaces.statistics.bricks_total == 2
    assert surfaces.statistics.brick_visits == 2
    assert surfaces.statistics.brick_visits_skipped == 8
    assert surfaces.statistics.triangles == (0, 0, 8, 8, 0)
    assert [mesh.brick for mesh in surfaces.meshes] == [(1, 0, 0), (1, 0, 0)]
    assert len(surfaces.mesh(0).triangles) == 0


def test_meshes_come_ordered_by_level_and_brick_and_progress_is_told() -> None:
    told: list[tuple[int, int]] = []
    surfaces = extract_surfaces(
        Volume(closed_noise(0)),
        [-0.5, 0.5],
        brick_cells=7,
        progress=lambda done, total: told.append((done, total)),
    )
    order = [(mesh.isovalue, mesh.brick[::-1]) for mesh in surfaces.meshes]
    assert order == sorted(order)
    assert told == [(i + 1, len(told)) for i in range(8)]


def test_a_level_that_does_not_exist_is_refused() -> None:
    with pytest.raises(InputError, match="level 1"):
        extract_surfaces(Volume(closed_noise(0, size=2)), [0.0]).mesh(1)


def test_a_memory_mapped_volume_gives_the_same_surfaces(tmp_path: Path) -> None:
    samples = closed_noise(4).astype(">f4")
    np.save(tmp_path / "samples.npy", samples)
    mapped = Volume(np.load(tmp_path / "samples.npy", mmap_mode="r"))
    assert np.array_equal(extract_mesh(mapped, 0.0).vertices, extract_mesh(Volume(samples), 0.0).vertices)


@pytest.mark.volumes
@pytest.mark.parametrize("level", [1.0, 40.0, 128.0])
def test_a_simulation_in_8_bits_has_open_edges_only_on_the_volumes_faces(
    real_volumes: Path, level: float
) -> None:
    samples = np.fromfile(real_volumes / "nucleon.raw", dtype=np.uint8).reshape(41, 41, 41)
    assert np.count_nonzero(samples == level) > 10
    ends = open_edges(extract_mesh(Volume(samples), level, brick_cells=16))
    on_one_face = ((ends[:, 0] == ends[:, 1]) & ((ends[:, 0] == 0) | (ends[:, 0] == 40))).any(axis=1)
    assert on_one_face.all()
    assert_watertight(extract_mesh(Volume(np.pad(samples, 1)), level, brick_cells=16))

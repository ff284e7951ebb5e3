"""Refined meshes: no cracks, the same topology, the same for any bricks, and on the isosurface."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hypothesis_numpy
from mesh_checks import (
    area_vectors,
    assert_same_mesh,
    assert_watertight,
    closed_noise,
    enclosed_volume,
    euler_characteristic,
    extract_mesh,
    index_grid,
    noise_with_holes,
    open_edges,
)

from isosample.errors import CapacityError, InputError
from isosample.surfaces import refine as refine_module
from isosample.surfaces.cache import extract_with_cache, load_surface_set
from isosample.surfaces.extract import extract_surfaces
from isosample.surfaces.mesh import weld
from isosample.surfaces.positions import POSITION_STEPS
from isosample.surfaces.refine import keys_between
from isosample.surfaces.settings import ExtractionSettings
from isosample.surfaces.store import chunk_key
from isosample.surfaces.surface_files import surface_key
from isosample.volume.grid import Volume
from isosample.volume.reconstruction import Reconstruction

if TYPE_CHECKING:
    from pathlib import Path

F64 = npt.NDArray[np.float64]
ROUNDING = 0.5 / POSITION_STEPS
TURN = np.array([[0.8, -0.6, 0.0], [0.6, 0.8, 0.0], [0.0, 0.0, -1.0]])  # mirrors
BOTH = (Reconstruction.TRILINEAR, Reconstruction.CUBIC)


def scene(name: str) -> tuple[Volume, float]:
    """A closed surface that is hard on extraction, and its isovalue."""
    x, y, z = index_grid((6, 5, 6))
    scenes: dict[str, tuple[npt.NDArray[np.generic], float]] = {
        "noise": (closed_noise(3, size=7), 0.2),
        "integers": (np.pad(np.random.default_rng(7).integers(0, 8, (6, 7, 6)), 1).astype(np.uint8), 3.0),
        "checkerboard": (np.pad(((x + y + z) % 2).astype(np.uint8), 1), 0.5),
        "plateau": (np.pad(np.full((4, 4, 4), 5, dtype=np.int16), 2), 5.0),
    }
    samples, level = scenes[name]
    return Volume(samples, spacing=(0.3, 0.7, 1.1), origin=(5.0, -3.0, 0.1), direction=TURN), level


@pytest.mark.parametrize("refine", [2, 8])
@pytest.mark.parametrize("reconstruction", list(Reconstruction))
@pytest.mark.parametrize("name", ["noise", "integers", "checkerboard", "plateau"])
def test_refinement_keeps_meshes_closed_and_of_the_same_topology_for_any_bricks(
    name: str, reconstruction: Reconstruction, refine: int
) -> None:
    volume, level = scene(name)
    plain = extract_mesh(volume, level, reconstruction=reconstruction)
    whole = extract_mesh(volume, level, reconstruction=reconstruction, refine=refine)
    assert_watertight(plain)
    assert_watertight(whole)
    assert euler_characteristic(whole) == euler_characteristic(plain)
    assert (np.linalg.norm(area_vectors(whole), axis=1) > 0).all()
    for brick_cells in (2, 5):
        parts = extract_mesh(
            volume, level, reconstruction=reconstruction, refine=refine, brick_cells=brick_cells
        )
        assert_same_mesh(whole, parts)


@settings(max_examples=15)
@given(
    samples=hypothesis_numpy.arrays(np.uint8, (3, 3, 4), elements=st.integers(0, 3)),
    level=st.sampled_from([1.0, 1.5, 2.0]),
    reconstruction=st.sampled_from(BOTH),
)
def test_small_integer_volumes_stay_watertight(
    samples: npt.NDArray[np.uint8], level: float, reconstruction: Reconstruction
) -> None:
    samples[1, 1, 1] = 3
    volume = Volume(np.pad(samples, 1))
    parts = extract_mesh(volume, level, brick_cells=2, refine=4, reconstruction=reconstruction)
    assert_watertight(parts)
    assert_same_mesh(parts, extract_mesh(volume, level, refine=4, reconstruction=reconstruction))


@pytest.mark.parametrize("reconstruction", BOTH)
def test_the_border_of_a_mesh_stays_on_the_volumes_faces(reconstruction: Reconstruction) -> None:
    volume = Volume(np.random.default_rng(1).standard_normal((7, 8, 9)))
    mesh = extract_mesh(volume, 0.0, brick_cells=3, refine=4, reconstruction=reconstruction)
    ends, last = open_edges(mesh), np.array([8.0, 7.0, 6.0])
    on_one_face = ((ends[:, 0] == ends[:, 1]) & ((ends[:, 0] == 0) | (ends[:, 0] == last))).any(axis=1)
    plain = open_edges(extract_mesh(volume, 0.0, reconstruction=reconstruction))
    assert on_one_face.all()
    assert len(ends) > 2 * len(plain) > 200  # the border is refined too
    assert mesh.vertices.min() == 0.0
    assert (mesh.vertices <= last).all()


def trilinear(samples: F64, points: F64) -> F64:
    """Values at index points (N, 3)."""
    from scipy.ndimage import map_coordinates

    values: F64 = map_coordinates(samples, points.T[::-1], order=1)
    return values


def test_new_vertices_lie_on_the_trilinear_isosurface() -> None:
    """A vertex is rounded by at most half a step along each axis; the field there changes by no more."""
    samples = closed_noise(5, size=10)
    (mesh,) = extract_surfaces(Volume(samples), [0.2], brick_cells=32, refine=4).meshes
    new = mesh.positions[mesh.edge_keys < 0].astype(np.float64)
    assert len(new) > 10_000
    steepest = sum(np.abs(np.diff(samples[1:-1, 1:-1, 1:-1], axis=axis)).max() for axis in range(3))
    beside = ((new < 1) | (new > 10)).any(axis=1)  # next to the wall of −9 the field is steeper
    heights = np.abs(trilinear(samples, new) - 0.2)
    assert heights[~beside].max() <= 1.01 * ROUNDING * steepest


def test_gradients_of_new_vertices_are_interpolated_differences() -> None:
    x, y, z = index_grid((9, 8, 7))
    field = x * y - 0.5 * y * z + 0.25 * x * z + z  # central differences are exact inside, and trilinear
    (mesh,) = extract_surfaces(Volume(field), [12.3], refine=4).meshes
    new = mesh.edge_keys < 0
    px, py, pz = mesh.positions[new].astype(np.float64).T
    exact = np.stack([py + 0.25 * pz, px - 0.5 * pz, -0.5 * py + 0.25 * px + 1.0], axis=1)
    assert np.count_nonzero(new) > 100
    # rounded to a shared exponent: by 2**-15 of the largest component
    assert np.abs(mesh.gradients[new] - exact).max() <= (2.0**-15 + 2.0**-23) * np.abs(exact).max()


def ball(n: int, radius: float) -> Volume:
    """R² − |x|², which the cubic spline reproduces: its isosurface 0 is the sphere, exactly."""
    x, y, z = (axis - 0.5 * (n - 1) for axis in index_grid((n, n, n)))
    return Volume(radius**2 - x**2 - y**2 - z**2, origin=(-0.5 * (n - 1),) * 3)


def test_the_distance_from_a_sphere_falls_with_the_square_of_the_pieces() -> None:
    """Chords are h²/(8 r) below the sphere: halved edges are 4 times nearer, until the tolerance ends it."""
    radius = 4.3
    distances = []
    for refine in (1, 2, 4):
        mesh = extract_mesh(ball(11, radius), 0.0, refine=refine, reconstruction=Reconstruction.CUBIC)
        assert_watertight(mesh)
        lengths = np.linalg.norm(mesh.vertices, axis=1)
        assert np.abs(lengths - radius).max() < 2.0**-14 + 3 * ROUNDING  # next to a sample up to 2**-14
        centroids = mesh.vertices[mesh.triangles].mean(axis=1)
        distances.append(np.sqrt(np.mean((radius - np.linalg.norm(centroids, axis=1)) ** 2)))
        facing = np.einsum("ij,ij->i", centroids, area_vectors(mesh))
        assert (facing > 0).all()
        assert enclosed_volume(mesh) < 4 / 3 * np.pi * radius**3
    orders = np.log2(np.divide(distances[:-1], distances[1:]))
    assert (orders > 1.7).all()
    assert (orders < 2.2).all()


@pytest.mark.parametrize("flatness", [1e-3, 4e-3])
def test_no_edge_is_divided_where_the_mesh_is_near_enough(flatness: float) -> None:
    """The largest distance of an edge's middle after 3 rounds is within the tolerance, on a field with one sheet.

    An edge of a sphere that is divided is sqrt(8 * radius * flatness) long or longer; its halves are half as long, so
    that their middles are at least a quarter of the flatness away (a half of that for the slant of the division).
    """
    radius = 6.3
    (mesh,) = extract_surfaces(
        ball(15, radius),
        [0.0],
        refine=8,
        reconstruction=Reconstruction.CUBIC,
        brick_cells=32,
        flatness=flatness,
    ).meshes
    sides = mesh.triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
    middles = mesh.positions.astype(np.float64)[sides].mean(axis=1) - 7.0
    distance = radius - np.linalg.norm(middles, axis=1)
    assert distance.max() < 1.2 * flatness  # the estimate of a distance is of first order
    assert distance.max() > flatness / 8
    plane = Volume(index_grid((5, 6, 7))[0] + 0.3 * index_grid((5, 6, 7))[1])
    flat = [extract_mesh(plane, 2.2, refine=refine).vertices for refine in (1, 8)]
    assert np.array_equal(flat[0], flat[1])


def test_meshes_of_another_flatness_are_kept_apart_in_a_cache(tmp_path: Path) -> None:
    volume, kind = ball(15, 6.3), Reconstruction.CUBIC
    fine = extract_with_cache(
        volume, [0.0], tmp_path, settings=ExtractionSettings(refine=4, reconstruction=kind)
    )
    rough = extract_with_cache(
        volume, [0.0], tmp_path, settings=ExtractionSettings(refine=4, reconstruction=kind, flatness=0.01)
    )
    assert rough.statistics.levels_reused == 0
    assert rough.statistics.triangles < fine.statistics.triangles
    again = load_surface_set(
        tmp_path, [0.0], ExtractionSettings(refine=4, reconstruction=kind, flatness=0.01)
    )
    assert again.settings.flatness == 0.01
    np.testing.assert_array_equal(again.meshes[0].positions, rough.meshes[0].positions)


def test_a_flatness_without_refinement_names_the_same_meshes(tmp_path: Path) -> None:
    plain, flat = ExtractionSettings(), ExtractionSettings(flatness=0.01)
    assert surface_key("a", 0.0, flat) == surface_key("a", 0.0, plain)
    assert chunk_key("a", 0.0, (1.0, 1.0, 1.0), flat) == chunk_key("a", 0.0, (1.0, 1.0, 1.0), plain)
    refined = [replace(chosen, refine=2) for chosen in (plain, flat)]
    assert surface_key("a", 0.0, refined[0]) != surface_key("a", 0.0, refined[1])
    surfaces = extract_surfaces(ball(15, 6.3), [0.0], flatness=0.01)
    extract_with_cache(ball(15, 6.3), [0.0], tmp_path, extracted=surfaces)
    again = extract_with_cache(ball(15, 6.3), [0.0], tmp_path, settings=ExtractionSettings(flatness=0.004))
    assert again.statistics.levels_reused == 1


@pytest.mark.parametrize("flatness", [0.0, 1e-6, 0.6, float("nan")])
def test_an_impossible_flatness_is_refused(flatness: float) -> None:
    with pytest.raises(InputError, match=r"flatness .* must be from 1e-05 to 0.5 voxel"):
        extract_surfaces(ball(15, 6.3), [0.0], refine=2, flatness=flatness)


def smoothed_noise() -> Volume:
    """Noise whose features are a few samples wide, closed."""
    from scipy.ndimage import gaussian_filter

    samples = gaussian_filter(np.random.default_rng(3).standard_normal((16, 16, 16)), 1.5)
    return Volume(np.pad(samples / samples.std(), 1, constant_values=-3.0))


def test_refined_triangles_face_falling_values() -> None:
    """Judged by the trilinear gradient at the centroids; a few slivers turn over where the surface bends most."""
    from isosample.surfaces.field_kernels import trilinear_value_gradient

    volume = smoothed_noise()
    shares = []
    for refine in (1, 2, 4):
        (mesh,) = extract_surfaces(volume, [0.1], refine=refine, brick_cells=32).meshes
        corners = mesh.positions.astype(np.float64)[mesh.triangles]
        centroids = corners.mean(axis=1)
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        padded = np.pad(np.asarray(volume.array, dtype=np.float64), 1)
        cells = np.floor(centroids)
        gradients = [
            trilinear_value_gradient(padded, tuple(cell), tuple(place))[1:]
            for cell, place in zip(cells.tolist(), (centroids - cells).tolist(), strict=True)
        ]
        shares.append(np.mean(np.einsum("ij,ij->i", normals, np.array(gradients)) > 0))
    assert shares[0] == 0.0
    assert max(shares) < 2e-3


def test_refinement_brings_the_mesh_nearer_to_the_isosurface() -> None:
    for reconstruction, gain in ((Reconstruction.TRILINEAR, 2.0), (Reconstruction.CUBIC, 1.4)):
        errors = []
        for refine in (1, 2):
            surfaces = extract_surfaces(
                smoothed_noise(), [0.1], refine=refine, residuals=True, reconstruction=reconstruction
            )
            assert surfaces.mesh_errors[0] is not None
            errors.append(surfaces.mesh_errors[0].flat_rms)
        assert errors[0] > gain * errors[1]


def test_masked_samples_end_a_refined_surface_too() -> None:
    field = noise_with_holes(2)
    volume = Volume(field)
    whole = extract_mesh(volume, 0.2, nan_masked=True, refine=4)
    assert len(whole.triangles) > 10_000
    assert np.isfinite(whole.vertices).all()
    assert np.isfinite(whole.gradients).all()
    assert_same_mesh(whole, extract_mesh(volume, 0.2, nan_masked=True, refine=4, brick_cells=3))
    ends = open_edges(whole)
    assert ((ends[:, 0] == ends[:, 1]) & (ends[:, 0] == np.floor(ends[:, 0]))).any(axis=1).all()
    cells = np.floor(whole.vertices[whole.triangles].mean(axis=1)).astype(int)
    corners = cells[:, None, :] + (np.arange(8)[:, None] >> np.arange(3) & 1)
    assert np.isfinite(field[corners[..., 2], corners[..., 1], corners[..., 0]]).all()


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_a_hole_beside_a_plane_does_not_move_vertices_on_it(axis: int) -> None:
    """They follow the samples of the plane alone; only whether an edge is divided asks for the slope across it."""
    field = np.random.default_rng(5).standard_normal((7, 7, 7))
    holed = field.copy()
    np.moveaxis(holed, 2 - axis, 0)[4:] = np.nan
    on_plane = []
    for samples in (field, holed):
        (mesh,) = extract_surfaces(Volume(samples), [0.1], nan_masked=True, refine=2).meshes
        new = mesh.positions[(mesh.edge_keys < 0) & (mesh.positions[:, axis] == 3.0)]
        on_plane.append({tuple(place) for place in new.tolist()})
    assert len(on_plane[1]) > 20
    assert len(on_plane[0] & on_plane[1]) > 0.9 * len(on_plane[1])


def test_a_wrong_side_of_a_plane_would_open_cracks(monkeypatch: pytest.MonkeyPatch) -> None:
    """The tests above see cracks: let one brick place the vertices of its own side of a plane elsewhere."""
    original = refine_module._divide

    def off(*arguments: object) -> object:
        places, divided = original(*arguments)  # type: ignore[arg-type]
        return places + ROUNDING * 2 * (arguments[1].values.shape[0] < 5), divided  # type: ignore[attr-defined]

    monkeypatch.setattr(refine_module, "_divide", off)
    volume = Volume(closed_noise(3, size=5))
    with pytest.raises((AssertionError, CapacityError)):
        assert_watertight(extract_mesh(volume, 0.2, refine=2, brick_cells=4))


def test_names_of_new_vertices_are_negative_different_and_free_of_order() -> None:
    rng = np.random.default_rng(0)
    first, second = rng.integers(0, 10**6, (2, 200_000))
    second += (second == first).astype(np.int64)
    names = keys_between(first, second)
    assert (names < 0).all()
    assert np.array_equal(names, keys_between(second, first))
    pairs = np.unique(np.sort(np.stack([first, second], axis=1), axis=1), axis=0)
    assert len(np.unique(keys_between(*pairs.T))) == len(pairs)
    again = keys_between(names[:-1], names[1:])
    assert len(np.unique(again)) == len(again)


def test_vertices_of_one_name_at_two_places_are_found() -> None:
    surfaces = extract_surfaces(Volume(closed_noise(1, size=5)), [0.0], refine=2)
    (mesh,) = surfaces.meshes
    new = np.flatnonzero(mesh.edge_keys < 0)
    mesh.edge_keys[new[1]] = mesh.edge_keys[new[0]]
    with pytest.raises(CapacityError, match="same name"):
        weld([mesh], surfaces.geometry)


@pytest.mark.parametrize("refine", [0, 3, 16, 2.5, True])
def test_refinements_that_are_no_power_of_two_are_refused(refine: int) -> None:
    with pytest.raises(InputError, match="1, 2, 4 or 8"):
        extract_surfaces(Volume(np.zeros((2, 2, 2))), [0.5], refine=refine)

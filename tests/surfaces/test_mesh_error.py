"""Residuals and distances of meshes: near what dense sampling finds, and of the right order."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt
import pytest
from mesh_checks import closed_noise, index_grid, noise_with_holes

from isosample.surfaces.extract import extract_surfaces
from isosample.surfaces.mesh_error import MeshError, combined
from isosample.volume.analytic import GaussianMixture, sample_field
from isosample.volume.grid import Volume
from isosample.volume.reconstruction import GridSpline, Reconstruction

if TYPE_CHECKING:
    from isosample.surfaces.mesh import BrickMesh

F64 = npt.NDArray[np.float64]


def measured(volume: Volume, isovalue: float, reconstruction: Reconstruction, refine: int = 1) -> BrickMesh:
    (mesh,) = extract_surfaces(
        volume, [isovalue], reconstruction=reconstruction, refine=refine, residuals=True, brick_cells=32
    ).meshes
    return mesh


def barycentric(steps: int) -> F64:
    """(N, 3) float64, evenly spread in a triangle, its sides included."""
    i, j = (grid.ravel() for grid in np.mgrid[0 : steps + 1, 0 : steps + 1])
    keep = i + j <= steps
    return np.stack([i[keep], j[keep], steps - i[keep] - j[keep]], axis=1) / steps


def smooth_volume(n: int = 20) -> Volume:
    field = GaussianMixture(centres=((-0.4, 0, 0), (0.4, 0.1, 0)), widths=(0.4, 0.35), amplitudes=(1.0, 0.8))
    return sample_field(field, (n, n, n), lower=(-1.0,) * 3, upper=(1.0,) * 3)


def dense(mesh: BrickMesh, volume: Volume, reconstruction: Reconstruction) -> tuple[F64, F64]:
    """Flat heights, and heights after the correction as `maths` 8.7 writes it, (T, N) each."""
    shares = barycentric(12)
    corners = mesh.positions.astype(np.float64)[mesh.triangles]
    slopes = mesh.gradients.astype(np.float64)[mesh.triangles]
    points = np.einsum("nk,tkc->tnc", shares, corners)
    gradient = np.einsum("nk,tkc->tnc", shares, slopes)
    offset = np.einsum("nk,tk->tn", shares, np.einsum("tkc,tkc->tk", slopes, corners))
    error = 0.5 * (np.einsum("tnc,tnc->tn", gradient, points) - offset)
    moved = points - error[..., None] * gradient / np.einsum("tnc,tnc->tn", gradient, gradient)[..., None]
    flat, curved = (values_at(place, volume, reconstruction) - mesh.isovalue for place in (points, moved))
    return np.abs(flat), np.abs(curved)


def values_at(points: F64, volume: Volume, reconstruction: Reconstruction) -> F64:
    if reconstruction.smooth:
        spline = GridSpline.build(volume, reconstruction)
        return spline.evaluate(points.reshape(-1, 3))[0].reshape(points.shape[:-1])
    from scipy.ndimage import map_coordinates

    values: F64 = map_coordinates(volume.array, points.reshape(-1, 3).T[::-1], order=1)
    return values.reshape(points.shape[:-1])


@pytest.mark.parametrize("refine", [1, 2])
@pytest.mark.parametrize("reconstruction", [Reconstruction.TRILINEAR, Reconstruction.CUBIC])
def test_residuals_are_near_those_of_dense_sampling(reconstruction: Reconstruction, refine: int) -> None:
    """91 points per triangle against 7 of Radon's: of a quadratic these see more than 3/4 of the largest height."""
    volume = smooth_volume()
    mesh = measured(volume, 0.5, reconstruction, refine)
    for column, heights in enumerate(dense(mesh, volume, reconstruction)):
        largest = np.zeros(len(mesh.positions))
        np.maximum.at(largest, mesh.triangles, heights.max(axis=1)[:, None])
        ratio = mesh.residuals[:, column] / largest
        assert ratio.max() <= 1.1  # a height between the 91 points
        assert np.median(ratio) > 0.75
        if column == 0:
            assert ratio.min() > 0.6


def test_distances_are_near_those_of_dense_sampling() -> None:
    volume = smooth_volume()
    mesh = measured(volume, 0.5, Reconstruction.CUBIC)
    spline = GridSpline.build(volume, Reconstruction.CUBIC)
    corners = mesh.positions.astype(np.float64)[mesh.triangles]
    area = 0.5 * np.linalg.norm(
        np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1
    )
    points = np.einsum("nk,tkc->tnc", barycentric(24), corners)
    values, gradients = spline.evaluate(points.reshape(-1, 3))
    distance = (np.abs(values - 0.5) / np.linalg.norm(gradients, axis=1)).reshape(len(corners), -1)
    assert mesh.error is not None
    assert mesh.error.area == pytest.approx(area.sum(), rel=1e-12)
    rms = np.sqrt((area * np.mean(distance**2, axis=1)).sum() / area.sum())
    assert mesh.error.flat_rms == pytest.approx(
        rms, rel=0.1
    )  # the lattice weighs the sides, where heights are less
    assert 0.75 * distance.max() < mesh.error.flat_largest < 1.01 * distance.max()


def test_the_correction_is_exact_to_second_order_on_a_sphere() -> None:
    """Of a quadratic field the estimate f(p) − v is exact; one Newton step leaves d²/(2 r), d the flat distance."""
    radius = 4.3
    x, y, z = (axis - 5.0 for axis in index_grid((11, 11, 11)))
    mesh = measured(Volume(radius**2 - x**2 - y**2 - z**2), 0.0, Reconstruction.CUBIC)
    assert mesh.error is not None
    flat, curved = mesh.error.flat_largest, mesh.error.curved_largest
    assert 0.01 < flat < 3.0 / (8 * radius)  # the longest side is a cell's diagonal
    # and, next to samples, 2**-14 of the vertices' own distance
    assert curved <= 1.2 * flat**2 / (2 * radius) + 2.0**-14


def test_distances_fall_at_order_2_flat_and_at_order_3_or_better_corrected() -> None:
    errors = []
    for n in (17, 33):
        error = measured(smooth_volume(n), 0.5, Reconstruction.CUBIC).error
        assert error is not None
        errors.append([error.flat_rms * 2 / (n - 1), error.curved_rms * 2 / (n - 1)])
    flat, curved = np.log2(np.divide(*np.array(errors)))
    assert 1.8 < flat < 2.2
    assert curved > 3.0


def test_a_mesh_in_bricks_has_the_error_of_the_whole() -> None:
    volume = Volume(closed_noise(3, size=9), spacing=(0.3, 0.7, 1.1))
    for reconstruction in (Reconstruction.TRILINEAR, Reconstruction.CUBIC):
        found = [
            extract_surfaces(
                volume, [0.1, 0.4], brick_cells=cells, reconstruction=reconstruction, residuals=True, refine=2
            )
            for cells in (3, 32)
        ]
        for parts, whole in zip(found[0].mesh_errors, found[1].mesh_errors, strict=True):
            assert parts is not None
            assert whole is not None
            assert parts.flat_largest == whole.flat_largest > 0
            assert parts.curved_largest == whole.curved_largest
            for name in ("area", "flat_rms", "curved_rms"):
                assert getattr(parts, name) == pytest.approx(getattr(whole, name), rel=1e-12)


def test_residuals_belong_to_the_triangles_around_a_vertex() -> None:
    """Half the volume is linear, so that its triangles are exact; the other half is twisted."""
    x, y, z = index_grid((15, 7, 7))
    field = y + 0.2 * z + 0.1 * np.maximum(x - 7, 0.0) * z - 3.3
    mesh = measured(Volume(field), 0.0, Reconstruction.TRILINEAR)
    # rounding of positions to 2**-18 times the slopes, 1 + 0.2; differences at x = 7 see the twisted half
    linear = mesh.positions[:, 0] <= 5
    assert mesh.residuals[linear].max() < 2.0**-17
    assert mesh.residuals[~linear & (mesh.positions[:, 0] > 7.5), 0].max() > 1e-3


def test_without_being_asked_nothing_is_measured() -> None:
    surfaces = extract_surfaces(Volume(closed_noise(1, size=5)), [0.0])
    assert surfaces.mesh_errors == (None,)
    assert surfaces.meshes[0].residuals.shape == (len(surfaces.meshes[0].positions), 2)
    assert not surfaces.meshes[0].residuals.any()


def test_masked_samples_beside_the_surface_leave_residuals_finite() -> None:
    volume = Volume(noise_with_holes(2))
    surfaces = extract_surfaces(volume, [0.2], nan_masked=True, residuals=True)
    assert np.isfinite(surfaces.meshes[0].residuals).all()
    assert surfaces.mesh_errors[0] is not None
    assert 0 < surfaces.mesh_errors[0].curved_rms < surfaces.mesh_errors[0].curved_largest < 1.8


def test_a_corrected_point_stays_in_its_cell_where_the_field_ends() -> None:
    """One cell with nothing around it: moved points beyond its walls are judged on the wall."""
    samples = np.array([[[-0.3, -0.6], [-0.8, 0.3]], [[-0.1, 1.0], [0.7, 0.7]]])
    mesh = measured(Volume(samples), -0.35, Reconstruction.TRILINEAR)
    shares = barycentric(40)
    corners = mesh.positions.astype(np.float64)[mesh.triangles]
    slopes = mesh.gradients.astype(np.float64)[mesh.triangles]
    points, gradient = (np.einsum("nk,tkc->tnc", shares, ends) for ends in (corners, slopes))
    offset = np.einsum("nk,tk->tn", shares, np.einsum("tkc,tkc->tk", slopes, corners))
    scale = 0.5 * (np.einsum("tnc,tnc->tn", gradient, points) - offset)
    moved = points - (scale / np.einsum("tnc,tnc->tn", gradient, gradient))[..., None] * gradient
    outside = (moved < 0).any(axis=-1) | (moved > 1).any(axis=-1)
    heights = np.abs(values_at(moved.clip(0, 1), Volume(samples), Reconstruction.TRILINEAR) + 0.35)
    row = int(heights.max(axis=1).argmax())
    assert outside[row].mean() > 0.5
    assert outside[row, heights[row].argmax()]
    ratio = mesh.residuals[mesh.triangles[row], 1].min() / heights[row].max()
    assert 0.75 < ratio < 1.01  # 7 points against 861


def test_errors_of_pieces_are_weighed_by_their_areas() -> None:
    small = MeshError(area=1.0, flat_rms=3.0, flat_largest=4.0, curved_rms=0.0, curved_largest=0.5)
    large = MeshError(area=8.0, flat_rms=0.0, flat_largest=1.0, curved_rms=3.0, curved_largest=3.5)
    found = combined([small, large])
    assert (found.area, found.flat_rms, found.flat_largest) == (9.0, 1.0, 4.0)
    assert found.curved_rms == pytest.approx(np.sqrt(8.0))
    assert combined([]) == MeshError()

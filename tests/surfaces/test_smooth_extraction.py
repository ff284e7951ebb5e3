"""Isosurfaces of smooth reconstructions: vertices and gradients are the spline's own."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest
from mesh_checks import (
    assert_same_mesh,
    assert_watertight,
    closed_noise,
    euler_characteristic,
    extract_mesh,
    index_grid,
)

from isosample.errors import InputError
from isosample.surfaces.extract import extract_surfaces
from isosample.surfaces.positions import POSITION_STEPS, SMALLEST_FRACTION
from isosample.surfaces.settings import ExtractionSettings
from isosample.volume.analytic import GaussianMixture, sample_field
from isosample.volume.grid import Volume
from isosample.volume.reconstruction import GridSpline, Reconstruction

SMOOTH = [member for member in Reconstruction if member.smooth]
ROUNDING = 0.5 / POSITION_STEPS
SHARED = 2.0**-15  # rounding of a gradient to a shared exponent, of its largest component


@pytest.mark.parametrize("reconstruction", SMOOTH)
def test_vertices_on_grid_edges_are_roots_of_the_spline(reconstruction: Reconstruction) -> None:
    """The field there is off by no more than the rounding of the position times the slope along the edge."""
    volume = Volume(closed_noise(4, size=9))
    spline = GridSpline.build(volume, reconstruction)
    (mesh,) = extract_surfaces(volume, [0.1], reconstruction=reconstruction, brick_cells=32).meshes
    edge = mesh.edge_keys < 3 * volume.array.size
    positions = mesh.positions.astype(np.float64)[edge]
    axis = mesh.edge_keys[edge] % 3
    values, gradients = spline.evaluate(positions)
    fraction = (positions - np.floor(positions))[np.arange(len(axis)), axis]
    free = np.minimum(fraction, 1 - fraction) > SMALLEST_FRACTION
    heights = np.abs(values - 0.1)[free]
    slopes = np.abs(gradients[np.arange(len(axis)), axis])[free]
    bending = 8.0 * np.abs(spline.coefficients).max()  # of the second derivative: 4 · 2 · the coefficients
    assert np.count_nonzero(free) > 100
    assert (heights <= slopes * ROUNDING * 1.01 + bending * ROUNDING**2).all()
    largest = np.abs(gradients).max()
    assert np.abs(mesh.gradients[edge] - gradients).max() <= (SHARED + 2.0**-24) * largest


@pytest.mark.parametrize("refine", [1, 2])
def test_vertices_inside_cells_are_moved_onto_the_isosurface(refine: int) -> None:
    volume = Volume(closed_noise(6, size=14))
    spline = GridSpline.build(volume, Reconstruction.CUBIC)
    (mesh,) = extract_surfaces(
        volume, [0.2], reconstruction=Reconstruction.CUBIC, brick_cells=32, refine=refine
    ).meshes
    inner = mesh.edge_keys >= 3 * volume.array.size
    positions = mesh.positions.astype(np.float64)[inner]
    values, gradients = spline.evaluate(positions)
    assert len(values) > 10
    on_it = np.abs(values - 0.2) <= np.abs(gradients).sum(axis=1) * ROUNDING * 1.1
    fraction = positions % 1
    assert (np.minimum(fraction, 1 - fraction) >= SMALLEST_FRACTION).all()
    assert (
        on_it.mean() > 0.6
    )  # where the spline joins sheets that marching cubes keeps apart there may be none near
    assert np.abs(mesh.gradients[inner] - gradients).max() <= (SHARED + 2.0**-24) * np.abs(gradients).max()


@pytest.mark.parametrize("reconstruction", SMOOTH)
@pytest.mark.parametrize("brick_cells", [3, 8])
def test_smooth_surfaces_are_closed_and_do_not_depend_on_the_bricks(
    reconstruction: Reconstruction, brick_cells: int
) -> None:
    volume = Volume(closed_noise(2, size=12), spacing=(0.3, 0.7, 1.1), origin=(5.0, -3.0, 0.1))
    whole = extract_mesh(volume, 0.1, reconstruction=reconstruction, brick_cells=32)
    assert_watertight(whole)
    parts = extract_mesh(volume, 0.1, reconstruction=reconstruction, brick_cells=brick_cells)
    assert_same_mesh(whole, parts)


def test_a_plateau_at_the_level_has_one_surface_around_it() -> None:
    """The spline through equal samples is equal to them up to rounding only; the samples decide what is inside."""
    samples = np.random.default_rng(2).uniform(-0.6, 0.0, (9, 9, 9))
    samples[2:7, 2:7, 2:7] = 0.7
    off = np.abs(GridSpline.build(Volume(samples), Reconstruction.CUBIC).samples() - samples)
    assert 0.0 < off[3:6, 3:6, 3:6].max() < 1e-14
    mesh = extract_mesh(Volume(samples), 0.7, reconstruction=Reconstruction.CUBIC)
    assert_watertight(mesh)
    assert euler_characteristic(mesh) == 2


def test_the_distance_from_the_true_isosurface_falls_with_the_fourth_power_of_the_spacing() -> None:
    """Vertices of the linear interpolant are of order 2, of the interpolating spline of order 4, gradients 3."""
    field = GaussianMixture(centres=((-0.4, 0, 0), (0.4, 0.1, 0)), widths=(0.4, 0.35), amplitudes=(1.0, 0.8))
    errors: dict[Reconstruction, list[tuple[float, float]]] = {}
    for reconstruction in (Reconstruction.TRILINEAR, Reconstruction.CUBIC):
        for n in (17, 33):
            volume = sample_field(field, (n, n, n), lower=(-1.0,) * 3, upper=(1.0,) * 3)
            mesh = extract_mesh(volume, 0.5, reconstruction=reconstruction)
            gradient = field.gradient(mesh.vertices)
            distance = np.abs(field.value(mesh.vertices) - 0.5) / np.linalg.norm(gradient, axis=1)
            slope = np.linalg.norm(mesh.gradients - gradient, axis=1)
            errors.setdefault(reconstruction, []).append(
                (float(np.sqrt(np.mean(distance**2))), float(np.sqrt(np.mean(slope**2))))
            )
    order = {reconstruction: np.log2(np.divide(*np.array(pair))) for reconstruction, pair in errors.items()}
    assert 1.8 < order[Reconstruction.TRILINEAR][0] < 2.2
    assert 1.8 < order[Reconstruction.TRILINEAR][1] < 2.2
    assert order[Reconstruction.CUBIC][0] > 3.7
    assert order[Reconstruction.CUBIC][1] > 2.8


def test_smoothing_reconstructions_are_surfaced_where_they_are_and_not_at_the_samples() -> None:
    """Of x² the B-spline is x² + 1/3: it takes 2.98² + 1/3 between 2 and 3, the samples between 3 and 4."""
    x, _, _ = index_grid((7, 4, 4))
    (mesh,) = extract_surfaces(Volume(x**2), [2.98**2 + 1 / 3], reconstruction=Reconstruction.BSPLINE).meshes
    assert np.abs(mesh.positions[:, 0] - 2.98).max() <= ROUNDING
    assert np.abs(mesh.gradients - [5.96, 0.0, 0.0]).max() <= SHARED * 5.96 + 1e-5
    assert mesh.edge_keys.size == 16


def test_the_value_range_is_that_of_the_reconstruction() -> None:
    volume = Volume(closed_noise(1, size=5))
    for reconstruction in SMOOTH:
        found = extract_surfaces(volume, [0.0], reconstruction=reconstruction).value_range
        assert found == GridSpline.build(volume, reconstruction).value_range
    assert extract_surfaces(volume, [0.0]).value_range == volume.value_range


@pytest.mark.parametrize("nan_masked", [False, True])
def test_a_smooth_reconstruction_of_nan_is_refused_with_a_way_out(nan_masked: bool) -> None:
    samples = np.zeros((4, 4, 4))
    samples[0, 0, :2] = np.nan
    with pytest.raises(InputError, match=r"2 NaN and 0 infinite.*cubic.*trilinear reconstruction"):
        extract_surfaces(Volume(samples), [0.5], reconstruction=Reconstruction.CUBIC, nan_masked=nan_masked)


def test_a_reconstruction_is_named_by_its_member() -> None:
    with pytest.raises(InputError, match=r"Reconstruction\.CUBIC"):
        extract_surfaces(Volume(np.zeros((2, 2, 2))), [0.5], reconstruction="cubic")  # type: ignore[arg-type]


def test_settings_come_back_from_their_entries() -> None:
    settings = ExtractionSettings(reconstruction=Reconstruction.BC21, refine=4, residuals=True, brick_cells=9)
    assert ExtractionSettings.from_dict(settings.to_dict()) == settings
    assert settings.rounds == 2
    for entries in (
        {},
        {**settings.to_dict(), "reconstruction": "quintic"},
        {**settings.to_dict(), "more": 1},
    ):
        with pytest.raises(InputError, match="extraction settings"):
            ExtractionSettings.from_dict(entries)


def test_plain_extraction_compiles_a_handful_of_kernels_and_only_once() -> None:
    program = (
        "import numpy, isosample.surfaces.extract as e; from isosample.volume.grid import Volume; "
        "e.extract_surfaces(Volume(numpy.eye(8).reshape(4, 4, 4)), [0.5]); "
        "import isosample.surfaces.march_kernels as k; from numba.core.registry import CPUDispatcher; "
        "kernels = [f.stats for f in vars(k).values() if isinstance(f, CPUDispatcher)]; "
        "print(sum(len(s.cache_hits) for s in kernels), sum(len(s.cache_misses) for s in kernels))"
    )
    run = [sys.executable, "-c", program]
    subprocess.run(run, check=True)
    found = subprocess.run(run, capture_output=True, text=True, check=True)
    hits, misses = found.stdout.split()
    assert misses == "0"
    assert 0 < int(hits) <= 5

"""Smooth reconstructions on the GPU: values on the faces, curved crossings, pictures against their reference."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from isosample.integral.segment_rule import SegmentRule
from isosample.rendering.abuffer import ABuffer
from isosample.rendering.camera import Camera, Projection
from isosample.rendering.pipeline import Renderer
from isosample.rendering.reference_image import render_reference
from isosample.rendering.scene import Scene
from isosample.rendering.settings import RenderSettings
from isosample.surfaces.extract import extract_surfaces
from isosample.transfer.control_points import ControlPoint, Isosurface
from isosample.transfer.isovalues import plan_isovalues
from isosample.transfer.transfer_function import TransferFunction
from isosample.volume.analytic import nucleon_like, sample_field
from isosample.volume.grid import Volume
from isosample.volume.reconstruction import GridSpline, Reconstruction

if TYPE_CHECKING:
    import moderngl

    from isosample.transfer.isovalue_plan import IsovaluePlan

SMOOTH = [kind for kind in Reconstruction if kind.smooth]
WHITE = (1.0, 1.0, 1.0)


def plan_of(
    volume: Volume, tf: TransferFunction, reconstruction: Reconstruction, per_slope: int
) -> IsovaluePlan:
    smooth = reconstruction.smooth
    value_range = GridSpline.build(volume, reconstruction).value_range if smooth else volume.value_range
    return plan_isovalues(tf, value_range, per_slope=per_slope)


@pytest.mark.parametrize("reconstruction", SMOOTH)
def test_rays_begin_with_the_value_of_the_smooth_field_on_the_face(
    gl: moderngl.Context, reconstruction: Reconstruction
) -> None:
    """The field does not change along the rays, so that every pixel is that of the face's value."""
    _, y, x = np.mgrid[0:4, 0:7, 0:8].astype(np.float64)
    volume = Volume(0.3 * x * x - 0.2 * x * y + 0.1 * y * y + 2.0)
    spline = GridSpline.build(volume, reconstruction)
    low, high = spline.value_range
    tf = TransferFunction([ControlPoint(low - 1.0, WHITE, 0.0), ControlPoint(high + 1.0, WHITE, 0.6)])
    plan = plan_of(volume, tf, reconstruction, 3)
    surfaces = extract_surfaces(volume, plan.isovalues, reconstruction=reconstruction)
    camera = Camera(
        projection=Projection.ORTHOGRAPHIC, eye=(3.5, 3.0, 9.0), target=(3.5, 3.0, 0.0), height=5.5
    )
    with ABuffer(gl, Scene.build(surfaces, plan)) as abuffer:
        rgba, statistics = abuffer.render(camera, (48, 48), RenderSettings())
    origins, _ = camera.rays(1.0).origins_and_directions(48, 48)
    points = origins.reshape(-1, 3).copy()
    points[:, 2] = 3.0
    value, _ = spline.evaluate(points)
    extinction = 0.6 * (value - low + 1.0) / (high - low + 2.0)
    expected = -np.expm1(-3.0 * extinction)  # a way of 3 through the box
    # 16 products and sums of coefficients of at most 1 (normalised; weights sum to 4/3 or less per axis), the position,
    # and the segment: 60 roundings, times the depth's sensitivity of 1.8 at most.
    error = np.abs(rgba[..., 3].ravel() - expected)
    # Isosurfaces stand edge-on: a pixel may meet one by rounding, and then begins in the neighbouring band.
    assert (error > 60 * 2.0**-24 * 2.0).mean() < 0.01
    assert error.max() < 0.01
    assert statistics.band_violations == 0
    # The bilinear interpolant of the same samples is a different field: it would be seen.
    corners = volume.array[0].astype(np.float64)
    i, j = points[:, 0].astype(int), points[:, 1].astype(int)
    u, v = points[:, 0] - i, points[:, 1] - j
    lower = corners[j, i] * (1 - u) + corners[j, i + 1] * u
    upper = corners[j + 1, i] * (1 - u) + corners[j + 1, i + 1] * u
    assert np.abs(lower * (1 - v) + upper * v - value).max() > 0.01


def distance_errors(gl: moderngl.Context, samples: int, *, curved: bool) -> float:
    """Largest error of the distances to a sphere around the middle, at rays up to half its radius from its centre."""
    axis = np.linspace(-1.0, 1.0, samples)
    z, y, x = np.meshgrid(axis, axis, axis, indexing="ij")
    volume = Volume(
        np.sqrt(x * x + y * y + z * z + 0.3),
        spacing=(axis[1] - axis[0],) * 3,
        origin=(-1.0, -1.0, -1.0),
    )
    radius = 0.7
    tf = TransferFunction([], [Isosurface(float(np.sqrt(radius**2 + 0.3)), WHITE, 0.5)])
    plan = plan_of(volume, tf, Reconstruction.CUBIC, 1)
    surfaces = extract_surfaces(volume, plan.isovalues, reconstruction=Reconstruction.CUBIC)
    camera = Camera.orbit(volume.box, azimuth=20, elevation=35)
    with ABuffer(gl, Scene.build(surfaces, plan)) as abuffer:
        lists = abuffer.fragment_lists(camera, (64, 64), RenderSettings(curved=curved))
    origins, directions = (part.reshape(-1, 3) for part in camera.rays(1.0).origins_and_directions(64, 64))
    o, d = origins[lists.pixels], directions[lists.pixels]
    nearest = -(o * d).sum(axis=1)
    away = np.linalg.norm(o + nearest[:, None] * d, axis=1)
    inner = away < 0.5 * radius
    half = np.sqrt(radius**2 - np.minimum(away, 0.5 * radius) ** 2)
    exact = np.where(lists.rising, nearest + half, nearest - half)  # the field rises outwards
    return float(np.abs(lists.distances - exact)[inner].max())


def test_curved_crossings_lie_on_a_sphere_to_a_higher_order(gl: moderngl.Context) -> None:
    flat = [distance_errors(gl, samples, curved=False) for samples in (11, 21, 41)]
    curved = [distance_errors(gl, samples, curved=True) for samples in (11, 21, 41)]
    # Flat triangles err by the square of their edges over 8 R: order 2. The quadratic correction leaves order 3,
    # and the float32 distances about 1e-6. Factors of 4 and 8 per halving, a quarter less for the largest of many
    # triangles, whose shapes change with the grid.
    assert 3.0 < flat[0] / flat[1] < 5.5
    assert 3.0 < flat[1] / flat[2] < 5.5
    assert curved[0] / curved[1] > 6.0
    assert curved[1] / curved[2] > 6.0
    assert curved[2] < 0.03 * flat[2]


@pytest.mark.parametrize(
    "reconstruction", [Reconstruction.CUBIC, Reconstruction.BSPLINE, Reconstruction.CATMULL_ROM]
)
def test_pictures_of_a_smooth_reconstruction_converge_to_its_own_reference(
    gl: moderngl.Context, reconstruction: Reconstruction
) -> None:
    """Not so `bc21`, whose ripples between the samples a mesh with one vertex per edge of the grid cannot have."""
    volume = sample_field(nucleon_like(), (17, 17, 17), lower=(4.0,) * 3, upper=(36.0,) * 3)
    high = volume.value_range[1]
    blue, gold = (0.1, 0.3, 1.0), (1.0, 0.7, 0.1)
    rows = [(0.1, blue, 0.0), (0.3, blue, 0.1), (0.5, blue, 0.0), (0.95, gold, 0.5)]
    tf = TransferFunction([ControlPoint(high * v, color, tau) for v, color, tau in rows])
    camera = Camera.orbit(volume.box, azimuth=25, elevation=30)
    size = (40, 40)
    truth = render_reference(
        volume, tf, camera=camera, size=size, tolerance=1e-6, reconstruction=reconstruction
    ).rgba
    trilinear = render_reference(volume, tf, camera=camera, size=size, tolerance=1e-6).rgba
    errors = []
    for per_slope, refine in ((3, 1), (12, 4)):
        plan = plan_of(volume, tf, reconstruction, per_slope)
        surfaces = extract_surfaces(volume, plan.isovalues, reconstruction=reconstruction, refine=refine)
        with Renderer(surfaces, plan) as renderer:
            rgba = renderer.render(
                camera=camera, size=size, settings=RenderSettings(segment=SegmentRule.CUBIC)
            ).rgba
        errors.append(float(np.sqrt(np.mean((rgba - truth) ** 2))))
    # Four times the isovalues: order 2 of cubic segments would give 1/16; a third of it is left for silhouettes.
    assert errors[1] < errors[0] / 5.0
    assert errors[1] < 0.1 * float(np.sqrt(np.mean((trilinear - truth) ** 2)))

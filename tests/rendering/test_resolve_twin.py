"""The resolve pass against its float64 twin, pixel by pixel, on the lists that the GPU built."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from isosample.integral.data_centric import BorderPoint, Crossing, integrate_ray
from isosample.integral.segment_rule import SegmentRule
from isosample.rendering.abuffer import ABuffer
from isosample.rendering.camera import Camera, Projection
from isosample.rendering.scene import Scene
from isosample.rendering.settings import ClipPlane, RenderSettings
from isosample.surfaces.extract import extract_surfaces
from isosample.transfer.control_points import ControlPoint, Isosurface
from isosample.transfer.isovalues import plan_isovalues
from isosample.transfer.transfer_function import TransferFunction
from isosample.volume.analytic import nucleon_like, sample_field
from isosample.volume.grid import Volume
from rendering.scenes import F64, box_interval, clip_interval

if TYPE_CHECKING:
    from collections.abc import Callable

    import moderngl

    from isosample.surfaces.extract import SurfaceSet
    from isosample.transfer.isovalue_plan import IsovaluePlan

SIZE = (40, 32)
NORMAL = np.array([0.3, -0.2, 1.0])


def busy_scene() -> tuple[SurfaceSet, IsovaluePlan]:
    """A field whose surfaces run out of the box, with slopes, a plateau, steps and impulses."""
    volume = sample_field(
        nucleon_like(), (17, 19, 21), lower=(6.0, 4.0, 2.0), upper=(30.0, 36.0, 34.0), name="nucleon-like"
    )
    low, high = volume.value_range
    at = [low + (high - low) * part for part in (0.05, 0.2, 0.35, 0.35, 0.5, 0.5, 0.8, 1.0)]
    colors = [(0.1, 0.3, 1.0), (0.2, 0.9, 0.4), (1.0, 1.0, 0.0), (0.5, 0.0, 0.5)] * 2
    extinctions = [0.0, 0.15, 0.0, 0.3, 0.3, 0.02, 0.9, 0.9]
    tf = TransferFunction(
        [ControlPoint(v, c, e) for v, c, e in zip(at, colors, extinctions, strict=True)],
        [Isosurface(at[1], (1.0, 1.0, 1.0), 0.2), Isosurface(at[6], (1.0, 0.0, 0.0), 0.5)],
    )
    plan = plan_isovalues(tf, volume.value_range, per_slope=3)
    return extract_surfaces(volume, plan.isovalues), plan


def rough_scene() -> tuple[SurfaceSet, IsovaluePlan]:
    """Noise with so many levels that the meshes of neighbouring ones cut each other inside the cells."""
    rng = np.random.default_rng(11)
    samples = np.zeros((14, 14, 14))
    samples[1:-1, 1:-1, 1:-1] = rng.random((12, 12, 12))
    volume = Volume(samples)
    tf = TransferFunction(
        [ControlPoint(0.3, (0.1, 0.3, 1.0), 0.0), ControlPoint(0.9, (1.0, 0.6, 0.1), 0.4)],
        [Isosurface(0.5, (0.0, 1.0, 0.0), 0.1)],
    )
    plan = plan_isovalues(tf, volume.value_range, per_slope=12)
    return extract_surfaces(volume, plan.isovalues), plan


def camera_of(surfaces: SurfaceSet, kind: str) -> Camera:
    box = surfaces.geometry.box
    if kind == "inside":
        eye = tuple(box.centre + np.array([1.0, 2.0, -3.0]))
        return Camera(
            projection=Projection.PERSPECTIVE, eye=eye, target=tuple(box.corner), fov_y_degrees=100.0
        )
    return Camera.orbit(box, azimuth=200, elevation=-35, projection=Projection(kind))


def face_value(surfaces: SurfaceSet, point: F64) -> float:
    """Value at a point of the box's surface, bilinear on the nearest face."""
    box = surfaces.geometry.box
    unit = np.clip(np.linalg.inv(box.edges.T) @ (point - box.corner), 0.0, 1.0)
    face = int(np.argmin(np.stack([unit, 1.0 - unit], axis=1).ravel()))
    index = unit * (np.array(surfaces.geometry.size_xyz) - 1)
    u, v = np.delete(index, face // 2)
    return float(surfaces.boundary.value(face // 2, face % 2, u, v))


CASES = [
    (scene, kind, rule)
    for scene in (busy_scene, rough_scene)
    for kind in ("orthographic", "perspective", "inside")
    for rule in SegmentRule
]


@pytest.mark.parametrize(("scene", "kind", "rule"), CASES)
def test_every_pixel_is_the_float64_integral_of_its_list(
    gl: moderngl.Context,
    scene: Callable[[], tuple[SurfaceSet, IsovaluePlan]],
    kind: str,
    rule: SegmentRule,
) -> None:
    surfaces, plan = scene()
    camera = camera_of(surfaces, kind)
    plane = (0.3, -0.2, 1.0, float(2.0 - NORMAL @ surfaces.geometry.box.centre))
    settings = RenderSettings(segment=rule, clip_planes=(ClipPlane(*plane),), min_transmittance=0.0)
    with ABuffer(gl, Scene.build(surfaces, plan)) as abuffer:
        lists = abuffer.fragment_lists(camera, SIZE, settings)
        rgba, statistics = abuffer.render(camera, SIZE, settings)
    origins, directions = (
        a.reshape(-1, 3) for a in camera.rays(SIZE[0] / SIZE[1]).origins_and_directions(*SIZE)
    )
    entry, leave = box_interval(surfaces.geometry.box, origins, directions)
    start, end = clip_interval(
        np.zeros(len(origins)), np.full(len(origins), 1e30), origins, directions, [plane]
    )
    expected = np.zeros((len(origins), 4))
    violations = 0
    for pixel in np.flatnonzero(leave > entry):
        first, last = np.searchsorted(lists.pixels, [pixel, pixel + 1])
        crossings = [
            Crossing(float(lists.distances[i]), int(lists.levels[i]), bool(lists.rising[i]))
            for i in range(first, last)
        ]
        border = [
            BorderPoint(float(t), face_value(surfaces, origins[pixel] + t * directions[pixel]))
            for t in (entry[pixel], leave[pixel])
        ]
        expected[pixel], count = integrate_ray(
            crossings, border[0], border[1], plan, rule, (float(start[pixel]), float(end[pixel]))
        )
        violations += count
    error = np.abs(rgba.reshape(-1, 4) - expected).max(axis=1)
    # At most 30 segments, each with 8 roundings of distances up to `reach` times extinctions up to 0.9 and
    # colours; and the quadrature. Impulses and steps at the cut or at the box may fall on either side by
    # rounding: those pixels are counted, and are fewer than 1 %.
    reach = float(np.linalg.norm(np.asarray(camera.eye) - surfaces.geometry.box.centre)) + 30.0
    tolerance = 4.3e-7 + 30 * 8 * 2.0**-24 * (1.0 + 0.9 * reach)
    assert (error > tolerance).mean() < 0.01, f"{(error > tolerance).sum()} pixels, {error.max()}"
    assert (expected[:, 3] > 0.1).mean() > 0.1
    assert statistics.band_violations == violations == 0
    assert (statistics.reordered_fragments > 0) == (scene is rough_scene)

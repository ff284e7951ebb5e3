"""Blinn–Phong on impulse surfaces: the closed form of a plane and of a sphere, two-sided."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from isosample.integral.lit_segment import crossing_gradient, lit_moments
from isosample.integral.optics import segment_weights
from isosample.integral.segment_rule import SegmentRule
from isosample.integral.shading import blinn_phong
from isosample.rendering.abuffer import ABuffer
from isosample.rendering.camera import Camera
from isosample.rendering.scene import Scene
from isosample.rendering.settings import ClipPlane, Material, RenderSettings
from isosample.surfaces.extract import extract_surfaces
from isosample.transfer.control_points import ControlPoint, Isosurface
from isosample.transfer.isovalues import plan_isovalues
from isosample.transfer.transfer_function import TransferFunction
from isosample.volume.grid import Volume
from rendering.scenes import picture
from rendering.test_closed_forms import sphere_volume

if TYPE_CHECKING:
    import moderngl

MATERIAL = Material(ambient=0.2, diffuse=0.5, specular=0.25, shininess=10.0)
VIEW = np.array([0.0, 0.0, -1.0])
NORMAL_ERROR = 6.8e-5  # shaders/lib/octahedral.glsl: angle of a packed normal [rad]


@pytest.mark.parametrize("falling", [False, True])
def test_a_tilted_plane_has_the_light_of_its_normal_from_both_sides(
    gl: moderngl.Context, *, falling: bool
) -> None:
    z, y, x = np.mgrid[0:6, 0:7, 0:8]
    gradient = np.array([0.3, -0.2, 1.0]) * (-1.0 if falling else 1.0)
    spacing = np.array([1.0, 0.5, 2.0])
    volume = Volume((np.stack([x, y, z], axis=-1) * spacing) @ gradient, spacing=tuple(spacing))
    middle = float(np.mean(volume.value_range))
    tf = TransferFunction([], [Isosurface(middle, (0.8, 0.4, 0.2), 1.0)])
    rgba, _ = picture(gl, volume, tf, Camera.orbit(volume.box, zoom=8), (16, 16), material=MATERIAL)
    cosine = 1.0 / np.linalg.norm([0.3, -0.2, 1.0])
    lit = np.array([0.8, 0.4, 0.2]) * (0.2 + 0.5 * cosine) + 0.25 * cosine**10
    # d cosine / d angle <= 1, times diffuse and 10 x specular; and roundings of gradients and of pow (1e-5).
    assert np.abs(rgba[..., :3] - lit).max() <= NORMAL_ERROR * (0.5 + 2.5) + 1e-5
    assert np.all(rgba[..., 3] == 1.0)


@pytest.mark.parametrize("rule", [SegmentRule.LINEAR, SegmentRule.CUBIC])
def test_the_two_ends_of_a_segment_are_lit_by_their_own_normals(
    gl: moderngl.Context, rule: SegmentRule
) -> None:
    z, _, _ = np.mgrid[0:5, 0:3, 0:3]
    volume = Volume(z.astype(np.float64))
    red, blue = np.array([1.0, 0.2, 0.0]), np.array([0.0, 0.4, 1.0])
    tf = TransferFunction([ControlPoint(0.0, tuple(red), 0.1), ControlPoint(4.0, tuple(blue), 0.5)])
    plan = plan_isovalues(tf, volume.value_range, per_slope=2)
    scene = Scene.build(extract_surfaces(volume, plan.isovalues), plan)
    tilts = {level: np.array([np.sin(angle), 0.0, np.cos(angle)]) for level, angle in enumerate((0.3, 1.1))}
    vertices = scene.vertices.copy()
    for part in scene.levels:
        rows = scene.indices[part.first_index : part.first_index + part.index_count]
        true_slope = float(vertices["gradient"][rows[0], 2])
        vertices["gradient"][rows] = true_slope / tilts[part.level][2] * tilts[part.level]
    camera = Camera.orbit(volume.box, zoom=6)  # looks along -z, so the values fall from 4 to 0
    with ABuffer(gl, replace(scene, vertices=vertices)) as abuffer:
        rgba, _ = abuffer.render(camera, (8, 8), RenderSettings(material=MATERIAL, segment=rule))
    light = np.array([MATERIAL.ambient, MATERIAL.diffuse, MATERIAL.specular, MATERIAL.shininess])
    places = [4.0, *plan.isovalues[::-1], 0.0]
    # A box end has no normal and takes that of the other end of its segment.
    normals = [tilts[1], tilts[1], tilts[0], tilts[0]]
    radiance, transmittance = np.zeros(3), 1.0
    for i in range(3):
        ends = [np.asarray(tf.evaluate(v)[0]) for v in places[i : i + 2]]
        lit = [blinn_phong(c, n, VIEW, light) for c, n in zip(ends, normals[i : i + 2], strict=True)]
        length = places[i] - places[i + 1]
        depths = [float(tf.evaluate(v)[1]) * length for v in places[i : i + 2]]
        weights = segment_weights(*depths)
        if rule is SegmentRule.LINEAR:
            radiance = radiance + transmittance * (weights[0] * lit[0] + weights[1] * lit[1])
        else:  # the value falls by one band; the slope along the ray is 1, so gradients are normals over cosines
            gradients = [crossing_gradient(n, 1.0, VIEW) for n in normals[i : i + 2]]
            seen = lit_moments(
                (depths[1], depths[0]),
                (1.0, 0.0),
                (-1.0, -1.0),
                (0.0, 1.0),
                (gradients[0], gradients[1]),
                VIEW,
                light,
            )
            radiance = radiance + transmittance * (
                ends[1] * (seen[1] - seen[2]) + ends[0] * seen[2] + seen[3]
            )
        transmittance *= 1.0 - weights.sum()
    error = np.abs(rgba[..., :3] - radiance).max()
    # Packed normals, 3 segments with weights to 3.8e-6, and roundings of pow (1e-5). A cubic's slope is a half float,
    # off by 2^-11 of it, which moves a position by 4/27 of that at each end of each segment, and the colour with it.
    half_float = 3 * 2 * 4 / 27 * 2.0**-11 if rule is SegmentRule.CUBIC else 0.0
    assert error <= NORMAL_ERROR * (0.5 + 2.5) + 3 * 3.8e-6 + 1e-5 + half_float
    assert np.abs(lit[0] - lit[1]).max() > 0.01  # swapped ends would be seen


def test_a_cut_through_a_segment_is_lit_without_a_jump(gl: moderngl.Context) -> None:
    volume = sphere_volume(0.0, (1.0, 1.0, 1.0))
    tf = TransferFunction([ControlPoint(2.0, (1.0, 1.0, 1.0), 3.0), ControlPoint(11.0, (1.0, 1.0, 1.0), 3.1)])
    camera = Camera.orbit(volume.box, azimuth=10, elevation=5)
    cut = ClipPlane(-0.3, 0.0, -1.0, 0.4)
    pictures = [
        picture(gl, volume, tf, camera, (64, 64), per_slope=k, material=MATERIAL, clip_planes=(cut,))[0]
        for k in (12, 60)
    ]
    # Where the cut passes an isovalue the light must not jump: between few and many isovalues it differs by what a
    # normal turns over one band (9 / 13 of a unit at 4 units or more from the centre: 0.17 rad) at most.
    y, x = np.mgrid[0:64, 0:64]
    ring = (np.hypot(x - 31.5, y - 31.5) > 16) & (np.hypot(x - 31.5, y - 31.5) < 22)
    difference = np.abs(pictures[0] - pictures[1])[ring, 0]
    assert difference.max() < 0.17 * (0.5 + 2.5)
    assert difference.mean() < 0.02


def test_a_sphere_darkens_towards_its_silhouette_under_any_spacing(gl: moderngl.Context) -> None:
    material = Material(ambient=0.0, diffuse=1.0, specular=0.0, shininess=1.0)
    volume = sphere_volume(0.0, (0.4, 0.4, 2.0))
    tf = TransferFunction([], [Isosurface(8.0, (1.0, 1.0, 1.0), 1.0)])
    camera = Camera.orbit(volume.box, azimuth=40, elevation=25)
    rgba, _ = picture(gl, volume, tf, camera, (64, 64), material=material)
    origins, directions = camera.rays(1.0).origins_and_directions(64, 64)
    along = (origins * directions).sum(axis=-1)
    miss = np.sqrt((origins**2).sum(axis=-1) - along**2)
    cosine = np.sqrt(np.maximum(1.0 - (miss / 8.0) ** 2, 0.0))
    inside = miss < 7.0
    # Central differences err by h² f''' / 6 with f''' <= 2 / r², so 0.021; between the vertices normals
    # differ from the surface's by up to (h / 2r)² / 2 = 0.008 more.
    assert np.abs(rgba[..., 0] - cosine)[inside].max() < 0.021 + 0.008


@pytest.mark.parametrize("top", [10.0, 30.0], ids=["inside the box", "beyond the box"])
def test_light_inside_a_plateau_converges_with_the_isovalues(gl: moderngl.Context, top: float) -> None:
    # The field is the distance r to the centre; extinction t and colour are constant for 2 <= r <= top, the light is
    # the cosine |s| / r at the way s from the point of a ray nearest to the centre, b from it. Thin (t = 1e-4), the
    # ray shows t times the integral of |s| / r up to r = R, its end on the plateau or the box: 2 t (R - b), and half of
    # the way there is in front of it in the mean.
    # Between two crossings the gradient runs linearly. In the segment that holds s = 0, between two crossings of one
    # level e, it is the place over e, so the light is right; that of the two ends would show 2 t (e - b) b / e too
    # much, from 0 to 2 t d with levels d apart: first order. In a segment of length h from one level to the next the
    # places are weighed by 1 / r at either end, so a normal is that of a place up to h d / 4r away: with light that
    # changes by b^2 / r^3, h^2 d b^2 / 6 r^4 in all. h is d r / s, and (2 b d)^(1/2) at most: second order in all.
    extinction, material = 1e-4, Material(ambient=0.0, diffuse=1.0, specular=0.0, shininess=1.0)
    volume = sphere_volume(0.0, (0.25, 0.25, 0.25))
    tf = TransferFunction([ControlPoint(value, (1.0, 1.0, 1.0), extinction) for value in (2.0, top)])
    camera = Camera.orbit(volume.box)  # along z: every ray is 24 long
    origins, _ = camera.rays(1.0).origins_and_directions(48, 48)
    nearest = np.hypot(origins[..., 0], origins[..., 1])
    end = np.minimum(top, np.sqrt(144.0 + nearest**2))
    way = np.sqrt(np.maximum(end**2 - nearest**2, 0.0))  # to the middle, from either end
    shown = 2.0 * (end - nearest) * np.exp(-extinction * way)
    judged = (nearest > 3.0) & (nearest < 9.0)
    errors, widths = [], []
    for per_slope in (1, 3, 7, 15):
        plan = plan_isovalues(tf, volume.value_range, per_slope=per_slope, lit=True)
        with ABuffer(gl, Scene.build(extract_surfaces(volume, plan.isovalues), plan)) as abuffer:
            rgba, _ = abuffer.render(camera, (48, 48), RenderSettings(material=material))
        difference = (rgba[..., 0] / extinction - shown)[judged]
        widths.append(float(np.diff(plan.isovalues).max()))
        errors.append(float(np.sqrt(np.mean(difference**2))))
        assert errors[-1] < widths[-1] / 5.0  # light of the ends alone: about half of d
    order = np.log(errors[-2] / errors[-1]) / np.log(widths[-2] / widths[-1])
    assert order >= 1.3  # 2 in the limit; less while d is not small against b


@pytest.mark.parametrize("rule", SegmentRule)
@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_planes_along_every_axis_have_the_light_of_their_normal(
    gl: moderngl.Context, rule: SegmentRule, axis: int, sign: float
) -> None:
    samples = sign * np.moveaxis(np.arange(8.0)[:, None, None] * np.ones((8, 8, 8)), 0, 2 - axis)
    volume, middle = Volume(samples), 3.5 * sign
    color = np.array([0.8, 0.4, 0.2])
    ends = sorted((0.0, 7.0 * sign))
    tf = TransferFunction(
        [ControlPoint(value, tuple(color), 0.05) for value in ends], [Isosurface(middle, tuple(color), 0.3)]
    )
    camera = Camera.orbit(volume.box, azimuth=40, elevation=25, zoom=12)  # every ray meets the middle plane
    rgba, _ = picture(gl, volume, tf, camera, (8, 8), per_slope=1, material=MATERIAL, segment=rule)
    cosine = abs(camera.rays(1.0).forward[axis])
    lit = color * (0.2 + 0.5 * cosine) + 0.25 * cosine**10
    # The same light along the whole ray, so that the colour is `lit` whatever the opacity; bounds as above, and the
    # weights of 4 segments to 3.8e-6 each.
    error = np.abs(rgba[..., :3] - lit * rgba[..., 3:]).max()
    assert error <= NORMAL_ERROR * (0.5 + 2.5) + 1e-5 + 4 * 3.8e-6
    assert np.all(rgba[..., 3] > 0.3)


def test_a_surface_without_a_gradient_keeps_its_colour(gl: moderngl.Context) -> None:
    volume = Volume(np.arange(5.0)[:, None, None] * np.ones((5, 5, 5)))
    tf = TransferFunction([], [Isosurface(2.5, (0.8, 0.4, 0.2), 1.0)])
    plan = plan_isovalues(tf, volume.value_range)
    scene = Scene.build(extract_surfaces(volume, plan.isovalues), plan)
    vertices = scene.vertices.copy()
    vertices["gradient"] = 0.0
    with ABuffer(gl, replace(scene, vertices=vertices)) as abuffer:
        rgba, _ = abuffer.render(Camera.orbit(volume.box, zoom=8), (8, 8), RenderSettings(material=MATERIAL))
    assert np.array_equal(rgba, np.broadcast_to(np.array([0.8, 0.4, 0.2, 1.0], np.float32), rgba.shape))

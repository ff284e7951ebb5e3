"""Where the samples of a ray lie: even steps, steps that grow with the distance, and shifted ones."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from isosample.integral.sampling import sample_number
from isosample.rendering.camera import Camera, Projection
from isosample.rendering.ray_sampling import first_step
from isosample.rendering.raycast_settings import Sampling
from isosample.rendering.raycaster import raycast
from isosample.rendering.reference_image import render_reference
from isosample.volume.grid import Volume
from rendering.raycast_cases import (
    PEAKS,
    POST,
    PRE,
    ROUNDING,
    SIZE,
    cast,
    inside,
    linear_volume,
    nucleon,
    tents,
)
from rendering.scenes import ramp_tf

if TYPE_CHECKING:
    import moderngl

pytestmark = pytest.mark.gl


@pytest.fixture(scope="module")
def volume() -> Volume:
    return nucleon()


def test_uniform_samples_are_as_many_as_the_way_has_steps(gl: moderngl.Context) -> None:
    volume = linear_volume()
    tf = ramp_tf(0.0, 100.0, (0.001, 0.001))
    own = replace(PRE, step=0.5, skipping=False)
    found = cast(volume, tf, own, camera=Camera.orbit(volume.box)).stats["samples_per_ray"]["max"]
    # 16 world units along z, steps of half the smallest spacing 0.5: 64 steps, whose first and last are cut.
    assert found in (65, 66, 67)


def test_differential_steps_grow_as_the_paper_says(gl: moderngl.Context, volume: Volume) -> None:
    own = replace(PRE, sampling=Sampling.DIFFERENTIAL, skipping=False)
    tf = ramp_tf(-1e3, 1e3, (1e-4, 1e-4))
    camera = inside(volume)
    rays = camera.rays(1.0)
    size = (33, 33)
    found = raycast(volume, tf, camera=camera, size=size, raycast=own).stats["samples_per_ray"]["max"]
    voxel = min(volume.spacing)
    first = first_step(own, volume.geometry, rays, size)
    assert first == pytest.approx(4.0 * np.sqrt(2.0) * 2.0 * np.tan(np.radians(30.0)) / 33.0 * voxel)
    # The longest way is that of a corner pixel at most, of length box.radius * 2; numbers of eq. 18.
    plane = np.tan(np.radians(30.0)) * 32.0 / 33.0
    longest = sample_number(
        first, first * np.tan(np.radians(30.0)) / (1.0 + 2.0 * plane**2) ** 0.5 / 1.6, 40.0
    )
    centre = sample_number(first, first * np.tan(np.radians(30.0)), 20.0)
    assert centre <= found <= longest


def test_parallel_rays_have_even_steps_of_pixels(gl: moderngl.Context, volume: Volume) -> None:
    own = replace(PRE, sampling=Sampling.DIFFERENTIAL, pixel_scale=0.5)
    camera = Camera.orbit(volume.box)
    pixel = camera.height / 32.0 if camera.height else 0.0
    found = first_step(own, volume.geometry, camera.rays(1.0), (32, 32))
    assert found == pytest.approx(0.5 * np.sqrt(2.0) * pixel)


def test_tiny_differential_steps_are_clean(gl: moderngl.Context, volume: Volume) -> None:
    tf, camera = tents(volume, 0.3, 0.6), inside(volume)
    expected = render_reference(volume, tf, camera=camera, size=SIZE).rgba
    errors = []
    for scale in (4.0, 0.5, 1.0 / 64.0):
        own = replace(PRE, sampling=Sampling.DIFFERENTIAL, pixel_scale=scale)
        errors.append(float(np.abs(cast(volume, tf, own, camera=camera).rgba - expected).max()))
    # Far from the eye steps go with the root of s_k: 5.7 times smaller from 1/2 to 1/64, so the errors of a method of
    # order 2 fall 32 times, but for where samples happen to lie.
    assert errors[1] < errors[0]
    assert errors[2] < errors[1] / 8.0


def test_a_seed_shifts_the_samples_of_every_ray_the_same_way_again(
    gl: moderngl.Context, volume: Volume
) -> None:
    tf = tents(volume, 0.3, 0.6)
    plain, first, again, other = (
        cast(volume, tf, replace(POST, step=2.0, jitter=seed)).rgba for seed in (None, 0, 0, 1)
    )
    assert np.array_equal(first, again)
    assert not np.array_equal(first, other)
    assert not np.array_equal(first, plain)


def test_shifted_samples_begin_at_an_eye_inside(gl: moderngl.Context) -> None:
    # The extinction is the same along all of every ray, so that the picture is exact whatever the step and its shift:
    # what is sampled at the eye itself stands for a part of a step.
    samples = np.linspace(0.0, 1.0, 17, dtype=np.float32)[:, None, None] * np.ones((17, 17, 17), np.float32)
    volume, tf = Volume(samples), ramp_tf(0.5, 2.0, (0.1, 0.1))
    camera = Camera(
        projection=Projection.PERSPECTIVE, eye=(8.0, 8.0, 10.0), target=(8.0, 8.0, 16.0), fov_y_degrees=50.0
    )
    expected = render_reference(volume, tf, camera=camera, size=SIZE).rgba
    for method in (POST, PRE, PEAKS):
        for step in (0.125, 1.0, 4.0):
            own = replace(method, step=step, jitter=3)
            for skipping in (True, False):
                found = cast(volume, tf, replace(own, skipping=skipping), camera=camera).rgba
                assert np.abs(found - expected).max() <= ROUNDING

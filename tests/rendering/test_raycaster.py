"""Pictures of the ray caster: exact where the data are linear, whole from inside, cut, lit, masked, by either stage."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from isosample.errors import CapacityError, InputError
from isosample.rendering.camera import Camera, Projection
from isosample.rendering.raycaster import RayCaster, raycast
from isosample.rendering.reference_image import render_reference
from isosample.rendering.settings import ClipPlane, Material, RenderSettings, ResolveStage
from isosample.transfer.transfer_function import TransferFunction
from isosample.volume.grid import Volume
from rendering.raycast_cases import METHODS, PRE, ROUNDING, SIZE, cast, inside, linear_volume, nucleon, tents
from rendering.scenes import ramp_tf

if TYPE_CHECKING:
    import moderngl

pytestmark = pytest.mark.gl


@pytest.fixture(scope="module")
def volume() -> Volume:
    return nucleon()


@pytest.mark.parametrize("method", METHODS)
def test_both_stages_agree(gl: moderngl.Context, volume: Volume, method: str) -> None:
    tf = tents(volume, 0.3, 0.6)
    fragment, compute = (
        cast(volume, tf, METHODS[method], settings=RenderSettings(stage=stage))
        for stage in (ResolveStage.FRAGMENT, ResolveStage.COMPUTE)
    )
    assert np.abs(fragment.rgba - compute.rgba).max() <= ROUNDING
    assert fragment.stats["samples_per_ray"] == compute.stats["samples_per_ray"]


@pytest.mark.parametrize("step", [0.3, 1.0, 7.0])
@pytest.mark.parametrize("projection", Projection)
def test_linear_data_are_exact_whatever_the_step(
    gl: moderngl.Context, projection: Projection, step: float
) -> None:
    volume = linear_volume()
    tf = TransferFunction([*ramp_tf(9.0, 14.0, (0.0, 0.3)).points, *ramp_tf(16.0, 18.0, (0.2, 0.0)).points])
    camera = Camera.orbit(volume.box, azimuth=40.0, elevation=20.0, projection=projection)
    planes = (ClipPlane(0.3, 0.8, -0.2, -0.3 * 100.0 + 0.8 * 14.0 + 0.2 * 14.0),)
    for settings in (RenderSettings(), RenderSettings(clip_planes=planes, background=(0.1, 0.2, 0.3, 1.0))):
        found = cast(volume, tf, replace(PRE, step=step), camera=camera, settings=settings).rgba
        expected = render_reference(volume, tf, camera=camera, size=SIZE, settings=settings).rgba
        # Distances of some 60 voxels err by 2^-24 of that; at the box's edge a ray may miss what another just meets,
        # over the same length. Extinction 0.3.
        assert np.abs(found - expected).max() <= ROUNDING + 0.3 * 4 * 60 * 2.0**-22


def test_an_eye_inside_sees_what_is_in_front_of_it(gl: moderngl.Context, volume: Volume) -> None:
    tf, camera = tents(volume, 0.3, 0.6), inside(volume)
    expected = render_reference(volume, tf, camera=camera, size=SIZE).rgba
    coarse, fine = (
        np.abs(cast(volume, tf, replace(PRE, step=step), camera=camera).rgba - expected).max()
        for step in (0.5, 0.0625)
    )
    assert fine < 0.25 * coarse  # of order 1 at least: 8 times, less what chance makes of it
    assert fine < 0.01


def test_another_transfer_function_needs_no_new_volume(gl: moderngl.Context, volume: Volume) -> None:
    first, second = tents(volume, 0.3), tents(volume, 0.5, 0.8)
    with RayCaster(volume, first) as caster:
        before = caster.render(size=SIZE)
        caster.set_transfer_function(second)
        after = caster.render(size=SIZE)
    assert np.array_equal(before.rgba, cast(volume, first, PRE).rgba)
    assert np.array_equal(after.rgba, cast(volume, second, PRE).rgba)
    assert after.stats["macrocells"]["occupied"] != before.stats["macrocells"]["occupied"]


def test_rays_end_behind_an_opaque_front(gl: moderngl.Context, volume: Volume) -> None:
    low, high = volume.value_range
    tf = ramp_tf(low, high, (20.0, 20.0))
    early = cast(volume, tf, PRE)
    late = cast(volume, tf, PRE, settings=RenderSettings(min_transmittance=0.0))
    assert early.stats["skipped"]["rays_ended_early"] > 0
    assert early.stats["samples_per_ray"]["mean"] < 0.5 * late.stats["samples_per_ray"]["mean"]
    assert np.abs(early.rgba - late.rgba).max() <= 2.0**-20 + ROUNDING


def test_masked_samples_leave_holes(gl: moderngl.Context) -> None:
    samples = np.linspace(0.0, 1.0, 17, dtype=np.float32)[:, None, None] * np.ones((17, 17, 17), np.float32)
    samples[:, :, 8:] = np.nan
    volume = Volume(samples)
    tf = ramp_tf(0.0, 1.0, (0.1, 0.1))
    with pytest.raises(InputError, match=r"NaN|finite"):
        raycast(volume, tf, size=SIZE)
    found = raycast(volume, tf, size=(32, 32), nan_masked=True).rgba
    assert np.isfinite(found).all()
    columns = Camera.orbit(volume.box).rays(1.0).origins_and_directions(32, 32)[0][0, :, 0]
    assert (found[16, columns > 7.0, 3] == 0.0).all()
    shown = (columns > 0.0) & (columns < 7.0)
    assert np.abs(found[16, shown, 3] - (1.0 - np.exp(-0.1 * 16.0))).max() <= ROUNDING


def test_light_on_a_plane_is_that_of_its_normal(gl: moderngl.Context) -> None:
    volume = linear_volume()
    tf = ramp_tf(12.0, 16.0, (0.5, 0.5))
    camera = Camera.orbit(volume.box, azimuth=30.0)
    material = Material(ambient=0.0, diffuse=1.0, specular=0.0)
    plain, lit = (
        cast(volume, tf, PRE, camera=camera, settings=RenderSettings(material=shading)).rgba
        for shading in (None, material)
    )
    slope = volume.geometry.world_gradient_from_index_gradient @ np.array([1.0, 0.5, -0.7])
    cosine = abs(slope @ camera.rays(1.0).forward) / np.linalg.norm(slope)
    assert np.abs(lit[..., :3] - cosine * plain[..., :3]).max() <= 10 * ROUNDING


def test_a_picture_beyond_the_driver_is_refused(gl: moderngl.Context, volume: Volume) -> None:
    with pytest.raises(CapacityError, match="larger than this driver"):
        raycast(volume, tents(volume, 0.3), size=(100_000, 4))

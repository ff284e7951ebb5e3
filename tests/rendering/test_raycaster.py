"""The march of the ray caster: every sample once, wherever a picture is cut, skipped over, put aside or clipped."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from isosample.errors import CapacityError, InputError
from isosample.integral.sampling import sample_number
from isosample.rendering import raycaster
from isosample.rendering.camera import Camera, Projection
from isosample.rendering.ray_sampling import first_step
from isosample.rendering.ray_statistics import RayStatistics
from isosample.rendering.raycast_settings import (
    Classification,
    Crossings,
    Integration,
    PeakMode,
    PeakWeight,
    Quadrature,
    RaycastSettings,
    Sampling,
    TransferLookup,
)
from isosample.rendering.raycaster import RayCaster, raycast
from isosample.rendering.reference_image import render_reference
from isosample.rendering.settings import ClipPlane, Material, RenderSettings, ResolveStage
from isosample.transfer.control_points import ControlPoint
from isosample.transfer.transfer_function import TransferFunction
from isosample.volume.analytic import nucleon_like, sample_field
from isosample.volume.grid import Volume
from isosample.volume.reconstruction import Reconstruction
from rendering.scenes import ramp_tf

if TYPE_CHECKING:
    import moderngl
    import numpy.typing as npt

    from isosample.rendering.image import Image

    F64 = npt.NDArray[np.float64]

pytestmark = pytest.mark.gl

SIZE = (48, 40)
TURNS_OF_LOOP = 8  # of the loops inside a stretch, see shaders/pass/march.glsl
ROUNDING = (
    2e-5  # of a picture whose rays take some 100 stretches: 100 compositions of 3 roundings of 2^-24 each
)
POST = RaycastSettings(classification=Classification.POST_CLASSIFIED)
PRE = RaycastSettings()
PEAKS = RaycastSettings(classification=Classification.PEAK_FINDING, peak_weight=PeakWeight.INTEGRAL)
METHODS = {
    "integrals over the value": replace(PRE, integration=Integration.TABLE_1D),
    "riemann": replace(POST, quadrature=Quadrature.RIEMANN),
    "trapezoid": POST,
    "pre-integrated": PRE,
    "peaks": PEAKS,
    "peaks, exact crossings": replace(PEAKS, crossings=Crossings.EXACT),
    "peaks alone": replace(PEAKS, peak_mode=PeakMode.PEAK_ONLY),
}
LOOKUPS = {  # show something up to a cell of their table beyond what is visible
    "integrals over the value": METHODS["integrals over the value"],
    "2d": replace(PRE, integration=Integration.TABLE_2D, table_size=12),
    "3d": replace(PRE, integration=Integration.TABLE_3D, table_size=12),
    "sampled": replace(POST, transfer_lookup=TransferLookup.TEXTURE),
    "peaks, sampled": replace(PEAKS, peak_weight=PeakWeight.PAPER, transfer_lookup=TransferLookup.TEXTURE),
}


@pytest.fixture(scope="module")
def volume() -> Volume:
    """A smooth field on 33 samples along every axis, of which a tent shows little."""
    return sample_field(
        nucleon_like(), (33,) * 3, lower=(0.0, 0.0, 0.0), upper=(40.0, 40.0, 40.0), name="nucleon"
    )


def tents(volume: Volume, *places: float) -> TransferFunction:
    """Narrow tents at parts of the value range."""
    low, high = volume.value_range
    points = []
    for place, color in zip(places, ((1.0, 0.2, 0.1), (0.1, 0.4, 1.0), (0.2, 1.0, 0.3)), strict=False):
        for part, extinction in ((place - 0.04, 0.0), (place, 0.8), (place + 0.04, 0.0)):
            points.append(ControlPoint(low + part * (high - low), color, extinction))
    return TransferFunction(points)


def inside(volume: Volume) -> Camera:
    """A perspective camera inside the box."""
    eye = tuple(volume.box.centre + np.array([2.0, -3.0, 12.0]))
    return Camera(
        projection=Projection.PERSPECTIVE, eye=eye, target=tuple(volume.box.centre), fov_y_degrees=60.0
    )


def cast(volume: Volume, tf: TransferFunction, own: RaycastSettings, **more: Any) -> Image:
    """A picture of the size of these tests."""
    return raycast(volume, tf, size=SIZE, raycast=own, **more)


@pytest.mark.parametrize("sampling", Sampling)
@pytest.mark.parametrize("adaptive", [False, True])
@pytest.mark.parametrize("method", METHODS | LOOKUPS)
def test_skipping_changes_no_picture(
    gl: moderngl.Context, volume: Volume, method: str, adaptive: bool, sampling: Sampling
) -> None:
    tf = tents(volume, 0.3, 0.6)
    own = replace((METHODS | LOOKUPS)[method], sampling=sampling, adaptive=adaptive, pixel_scale=1.0)
    for camera in (Camera.orbit(volume.box, azimuth=25.0, elevation=15.0), inside(volume)):
        skipped = cast(volume, tf, own, camera=camera)
        whole = cast(volume, tf, replace(own, skipping=False), camera=camera)
        assert np.array_equal(skipped.rgba, whole.rgba)
        assert skipped.stats["samples_per_ray"]["mean"] < whole.stats["samples_per_ray"]["mean"]
        assert whole.stats["skipped"]["leaps_over_empty_macrocells"] == 0


@pytest.mark.parametrize("beside", [0.25, 0.75])
@pytest.mark.parametrize("method", LOOKUPS)
def test_skipping_keeps_what_a_table_shows_beside_what_is_visible(
    gl: moderngl.Context, method: str, beside: float
) -> None:
    # Of the way between two entries of the table one half is visible; much of the volume has a value in the other.
    own = LOOKUPS[method]
    cells = {"2d": 11, "3d": 11, "integrals over the value": 8192}.get(method, 8191)
    number = cells // 3
    samples = np.full((17, 17, 17), (number + beside) / cells, np.float32)
    samples[8:, 8:], samples[-1, -1, -1] = 0.0, 1.0
    volume = Volume(samples)
    seen = (number + 0.5) / cells + np.array([0.0, 3.0 / cells]) * (1.0 if beside < 0.5 else -1.0)
    low, high = sorted(seen.tolist())
    tf = TransferFunction([ControlPoint(value, (1.0, 0.5, 0.2), 5.0) for value in (low, high)])
    skipped = cast(volume, tf, replace(own, macrocells=8))
    whole = cast(volume, tf, replace(own, skipping=False))
    assert whole.rgba[..., 3].max() > 0.1
    assert np.array_equal(skipped.rgba, whole.rgba)


def test_a_table_s_first_entry_leaves_air_below_it_empty(gl: moderngl.Context) -> None:
    samples = np.zeros((33, 33, 33), np.float32)
    samples[12:20, 12:20, 12:20] = 1.0
    for method in LOOKUPS:
        own = replace(LOOKUPS[method], macrocells=16)
        found = cast(Volume(samples), ramp_tf(0.0, 1.0, (0.0, 0.2)), own)
        assert (
            found.stats["macrocells"]["occupied"] == 5**3
        )  # as in test_air_at_the_foot_of_a_ramp_is_leapt_over
        assert np.array_equal(
            found.rgba,
            cast(Volume(samples), ramp_tf(0.0, 1.0, (0.0, 0.2)), replace(own, skipping=False)).rgba,
        )


def leaning(volume: Volume) -> Volume:
    """The same samples on a grid that is turned, mirrored, shifted and of uneven spacing."""
    turn = np.array([[0.6, -0.8, 0.0], [0.8, 0.6, 0.0], [0.0, 0.0, -1.0]])
    return Volume(volume.array, spacing=(1.0, 1.7, 0.6), origin=(300.0, -20.0, 7.0), direction=turn)


VIEWS = {
    "parallel": lambda box: Camera.orbit(box, azimuth=25.0, elevation=15.0),
    "parallel, small on the picture": lambda box: Camera.orbit(box, azimuth=-70.0, elevation=55.0, zoom=0.2),
    "along an axis": lambda box: Camera.orbit(box, azimuth=0.0, elevation=0.0),
    "perspective": lambda box: Camera.orbit(
        box, azimuth=25.0, elevation=15.0, projection=Projection.PERSPECTIVE
    ),
    "far away": lambda box: Camera(
        projection=Projection.PERSPECTIVE,
        eye=tuple((box.centre + box.radius * np.array([300.0, 200.0, 100.0])).tolist()),
        target=tuple(box.centre.tolist()),
        fov_y_degrees=0.3,
    ),
    "inside, wide": lambda box: Camera(
        projection=Projection.PERSPECTIVE,
        eye=tuple((box.centre + box.radius * np.array([0.1, -0.2, 0.05])).tolist()),
        target=tuple(box.centre.tolist()),
        fov_y_degrees=140.0,
    ),
}


@pytest.mark.parametrize("view", VIEWS)
@pytest.mark.parametrize("lean", [False, True])
def test_a_block_of_pixels_leaps_over_nothing_that_one_of_its_rays_sees(
    gl: moderngl.Context, volume: Volume, view: str, lean: bool
) -> None:
    volume = leaning(volume) if lean else volume
    camera = VIEWS[view](volume.box)
    own = replace(PRE, macrocells=33)
    size = (61, 43)  # the last blocks stick out
    broad = tents(volume, 0.3)
    for tf in (broad, tents(volume, 0.85), tents(volume, 0.98)):
        with RayCaster(volume, tf, raycast=own) as caster:
            skipped = caster.render(camera=camera, size=size)
        whole = raycast(volume, tf, camera=camera, size=size, raycast=replace(own, skipping=False))
        assert np.array_equal(skipped.rgba, whole.rgba)
        assert whole.rgba.any() or tf is not broad


def test_blocks_leap_for_their_pixels(gl: moderngl.Context, volume: Volume) -> None:
    # The box covers more than a quarter of the picture, and what is seen a spot in it. Every ray that meets the box
    # would take a leap at least by itself.
    image = raycast(volume, tents(volume, 0.97), size=(128, 128), raycast=PRE)
    assert 0.0 < (image.rgba[..., 3] > 0.0).mean() < 0.02
    assert image.stats["macrocells"]["skipped_per_ray"] < 0.25


def test_what_no_block_sees_has_the_background(gl: moderngl.Context, volume: Volume) -> None:
    low, _ = volume.value_range
    nothing = TransferFunction(
        [ControlPoint(low - 2.0, (1.0, 1.0, 1.0), 1.0), ControlPoint(low - 1.0, (1.0, 1.0, 1.0), 1.0)]
    )
    settings = RenderSettings(background=(0.25, 0.5, 0.75, 0.5))
    with RayCaster(volume, nothing) as caster:
        image = caster.render(size=SIZE, settings=settings)
        again = caster.render(size=SIZE)
    expected = np.array([0.125, 0.25, 0.375, 0.5], dtype=np.float32)
    assert np.array_equal(image.rgba, np.broadcast_to(expected, image.rgba.shape))
    assert not again.rgba.any()


@pytest.mark.parametrize("method", METHODS)
def test_rays_that_take_several_calls_see_the_same(
    gl: moderngl.Context, volume: Volume, method: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    tf, own = tents(volume, 0.3, 0.6), replace(METHODS[method], adaptive=True)
    whole = cast(volume, tf, own)
    monkeypatch.setattr(raycaster, "LOOP_LIMIT", 7)
    parts = cast(volume, tf, own)
    assert parts.stats["calls"] > 3 * whole.stats["calls"]
    assert np.array_equal(parts.rgba, whole.rgba)
    assert parts.stats["skipped"]["rays_ended_early"] == whole.stats["skipped"]["rays_ended_early"]


def test_tiles_leave_no_seam(gl: moderngl.Context, volume: Volume, monkeypatch: pytest.MonkeyPatch) -> None:
    tf = tents(volume, 0.3, 0.6)
    whole = cast(volume, tf, PRE)
    monkeypatch.setattr(raycaster, "TILE_PIXELS", 7 * SIZE[0])
    tiled = cast(volume, tf, PRE)
    assert tiled.stats["tiles"] == 6
    assert np.array_equal(tiled.rgba, whole.rgba)


@pytest.mark.parametrize("method", METHODS)
def test_both_stages_agree(gl: moderngl.Context, volume: Volume, method: str) -> None:
    tf = tents(volume, 0.3, 0.6)
    fragment, compute = (
        cast(volume, tf, METHODS[method], settings=RenderSettings(stage=stage))
        for stage in (ResolveStage.FRAGMENT, ResolveStage.COMPUTE)
    )
    assert np.abs(fragment.rgba - compute.rgba).max() <= ROUNDING
    assert fragment.stats["samples_per_ray"] == compute.stats["samples_per_ray"]


def linear_volume() -> Volume:
    """A field without curvature, on an oblique grid of uneven spacing."""
    z, y, x = np.meshgrid(np.arange(9.0), np.arange(12.0), np.arange(15.0), indexing="ij")
    turned = np.array([[0.8, -0.6, 0.0], [0.6, 0.8, 0.0], [0.0, 0.0, 1.0]])
    samples = (10.0 + x + 0.5 * y - 0.7 * z).astype(np.float32)
    return Volume(samples, spacing=(0.5, 1.0, 2.0), origin=(100.0, -20.0, 7.0), direction=turned)


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


def test_air_at_the_foot_of_a_ramp_is_leapt_over(gl: moderngl.Context) -> None:
    samples = np.zeros((33, 33, 33), np.float32)
    samples[12:20, 12:20, 12:20] = 1.0
    volume = Volume(samples)
    found = cast(volume, ramp_tf(0.0, 1.0, (0.0, 0.2)), replace(PRE, macrocells=16))
    stats = found.stats["macrocells"]
    assert stats["of"] == 16**3
    assert stats["occupied"] == 5**3  # macrocells of 2 cells that touch samples 12 to 19: from 11 to 20
    everything = cast(volume, ramp_tf(0.0, 1.0, (0.1, 0.2)), replace(PRE, macrocells=16))
    assert everything.stats["macrocells"]["occupied"] == 16**3


def noise_and_tents(extinction: float) -> tuple[Volume, TransferFunction, Camera]:
    """A column of noise, in which a step crosses some 20 of 64 tents, seen along its 600 cells."""
    volume = Volume(np.random.default_rng(5).random((600, 3, 3), dtype=np.float32))
    points = [
        ControlPoint(float(place + part), (1.0, 0.5, float(place)), extinction * height)
        for place in (np.arange(64) + 0.5) / 64
        for part, height in ((-0.004, 0.0), (0.0, 1.0), (0.004, 0.0))
    ]
    camera = Camera(
        projection=Projection.ORTHOGRAPHIC, eye=(1.0, 1.0, 700.0), target=(1.0, 1.0, 0.0), height=1.6
    )
    return volume, TransferFunction(points), camera


@pytest.mark.parametrize("weight", PeakWeight)
def test_long_loops_of_root_finding_are_cut_into_calls_too(
    gl: moderngl.Context, weight: PeakWeight, monkeypatch: pytest.MonkeyPatch
) -> None:
    # 600 steps with four roots of 63 evaluations each: above the 65535 turns after which llvmpipe ends all loops.
    volume, tf, camera = noise_and_tents(0.001)
    own = replace(
        PEAKS, crossings=Crossings.SECANT, peak_weight=weight, peaks=4, root_iterations=64, step=1.0
    )
    at_once = raycast(volume, tf, camera=camera, size=(4, 4), raycast=own)
    assert at_once.stats["root_evaluations_per_ray"] > 65535
    monkeypatch.setattr(raycaster, "LOOP_LIMIT", 16)
    in_parts = raycast(volume, tf, camera=camera, size=(4, 4), raycast=own)
    assert np.array_equal(at_once.rgba, in_parts.rgba)
    assert at_once.stats["root_evaluations_per_ray"] == in_parts.stats["root_evaluations_per_ray"]


@pytest.mark.parametrize("method", ["pre-integrated", "secant", "exact", "smooth"])
def test_what_a_call_counts_fits_its_counters(
    gl: moderngl.Context, method: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    # A tile of 2^18 rays, in uint32: below 2^14 per ray and call. A call ends after LOOP_LIMIT = 2^10 turns; of 8 in
    # loops inside a stretch one counts. A turn takes two samples at most (the first anew), an inner one a root.
    volume, tf, camera = noise_and_tents(0.001)
    own = {
        "pre-integrated": PRE,
        "secant": replace(PEAKS, crossings=Crossings.SECANT, peaks=4, root_iterations=64),
        "exact": replace(PEAKS, crossings=Crossings.EXACT),
        "smooth": replace(PEAKS, crossings=Crossings.EXACT, reconstruction=Reconstruction.BSPLINE),
    }[method]
    counted: list[dict[str, int]] = []
    add = RayStatistics.add
    largest = TURNS_OF_LOOP * raycaster.LOOP_LIMIT + (
        one_stretch := 4 * 64
    )  # with which a call may exceed its limit
    assert largest * raycaster.TILE_PIXELS < 2**32

    def noted(self: RayStatistics, counters: np.void) -> None:
        counted.append({name: int(counters[name]) for name in counters.dtype.names or ()})
        add(self, counters)

    monkeypatch.setattr(RayStatistics, "add", noted)
    monkeypatch.setattr(raycaster, "LOOP_LIMIT", limit := 64)
    image = raycast(volume, tf, camera=camera, size=(4, 4), raycast=replace(own, step=0.5))
    rays = 16
    assert len(counted) == image.stats["calls"] > 5
    for call in counted:
        assert call["samples"] <= 2 * limit * rays
        assert call["roots"] <= (TURNS_OF_LOOP * limit + one_stretch) * rays
        assert call["crossings"] <= (TURNS_OF_LOOP * limit + one_stretch) * rays
        assert call["macrocells"] + call["skipped"] <= 2 * limit * rays
    assert image.stats["samples_per_ray"]["mean"] * rays == sum(call["samples"] for call in counted)
    # All rays have the same steps; where a call goes on, which differs, one sample is taken again.
    most = image.stats["samples_per_ray"]["max"]
    assert most - len(counted) <= image.stats["samples_per_ray"]["mean"] <= most


def test_long_rays_through_noise_and_many_tents_are_whole(gl: moderngl.Context) -> None:
    volume, tf, camera = noise_and_tents(0.05)
    exact = replace(PEAKS, crossings=Crossings.EXACT)
    expected = render_reference(volume, tf, camera=camera, size=(12, 12)).rgba
    for step in (1.0, 8.0, 64.0):
        found = raycast(volume, tf, camera=camera, size=(12, 12), raycast=replace(exact, step=step))
        # 600 cells with some 30 bands each: roundings of 2^-24 of the depth, 600 * 64 * 0.05 * 0.004 = 7.7 in all.
        assert np.abs(found.rgba - expected).max() <= 600 * 2.0**-24 * 7.7

"""Empty macrocells are leapt over, by rays and by blocks of them, and no picture changes."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from isosample.rendering.camera import Camera, Projection
from isosample.rendering.raycast_settings import Sampling
from isosample.rendering.raycaster import RayCaster, raycast
from isosample.rendering.settings import RenderSettings
from isosample.transfer.control_points import ControlPoint
from isosample.transfer.transfer_function import TransferFunction
from isosample.volume.grid import Volume
from rendering.raycast_cases import LOOKUPS, METHODS, PRE, SIZE, cast, inside, nucleon, tents
from rendering.scenes import ramp_tf

if TYPE_CHECKING:
    import moderngl

pytestmark = pytest.mark.gl


@pytest.fixture(scope="module")
def volume() -> Volume:
    return nucleon()


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

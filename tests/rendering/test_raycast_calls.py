"""Every sample once, wherever a picture is cut into tiles and a ray into calls, and counters that hold them."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from isosample.rendering import raycaster
from isosample.rendering.camera import Camera, Projection
from isosample.rendering.ray_statistics import RayStatistics
from isosample.rendering.raycast_settings import Crossings, PeakWeight
from isosample.rendering.raycaster import raycast
from isosample.rendering.reference_image import render_reference
from isosample.transfer.control_points import ControlPoint
from isosample.transfer.transfer_function import TransferFunction
from isosample.volume.grid import Volume
from isosample.volume.reconstruction import Reconstruction
from rendering.raycast_cases import METHODS, PEAKS, PRE, SIZE, cast, nucleon, tents

if TYPE_CHECKING:
    import moderngl

pytestmark = pytest.mark.gl

TURNS_OF_LOOP = 8  # of the loops inside a stretch, see shaders/pass/march.glsl


@pytest.fixture(scope="module")
def volume() -> Volume:
    return nucleon()


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

"""Programs for lists that are chains: the same picture, bit for bit, as the program for any list."""

from __future__ import annotations

import re
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from isosample.gl.shader_source import shader_root
from isosample.integral.segment_rule import SegmentRule
from isosample.rendering.abuffer import ABuffer
from isosample.rendering.camera import Camera, Projection
from isosample.rendering.resolve_pass import BALANCED_RUNS, CHAIN_CLASSES, RUN
from isosample.rendering.scene import Scene
from isosample.rendering.settings import ClipPlane, Material, RenderSettings, ResolveStage
from isosample.surfaces.detail_sets import extract_details
from isosample.surfaces.extract import extract_surfaces
from isosample.transfer.control_points import ControlPoint, Isosurface
from isosample.transfer.isovalues import plan_isovalues
from isosample.transfer.transfer_function import TransferFunction
from isosample.volume.analytic import nucleon_like, sample_field
from isosample.volume.grid import Volume
from isosample.volume.reconstruction import Reconstruction

if TYPE_CHECKING:
    import moderngl

ANY_LIST = 1  # sort_capacity: no class of chains is that short
TOLD = (
    "fragments max_depth_complexity band_violations repaired_pixels reordered_fragments unrepaired_pixels "
    "terminated_rays saturated_segments"
)


def smooth_volume() -> Volume:
    return sample_field(nucleon_like(), (25, 25, 25), lower=(4.0,) * 3, upper=(36.0,) * 3)


def rough_volume() -> Volume:
    return Volume(np.random.default_rng(5).random((9, 9, 9)))


def empty_volume() -> Volume:
    """The values of two corners alone are in the transfer function: most lists are empty, in a visible band or not."""
    samples = np.zeros((5, 5, 5))
    samples[0, 0, 0], samples[4, 4, 4] = 1.0, -1.0
    return Volume(samples)


VOLUMES = {"smooth": smooth_volume, "rough": rough_volume, "empty": empty_volume}


def scene_of(volume: Volume, per_slope: int) -> Scene:
    plan = plan_isovalues(tents(volume), volume.value_range, per_slope=per_slope)
    return Scene.build(extract_surfaces(volume, plan.isovalues), plan)


def tents(volume: Volume) -> TransferFunction:
    low, high = volume.value_range
    at = [low + (high - low) * part for part in (0.1, 0.3, 0.5, 0.7, 0.9)]
    colors = [(0.1, 0.3, 1.0), (1.0, 0.7, 0.1), (0.2, 0.9, 0.4), (0.9, 0.1, 0.1), (0.5, 0.5, 0.5)]
    return TransferFunction(
        [ControlPoint(v, c, e) for v, c, e in zip(at, colors, (0.0, 0.2, 0.02, 0.4, 0.0), strict=True)],
        [Isosurface(at[2], (0.0, 1.0, 0.0), 0.3)],
    )


def camera_of(volume: Volume, kind: str) -> Camera:
    centre = np.asarray(volume.box.centre)
    if kind == "inside":
        eye, target = tuple(centre + 1.0), tuple(volume.box.corner)
        return Camera(projection=Projection.PERSPECTIVE, eye=eye, target=target, fov_y_degrees=110.0)
    return Camera.orbit(volume.box, azimuth=35, elevation=25, projection=Projection(kind))


@pytest.mark.parametrize("stage", [ResolveStage.FRAGMENT, ResolveStage.COMPUTE])
@pytest.mark.parametrize("kind", ["orthographic", "perspective", "inside"])
@pytest.mark.parametrize("name", VOLUMES)
def test_chains_give_the_picture_of_the_program_for_any_list(
    gl: moderngl.Context, name: str, kind: str, stage: ResolveStage
) -> None:
    volume = VOLUMES[name]()
    camera, size = camera_of(volume, kind), (53, 38)  # blocks of 4 pixels stand over at two sides
    centre = np.asarray(volume.box.centre)
    looks = (
        RenderSettings(stage=stage),
        RenderSettings(stage=stage, material=Material(), min_transmittance=0.3),
        RenderSettings(stage=stage, clip_planes=(ClipPlane(0.3, -0.2, 1.0, float(-centre.sum())),)),
        RenderSettings(stage=stage, fragment_budget_bytes=1 << 16, background=(0.2, 0.3, 0.4, 0.5)),
        RenderSettings(stage=stage, segment=SegmentRule.CONSTANT_FIRST_ORDER),
        RenderSettings(stage=stage, segment=SegmentRule.LINEAR, material=Material()),
    )
    with ABuffer(gl, scene_of(volume, 9)) as abuffer:
        for look in looks:
            rgba, told = abuffer.render(camera, size, look)
            counters = abuffer._shared.pool.counters()
            expected, expected_told = abuffer.render(camera, size, replace(look, sort_capacity=ANY_LIST))
            assert np.array_equal(rgba.view(np.uint32), expected.view(np.uint32))
            for part in TOLD.split():
                assert getattr(told, part) == getattr(expected_told, part), part
            if name == "rough" and told.tiles == 1 and not look.clip_planes:
                assert (
                    0 < int(counters["balanced_lists"]) < int(counters["broken_chains"])
                )  # both programs ran


@pytest.mark.parametrize("reconstruction", [Reconstruction.TRILINEAR, Reconstruction.CUBIC])
def test_coarser_meshes_that_cut_each_other_give_the_picture_of_the_program_for_any_list(
    gl: moderngl.Context, reconstruction: Reconstruction
) -> None:
    volume = smooth_volume()
    plan = plan_isovalues(tents(volume), volume.value_range, per_slope=20)
    surfaces = extract_details(volume, plan.isovalues, reconstruction=reconstruction)
    camera, size = camera_of(volume, "perspective"), (90, 80)
    look = RenderSettings(screen_error=4.0)
    with ABuffer(gl, Scene.build(surfaces, plan)) as abuffer:
        rgba, told = abuffer.render(camera, size, look)
        assert int(abuffer._shared.pool.counters()["balanced_lists"]) > 50
        expected, expected_told = abuffer.render(camera, size, replace(look, sort_capacity=ANY_LIST))
    assert np.array_equal(rgba.view(np.uint32), expected.view(np.uint32))
    for part in TOLD.split():
        assert getattr(told, part) == getattr(expected_told, part), part


def test_one_long_list_leaves_the_others_to_the_program_for_lists_that_add_up(gl: moderngl.Context) -> None:
    volume = rough_volume()
    with ABuffer(gl, scene_of(volume, 15)) as abuffer:
        _, told = abuffer.render(camera_of(volume, "orthographic"), (64, 64), RenderSettings())
        counters = abuffer._shared.pool.counters()
    assert told.max_depth_complexity > RUN * CHAIN_CLASSES[-1]
    assert int(counters["balanced_lists"]) > 0


def test_almost_all_lists_of_a_smooth_field_are_chains(gl: moderngl.Context) -> None:
    volume = smooth_volume()
    with ABuffer(gl, scene_of(volume, 9)) as abuffer:
        _, told = abuffer.render(camera_of(volume, "orthographic"), (128, 128), RenderSettings())
        assert int(abuffer._shared.pool.counters()["broken_chains"]) < 0.01 * 128**2
    assert told.max_depth_complexity > RUN  # runs were merged


@pytest.mark.parametrize("run", [8, 12, 16])
def test_the_network_sorts_whatever_is_given(run: int) -> None:
    # A network that sorts all sequences of zeros and ones sorts everything (Knuth, 5.3.4, theorem Z).
    text = (shader_root() / "pass" / "network.glsl").read_text(encoding="utf-8")
    parts = dict(
        zip((8, 12, 16), re.split(r"#elif.*|#else", text[text.index("void sort_run") :]), strict=True)
    )
    pairs = [(int(a), int(b)) for a, b in re.findall(r"ORDER\((\d+), (\d+)\)", parts[run])]
    assert len(pairs) == {8: 19, 12: 39, 16: 60}[run]
    rows = (np.arange(1 << run)[:, None] >> np.arange(run)) & 1
    for a, b in pairs:
        rows[:, a], rows[:, b] = np.minimum(rows[:, a], rows[:, b]), np.maximum(rows[:, a], rows[:, b])
    assert np.all(np.diff(rows, axis=1) >= 0)


def test_the_classes_ascend() -> None:
    assert list(CHAIN_CLASSES) == sorted(set(CHAIN_CLASSES))
    assert RUN * max(CHAIN_CLASSES[-1], BALANCED_RUNS) <= RenderSettings().sort_capacity

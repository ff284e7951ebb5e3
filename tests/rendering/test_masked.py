"""Volumes with NaN: the cells that touch one are left out, and nothing else changes."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from isosample.errors import InputError
from isosample.rendering.abuffer import ABuffer
from isosample.rendering.pipeline import render
from isosample.rendering.scene import Scene
from isosample.rendering.settings import RenderSettings
from isosample.surfaces.cache import content_hash, load_cache, write_cache
from isosample.surfaces.extract import extract_surfaces
from isosample.surfaces.mask_faces import MaskFaces, valid_cells
from isosample.transfer.isovalues import plan_isovalues
from isosample.volume.geometry import Box
from isosample.volume.grid import Volume
from rendering.scenes import F64, LARGE, box_interval, linear_slab, ramp_tf
from rendering.test_closed_forms import KINDS, QUADRATURE, SIZE, camera_of, gamma, ramp_volume

if TYPE_CHECKING:
    from pathlib import Path

    import moderngl

    from isosample.rendering.camera import Camera
    from isosample.rendering.frame_statistics import FrameStatistics
    from isosample.transfer.transfer_function import TransferFunction

# Samples that are NaN, [z, y, x], and the box of cells that they mask (first and last sample, x, y, z).
HOLES: dict[str, tuple[Any, tuple[int, int, int], tuple[int, int, int]]] = {
    "one sample inside": ((5, 3, 4), (3, 2, 4), (5, 4, 6)),
    "one at a corner": ((0, 0, 0), (0, 0, 0), (1, 1, 1)),
    "a slab at the border": ((slice(None), slice(None), slice(0, 2)), (0, 0, 0), (2, 6, 10)),
    "a slab in the middle": ((5, slice(None), slice(None)), (0, 0, 4), (8, 6, 6)),
}


def masked_picture(
    ctx: moderngl.Context, volume: Volume, tf: TransferFunction, camera: Camera
) -> tuple[F64, FrameStatistics]:
    plan = plan_isovalues(tf, volume.value_range)
    scene = Scene.build(extract_surfaces(volume, plan.isovalues, nan_masked=True), plan)
    with ABuffer(ctx, scene) as abuffer:
        rgba, statistics = abuffer.render(camera, SIZE, RenderSettings())
    return rgba.astype(np.float64), statistics


def part_box(volume: Volume, low: tuple[int, ...], high: tuple[int, ...]) -> Box:
    """The box between two samples."""
    matrix = volume.world_from_index
    corner = matrix[:3, :3] @ low + matrix[:3, 3]
    return Box(corner=corner, edges=(matrix[:3, :3] * (np.array(high) - low)).T)


@pytest.mark.parametrize("hole", HOLES)
@pytest.mark.parametrize("kind", KINDS)
def test_a_linear_field_with_a_hole_is_the_two_parts_of_its_rays(
    gl: moderngl.Context, kind: str, hole: str
) -> None:
    whole, gradient = ramp_volume((1.0, 1.0, 2.0), 0.0)
    where, low, high = HOLES[hole]
    samples = whole.array.copy()
    samples[where] = np.nan
    volume = Volume(samples, spacing=whole.spacing, origin=whole.origin)
    tf = ramp_tf(*volume.value_range, (0.05, 0.3))
    camera = camera_of(kind, volume)
    origins, directions = camera.rays(SIZE[0] / SIZE[1]).origins_and_directions(*SIZE)
    entry, leave = box_interval(volume.box, origins, directions)
    hole_entry, hole_leave = box_interval(part_box(volume, low, high), origins, directions)
    missed = hole_entry >= hole_leave
    hole_entry, hole_leave = np.where(missed, LARGE, hole_entry), np.where(missed, LARGE, hole_leave)

    def part(start: F64, end: F64) -> F64:
        start = np.maximum(start, 0.0)
        hit = end > start
        ends = []
        for t in (start, end):
            points = origins + np.where(hit, t, 0.0)[..., None] * directions
            value = np.clip(whole.array[0, 0, 0] + (points - whole.origin) @ gradient, *volume.value_range)
            color, extinction = tf.evaluate(value)
            ends.append(np.concatenate([color, extinction[..., None]], axis=-1))
        return linear_slab(ends[0], ends[1], np.where(hit, end - start, 0.0)) * hit[..., None]

    front = part(entry, np.minimum(leave, hole_entry))
    back = part(np.maximum(entry, hole_leave), leave)
    expected = front + (1.0 - front[..., 3:]) * back
    rgba, statistics = masked_picture(gl, volume, tf, camera)
    # As in the closed forms of whole volumes; a ray may be wrong where its pixel centre lies within the
    # rasteriser's 1/256 pixel of an edge of the border, which may then count for the neighbouring pixel.
    reach = float(np.linalg.norm(np.asarray(camera.eye) - volume.box.centre)) + volume.box.radius
    cosine = np.where(np.abs(directions) > 1e-9, np.abs(directions), 1.0).min(axis=-1)
    tolerance = QUADRATURE + gamma(30) + 4 * 0.3 * (gamma(12) * reach / cosine + 2.0**-18 * reach)
    wrong = np.abs(rgba - expected).max(axis=-1) > tolerance
    assert wrong.mean() < 4 * 2 / 256, f"{wrong.sum()} pixels"
    assert expected[..., 3].max() > 0.2
    assert statistics.lost_fragments == 0


def test_without_the_option_nan_is_an_error_that_names_the_counts(gl: moderngl.Context) -> None:
    del gl
    volume = Volume(np.full((4, 4, 4), np.nan))
    samples = np.arange(64, dtype=np.float32).reshape(4, 4, 4)
    samples[1, 1, 1] = np.nan
    volume = Volume(samples)
    with pytest.raises(InputError, match=r"1 .*NaN.*--nan masked"):
        render(volume, ramp_tf(0.0, 63.0, (0.1, 0.2)))


def test_the_border_of_one_valid_cell_is_its_six_faces() -> None:
    samples = np.full((4, 4, 4), np.nan)
    samples[1:3, 1:3, 1:3] = np.arange(8.0).reshape(2, 2, 2)
    assert valid_cells(samples).sum() == 1
    faces = MaskFaces.from_volume(Volume(samples))
    assert faces is not None
    assert sorted(zip(faces.axes.tolist(), faces.outward.tolist(), strict=True)) == [
        (axis, side) for axis in range(3) for side in (-1, 1)
    ]
    assert np.isfinite(faces.values).all()
    top = (faces.axes == 2) & (faces.outward == 1)
    assert faces.starts[top].tolist() == [[1, 1, 2]]
    assert faces.values[top].tolist() == [[4.0, 5.0, 6.0, 7.0]]


def test_a_finite_volume_has_no_mask() -> None:
    assert MaskFaces.from_volume(Volume(np.zeros((3, 3, 3)))) is None


def test_a_cache_keeps_the_mask(tmp_path: Path) -> None:
    samples = np.arange(125, dtype=np.float32).reshape(5, 5, 5)
    samples[2, 2, 2] = np.inf
    volume = Volume(samples)
    tf = ramp_tf(0.0, 124.0, (0.1, 0.2))
    plan = plan_isovalues(tf, volume.value_range)
    surfaces = extract_surfaces(volume, plan.isovalues, nan_masked=True)
    write_cache(
        tmp_path, surfaces, content_hash=content_hash(volume), transfer_function=tf, plan=plan, name="holed"
    )
    found = load_cache(tmp_path).surfaces.boundary.mask_faces
    expected = surfaces.boundary.mask_faces
    assert found is not None
    assert expected is not None
    for name in ("starts", "axes", "outward", "values"):
        assert np.array_equal(getattr(found, name), getattr(expected, name))
        assert getattr(found, name).dtype == getattr(expected, name).dtype

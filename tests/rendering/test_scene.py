"""Scenes: bands share their isovalue, levels stand where the plan says, and impossible magnitudes are refused."""

from __future__ import annotations

import numpy as np
import pytest

from isosample.errors import InputError
from isosample.rendering.scene import Scene, ValueScale
from isosample.rendering.settings import ClipPlane
from isosample.surfaces.extract import extract_surfaces
from isosample.transfer.isovalues import plan_isovalues
from isosample.volume.grid import Volume
from rendering.scenes import ramp_tf


def ramp(spacing: float = 1.0) -> Volume:
    z, _, _ = np.mgrid[0:5, 0:4, 0:3]
    return Volume(z + 1e6, spacing=(spacing, spacing, spacing), origin=(1e3, 0.0, 0.0))


def scene_of(volume: Volume, extinction: float) -> Scene:
    plan = plan_isovalues(ramp_tf(*volume.value_range, (0.0, extinction)), volume.value_range)
    return Scene.build(extract_surfaces(volume, plan.isovalues), plan)


def test_neighbouring_bands_share_the_float32_of_their_isovalue() -> None:
    scene = scene_of(ramp(), 0.1)
    assert np.array_equal(scene.band_values[:-1, 1], scene.band_values[1:, 0])
    assert scene.band_values[0, 0] == 0.0
    assert scene.band_values[-1, 1] == 1.0


def test_an_offset_costs_no_accuracy() -> None:
    values = np.array([1e6, 1e6 + 0.25, 1e6 + 4.0])
    assert ValueScale(1e6, 1e6 + 4.0).normalise(values).tolist() == [0.0, 0.0625, 1.0]


def test_every_level_names_its_own_triangles() -> None:
    scene = scene_of(ramp(), 0.1)
    assert [part.level for part in scene.levels] == list(range(5))
    assert sum(part.index_count for part in scene.levels) == len(scene.indices)
    for part in scene.levels:
        rows = scene.indices[part.first_index : part.first_index + part.index_count]
        height = scene.vertices["position"][rows, 2] + 2.0  # the box's centre is at z = 2
        assert np.allclose(height + 1e6, scene.plan.isovalues[part.level], atol=2.0**-17)


@pytest.mark.parametrize(
    ("spacing", "extinction", "named"),
    [(1e19, 1e-20, "radius of 2"), (1e-20, 1e19, "radius of 2"), (1.0, 1e300, "extinction of 1e\\+300")],
)
def test_magnitudes_that_float32_cannot_hold_are_refused(
    spacing: float, extinction: float, named: str
) -> None:
    with pytest.raises(InputError, match=named):
        scene_of(ramp(spacing), extinction)


@pytest.mark.parametrize("scale", [1e-14, 1e14])
def test_magnitudes_that_float32_can_hold_are_taken(scale: float) -> None:
    assert scene_of(ramp(scale), 0.1 / scale).triangle_count > 0


def test_surfaces_that_lack_an_isovalue_are_refused() -> None:
    volume = ramp()
    plan = plan_isovalues(ramp_tf(*volume.value_range, (0.0, 0.1)), volume.value_range)
    with pytest.raises(InputError, match="lack 5 isovalue"):
        Scene.build(extract_surfaces(volume, [1e6 + 0.5]), plan)


@pytest.mark.parametrize("scale", [1e-200, 1.0, 1e200])
def test_a_clip_plane_does_not_depend_on_the_length_of_its_normal(scale: float) -> None:
    plane = ClipPlane(3.0 * scale, 0.0, 4.0 * scale, 10.0 * scale)
    assert plane.about(np.array([1.0, 2.0, 3.0])) == pytest.approx((0.6, 0.0, 0.8, 5.0))

"""The mesh cache gives back what was written, bit for bit, and needs no volume for it."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import pytest
from cache_scenes import CURVED, SMALL_BRICKS, assert_same_bits, scene_transfer, scene_volume, written_scene

from isosample.errors import CacheError
from isosample.surfaces.cache import extract_with_cache, load_cache, load_surface_set
from isosample.surfaces.extract import extract_surfaces
from isosample.surfaces.settings import ExtractionSettings
from isosample.volume.grid import Volume
from isosample.volume.reconstruction import Reconstruction

if TYPE_CHECKING:
    from pathlib import Path


def test_a_scene_comes_back_bit_for_bit(tmp_path: Path) -> None:
    volume = scene_volume()
    surfaces = written_scene(tmp_path / "deep" / "cache", volume)
    scene = load_cache(tmp_path / "deep" / "cache")
    assert_same_bits(scene.surfaces, surfaces)
    transfer, plan = scene_transfer(volume)
    assert scene.transfer_function.to_dict() == transfer.to_dict()
    assert scene.plan.to_dict() == plan.to_dict()
    assert scene.name == "noise"
    assert scene.surfaces.statistics.levels_reused == len(plan.isovalues)


def test_a_smooth_refined_scene_comes_back_bit_for_bit_with_its_errors(tmp_path: Path) -> None:
    volume = scene_volume()
    surfaces = written_scene(tmp_path, volume, **CURVED)
    settings = replace(SMALL_BRICKS, **CURVED)
    assert surfaces.mesh_errors[0] is not None
    assert_same_bits(load_cache(tmp_path).surfaces, surfaces)
    again = extract_with_cache(volume, surfaces.isovalues, tmp_path, settings=settings)
    assert again.statistics.levels_reused == len(surfaces.isovalues)
    assert_same_bits(again, surfaces)
    assert_same_bits(load_surface_set(tmp_path, surfaces.isovalues, settings), surfaces)


def test_every_setting_names_other_surfaces_in_one_folder(tmp_path: Path) -> None:
    volume = scene_volume()
    variants: list[dict[str, Any]] = [
        {},
        {"refine": 2},
        {"residuals": True},
        {"reconstruction": Reconstruction.CUBIC},
        {"reconstruction": Reconstruction.BSPLINE},
    ]
    for number, settings in enumerate(variants):
        for other in variants[number:]:
            with pytest.raises(CacheError, match="has no"):
                load_surface_set(tmp_path, [0.0], ExtractionSettings(**other))
        found = extract_with_cache(volume, [0.0], tmp_path, settings=ExtractionSettings(**settings))
        assert found.statistics.levels_reused == 0
        assert_same_bits(found, extract_surfaces(volume, [0.0], **settings))
    for settings in variants:
        assert_same_bits(
            load_surface_set(tmp_path, [0.0], ExtractionSettings(**settings)),
            extract_surfaces(volume, [0.0], **settings),
        )
    assert load_surface_set(tmp_path, ()).value_range == volume.value_range


def test_surfaces_of_other_settings_are_not_mixed_up(tmp_path: Path) -> None:
    volume = scene_volume()
    extract_with_cache(volume, [0.0], tmp_path, settings=SMALL_BRICKS)
    other = extract_with_cache(volume, [0.0], tmp_path, settings=ExtractionSettings(brick_cells=5))
    assert other.statistics.levels_reused == 0
    assert_same_bits(load_surface_set(tmp_path, [0.0], ExtractionSettings(brick_cells=5)), other)
    with pytest.raises(CacheError, match=r"no isosurface 0\.0 for these settings.*precompute"):
        load_surface_set(tmp_path, [0.0], ExtractionSettings(brick_cells=6))


def test_a_reconstruction_that_is_not_there_is_named(tmp_path: Path) -> None:
    extract_with_cache(scene_volume(), [0.0], tmp_path)
    with pytest.raises(CacheError, match=r"no surfaces of the bc21 reconstruction.*precompute"):
        load_surface_set(tmp_path, (), ExtractionSettings(reconstruction=Reconstruction.BC21))


def test_loading_needs_no_volume(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    written_scene(tmp_path, scene_volume())

    def refuse(self: Volume) -> None:
        raise AssertionError("a volume was made")

    monkeypatch.setattr(Volume, "__post_init__", refuse)
    assert len(load_cache(tmp_path).surfaces.meshes) > 0

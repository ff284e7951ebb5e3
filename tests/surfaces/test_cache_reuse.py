"""What a cache folder holds is not extracted again, and only what it lacks is."""

from __future__ import annotations

import os
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest
from cache_scenes import SMALL_BRICKS, assert_same_bits, files_of, scene_volume

from isosample.errors import CacheError, InputError
from isosample.surfaces import field
from isosample.surfaces.cache import extract_with_cache, load_surface_set
from isosample.surfaces.extract import SurfaceSet, extract_surfaces
from isosample.transfer.isovalues import plan_isovalues
from isosample.transfer.transfer_function import ControlPoint, TransferFunction
from isosample.volume.reconstruction import GridSpline, Reconstruction

if TYPE_CHECKING:
    from pathlib import Path


def test_only_missing_isovalues_are_extracted(tmp_path: Path) -> None:
    volume = scene_volume()
    first = extract_with_cache(volume, [0.0, 0.5], tmp_path, settings=SMALL_BRICKS)
    assert first.statistics.levels_reused == 0
    files = {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*.*")}
    second = extract_with_cache(volume, [0.0, 0.25, 0.5, 99.0], tmp_path, settings=SMALL_BRICKS)
    assert second.statistics.levels_reused == 3  # nothing has the value 99: there is nothing to extract
    alone = extract_surfaces(volume, [0.25], brick_cells=4).statistics
    assert second.statistics.brick_visits == alone.brick_visits > 0
    assert second.statistics.chunks_reused == len(first.meshes)
    assert_same_bits(second, extract_surfaces(volume, [0.0, 0.25, 0.5, 99.0], brick_cells=4))
    assert {path: path.stat().st_mtime_ns for path in files} == files
    third = extract_with_cache(volume, [0.0, 0.25, 0.5, 99.0], tmp_path, settings=SMALL_BRICKS)
    assert (third.statistics.levels_reused, third.statistics.brick_visits) == (4, 0)
    assert_same_bits(third, second)


def test_negative_zero_names_the_same_surface(tmp_path: Path) -> None:
    volume = scene_volume()
    extract_with_cache(volume, [0.0], tmp_path)
    assert extract_with_cache(volume, [-0.0], tmp_path).statistics.levels_reused == 1


def test_a_budget_keeps_what_the_call_itself_uses(tmp_path: Path) -> None:
    volume = scene_volume()
    extract_with_cache(volume, [0.0], tmp_path, settings=SMALL_BRICKS)
    for path in tmp_path.glob("chunks/*/*.chunk"):
        os.utime(path, (1e9, 1e9))
    now = extract_with_cache(volume, [0.5], tmp_path, settings=SMALL_BRICKS, budget_bytes=1)
    assert_same_bits(load_surface_set(tmp_path, [0.5], SMALL_BRICKS), now)
    with pytest.raises(CacheError, match=r"is missing, and isosurface 0\.0"):
        load_surface_set(tmp_path, [0.0], SMALL_BRICKS)
    assert extract_with_cache(volume, [0.0], tmp_path, settings=SMALL_BRICKS).statistics.levels_reused == 0


def test_an_edit_of_colours_extracts_nothing_and_a_moved_peak_its_own_values(tmp_path: Path) -> None:
    volume = scene_volume()

    def edited(peak: float, colour: tuple[float, float, float], extinction: float) -> SurfaceSet:
        points = [
            ControlPoint(value=value, color=colour, extinction=height)
            for value, height in (
                (-0.8, 0.0),
                (-0.6, 0.5),
                (-0.4, 0.0),
                (0.2, 0.0),
                (peak, extinction),
                (0.7, 0.0),
            )
        ]
        plan = plan_isovalues(TransferFunction(points), volume.value_range, per_slope=1)
        return extract_with_cache(volume, plan.isovalues, tmp_path, settings=SMALL_BRICKS)

    first = edited(0.4, (1.0, 0.5, 0.0), 1.0)
    recoloured = edited(0.4, (0.0, 0.5, 1.0), 0.25)
    assert (recoloured.statistics.brick_visits, recoloured.statistics.levels_reused) == (
        0,
        len(first.isovalues),
    )
    moved = edited(0.5, (1.0, 0.5, 0.0), 1.0)
    new = sorted(set(moved.isovalues.tolist()) - set(first.isovalues.tolist()))
    assert len(new) == 3  # the peak, and one value in each of its slopes
    alone = extract_surfaces(volume, new, brick_cells=4)
    assert moved.statistics.brick_visits == alone.statistics.brick_visits
    assert moved.statistics.levels_reused == len(moved.isovalues) - 3
    assert_same_bits(moved, extract_surfaces(volume, moved.isovalues, brick_cells=4))


def test_isovalues_that_are_not_finite_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="finite"):
        extract_with_cache(scene_volume(), [np.inf], tmp_path)


@pytest.mark.parametrize("reconstruction", Reconstruction)
def test_surfaces_at_hand_are_kept_without_fitting_or_extracting_anything(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, reconstruction: Reconstruction
) -> None:
    volume, levels = scene_volume(), [-0.2, 0.1, 0.5]
    settings = replace(SMALL_BRICKS, reconstruction=reconstruction)
    surfaces = extract_surfaces(volume, levels, **settings.as_keywords())
    expected = extract_with_cache(volume, levels, tmp_path / "expected", settings=settings)

    def refuse(*_: object, **__: object) -> None:
        raise AssertionError("a spline is fitted, or a brick is extracted")

    monkeypatch.setattr(GridSpline, "build", refuse)
    monkeypatch.setattr(field, "extract_brick", refuse)
    found = extract_with_cache(volume, levels, tmp_path / "found", settings=settings, extracted=surfaces)
    assert_same_bits(found, expected)
    assert found.statistics == expected.statistics
    assert files_of(tmp_path / "found") == files_of(tmp_path / "expected")

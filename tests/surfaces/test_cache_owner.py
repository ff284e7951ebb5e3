"""Whose a cache folder is: of one volume and one format version, and refused to all others."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

import numpy as np
import pytest
from cache_scenes import files_of, scene_volume, written_scene

from isosample.errors import CacheError
from isosample.surfaces.cache import content_hash, extract_with_cache, load_cache
from isosample.volume.grid import Volume

if TYPE_CHECKING:
    from pathlib import Path


def test_the_content_hash_sees_samples_geometry_and_dtype_and_not_the_name() -> None:
    samples = np.arange(60, dtype=np.int16).reshape(3, 4, 5)
    changed = samples.copy()
    changed[-1, -1, -1] += 1
    plain = content_hash(Volume(samples))
    assert content_hash(Volume(samples, name="other")) == plain
    assert content_hash(Volume(np.asfortranarray(samples))) == plain
    assert (
        content_hash(Volume(samples, patient_axes=True)) == plain
    )  # as caches had it before there was the word
    others = [
        Volume(changed),
        Volume(samples, spacing=(1.0, 1.0, 1.0000000000000002)),
        Volume(samples, origin=(0.0, 0.0, 1e-300)),
        Volume(samples.astype(np.uint16)),
        Volume(samples.reshape(5, 4, 3)),
    ]
    assert len({plain, *(content_hash(volume) for volume in others)}) == 6


def test_the_folder_of_another_volume_is_refused(tmp_path: Path) -> None:
    written_scene(tmp_path, scene_volume(0))
    with pytest.raises(CacheError, match=r"another volume.*Choose another"):
        extract_with_cache(scene_volume(1), [0.0], tmp_path)


def test_a_folder_that_is_no_cache_is_refused(tmp_path: Path) -> None:
    with pytest.raises(CacheError, match=r"not a mesh cache.*isosample precompute"):
        load_cache(tmp_path)
    extract_with_cache(scene_volume(), [0.0], tmp_path)
    with pytest.raises(CacheError, match=r"was not finished: it has no scene\.json"):
        load_cache(tmp_path)
    (tmp_path / "volume.json").write_text("[]")
    with pytest.raises(CacheError, match=r"volume\.json is not an isosample cache"):
        load_cache(tmp_path)
    (tmp_path / "file").write_text("")
    with pytest.raises(CacheError, match="cannot be written"):
        extract_with_cache(scene_volume(), [0.0], tmp_path / "file")


@pytest.mark.parametrize("name", ["volume.json", "scene.json"])
def test_another_format_version_is_refused(tmp_path: Path, name: str) -> None:
    written_scene(tmp_path, scene_volume())
    document = json.loads((tmp_path / name).read_text())
    document["version"] = 2  # before chunks
    (tmp_path / name).write_text(json.dumps(document))
    before = files_of(tmp_path)
    if name == "volume.json":
        with pytest.raises(CacheError, match="format version 2"):
            extract_with_cache(scene_volume(), [0.0], tmp_path)
    with pytest.raises(CacheError, match=f"{name} has format version 2; this program reads and writes 3"):
        load_cache(tmp_path)
    assert files_of(tmp_path) == before

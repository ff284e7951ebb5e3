"""Whoever writes a cache folder leaves it whole: on a full disk, one for reading only, and with others at once."""

from __future__ import annotations

import errno
import itertools
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from cache_scenes import SMALL_BRICKS, assert_same_bits, files_of, scene_volume
from mesh_checks import closed_noise

from isosample.errors import CacheError
from isosample.surfaces.cache import extract_with_cache, load_surface_set
from isosample.surfaces.extract import extract_surfaces
from isosample.surfaces.store import MeshStore
from isosample.volume.grid import Volume


def refuse_writing(monkeypatch: pytest.MonkeyPatch, number: int, *, after: int = 0) -> None:
    """Let `after` more files be written, and refuse all others with an error of the system."""
    written = itertools.count()

    def replace_or_fail(source: Path, target: Path) -> None:
        if next(written) >= after:
            raise OSError(number, os.strerror(number))
        source.rename(target)

    monkeypatch.setattr("isosample.files.os.replace", replace_or_fail)


@pytest.mark.parametrize("after", [0, 1, 9, 27])
def test_a_full_disk_keeps_what_is_there_and_the_next_run_goes_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, after: int
) -> None:
    volume = scene_volume()
    extract_with_cache(volume, [0.0], tmp_path, settings=SMALL_BRICKS)
    before = files_of(tmp_path)
    with monkeypatch.context() as patch:
        refuse_writing(patch, errno.ENOSPC, after=after)
        with pytest.raises(CacheError, match=r"cannot be written: No space left on device.*goes on"):
            extract_with_cache(volume, [0.0, 0.5], tmp_path, settings=SMALL_BRICKS)
    there = files_of(tmp_path)
    assert {name: there[name] for name in before} == before
    assert len(there) == len(before) + after  # of 27 bricks; then comes the list of chunks
    resumed = extract_with_cache(volume, [0.0, 0.5], tmp_path, settings=SMALL_BRICKS)
    fresh = extract_surfaces(volume, [0.0, 0.5], brick_cells=4)
    assert_same_bits(resumed, fresh)
    assert resumed.statistics.brick_visits == 27 - after
    assert_same_bits(load_surface_set(tmp_path, [0.0, 0.5], SMALL_BRICKS), fresh)


def test_a_read_only_cache_is_read_and_what_it_lacks_is_extracted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    volume = scene_volume()
    extract_with_cache(volume, [0.0], tmp_path, settings=SMALL_BRICKS)
    before = files_of(tmp_path)
    refuse_writing(monkeypatch, errno.EROFS)
    assert extract_with_cache(volume, [0.0], tmp_path, settings=SMALL_BRICKS).statistics.brick_visits == 0
    with pytest.warns(UserWarning, match="cannot be written: what it lacks was extracted"):
        found = extract_with_cache(volume, [0.0, 0.5], tmp_path, settings=SMALL_BRICKS)
    assert found.statistics.levels_reused == 1
    assert_same_bits(found, extract_surfaces(volume, [0.0, 0.5], brick_cells=4))
    assert files_of(tmp_path) == before
    with pytest.raises(CacheError, match="cannot be written"):
        extract_with_cache(
            volume, [0.0], tmp_path / "new"
        )  # no cache yet: it was asked for, and cannot be made


FILL = """
import sys
import numpy as np
from isosample.surfaces.cache import extract_with_cache
from isosample.surfaces.settings import ExtractionSettings
from isosample.volume.grid import Volume
volume = Volume(np.load(sys.argv[1]))
sys.stdin.readline()  # both begin at once
found = extract_with_cache(volume, [-0.3, -0.1, 0.1, 0.3], sys.argv[2], settings=ExtractionSettings(brick_cells=4))
print(found.statistics.brick_visits, sum(found.statistics.triangles))
"""


def test_two_processes_fill_one_cache_at_once(tmp_path: Path) -> None:
    volume = Volume(closed_noise(3, size=17))
    np.save(tmp_path / "samples.npy", volume.array)
    folder = tmp_path / "cache"
    command = [sys.executable, "-c", FILL, str(tmp_path / "samples.npy"), str(folder)]
    environment = {**os.environ, "PYTHONPATH": str(Path(__file__).resolve().parents[2])}
    both = [
        subprocess.Popen(
            command,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            env=environment,
            text=True,
        )
        for _ in range(2)
    ]
    for process in both:
        assert process.stdin is not None
        process.stdin.write("go\n")
        process.stdin.flush()
    answers = [process.communicate(timeout=120) for process in both]
    assert [process.returncode for process in both] == [0, 0], answers
    fresh = extract_surfaces(volume, [-0.3, -0.1, 0.1, 0.3], brick_cells=4)
    assert [int(out.split()[1]) for out, _ in answers] == [sum(fresh.statistics.triangles)] * 2
    assert_same_bits(load_surface_set(folder, fresh.isovalues, SMALL_BRICKS), fresh)
    assert MeshStore(folder).verify().damaged == ()
    assert not list(folder.rglob("*.tmp"))
    assert (
        extract_with_cache(volume, fresh.isovalues, folder, settings=SMALL_BRICKS).statistics.brick_visits
        == 0
    )

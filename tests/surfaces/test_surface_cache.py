"""The mesh cache: bit-exact, incremental, and loud about every kind of damage."""

from __future__ import annotations

import contextlib
import errno
import itertools
import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mesh_checks import closed_noise

from isosample.errors import CacheError, InputError
from isosample.surfaces.cache import (
    content_hash,
    extract_with_cache,
    load_cache,
    load_surface_set,
    open_cache,
    write_cache,
)
from isosample.surfaces.cache_files import write_arrays
from isosample.surfaces.cache_folders import verify_folder
from isosample.surfaces.extract import SurfaceSet, extract_surfaces
from isosample.surfaces.store import MeshStore
from isosample.surfaces.surface_files import listed_key, read_rows, surface_path, write_rows
from isosample.transfer.isovalues import IsovaluePlan, plan_isovalues
from isosample.transfer.transfer_function import ControlPoint, TransferFunction
from isosample.volume.grid import Volume
from isosample.volume.reconstruction import Reconstruction


def scene_volume(seed: int = 0) -> Volume:
    turn = np.array([[0.8, -0.6, 0.0], [0.6, 0.8, 0.0], [0.0, 0.0, -1.0]])
    samples = closed_noise(seed, size=9).astype(">f4")
    return Volume(samples, spacing=(0.1, 1 / 3, 0.7), origin=(0.1, -2.0, 1e3), direction=turn, name="noise")


def scene_transfer(volume: Volume) -> tuple[TransferFunction, IsovaluePlan]:
    colors = ((0.1, 0.2, 1 / 3), (1.0, 0.5, 0.0), (0.3, 0.3, 0.3))
    points = zip((-0.5, 0.1, 0.7), colors, (0.0, 2.0 / 3.0, 0.0), strict=True)
    transfer = TransferFunction([ControlPoint(value=v, color=c, extinction=e) for v, c, e in points])
    return transfer, plan_isovalues(transfer, volume.value_range, per_slope=1)


def written_scene(folder: Path, volume: Volume, **settings: Any) -> SurfaceSet:
    transfer, plan = scene_transfer(volume)
    surfaces = extract_surfaces(volume, plan.isovalues, brick_cells=4, **settings)
    write_cache(
        folder,
        surfaces,
        content_hash=content_hash(volume),
        transfer_function=transfer,
        plan=plan,
        name=volume.name,
    )
    return surfaces


def assert_same_bits(first: SurfaceSet, second: SurfaceSet) -> None:
    assert first.geometry == second.geometry
    assert first.value_range == second.value_range
    assert first.settings == second.settings
    assert first.statistics.triangles == second.statistics.triangles
    assert first.statistics.vertices == second.statistics.vertices
    assert first.isovalues.tobytes() == second.isovalues.tobytes()
    assert len(first.meshes) == len(second.meshes) > 0
    for a, b in zip(first.meshes, second.meshes, strict=True):
        assert (a.isovalue, a.brick, a.start) == (b.isovalue, b.brick, b.start)
        assert a.error == b.error
        for field in ("positions", "gradients", "edge_keys", "triangles", "residuals"):
            left, right = getattr(a, field), getattr(b, field)
            assert left.dtype == right.dtype
            assert left.shape == right.shape
            assert left.tobytes() == right.tobytes()
    assert first.mesh_errors == second.mesh_errors
    kernels = [surfaces.boundary.kernel for surfaces in (first, second)]
    left, right = (None if kernel is None else kernel.tobytes() for kernel in kernels)
    assert left == right
    for face, other in zip(first.boundary.faces, second.boundary.faces, strict=True):
        assert face.dtype == other.dtype
        assert face.tobytes() == other.tobytes()


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


CURVED: dict[str, Any] = {"reconstruction": Reconstruction.CUBIC, "refine": 2, "residuals": True}


def test_a_smooth_refined_scene_comes_back_bit_for_bit_with_its_errors(tmp_path: Path) -> None:
    volume = scene_volume()
    surfaces = written_scene(tmp_path, volume, **CURVED)
    assert surfaces.mesh_errors[0] is not None
    assert_same_bits(load_cache(tmp_path).surfaces, surfaces)
    again = extract_with_cache(volume, surfaces.isovalues, tmp_path, brick_cells=4, **CURVED)
    assert again.statistics.levels_reused == len(surfaces.isovalues)
    assert_same_bits(again, surfaces)
    assert_same_bits(load_surface_set(tmp_path, surfaces.isovalues, brick_cells=4, **CURVED), surfaces)


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
                load_surface_set(tmp_path, [0.0], **other)
        found = extract_with_cache(volume, [0.0], tmp_path, **settings)
        assert found.statistics.levels_reused == 0
        assert_same_bits(found, extract_surfaces(volume, [0.0], **settings))
    for settings in variants:
        assert_same_bits(
            load_surface_set(tmp_path, [0.0], **settings), extract_surfaces(volume, [0.0], **settings)
        )
    assert load_surface_set(tmp_path, ()).value_range == volume.value_range


def test_a_reconstruction_that_is_not_there_is_named(tmp_path: Path) -> None:
    extract_with_cache(scene_volume(), [0.0], tmp_path)
    with pytest.raises(CacheError, match=r"no surfaces of the bc21 reconstruction.*precompute"):
        load_surface_set(tmp_path, (), reconstruction=Reconstruction.BC21)


def test_a_damaged_spline_boundary_is_found(tmp_path: Path) -> None:
    surfaces = written_scene(tmp_path, scene_volume(), **CURVED)
    path = tmp_path / "boundary-cubic.npz"
    path.write_bytes(path.read_bytes()[:-200])
    with pytest.raises(CacheError, match=r"boundary-cubic\.npz is damaged"):
        load_cache(tmp_path)
    path.unlink()
    with pytest.raises(CacheError, match=r"boundary-cubic\.npz"):
        load_surface_set(tmp_path, surfaces.isovalues, brick_cells=4, **CURVED)


def test_only_missing_isovalues_are_extracted(tmp_path: Path) -> None:
    volume = scene_volume()
    first = extract_with_cache(volume, [0.0, 0.5], tmp_path, brick_cells=4)
    assert first.statistics.levels_reused == 0
    files = {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*.*")}
    second = extract_with_cache(volume, [0.0, 0.25, 0.5, 99.0], tmp_path, brick_cells=4)
    assert second.statistics.levels_reused == 3  # nothing has the value 99: there is nothing to extract
    alone = extract_surfaces(volume, [0.25], brick_cells=4).statistics
    assert second.statistics.brick_visits == alone.brick_visits > 0
    assert second.statistics.chunks_reused == len(first.meshes)
    assert_same_bits(second, extract_surfaces(volume, [0.0, 0.25, 0.5, 99.0], brick_cells=4))
    assert {path: path.stat().st_mtime_ns for path in files} == files
    third = extract_with_cache(volume, [0.0, 0.25, 0.5, 99.0], tmp_path, brick_cells=4)
    assert (third.statistics.levels_reused, third.statistics.brick_visits) == (4, 0)
    assert_same_bits(third, second)


def test_surfaces_of_other_settings_are_not_mixed_up(tmp_path: Path) -> None:
    volume = scene_volume()
    extract_with_cache(volume, [0.0], tmp_path, brick_cells=4)
    other = extract_with_cache(volume, [0.0], tmp_path, brick_cells=5)
    assert other.statistics.levels_reused == 0
    assert_same_bits(load_surface_set(tmp_path, [0.0], brick_cells=5), other)
    with pytest.raises(CacheError, match=r"no isosurface 0\.0 for these settings.*precompute"):
        load_surface_set(tmp_path, [0.0], brick_cells=6)


def test_negative_zero_names_the_same_surface(tmp_path: Path) -> None:
    volume = scene_volume()
    extract_with_cache(volume, [0.0], tmp_path)
    assert extract_with_cache(volume, [-0.0], tmp_path).statistics.levels_reused == 1


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


@pytest.mark.parametrize("name", ["volume.json", "scene.json", "boundary.npz", "surface"])
@pytest.mark.parametrize("damage", ["truncate", "empty", "remove"])
def test_damage_to_any_file_is_found_and_named(tmp_path: Path, name: str, damage: str) -> None:
    written_scene(tmp_path, scene_volume())
    path = min((tmp_path / "surfaces").iterdir()) if name == "surface" else tmp_path / name
    content = path.read_bytes()
    path.unlink() if damage == "remove" else path.write_bytes(
        content[: len(content) // 2 * (damage != "empty")]
    )
    missing = name == "surface" and damage == "remove"  # a name of 64 digits tells less than the isovalue
    with pytest.raises(CacheError, match=r"no isosurface -?\d\.\d+ for" if missing else path.name):
        load_cache(tmp_path)


@pytest.mark.parametrize("name", ["volume.json", "scene.json", "boundary.npz", "surface"])
def test_a_flipped_bit_is_found_or_changes_nothing(tmp_path: Path, name: str) -> None:
    """Some bytes of a zip archive say nothing (dates); nearly all others are covered by digests."""
    surfaces = written_scene(tmp_path, scene_volume())
    path = min((tmp_path / "surfaces").iterdir()) if name == "surface" else tmp_path / name
    content = path.read_bytes()
    places = np.linspace(0, len(content) - 1, 16).astype(int).tolist()
    directory = content.find(
        b"PK\x01\x02"
    )  # in an archive also: encryption flag, compression method, checksum
    places += [directory + entry for entry in (8, 10, 16)] if directory > 0 else []
    found = 0
    for place in places:
        path.write_bytes(content[:place] + bytes([content[place] ^ 1]) + content[place + 1 :])
        try:
            assert_same_bits(load_cache(tmp_path).surfaces, surfaces)
        except CacheError as error:
            assert path.name in str(error)  # noqa: PT017
            found += 1
    assert found > 0.7 * len(places)


def test_swapped_surface_files_are_found(tmp_path: Path) -> None:
    extract_with_cache(scene_volume(), [0.0, 0.5], tmp_path)
    first, second = sorted((tmp_path / "surfaces").iterdir())
    first.write_bytes(second.read_bytes())
    with pytest.raises(CacheError, match=f"{first.name} has key"):
        load_surface_set(tmp_path, [0.0, 0.5])


def test_a_scene_pins_the_arrays_it_was_written_with(tmp_path: Path) -> None:
    """A well-formed file of the right name and other arrays, as another version of the kernel might write."""
    surfaces = written_scene(tmp_path, scene_volume())
    content, isovalue = content_hash(scene_volume()), float(surfaces.isovalues[0])
    key = listed_key(tmp_path, content, isovalue, surfaces.settings)
    rows, _ = read_rows(tmp_path, key, isovalue)
    write_rows(tmp_path, key, rows[1:])
    with pytest.raises(CacheError, match="payload_sha256"):
        load_cache(tmp_path)


def test_arrays_under_the_header_of_others_are_found(tmp_path: Path) -> None:
    written_scene(tmp_path, scene_volume())
    path = min((tmp_path / "surfaces").iterdir())
    with np.load(path) as stored:
        arrays = dict(stored)
    arrays["rows"][0] ^= 1
    np.savez(path, **arrays)
    with pytest.raises(CacheError, match=f"{path.name} is damaged: its arrays"):
        load_cache(tmp_path)


@pytest.mark.parametrize(
    ("arrays", "wrong"),
    [
        ({}, "it has no rows"),
        ({"rows": np.zeros(7, dtype=np.uint8)}, "its rows are 7 of uint8"),
        ({"rows": np.zeros(4, dtype=np.float64)}, "its rows are 4 of float64"),
    ],
    ids=["none", "part of a row", "another type"],
)
def test_a_list_whose_digest_holds_and_that_has_no_rows_is_damaged(
    tmp_path: Path, arrays: dict[str, Any], wrong: str
) -> None:
    volume = scene_volume()
    surfaces = extract_with_cache(volume, [0.0], tmp_path)
    key = listed_key(tmp_path, content_hash(volume), 0.0, surfaces.settings)
    path = surface_path(tmp_path, key)
    write_arrays(path, {"key": key}, arrays)
    with pytest.raises(CacheError, match=rf"{path.name} is damaged: {wrong}"):
        load_surface_set(tmp_path, [0.0])
    named = [(chunk.path, wrong in chunk.reason) for chunk in verify_folder(tmp_path).damaged]
    assert (path, True) in named
    assert extract_with_cache(volume, [0.0], tmp_path).statistics.brick_visits == 0
    assert path not in [chunk.path for chunk in verify_folder(tmp_path).damaged]


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


def test_pickled_arrays_are_never_loaded(tmp_path: Path) -> None:
    written_scene(tmp_path, scene_volume())
    np.savez(tmp_path / "boundary.npz", header=np.array([{"a": 1}], dtype=object))
    with pytest.raises(CacheError, match=r"boundary\.npz is damaged"):
        load_cache(tmp_path)


def files_of(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


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
    extract_with_cache(volume, [0.0], tmp_path, brick_cells=4)
    before = files_of(tmp_path)
    with monkeypatch.context() as patch:
        refuse_writing(patch, errno.ENOSPC, after=after)
        with pytest.raises(CacheError, match=r"cannot be written: No space left on device.*goes on"):
            extract_with_cache(volume, [0.0, 0.5], tmp_path, brick_cells=4)
    there = files_of(tmp_path)
    assert {name: there[name] for name in before} == before
    assert len(there) == len(before) + after  # of 27 bricks; then comes the list of chunks
    resumed = extract_with_cache(volume, [0.0, 0.5], tmp_path, brick_cells=4)
    fresh = extract_surfaces(volume, [0.0, 0.5], brick_cells=4)
    assert_same_bits(resumed, fresh)
    assert resumed.statistics.brick_visits == 27 - after
    assert_same_bits(load_surface_set(tmp_path, [0.0, 0.5], brick_cells=4), fresh)


def test_a_read_only_cache_is_read_and_what_it_lacks_is_extracted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    volume = scene_volume()
    extract_with_cache(volume, [0.0], tmp_path, brick_cells=4)
    before = files_of(tmp_path)
    refuse_writing(monkeypatch, errno.EROFS)
    assert extract_with_cache(volume, [0.0], tmp_path, brick_cells=4).statistics.brick_visits == 0
    with pytest.warns(UserWarning, match="cannot be written: what it lacks was extracted"):
        found = extract_with_cache(volume, [0.0, 0.5], tmp_path, brick_cells=4)
    assert found.statistics.levels_reused == 1
    assert_same_bits(found, extract_surfaces(volume, [0.0, 0.5], brick_cells=4))
    assert files_of(tmp_path) == before
    with pytest.raises(CacheError, match="cannot be written"):
        extract_with_cache(
            volume, [0.0], tmp_path / "new"
        )  # no cache yet: it was asked for, and cannot be made


def damaged(path: Path, damage: str) -> None:
    content = path.read_bytes()
    if damage == "flipped":
        middle = len(content) // 2
        path.write_bytes(content[:middle] + bytes([content[middle] ^ 4]) + content[middle + 1 :])
    else:
        path.write_bytes(content[: len(content) * 2 // 3 * (damage == "truncated")])


@pytest.mark.parametrize("damage", ["flipped", "truncated", "empty", "removed"])
def test_a_damaged_chunk_is_named_and_extracted_again_and_only_it(tmp_path: Path, damage: str) -> None:
    volume = scene_volume()
    surfaces = written_scene(tmp_path, volume)
    levels = surfaces.isovalues
    path = sorted(tmp_path.glob("chunks/*/*.chunk"))[3]
    path.unlink() if damage == "removed" else damaged(path, damage)
    before = files_of(tmp_path)
    with pytest.raises(CacheError, match=rf"{path.name} is (damaged|missing).*isosurface.*precompute"):
        load_cache(tmp_path)
    assert files_of(tmp_path) == before  # who has no volume removes nothing
    expected = contextlib.nullcontext() if damage == "removed" else pytest.warns(UserWarning, match=path.name)
    with expected:
        again = extract_with_cache(volume, levels, tmp_path, brick_cells=4)
    assert again.statistics.brick_visits == 1
    assert_same_bits(again, surfaces)
    assert_same_bits(load_cache(tmp_path).surfaces, surfaces)


def test_a_chunk_is_named_with_the_isosurface_that_it_is_of(tmp_path: Path) -> None:
    """The first in the order of the list, which is missing, where the damaged one is of the last isosurface."""
    surfaces = written_scene(tmp_path, scene_volume())
    table = open_cache(tmp_path).surfaces.chunk_table
    store = MeshStore(tmp_path)
    first, last = (store.path(table["key"][place].decode()) for place in (0, -1))
    first.unlink()
    damaged(last, "flipped")
    lowest, highest = (float(surfaces.isovalues[place]) for place in (0, -1))
    with pytest.raises(CacheError, match=rf"{first.name} is missing, and isosurface {lowest!r} with it"):
        load_cache(tmp_path)
    first.write_bytes(b"")
    with pytest.raises(CacheError, match=rf"{first.name} is damaged: .*, and isosurface {lowest!r} with it"):
        load_cache(tmp_path)
    assert lowest != highest


@pytest.mark.parametrize("name", ["boundary.npz", "surface"])
def test_other_files_that_are_damaged_are_made_anew_from_the_volume(tmp_path: Path, name: str) -> None:
    volume = scene_volume()
    surfaces = written_scene(tmp_path, volume)
    path = min((tmp_path / "surfaces").iterdir()) if name == "surface" else tmp_path / name
    content = path.read_bytes()
    damaged(path, "truncated")
    extract_with_cache(volume, surfaces.isovalues, tmp_path, brick_cells=4)
    assert_same_bits(load_surface_set(tmp_path, surfaces.isovalues, brick_cells=4), surfaces)
    if name == "boundary.npz":
        assert path.read_bytes() == content


def test_chunks_swapped_between_bricks_are_found(tmp_path: Path) -> None:
    written_scene(tmp_path, scene_volume())
    first, second = sorted(tmp_path.glob("chunks/*/*.chunk"))[:2]
    first.write_bytes(second.read_bytes())
    with pytest.raises(CacheError, match=f"{first.name} is damaged: it is named {second.stem}"):
        load_cache(tmp_path)


def test_a_budget_keeps_what_the_call_itself_uses(tmp_path: Path) -> None:
    volume = scene_volume()
    extract_with_cache(volume, [0.0], tmp_path, brick_cells=4)
    for path in tmp_path.glob("chunks/*/*.chunk"):
        os.utime(path, (1e9, 1e9))
    now = extract_with_cache(volume, [0.5], tmp_path, brick_cells=4, budget_bytes=1)
    assert_same_bits(load_surface_set(tmp_path, [0.5], brick_cells=4), now)
    with pytest.raises(CacheError, match=r"is missing, and isosurface 0\.0"):
        load_surface_set(tmp_path, [0.0], brick_cells=4)
    assert extract_with_cache(volume, [0.0], tmp_path, brick_cells=4).statistics.levels_reused == 0


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
        return extract_with_cache(volume, plan.isovalues, tmp_path, brick_cells=4)

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


FILL = """
import sys
import numpy as np
from isosample.surfaces.cache import extract_with_cache
from isosample.volume.grid import Volume
volume = Volume(np.load(sys.argv[1]))
sys.stdin.readline()  # both begin at once
found = extract_with_cache(volume, [-0.3, -0.1, 0.1, 0.3], sys.argv[2], brick_cells=4)
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
    assert_same_bits(load_surface_set(folder, fresh.isovalues, brick_cells=4), fresh)
    assert MeshStore(folder).verify().damaged == ()
    assert not list(folder.rglob("*.tmp"))
    assert extract_with_cache(volume, fresh.isovalues, folder, brick_cells=4).statistics.brick_visits == 0


def test_isovalues_that_are_not_finite_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="finite"):
        extract_with_cache(scene_volume(), [np.inf], tmp_path)


def test_loading_needs_no_volume(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    written_scene(tmp_path, scene_volume())

    def refuse(self: Volume) -> None:
        raise AssertionError("a volume was made")

    monkeypatch.setattr(Volume, "__post_init__", refuse)
    assert len(load_cache(tmp_path).surfaces.meshes) > 0

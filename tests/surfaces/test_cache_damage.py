"""Every kind of damage to a cache folder is found and named, and only what is damaged is made anew."""

from __future__ import annotations

import contextlib
import shutil
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from cache_scenes import (
    CURVED,
    SMALL_BRICKS,
    assert_same_bits,
    damaged,
    files_of,
    scene_volume,
    written_scene,
)

from isosample.errors import CacheError
from isosample.surfaces.boundary_files import boundary_path, write_boundary
from isosample.surfaces.cache import (
    content_hash,
    extract_with_cache,
    load_cache,
    load_surface_set,
    open_cache,
)
from isosample.surfaces.cache_files import read_json, write_arrays, write_json
from isosample.surfaces.cache_verification import verify_folder
from isosample.surfaces.settings import ExtractionSettings
from isosample.surfaces.store import MeshStore
from isosample.surfaces.surface_files import listed_key, read_rows, surface_path, write_rows

if TYPE_CHECKING:
    from pathlib import Path


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


def test_a_damaged_spline_boundary_is_found(tmp_path: Path) -> None:
    surfaces = written_scene(tmp_path, scene_volume(), **CURVED)
    path = tmp_path / "boundary-cubic.npz"
    path.write_bytes(path.read_bytes()[:-200])
    with pytest.raises(CacheError, match=r"boundary-cubic\.npz is damaged"):
        load_cache(tmp_path)
    path.unlink()
    with pytest.raises(CacheError, match=r"boundary-cubic\.npz"):
        load_surface_set(tmp_path, surfaces.isovalues, ExtractionSettings(brick_cells=4, **CURVED))


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


def test_pickled_arrays_are_never_loaded(tmp_path: Path) -> None:
    written_scene(tmp_path, scene_volume())
    np.savez(tmp_path / "boundary.npz", header=np.array([{"a": 1}], dtype=object))
    with pytest.raises(CacheError, match=r"boundary\.npz is damaged"):
        load_cache(tmp_path)


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
        again = extract_with_cache(volume, levels, tmp_path, settings=SMALL_BRICKS)
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
    extract_with_cache(volume, surfaces.isovalues, tmp_path, settings=SMALL_BRICKS)
    assert_same_bits(load_surface_set(tmp_path, surfaces.isovalues, SMALL_BRICKS), surfaces)
    if name == "boundary.npz":
        assert path.read_bytes() == content


def test_chunks_swapped_between_bricks_are_found(tmp_path: Path) -> None:
    written_scene(tmp_path, scene_volume())
    first, second = sorted(tmp_path.glob("chunks/*/*.chunk"))[:2]
    first.write_bytes(second.read_bytes())
    with pytest.raises(CacheError, match=f"{first.name} is damaged: it is named {second.stem}"):
        load_cache(tmp_path)


@pytest.mark.parametrize("name", ["volume.json", "scene.json", "boundary.npz", "surface"])
@pytest.mark.parametrize("damage", ["truncated", "empty", "missing"])
def test_verify_names_every_file_without_which_the_scene_cannot_be_loaded(
    tmp_path: Path, name: str, damage: str
) -> None:
    written_scene(tmp_path, scene_volume())
    assert verify_folder(tmp_path).damaged == ()
    path = min((tmp_path / "surfaces").iterdir()) if name == "surface" else tmp_path / name
    path.unlink() if damage == "missing" else damaged(path, damage)
    assert (name, damage) == ("scene.json", "missing") or path in named(
        tmp_path
    )  # else it was never finished
    with pytest.raises(CacheError):
        load_cache(tmp_path)


def named(folder: Path) -> list[Path]:
    """Return the files that verify says are damaged; each is named once."""
    paths = [chunk.path for chunk in verify_folder(folder).damaged]
    assert len(set(paths)) == len(paths)
    return paths


@pytest.mark.parametrize("settings", [{}, CURVED], ids=["trilinear", "cubic"])
@pytest.mark.parametrize("pinned", ["boundary", "surface"])
def test_verify_holds_files_against_the_digests_that_the_scene_pins(
    tmp_path: Path, settings: dict[str, Any], pinned: str
) -> None:
    """A whole file of the right name, with a digest of its own that holds, and other arrays."""
    surfaces = written_scene(tmp_path, scene_volume(), **settings)
    content, isovalue = content_hash(scene_volume()), float(surfaces.isovalues[0])
    if pinned == "surface":
        key = listed_key(tmp_path, content, isovalue, surfaces.settings)
        path = surface_path(tmp_path, key)
        rows, _ = read_rows(tmp_path, key, isovalue)
        write_rows(tmp_path, key, rows[1:])
    else:
        path = boundary_path(tmp_path, surfaces.settings)
        path.unlink()
        write_boundary(tmp_path, content, replace(surfaces, value_range=(-9.0, 9.0)))
    with pytest.raises(CacheError, match=f"{path.name} has payload_sha256"):
        load_cache(tmp_path)
    assert named(tmp_path) == [path]


def test_verify_names_a_scene_of_another_volume(tmp_path: Path) -> None:
    for seed in (0, 1):
        written_scene(tmp_path / str(seed), scene_volume(seed))
    shutil.copy(tmp_path / "1" / "scene.json", tmp_path / "0" / "scene.json")
    with pytest.raises(CacheError, match=r"scene\.json is of another volume"):
        load_cache(tmp_path / "0")
    assert tmp_path / "0" / "scene.json" in named(tmp_path / "0")


def test_verify_names_a_scene_with_settings_that_are_unknown(tmp_path: Path) -> None:
    written_scene(tmp_path, scene_volume())
    scene = read_json(tmp_path / "scene.json", "scene")
    scene["settings"]["reconstruction"] = "quintic"
    write_json(tmp_path / "scene.json", "scene", scene)
    assert named(tmp_path) == [tmp_path / "scene.json"]

"""The store of chunks: keys, damage, budgets, several readers and writers, places that cannot be written."""

from __future__ import annotations

import os
import subprocess
import threading
import time
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from test_chunk_codec import any_mesh, assert_same, with_wrong_corners

from isosample.errors import CacheError
from isosample.files import leftovers, replacing
from isosample.surfaces import chunk_decoding
from isosample.surfaces.chunk_folder import prune
from isosample.surfaces.settings import ExtractionSettings
from isosample.surfaces.store import MeshStore, chunk_key
from isosample.volume.reconstruction import Reconstruction

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

SETTINGS = ExtractionSettings()


def key_of(number: int) -> str:
    return chunk_key(str(number), 0.5, (1.0, 1.0, 1.0), SETTINGS)


def filled(folder: Path, count: int) -> MeshStore:
    """Chunks of the same size, used one after the other long ago."""
    store = MeshStore(folder)
    for number in range(count):
        store.put(key_of(number), any_mesh(20))
        os.utime(store.path(key_of(number)), (1e9 + number, 1e9 + number))
    return store


def test_a_key_names_everything_that_decides() -> None:
    keys = [
        chunk_key("a", 0.5, (1.0, 1.0, 1.0), SETTINGS),
        chunk_key("b", 0.5, (1.0, 1.0, 1.0), SETTINGS),
        chunk_key("a", np.nextafter(0.5, 1.0), (1.0, 1.0, 1.0), SETTINGS),
        chunk_key("a", 0.5, (1.0, 1.0, 2.0), SETTINGS),
        chunk_key("a", 0.5, (1.0, 1.0, 1.0), ExtractionSettings(reconstruction=Reconstruction.CUBIC)),
        chunk_key("a", 0.5, (1.0, 1.0, 1.0), SETTINGS, 4),
        chunk_key("a", 0.5, (1.0, 1.0, 1.0), SETTINGS, mirrored=True),
    ]
    assert len(set(keys)) == 7
    assert chunk_key("a", 0.0, (1.0, 1.0, 1.0), SETTINGS) == chunk_key("a", -0.0, (1.0, 1.0, 1.0), SETTINGS)


def test_what_is_put_comes_back_and_an_empty_mesh_too(tmp_path: Path) -> None:
    store = MeshStore(tmp_path / "deep" / "folder")
    assert store.get(key_of(0)) is None
    assert not store.has(key_of(0))
    for number, count in ((0, 30), (1, 0)):
        store.put(key_of(number), any_mesh(count))
        found = MeshStore(store.folder).get(key_of(number))
        assert found is not None
        assert_same(found, any_mesh(count))
    assert store.keys() == sorted([key_of(0), key_of(1)])
    assert (store.hits, store.misses, store.written, store.damaged) == (0, 1, 2, 0)


@pytest.mark.parametrize("damage", ["flipped", "truncated", "empty", "another chunk"])
def test_damage_is_named_counted_and_removed(tmp_path: Path, damage: str) -> None:
    store = filled(tmp_path, 2)
    path = store.path(key_of(0))
    data = path.read_bytes()
    path.write_bytes(
        {
            "flipped": data[:200] + bytes([data[200] ^ 16]) + data[201:],
            "truncated": data[:-1],
            "empty": b"",
            "another chunk": store.path(key_of(1)).read_bytes(),
        }[damage]
    )
    watching = MeshStore(tmp_path, read_only=True)
    assert watching.get(key_of(0)) is None
    assert path.exists()
    (bad,) = store.verify().damaged
    assert bad.path == path
    assert store.get(key_of(0)) is None
    assert (store.damaged, store.misses) == (1, 1)
    assert store.notes[0].startswith(f"{path} is damaged: it")
    assert not path.exists()
    store.put(key_of(0), any_mesh(20))
    assert store.get(key_of(0)) is not None
    assert store.verify().damaged == ()


def test_a_chunk_of_an_older_version_is_named_and_left_alone(tmp_path: Path) -> None:
    store = filled(tmp_path, 1)
    path = store.path(key_of(0))
    data = path.read_bytes()
    path.write_bytes(data[:8] + b"\2\0" + data[10:])
    assert store.get(key_of(0)) is None
    assert "format version 2" in store.notes[0]
    assert path.exists()


def test_a_chunk_that_cannot_be_read_is_named(tmp_path: Path) -> None:
    store = filled(tmp_path, 1)
    path = store.path(key_of(0))
    path.unlink()
    path.mkdir()
    assert store.get(key_of(0)) is None
    assert "cannot be read (Is a directory)" in store.notes[0]


def test_prune_removes_those_used_longest_ago(tmp_path: Path) -> None:
    store = filled(tmp_path, 6)
    size = store.path(key_of(0)).stat().st_size
    assert MeshStore(tmp_path).get(key_of(1)) is not None  # now it is the one that was used last
    found = store.prune(3 * size)
    assert (found.chunks, found.size_bytes, found.chunks_left, found.bytes_left) == (3, 3 * size, 3, 3 * size)
    assert set(store.keys()) == {key_of(number) for number in (1, 4, 5)}


def test_prune_takes_those_used_longest_ago_of_all_folders_but_those_to_keep(tmp_path: Path) -> None:
    stores = [filled(tmp_path / name, count) for name, count in (("one", 3), ("two", 5))]
    size = stores[0].path(key_of(0)).stat().st_size
    for pretend in (True, False):
        found = prune(stores, 4 * size, keep=[key_of(1)], pretend=pretend)
        assert [(one.chunks, one.chunks_left, one.bytes_left) for one in found] == [
            (2, 1, size),  # of 0 to 2, in both folders the same times
            (2, 3, 3 * size),
        ]
        left = [3, 5] if pretend else [1, 3]
        assert [len(store.keys()) for store in stores] == left
    assert set(stores[1].keys()) == {key_of(number) for number in (1, 3, 4)}


@pytest.mark.parametrize("place", ["", "surfaces", "chunks/00"])
def test_prune_removes_what_killed_writers_left_in_every_place(tmp_path: Path, place: str) -> None:
    store = filled(tmp_path, 1)
    (tmp_path / place).mkdir(parents=True, exist_ok=True)
    left, new = (tmp_path / place / f".{digit * 32}.tmp" for digit in "0a")
    others = tmp_path / place / ".notes.tmp"  # not ours
    for path in (left, new, others):
        path.write_bytes(b"half a chunk")
        if path != new:  # another process writes this
            os.utime(path, (1e9, 1e9))
    for pretend in (True, False):
        (found,) = prune([store], 1 << 30, pretend=pretend)
        assert (found.chunks, found.leftovers, found.leftover_bytes) == (0, 1, 12)
        assert (left.exists(), new.exists(), others.exists()) == (pretend, True, True)


def test_what_a_killed_writer_leaves_is_known_by_its_name(tmp_path: Path) -> None:
    with replacing(tmp_path / "scene.json") as file:
        (path,) = tmp_path.iterdir()
        file.write(b"half")
        file.flush()
        assert leftovers(tmp_path) == []  # it is being written
        os.utime(path, (1e9, 1e9))
        assert leftovers(tmp_path) == [(path, 4)]
    assert leftovers(tmp_path) == []


def test_a_budget_holds_and_spares_what_the_run_uses(tmp_path: Path) -> None:
    filled(tmp_path, 10)
    size = MeshStore(tmp_path).chunks()[0].size_bytes
    store = MeshStore(tmp_path, budget_bytes=8 * size)
    assert store.get(key_of(0)) is not None
    store.put(key_of(10), any_mesh(20))
    kept = set(store.keys())
    assert {key_of(0), key_of(10)} <= kept
    assert len(kept) <= 8
    assert store.evicted == 11 - len(kept)
    for number in range(20, 40):
        store.put(key_of(number), any_mesh(20))
    assert {key_of(number) for number in (0, 10, *range(20, 40))} == set(store.keys())


def test_a_chunk_that_was_asked_for_is_in_use(tmp_path: Path) -> None:
    filled(tmp_path, 6)
    size = MeshStore(tmp_path).chunks()[0].size_bytes
    store = MeshStore(tmp_path, budget_bytes=3 * size)
    assert store.has(key_of(0))
    assert time.time() - store.path(key_of(0)).stat().st_mtime < 60
    store.put(key_of(6), any_mesh(20))
    assert set(store.keys()) == {key_of(0), key_of(6)}
    watching = MeshStore(tmp_path, read_only=True)
    os.utime(store.path(key_of(0)), (1e9, 1e9))
    assert watching.has(key_of(0))
    assert store.path(key_of(0)).stat().st_mtime == 1e9


def test_chunks_loaded_together_come_each_as_alone(tmp_path: Path) -> None:
    """Packed and plain ones, an empty, a damaged and a missing one; damage to one does not touch the others."""
    counts = (30, 0, 500, 7, 3000, 12)
    for number, count in enumerate(counts):
        MeshStore(tmp_path, plain=number % 3 == 2).put(key_of(number), any_mesh(count))
    path = MeshStore(tmp_path).path(key_of(3))
    path.write_bytes(path.read_bytes()[:-5] + b"wrong")
    store = MeshStore(tmp_path)
    found = store.get_all([key_of(number) for number in (5, 4, 99, 3, 2, 1, 0)])
    assert [mesh is None for mesh in found] == [False, False, True, True, False, False, False]
    expected = [any_mesh(count) for count in (12, 3000, 500, 0, 30)]
    for mesh, same in zip([mesh for mesh in found if mesh is not None], expected, strict=True):
        assert_same(mesh, same)
    assert (store.hits, store.misses, store.damaged) == (5, 2, 1)
    assert store.notes[0].startswith(f"{path} is damaged")


def test_a_chunk_with_wrong_content_does_not_touch_those_decoded_with_it(tmp_path: Path) -> None:
    """Its checksums hold: only the kernels find that its corners are no vertices."""
    store = filled(tmp_path, 5)
    path = store.path(key_of(2))
    path.write_bytes(with_wrong_corners(any_mesh(20), bytes.fromhex(key_of(2))))
    found = store.get_all([key_of(number) for number in range(5)])
    assert [mesh is None for mesh in found] == [False, False, True, False, False]
    for mesh in found:
        if mesh is not None:
            assert_same(mesh, any_mesh(20))
    assert (store.hits, store.misses, store.damaged) == (4, 1, 1)
    assert "corner that is no vertex" in store.reasons[key_of(2)]
    assert not path.exists()


@pytest.mark.parametrize("together", [1, 60, 100])
def test_more_chunks_than_are_decoded_together_come_each_as_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, together: int
) -> None:
    """Twice as many triangles as vertices: a batch ends before the chunk with which it would have too many."""
    counts = (20, 20, 300, 20, 0, 20, 20, 20, 7)
    store = MeshStore(tmp_path)
    for number, count in enumerate(counts):
        store.put(key_of(number), any_mesh(count))
    monkeypatch.setattr(chunk_decoding, "TOGETHER", together)
    restored: list[int] = []
    whole = chunk_decoding._restored

    def noted(batch: Any) -> Any:
        restored.append(len(batch))
        return whole(batch)

    monkeypatch.setattr(chunk_decoding, "_restored", noted)
    found = store.get_all([key_of(number) for number in range(len(counts))])
    for mesh, count in zip(found, counts, strict=True):
        assert mesh is not None
        assert_same(mesh, any_mesh(count))
    assert (
        restored == {1: [1, 1, 1, 1, 1, 1, 1, 1, 1], 60: [1, 1, 1, 2, 1, 1, 2], 100: [2, 1, 3, 3]}[together]
    )


def test_a_chunk_asked_for_twice_counts_twice(tmp_path: Path) -> None:
    store = filled(tmp_path, 1)
    found = store.get_all([key_of(number) for number in (0, 1, 0, 1, 1)])
    assert [mesh is None for mesh in found] == [False, True, False, True, True]
    assert (store.hits, store.misses) == (2, 3)


def test_reading_notes_the_use_and_a_read_only_store_notes_nothing(tmp_path: Path) -> None:
    path = filled(tmp_path, 1).path(key_of(0))
    watching = MeshStore(tmp_path, read_only=True)
    assert watching.get(key_of(0)) is not None
    assert path.stat().st_mtime == 1e9
    assert MeshStore(tmp_path).get(key_of(0)) is not None
    assert time.time() - path.stat().st_mtime < 60
    for refused in (lambda: watching.put(key_of(1), any_mesh(2)), lambda: watching.prune(0)):
        with pytest.raises(CacheError, match="opened for reading only"):
            refused()
    assert watching.keys() == [key_of(0)]


def test_readers_never_see_half_a_chunk(tmp_path: Path) -> None:
    """One thread writes the same chunks again and again, another removes them, and two read."""
    meshes = [any_mesh(count) for count in (50, 400)]
    stop = threading.Event()
    seen: list[int] = []

    def write() -> None:
        store = MeshStore(tmp_path)
        while not stop.is_set():
            for number, mesh in enumerate(meshes):
                store.put(key_of(number), mesh)

    def prune() -> None:
        store = MeshStore(tmp_path)
        while not stop.wait(0.001):  # else a chunk may be gone before any reader has looked
            store.prune(0)

    def read() -> None:
        store = MeshStore(tmp_path)
        turn, found, deadline = 0, 0, time.monotonic() + 60.0
        while turn < 300 or (found < 20 and time.monotonic() < deadline):
            mesh = store.get(key_of(turn % 2))
            if mesh is not None:
                seen.append(len(mesh.positions))
                found += 1
            turn += 1
        assert store.damaged == 0, store.notes

    others = [threading.Thread(target=work) for work in (write, prune)]
    for thread in others:
        thread.start()
    try:
        read()
        read()
    finally:
        stop.set()
        for thread in others:
            thread.join()
    assert {50, 400} >= set(seen) != set()


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """A file system of 256 KiB; skipped where none may be mounted."""
    place = tmp_path / "disk"
    place.mkdir()
    command = ["mount", "-t", "tmpfs", "-o", "size=256k", "tmpfs", str(place)]
    try:
        mounted = subprocess.run(command, check=False, capture_output=True).returncode == 0
    except FileNotFoundError:
        mounted = False
    if not mounted:
        pytest.skip("no file system can be mounted here")
    yield place
    subprocess.run(["umount", str(place)], check=True)


def test_a_disk_that_fills_up_keeps_every_whole_chunk(small_disk: Path) -> None:
    store = MeshStore(small_disk)

    def fill() -> None:
        for number in range(100):
            store.put(key_of(number), any_mesh(500))

    with pytest.raises(CacheError, match=r"No space left on device.*cache prune.*extracted before is kept"):
        fill()
    there = store.keys()
    assert 3 < len(there) == store.written
    assert store.verify().damaged == ()
    assert not list(small_disk.rglob("*.tmp"))
    store.prune(0)
    store.put(key_of(99), any_mesh(500))
    assert store.keys() == [key_of(99)]


def test_a_disk_mounted_for_reading_is_read(small_disk: Path) -> None:
    filled(small_disk, 2)
    subprocess.run(["mount", "-o", "remount,ro", str(small_disk)], check=True)
    store = MeshStore(small_disk)
    assert store.get(key_of(1)) is not None
    with pytest.raises(CacheError, match="Read-only file system"):
        store.put(key_of(2), any_mesh(3))
    path = store.path(key_of(0))
    with pytest.raises(CacheError, match="cannot be removed: Read-only file system"):
        store.prune(0)
    assert path.exists()

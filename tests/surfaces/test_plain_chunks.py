"""Chunks that need no decoding: every mesh comes back bit for bit, and no damage goes unseen."""

from __future__ import annotations

import mmap
import subprocess
import sys
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from mesh_checks import closed_noise
from test_chunk_codec import any_mesh, assert_same
from test_mesh_store import key_of

from isosample.errors import CacheError, InputError
from isosample.surfaces import chunk_reading
from isosample.surfaces.cache import extract_with_cache, load_surface_set
from isosample.surfaces.checksum_kernel import checksum
from isosample.surfaces.chunk_header import NO_NAME, OtherVersionError
from isosample.surfaces.extract import extract_surfaces
from isosample.surfaces.mesh_error import MeshError
from isosample.surfaces.plain_chunks import decode_plain, encode_plain
from isosample.surfaces.settings import ExtractionSettings
from isosample.surfaces.store import MeshStore
from isosample.volume.grid import Volume

if TYPE_CHECKING:
    from pathlib import Path

    from isosample.surfaces.mesh import BrickMesh


@pytest.mark.parametrize("count", [0, 1, 7, 300])
def test_any_mesh_comes_back_bit_for_bit(count: int) -> None:
    for mesh in (
        any_mesh(count),
        any_mesh(count, error=MeshError(area=1 / 3, flat_rms=5e-324)),
        any_mesh(count, residuals=np.zeros((count, 2), dtype=np.float32)),
        any_mesh(count, residuals=np.full((count, 2), -0.0, dtype=np.float32)),
    ):
        assert_same(decode_plain(encode_plain(mesh, name=bytes(range(32))), name=bytes(range(32))), mesh)


def test_a_chunk_of_another_name_is_refused() -> None:
    with pytest.raises(CacheError, match=r"it is named 0000.*expected 0101"):
        decode_plain(encode_plain(any_mesh()), name=b"\1" * 32)


def test_every_flipped_bit_is_found() -> None:
    """Header and content have checksums, the rest of the header is zero, and names and sizes must agree."""
    data = encode_plain(any_mesh(5))
    for place in range(len(data)):
        changed = data[:place] + bytes([data[place] ^ 1 << place % 8]) + data[place + 1 :]
        with pytest.raises(CacheError):
            decode_plain(changed, name=NO_NAME)


def test_every_truncation_is_found() -> None:
    data = encode_plain(any_mesh(3))
    for length in range(len(data)):
        with pytest.raises(CacheError):
            decode_plain(data[:length])
    with pytest.raises(CacheError, match="bytes, expected"):
        decode_plain(data + bytes(64))


def test_another_version_is_told_from_damage() -> None:
    data = encode_plain(any_mesh(2))
    with pytest.raises(OtherVersionError, match="format version 9; this program reads and writes 1"):
        decode_plain(data[:8] + b"\t\0" + data[10:])


def test_a_mesh_with_a_corner_that_is_no_vertex_is_refused() -> None:
    with pytest.raises(InputError, match="corner"):
        encode_plain(any_mesh(2, triangles=np.array([[0, 1, 2]], dtype=np.int32)))


def test_the_checksum_tells_words_that_changed_places_or_are_missing() -> None:
    words = np.random.default_rng(0).integers(0, 2**64, 64, dtype=np.uint64)
    others = [words[:56], np.append(words, np.zeros(8, np.uint64)), words[::-1].copy(), np.roll(words, 8)]
    top = words.copy()
    top[[3, 11]] ^= np.uint64(1 << 63)  # the top bits of two words of one lane
    assert len({checksum(case) for case in (words, top, *others)}) == 6


@pytest.mark.parametrize("mapped", [0, chunk_reading.MOST_MAPPED])
def test_a_store_reads_both_kinds(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, mapped: int) -> None:
    monkeypatch.setattr(chunk_reading, "MOST_MAPPED", mapped)
    large, small = any_mesh(2000), any_mesh(3)
    for number, (mesh, plain) in enumerate([(large, True), (small, True), (large, False), (small, False)]):
        MeshStore(tmp_path, plain=plain).put(key_of(number), mesh)
        found = MeshStore(tmp_path).get(key_of(number))
        assert found is not None
        assert_same(found, mesh)
        assert is_mapped(found) == (number == 0 and mapped > 0)
    assert MeshStore(tmp_path).verify().damaged == ()


def is_mapped(mesh: BrickMesh) -> bool:
    """Whether the positions are those in a mapped file."""
    base: Any = mesh.positions
    while isinstance(base, np.ndarray):
        base = base.base
    return isinstance(base.obj if isinstance(base, memoryview) else base, mmap.mmap)


FEW_FILES = """
import os, resource, sys
from pathlib import Path
from isosample.errors import CacheError
from isosample.surfaces import chunk_reading
from isosample.surfaces.store import MeshStore

resource.setrlimit(resource.RLIMIT_NOFILE, (64, 64))
folder = Path(sys.argv[1])
keys = MeshStore(folder).keys()
found = MeshStore(folder).get_all(keys)
print("half", sum(mesh is not None for mesh in found), len(chunk_reading.MAPPED))
del found
print("freed", len(chunk_reading.MAPPED))
chunk_reading.DESCRIPTOR_SHARE = 1  # as if others had files open too: mapping fails
store = MeshStore(folder)
found = store.get_all(keys)
print("all", sum(mesh is not None for mesh in found), 32 < len(chunk_reading.MAPPED) < 64)
files = []
try:
    while True:
        files.append(os.open("/dev/null", os.O_RDONLY))
except OSError:
    pass
try:
    store.get(keys[0])
except CacheError as error:
    print("told", "Too many open files" in str(error), "damaged" in str(error), store.damaged)
"""


def test_many_chunks_are_loaded_though_few_files_may_be_open(tmp_path: Path) -> None:
    """Every mapping keeps a descriptor: of 64 that may be open 32 are mapped, and the others read."""
    for number in range(100):
        MeshStore(tmp_path, plain=True).put(key_of(number), any_mesh(300))
    assert min(chunk.size_bytes for chunk in MeshStore(tmp_path).chunks()) >= chunk_reading.MAPPED_BYTES
    command = [sys.executable, "-c", FEW_FILES, str(tmp_path)]
    found = subprocess.run(command, check=True, capture_output=True, text=True).stdout
    assert found.splitlines() == [
        "half 100 32",
        "freed 0",
        "all 100 True",
        "told True False 0",
    ]


@pytest.mark.parametrize("damage", ["flipped", "truncated", "another chunk"])
def test_a_damaged_plain_chunk_is_named_and_removed(tmp_path: Path, damage: str) -> None:
    store = MeshStore(tmp_path, plain=True)
    for number in range(2):
        store.put(key_of(number), any_mesh(2000))
    path = store.path(key_of(0))
    data = path.read_bytes()
    path.write_bytes(
        {
            "flipped": data[:9000] + bytes([data[9000] ^ 16]) + data[9001:],
            "truncated": data[:-64],
            "another chunk": store.path(key_of(1)).read_bytes(),
        }[damage]
    )
    assert [bad.path for bad in store.verify().damaged] == [path]
    assert store.get(key_of(0)) is None
    assert store.notes[0].startswith(f"{path} is damaged: it")
    assert not path.exists()


def test_a_folder_of_plain_chunks_gives_the_surfaces_of_the_extraction(tmp_path: Path) -> None:
    volume, levels = Volume(closed_noise(3, size=40)), [-0.5, 0.25]
    expected = extract_surfaces(volume, levels, residuals=True)
    written = extract_with_cache(
        volume, levels, tmp_path, settings=ExtractionSettings(residuals=True), plain=True
    )
    again = extract_with_cache(volume, levels, tmp_path, settings=ExtractionSettings(residuals=True))
    assert (again.statistics.brick_visits, again.statistics.levels_reused) == (0, 2)
    for surfaces in (written, again, load_surface_set(tmp_path, levels, ExtractionSettings(residuals=True))):
        assert len(surfaces.meshes) == len(expected.meshes)
        for found, mesh in zip(surfaces.meshes, expected.meshes, strict=True):
            assert_same(found, mesh)

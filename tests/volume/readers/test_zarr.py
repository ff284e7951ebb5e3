"""Zarr arrays and OME-Zarr images of both versions stay in their folder until they are sliced."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from isosample.errors import InputError, MissingDependencyError
from isosample.volume.lazy import LazySamples, identity_of
from isosample.volume.readers import open_volume

if TYPE_CHECKING:
    from pathlib import Path

zarr = pytest.importorskip("zarr")

SAMPLES = np.random.default_rng(3).integers(0, 1000, (9, 14, 20)).astype(np.uint16)
VERSIONS = pytest.mark.parametrize("version", [2, 3])


def write(folder: Path, samples: Any = SAMPLES, *, version: int = 3, **more: Any) -> Path:
    """An array of chunks of 4 × 5 × 6 samples."""
    chunks = (1,) * (samples.ndim - 3) + (4, 5, 6)
    array = zarr.create_array(
        folder, shape=samples.shape, chunks=chunks, dtype=samples.dtype, zarr_format=version, **more
    )
    array[...] = samples
    return folder


def write_image(folder: Path, version: int, datasets: list[dict[str, Any]], **arrays: Any) -> Path:
    """An OME-Zarr image with the axes t, c, z, y, x."""
    group = zarr.open_group(folder, mode="w", zarr_format=version)
    for name, samples in arrays.items():
        group.create_array(name, shape=samples.shape, chunks=(1, 1, 4, 5, 6), dtype=samples.dtype)[...] = (
            samples
        )
    images = [{"axes": [{"name": name} for name in "tczyx"], "datasets": datasets}]
    group.attrs.update({"ome": {"multiscales": images}} if version == 3 else {"multiscales": images})
    return folder


@VERSIONS
@pytest.mark.parametrize("dtype", ["uint8", ">u2", "<i4", "float32", "float64"])
def test_an_array_is_read_in_its_own_type_when_it_is_sliced(tmp_path: Path, version: int, dtype: str) -> None:
    volume = open_volume(write(tmp_path / "a.zarr", SAMPLES.astype(dtype), version=version))
    assert isinstance(volume.array, LazySamples)
    assert volume.stays_in_file
    assert volume.array.dtype == np.dtype(dtype).newbyteorder("=")
    assert volume.array.chunks == (4, 5, 6)
    np.testing.assert_array_equal(volume.array[2:7, 3, ::4], SAMPLES.astype(dtype)[2:7, 3, ::4])
    np.testing.assert_array_equal(np.asarray(volume.array), SAMPLES.astype(dtype))


@VERSIONS
def test_an_image_gives_its_finest_resolution_and_its_placement(tmp_path: Path, version: int) -> None:
    finest = {
        "path": "fine",
        "coordinateTransformations": [
            {"type": "scale", "scale": [1, 1, 3, 2, 0.5]},
            {"type": "translation", "translation": [0, 0, 30, 20, 5]},
        ],
    }
    samples = np.stack([np.stack([SAMPLES, SAMPLES + 1, SAMPLES + 2])] * 2)
    samples[1] += 10
    coarse = samples[..., ::2, ::2, ::2]
    folder = write_image(
        tmp_path / "i.zarr", version, [finest, {"path": "coarse"}], fine=samples, coarse=coarse
    )
    volume = open_volume(folder, channel=2, time=1)
    assert volume.spacing == (0.5, 2, 3)
    assert volume.origin == (5, 20, 30)
    np.testing.assert_array_equal(np.asarray(volume.array), SAMPLES + 12)
    small = open_volume(folder, channel=0, time=0, dataset="coarse")
    np.testing.assert_array_equal(np.asarray(small.array), SAMPLES[::2, ::2, ::2])
    with pytest.raises(InputError, match=r"2 time steps.*--time"):
        open_volume(folder, channel=0)
    with pytest.raises(InputError, match=r"3 channels; --channel 3 must be 0 to 2"):
        open_volume(folder, channel=3, time=0)


def test_a_group_with_several_arrays_lists_them(tmp_path: Path) -> None:
    group = zarr.open_group(tmp_path / "g.zarr", mode="w")
    for name in ("one", "two"):
        group.create_array(name, shape=SAMPLES.shape, dtype="u2")[...] = SAMPLES
    with pytest.raises(InputError, match=r"more than one array; it holds one \(9, 14, 20\), two .*--dataset"):
        open_volume(tmp_path / "g.zarr")
    with pytest.raises(InputError, match=r"no array 'three'"):
        open_volume(tmp_path / "g.zarr", dataset="three")
    np.testing.assert_array_equal(np.asarray(open_volume(tmp_path / "g.zarr", dataset="two").array), SAMPLES)


def test_a_mask_is_read_as_0_and_1(tmp_path: Path) -> None:
    mask = SAMPLES % 2 == 1
    zarr.create_array(tmp_path / "mask.zarr", data=mask)
    volume = open_volume(tmp_path / "mask.zarr")
    assert volume.array.dtype == np.uint8
    np.testing.assert_array_equal(volume.array[1:3], mask[1:3].astype(np.uint8))


def test_what_is_no_volume_is_refused(tmp_path: Path) -> None:
    zarr.create_array(tmp_path / "flat.zarr", shape=(4, 5), dtype="u1")
    with pytest.raises(InputError, match=r"shape \(4, 5\).*z, y, x"):
        open_volume(tmp_path / "flat.zarr")
    zarr.create_array(tmp_path / "truth.zarr", shape=(4, 5, 6), dtype="complex64")
    with pytest.raises(InputError, match="holds complex64"):
        open_volume(tmp_path / "truth.zarr")
    (tmp_path / "broken.zarr").mkdir()
    (tmp_path / "broken.zarr" / "zarr.json").write_text("{")
    with pytest.raises(InputError, match="no readable Zarr folder"):
        open_volume(tmp_path / "broken.zarr")
    with pytest.raises(InputError, match=r"leave out --shape"):
        open_volume(write(tmp_path / "a.zarr"), shape=(1, 2, 3), dtype="u1")


def test_a_damaged_chunk_is_an_error_when_it_is_read(tmp_path: Path) -> None:
    folder = write(tmp_path / "a.zarr")
    chunk = next(path for path in (folder / "c" / "0").rglob("*") if path.is_file())
    chunk.write_bytes(chunk.read_bytes()[:7])
    volume = open_volume(folder)
    with pytest.raises(InputError, match=r"a chunk of .* cannot be read"):
        np.asarray(volume.array)


def test_the_identity_changes_with_a_chunk(tmp_path: Path) -> None:
    folder = write(tmp_path / "a.zarr")
    first = identity_of(open_volume(folder).array)
    assert first == identity_of(open_volume(folder).array) is not None
    zarr.open(folder)[0, 0, 0] = 7
    assert identity_of(open_volume(folder).array) != first


def test_without_zarr_the_extra_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = write(tmp_path / "a.zarr")
    monkeypatch.setitem(sys.modules, "zarr", None)
    with pytest.raises(MissingDependencyError, match=r"isosample\[zarr\]"):
        open_volume(folder)

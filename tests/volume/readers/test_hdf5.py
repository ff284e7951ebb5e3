"""HDF5 datasets stay in their file until they are sliced."""

from __future__ import annotations

import sys
from concurrent.futures import ThreadPoolExecutor
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from isosample.errors import InputError, MissingDependencyError
from isosample.volume.lazy import LazySamples, identity_of
from isosample.volume.readers import open_volume

if TYPE_CHECKING:
    from pathlib import Path

h5py = pytest.importorskip("h5py")

SAMPLES = np.random.default_rng(4).integers(0, 1000, (9, 14, 20)).astype(np.uint16)


def write(path: Path, **datasets: Any) -> Path:
    """Compressed datasets in chunks."""
    with h5py.File(path, "w") as file:
        for name, samples in datasets.items():
            file.create_dataset(name, data=samples, chunks=True, compression="gzip")
    return path


@pytest.mark.parametrize("dtype", ["uint8", ">u2", "float32"])
@pytest.mark.parametrize("name", ["a.h5", "a.hdf5", "a.ims"])
def test_the_only_dataset_is_read_in_its_own_type(tmp_path: Path, dtype: str, name: str) -> None:
    volume = open_volume(write(tmp_path / name, samples=SAMPLES.astype(dtype), note=np.arange(3)))
    assert isinstance(volume.array, LazySamples)
    assert volume.array.dtype == np.dtype(dtype).newbyteorder("=")
    np.testing.assert_array_equal(volume.array[3:5, :, 7], SAMPLES.astype(dtype)[3:5, :, 7])
    np.testing.assert_array_equal(np.asarray(volume.array), SAMPLES.astype(dtype))


def test_a_mask_is_read_as_0_and_1_and_stands_back_behind_a_scan(tmp_path: Path) -> None:
    mask = SAMPLES % 2 == 1
    path = write(tmp_path / "a.h5", mask=mask, scan=SAMPLES)
    np.testing.assert_array_equal(np.asarray(open_volume(path).array), SAMPLES)
    for volume in (open_volume(path, dataset="mask"), open_volume(write(tmp_path / "b.h5", mask=mask))):
        assert volume.array.dtype == np.uint8
        np.testing.assert_array_equal(np.asarray(volume.array), mask.astype(np.uint8))


def test_a_dataset_is_named_where_there_are_several(tmp_path: Path) -> None:
    path = write(tmp_path / "a.h5", **{"scan/ct": SAMPLES, "scan/mask": SAMPLES + 1})
    with pytest.raises(
        InputError, match=r"more than one dataset .*scan/ct \(9, 14, 20\), scan/mask.*--dataset"
    ):
        open_volume(path)
    with pytest.raises(InputError, match=r"no dataset 'pet'"):
        open_volume(path, dataset="pet")
    np.testing.assert_array_equal(np.asarray(open_volume(path, dataset="/scan/mask").array), SAMPLES + 1)


def test_channels_and_time_steps_are_chosen(tmp_path: Path) -> None:
    path = write(tmp_path / "a.h5", samples=np.stack([SAMPLES, SAMPLES + 1]))
    np.testing.assert_array_equal(np.asarray(open_volume(path, channel=1).array), SAMPLES + 1)
    np.testing.assert_array_equal(np.asarray(open_volume(path, time=1).array), SAMPLES + 1)
    with pytest.raises(InputError, match="2 channels"):
        open_volume(path)


def test_the_element_size_gives_the_spacing(tmp_path: Path) -> None:
    path = write(tmp_path / "a.h5", samples=SAMPLES)
    with h5py.File(path, "a") as file:
        file["samples"].attrs["element_size_um"] = [3.0, 2.0, 1.0]
    assert open_volume(path).spacing == (1, 2, 3)
    assert open_volume(path, spacing=(4, 5, 6)).spacing == (4, 5, 6)


@pytest.mark.parametrize(
    "stated",
    [[3.0, 2.0], [0.0, 1.0, 1.0], [1.0, -1.0, 1.0], [1.0, np.nan, 1.0], 2.0, "0.5 0.2 0.2", ["a", "b", "c"]],
)
def test_an_element_size_that_is_no_spacing_is_refused_unless_one_is_given(
    tmp_path: Path, stated: Any
) -> None:
    path = write(tmp_path / "a.h5", samples=SAMPLES)
    with h5py.File(path, "a") as file:
        file["samples"].attrs["element_size_um"] = stated
    with pytest.raises(
        InputError, match=r"a\.h5: /samples has element_size_um .*three numbers.*--spacing X,Y,Z"
    ):
        open_volume(path)
    assert open_volume(path, spacing=(4, 5, 6)).spacing == (4, 5, 6)


def test_a_damaged_chunk_is_an_error_when_it_is_read(tmp_path: Path) -> None:
    path = write(tmp_path / "a.h5", samples=SAMPLES)
    with h5py.File(path) as file:
        chunk = file["samples"].id.get_chunk_info(0)
    content = bytearray(path.read_bytes())
    content[chunk.byte_offset : chunk.byte_offset + 40] = bytes(40)
    path.write_bytes(content)
    volume = open_volume(path)
    with pytest.raises(
        InputError, match=r"a chunk of a\.h5 cannot be read \(.*\)\. .*fetch it again"
    ) as caught:
        np.asarray(volume.array)
    assert "\n" not in str(caught.value)


def test_threads_may_read_at_once(tmp_path: Path) -> None:
    volume = open_volume(write(tmp_path / "a.h5", samples=SAMPLES))
    with ThreadPoolExecutor(8) as pool:
        slices = list(pool.map(lambda z: volume.array[z], list(range(9)) * 5))
    np.testing.assert_array_equal(np.stack(slices[:9]), SAMPLES)


def test_a_damaged_file_and_one_without_a_volume_are_refused(tmp_path: Path) -> None:
    path = write(tmp_path / "a.h5", samples=SAMPLES)
    (tmp_path / "cut.h5").write_bytes(path.read_bytes()[:500])
    with pytest.raises(InputError, match=r"cut.h5 is no readable HDF5 file"):
        open_volume(tmp_path / "cut.h5")
    with pytest.raises(InputError, match=r"no dataset with three axes of numbers; it holds none"):
        open_volume(write(tmp_path / "flat.h5", samples=SAMPLES[0]))
    (tmp_path / "text.h5").write_text("no HDF5 at all")
    with pytest.raises(InputError, match=r"does not start like a HDF5 file"):
        open_volume(tmp_path / "text.h5")


def test_a_dataset_of_another_format_is_refused(tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", SAMPLES)
    with pytest.raises(InputError, match=r"no HDF5 file .*leave out --dataset x"):
        open_volume(tmp_path / "a.npy", dataset="x")


def test_the_identity_names_file_and_dataset(tmp_path: Path) -> None:
    path = write(tmp_path / "a.h5", one=SAMPLES, two=SAMPLES)
    one, two = (identity_of(open_volume(path, dataset=name).array) for name in ("one", "two"))
    assert one is not None
    assert one != two


def test_without_h5py_the_extra_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = write(tmp_path / "a.h5", samples=SAMPLES)
    monkeypatch.setitem(sys.modules, "h5py", None)
    with pytest.raises(MissingDependencyError, match=r"isosample\[hdf5\]"):
        open_volume(path)

"""A file is recognised by its content first; what cannot be opened is refused in one clear line."""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from isosample.errors import InputError, MissingDependencyError
from isosample.volume.readers import open_volume

SAMPLES = np.arange(24, dtype=np.float32).reshape(2, 3, 4)


def test_content_decides_over_the_suffix(tmp_path: Path) -> None:
    path = tmp_path / "a.raw"
    with path.open("wb") as stream:
        np.save(stream, SAMPLES)
    np.testing.assert_array_equal(open_volume(path).array, SAMPLES)


def test_an_npy_file_is_mapped(tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", SAMPLES)
    volume = open_volume(str(tmp_path / "a.npy"), spacing=(1, 2, 3))
    assert isinstance(volume.array, np.memmap)
    assert volume.spacing == (1, 2, 3)
    assert volume.name == "a.npy"


def test_an_npy_file_of_foreign_byte_order_is_converted(tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", SAMPLES.astype(">f4"))
    volume = open_volume(tmp_path / "a.npy")
    assert volume.array.dtype.isnative
    np.testing.assert_array_equal(volume.array, SAMPLES)


def test_channels_and_time_steps_of_an_npy_file_are_chosen(tmp_path: Path) -> None:
    samples = np.arange(5 * 24 * 2).reshape(5, 2, 3, 4, 2)
    np.save(tmp_path / "five.npy", samples)
    np.save(tmp_path / "time.npy", samples[..., 0])
    np.save(tmp_path / "channel.npy", samples[0])
    np.testing.assert_array_equal(
        open_volume(tmp_path / "five.npy", time=3, channel=1).array, samples[3, ..., 1]
    )
    np.testing.assert_array_equal(open_volume(tmp_path / "time.npy", time=4).array, samples[4, ..., 0])
    np.testing.assert_array_equal(open_volume(tmp_path / "channel.npy", channel=1).array, samples[0, ..., 1])
    with pytest.raises(InputError, match=r"--time N \(0 to 4\).*--channel N \(0 to 3\)"):
        open_volume(tmp_path / "time.npy")
    with pytest.raises(InputError, match="has 5 time steps; --time 5 must be 0 to 4"):
        open_volume(tmp_path / "time.npy", time=5)
    with pytest.raises(InputError, match=r"has 2 channels; a volume has one. Choose with --channel N"):
        open_volume(tmp_path / "five.npy", time=0)


def test_a_cut_npy_file_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.npy"
    np.save(path, SAMPLES)
    for length in (100, len(path.read_bytes()) - 4):
        path.write_bytes(path.read_bytes()[:length])
        with pytest.raises(InputError, match=r"a\.npy is no readable \.npy file"):
            open_volume(path)


def test_pickled_objects_are_refused(tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", np.array([[[None]]], dtype=object))
    with pytest.raises(InputError, match="no readable"):
        open_volume(tmp_path / "a.npy")


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"none\.nrrd does not exist"):
        open_volume(tmp_path / "none.nrrd")


def test_an_empty_file_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.nrrd").touch()
    with pytest.raises(InputError, match=r"a\.nrrd is empty"):
        open_volume(tmp_path / "a.nrrd")


def test_an_unknown_suffix_lists_the_known_ones(tmp_path: Path) -> None:
    (tmp_path / "a.xyz").write_bytes(b"what is this")
    with pytest.raises(InputError, match=r"known suffixes are \.nrrd, .*\.raw\.gz.*--shape"):
        open_volume(tmp_path / "a.xyz")


@pytest.mark.parametrize("suffix", [".nrrd", ".nii", ".nii.gz", ".vti", ".tif", ".npy", ".dcm"])
def test_content_that_belies_its_suffix_is_refused(tmp_path: Path, suffix: str) -> None:
    (tmp_path / f"a{suffix}").write_bytes(b"not what it says " * 40)
    with pytest.raises(InputError, match=r"does not start like a .* file"):
        open_volume(tmp_path / f"a{suffix}")


def test_a_shape_for_a_self_describing_file_is_refused(tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", SAMPLES)
    with pytest.raises(InputError, match=r"states its own size and type \(NumPy\); leave out --shape"):
        open_volume(tmp_path / "a.npy", shape=(4, 3, 2))


@pytest.mark.parametrize("spacing", [(1, 2), (1, "a", 2), 2.0, (1, 2, np.nan), (1, 0, 1)])
def test_a_spacing_that_is_no_three_lengths_is_refused(tmp_path: Path, spacing: Any) -> None:
    np.save(tmp_path / "a.npy", SAMPLES)
    with pytest.raises(InputError, match=r"spacing .* must be"):
        open_volume(tmp_path / "a.npy", spacing=spacing)


@pytest.mark.parametrize(
    "shape", [(4, 3), (4, "a", 2), 24, (4, 3, np.nan), (4, 3, np.inf), (4, 3, 0), (4, 3, 1.5)]
)
def test_a_shape_that_is_no_three_counts_is_refused(tmp_path: Path, shape: Any) -> None:
    (tmp_path / "a.raw").write_bytes(bytes(24))
    with pytest.raises(InputError, match=r"shape .* must be three whole numbers >= 1"):
        open_volume(tmp_path / "a.raw", shape=shape, dtype="u1")


def test_without_simpleitk_the_error_says_how_to_install_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "SimpleITK", None)
    (tmp_path / "a.nrrd").write_bytes(b"NRRD0004\nencoding: raw\n\n")
    with pytest.raises(MissingDependencyError, match=r'pip install "isosample\[medical\]"'):
        open_volume(tmp_path / "a.nrrd")
    with pytest.raises(MissingDependencyError, match="reading DICOM needs SimpleITK"):
        open_volume(tmp_path)


def test_every_refusal_is_one_line(tmp_path: Path) -> None:
    path = tmp_path / "a.npy"
    np.save(path, SAMPLES)
    path.write_bytes(path.read_bytes()[:90])
    with pytest.raises(InputError) as caught:
        open_volume(path)
    assert "\n" not in str(caught.value)


def test_a_volume_cannot_be_read_from_a_pipe(tmp_path: Path) -> None:
    pipe = tmp_path / "pipe.nrrd"
    os.mkfifo(pipe)
    for path, what in ((pipe, "a pipe or a device"), (Path("-"), "standard input")):
        with pytest.raises(
            InputError, match=f"is {what}, from which no volume can be read. Save it to a file"
        ):
            open_volume(path)


def test_a_file_called_like_standard_input_is_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    np.arange(27, dtype=np.uint8).tofile("-")
    assert open_volume("-", shape=(3, 3, 3), dtype="uint8").value_range == (0.0, 26.0)

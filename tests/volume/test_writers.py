"""Volume files that are written are read back as they were, and appear whole or not at all."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

import numpy as np
import pytest

from isosample.defaults import VOLUME_SUFFIXES
from isosample.errors import InputError, MissingDependencyError
from isosample.volume.grid import Volume
from isosample.volume.readers import open_volume
from isosample.volume.writers import check_can_write, save_volume, volume_suffix

if TYPE_CHECKING:
    from pathlib import Path

TURN = np.array([[0.8, -0.36, -0.48], [0.6, 0.48, 0.64], [0.0, -0.8, 0.6]])


@pytest.mark.parametrize("suffix", VOLUME_SUFFIXES)
@pytest.mark.parametrize("dtype", ["<u1", ">i2", "<f4", "<f8", "<f2"])
def test_what_is_written_is_read_back(tmp_path: Path, suffix: str, dtype: str) -> None:
    if suffix != ".npy":
        pytest.importorskip("SimpleITK")
    samples = (np.random.default_rng(1).random((4, 5, 6)) * 200).astype(dtype)
    volume = Volume(samples, spacing=(0.7, 1.0, 2.5), origin=(3.0, -4.5, 5.0), direction=TURN)
    path = tmp_path / f"scan{suffix}"
    path.write_bytes(b"what was there before")
    save_volume(volume, path)
    found = open_volume(path)
    assert np.array_equal(found.array, samples)
    assert [part.name for part in tmp_path.iterdir()] == [path.name]
    if suffix == ".npy":
        return
    rounding = 1e-6 if "nii" in suffix else 1e-12  # NIfTI keeps float32, turned into a quaternion and back
    assert found.spacing == pytest.approx(volume.spacing, rel=rounding)
    assert found.origin == pytest.approx(volume.origin, rel=rounding)
    assert np.abs(found.direction - TURN).max() <= rounding


def test_names_are_told_by_their_whole_suffix(tmp_path: Path) -> None:
    assert volume_suffix(tmp_path / "A.NII.GZ") == ".nii.gz"
    for name in ("scan.gz", "scan.tif", "scan", "nrrd"):
        with pytest.raises(
            InputError, match=rf"{name} is no volume file that can be written; it ends in .nrrd or"
        ):
            check_can_write(tmp_path / name)


def test_a_missing_simpleitk_is_told_and_numpy_files_need_none(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "SimpleITK", None)
    with pytest.raises(
        MissingDependencyError, match=r"writing out.nrrd needs SimpleITK.*isosample\[medical\]"
    ):
        check_can_write(tmp_path / "out.nrrd")
    check_can_write(tmp_path / "out.npy")


@pytest.mark.parametrize("suffix", VOLUME_SUFFIXES)
def test_a_file_that_cannot_be_written_is_told(tmp_path: Path, suffix: str) -> None:
    if suffix != ".npy":
        pytest.importorskip("SimpleITK")
    with pytest.raises(InputError, match="cannot be written: No such file or directory"):
        save_volume(Volume(np.zeros((2, 2, 2))), tmp_path / "absent" / f"out{suffix}")


@pytest.mark.parametrize("suffix", VOLUME_SUFFIXES)
def test_a_file_that_does_not_fit_is_told_with_the_reason_and_vanishes(tmp_path: Path, suffix: str) -> None:
    """The system's limit for the size of a file stands for a full disk; the NIfTI library does not notice either."""
    resource = pytest.importorskip("resource")
    if suffix != ".npy":
        pytest.importorskip("SimpleITK")
    volume = Volume(
        np.random.default_rng(2).random((40, 50, 60)).astype(np.float32)
    )  # 480 kB that hardly deflate
    path = tmp_path / f"out{suffix}"
    path.write_bytes(b"what was there before")
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, limits[1]))
    try:
        with pytest.raises(InputError) as told:
            save_volume(volume, path)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert str(told.value) == f"{path} cannot be written: File too large. Choose another path."
    assert path.read_bytes() == b"what was there before"
    assert [part.name for part in tmp_path.iterdir()] == [path.name]


def test_a_failure_without_a_reason_of_the_system_is_told_with_that_of_the_library(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    sitk = pytest.importorskip("SimpleITK")

    def refuse(*_: object, **__: object) -> None:
        raise RuntimeError("ITK ERROR: NrrdImageIO(0x1): the moon is full.")

    monkeypatch.setattr(sitk, "WriteImage", refuse)
    with pytest.raises(
        InputError, match=r"out.nrrd cannot be written: the moon is full\. Choose another path"
    ):
        save_volume(Volume(np.zeros((2, 2, 2))), tmp_path / "out.nrrd")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("patient", [False, True])
def test_an_nrrd_says_whether_its_axes_are_a_patients(tmp_path: Path, patient: bool) -> None:
    pytest.importorskip("SimpleITK")
    volume = Volume(
        np.zeros((3, 4, 5), np.uint8), (1.0, 2.0, 3.0), (3.0, -4.5, 5.0), TURN, patient_axes=patient
    )
    save_volume(volume, tmp_path / "scan.nrrd")
    found = open_volume(tmp_path / "scan.nrrd")
    assert found.patient_axes == patient
    assert found.origin == pytest.approx(volume.origin)
    np.testing.assert_allclose(found.direction, TURN, atol=1e-12)

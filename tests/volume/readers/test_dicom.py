"""A folder of DICOM slices becomes one volume, or says why it cannot."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from isosample.errors import InputError
from isosample.volume.readers import open_volume

if TYPE_CHECKING:
    from pathlib import Path

sitk = pytest.importorskip("SimpleITK")

SERIES = "1.2.826.0.1.3680043.2.1125.1"


def write_series(
    folder: Path, *, heights: list[float], uid: str = SERIES, shift: float = 0.0, first: int = 0
) -> np.ndarray:
    """Write one slice per height [mm] and return the samples (Z, Y, X)."""
    folder.mkdir(exist_ok=True)
    samples = np.random.default_rng(9).integers(0, 1000, (len(heights), 6, 5)).astype(np.int16)
    writer = sitk.ImageFileWriter()
    writer.KeepOriginalImageUIDOn()
    for k, height in enumerate(heights):
        image = sitk.GetImageFromArray(samples[k])
        image.SetSpacing((0.5, 0.75))
        entries = {
            "0008|0016": "1.2.840.10008.5.1.4.1.1.2",
            "0008|0018": f"{uid}.{k + 1}",
            "0008|0060": "CT",
            "0008|103e": "phantom",
            "0020|000e": uid,
            "0020|0013": str(k + 1),
            "0020|0032": f"{1 + shift * k}\\2\\{height}",
            "0020|0037": "1\\0\\0\\0\\1\\0",
        }
        for key, value in entries.items():
            image.SetMetaData(key, value)
        writer.SetFileName(str(folder / f"{first + (7 * k) % 10:03d}.dcm"))  # names out of order
        writer.Execute(image)
    return samples


def test_slices_are_sorted_by_position_and_placed(tmp_path: Path) -> None:
    samples = write_series(tmp_path, heights=[10.0, 12.5, 15.0, 17.5])
    volume = open_volume(tmp_path)
    np.testing.assert_array_equal(volume.array, samples)
    np.testing.assert_allclose(volume.spacing, (0.5, 0.75, 2.5), rtol=1e-12)
    assert volume.origin == (1, 2, 10)


@pytest.mark.parametrize("step", [0.0096, 0.00012, 3.3333])
def test_even_slices_are_even_however_thin(tmp_path: Path, step: float) -> None:
    write_series(tmp_path, heights=[round(1.0 + step * k, 6) for k in range(8)])
    assert open_volume(tmp_path).spacing[2] == pytest.approx(step, rel=1e-3)


def test_a_missing_slice_is_reported_not_bridged(tmp_path: Path) -> None:
    write_series(tmp_path, heights=[10.0, 12.5, 17.5, 20.0])
    with pytest.raises(InputError, match=r"slices 1 and 2 are 5 mm apart, most are 2\.5 mm"):
        open_volume(tmp_path)


def test_a_missing_slice_among_three_is_reported_by_a_distance_that_there_is(tmp_path: Path) -> None:
    write_series(tmp_path, heights=[10.0, 15.0, 17.5])
    with pytest.raises(InputError, match=r"slices 0 and 1 are 5 mm apart, most are 2\.5 mm"):
        open_volume(tmp_path)


def test_doubled_slices_are_reported(tmp_path: Path) -> None:
    write_series(tmp_path, heights=[10.0, 10.0, 12.5, 12.5, 15.0, 15.0])
    with pytest.raises(InputError, match="0 mm apart"):
        open_volume(tmp_path)


def test_slices_shifted_sideways_are_refused_as_sheared(tmp_path: Path) -> None:
    write_series(tmp_path, heights=[10.0, 12.5, 15.0], shift=0.3)
    with pytest.raises(InputError, match=r"shifted sideways \(a tilted gantry\); sheared grids"):
        open_volume(tmp_path)


def test_several_series_are_listed(tmp_path: Path) -> None:
    write_series(tmp_path, heights=[1.0, 2.0])
    write_series(tmp_path, heights=[1.0, 2.0, 3.0], uid="1.2.826.0.1.3680043.2.1125.2", first=100)
    with pytest.raises(InputError, match=r"holds 2 DICOM series: .*\(phantom, 2 slices\); .*3 slices\)"):
        open_volume(tmp_path)


def test_a_folder_without_dicom_is_refused(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "notes.txt").write_text("nothing here")
    with pytest.raises(InputError, match="holds no DICOM series"):
        open_volume(tmp_path)
    assert capfd.readouterr().err == ""


def test_a_single_slice_is_refused_and_its_folder_named(tmp_path: Path) -> None:
    write_series(tmp_path, heights=[1.0])
    with pytest.raises(InputError, match="a single DICOM slice; a volume needs at least two"):
        open_volume(tmp_path)
    with pytest.raises(InputError, match=r"is a single DICOM slice. Name its folder instead"):
        open_volume(tmp_path / "000.dcm")


def test_slices_with_unequal_rescale_slopes_are_not_truncated_to_the_first_ones_integers(
    tmp_path: Path,
) -> None:
    samples = write_series(tmp_path, heights=[10.0, 12.5, 15.0])
    slope = b"\x28\0\x53\x10\2\0\0\0"  # (0028,1053) in implicit representation: a decimal string of two bytes
    for path in tmp_path.iterdir():
        before, after = path.read_bytes().split(slope + b"1 ")
        if path.name != "000.dcm":
            path.write_bytes(before + slope + b".5" + after)
    volume = open_volume(tmp_path)
    np.testing.assert_array_equal(volume.array[0], samples[0])
    np.testing.assert_array_equal(volume.array[1:], samples[1:] * 0.5)  # half of odd integers is no integer

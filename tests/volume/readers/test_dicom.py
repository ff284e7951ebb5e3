"""A folder of DICOM slices becomes one volume, or says why it cannot."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
from dicom_files import write_series

from isosample.errors import InputError
from isosample.volume.readers import open_volume

if TYPE_CHECKING:
    from pathlib import Path

pytest.importorskip("SimpleITK")


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


@pytest.mark.parametrize("height", ["nan ", "inf ", "high"])
def test_a_position_that_is_no_number_is_told(tmp_path: Path, height: str) -> None:
    write_series(tmp_path, heights=[10.0, 12.5, 15.0])
    for path in tmp_path.iterdir():
        path.write_bytes(path.read_bytes().replace(b"\\2\\12.5", b"\\2\\" + height.encode()))
    reason = rf"\(.*{height.strip()}.*\)\. It may be damaged or incomplete"
    with pytest.raises(InputError, match=rf"{tmp_path.name} could not be read as DICOM {reason}"):
        open_volume(tmp_path)


@pytest.mark.parametrize("number", [0, 3])
@pytest.mark.parametrize("kept", [0.5, 0.999])
def test_a_cut_slice_at_an_end_of_the_stack_is_not_left_out(tmp_path: Path, number: int, kept: float) -> None:
    write_series(tmp_path, heights=[1.0, 2.0, 3.0, 4.0])
    (tmp_path / "notes.txt").write_text("no slice")
    (tmp_path / "more").mkdir()
    path = tmp_path / f"{7 * number % 10:03d}.dcm"
    content = path.read_bytes()
    path.write_bytes(content[: int(kept * len(content))])
    with pytest.raises(
        InputError, match=rf"{path.name} begins like a slice, but cannot be read\. It may be damaged"
    ):
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

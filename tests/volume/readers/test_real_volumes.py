"""Every real scan opens with the size, type, spacing and range that its table states."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from isosample.volume.readers import open_volume

if TYPE_CHECKING:
    from pathlib import Path

UNIT = (1.0, 1.0, 1.0)
# file, size (x, y, z), dtype, spacing, range; spacing and range as rounded in the table
SCANS: list[tuple[str, tuple[int, int, int], str, tuple[float, float, float], tuple[float, float]]] = [
    ("nucleon.nhdr", (41, 41, 41), "uint8", UNIT, (0, 249)),
    ("aneurism.raw.gz", (256, 256, 256), "uint8", UNIT, (0, 255)),
    ("engine.tif", (256, 256, 116), "uint8", UNIT, (0, 255)),
    ("carp.nii.gz", (256, 512, 256), "uint8", UNIT, (0, 254)),
    ("hydrogenatom.dat", (128, 128, 128), "uint8", UNIT, (0, 250)),
    ("hydrogen.vti", (64, 64, 64), "float32", UNIT, (0, 1)),
    ("embryo.nrrd", (256, 256, 256), "uint8", UNIT, (0, 197)),
    ("head_ct.nii.gz", (208, 256, 225), "float32", UNIT, (0, 0.9996)),
    ("HeadMRVolume.mhd", (48, 62, 42), "uint8", (4, 4, 4), (0, 255)),
    ("fetal_t2.nrrd", (117, 159, 126), "float32", (0.859, 0.859, 0.859), (0, 710.678)),
    ("brain_thick_slices.nrrd", (256, 256, 25), "int16", (0.78, 0.78, 6.5), (0, 3057)),
    ("vessels_mra.nii.gz", (200, 256, 120), "uint8", (0.521, 0.521, 0.65), (0, 254)),
    ("pet_dicom", (128, 128, 80), "float64", (3.54, 3.54, 3.37), (0, 47267.9)),
]


@pytest.mark.volumes
@pytest.mark.parametrize(
    ("name", "size", "dtype", "spacing", "value_range"), SCANS, ids=[s[0] for s in SCANS]
)
def test_a_real_scan_opens_as_its_table_states(
    real_volumes: Path,
    capfd: pytest.CaptureFixture[str],
    name: str,
    size: tuple[int, int, int],
    dtype: str,
    spacing: tuple[float, float, float],
    value_range: tuple[float, float],
) -> None:
    if not name.endswith((".raw.gz", ".vti", ".tif", ".dat")):
        pytest.importorskip("SimpleITK")
    bare = name.endswith(".raw.gz")
    volume = open_volume(real_volumes / name, shape=size if bare else None, dtype="uint8" if bare else None)
    assert volume.size_xyz == size
    assert volume.array.dtype == np.dtype(dtype)
    # the table rounds spacings to 2 or 3 decimals (3.375 is written 3.37), ranges to 6 digits
    np.testing.assert_allclose(volume.spacing, spacing, rtol=0, atol=6e-3)
    np.testing.assert_allclose(volume.value_range, value_range, rtol=2e-6)
    assert volume.name == name
    assert capfd.readouterr().err == ""


@pytest.mark.volumes
def test_the_thick_brain_keeps_its_flipped_axis(real_volumes: Path) -> None:
    pytest.importorskip("SimpleITK")
    volume = open_volume(real_volumes / "brain_thick_slices.nrrd")
    np.testing.assert_array_equal(volume.direction, np.diag([1.0, -1.0, 1.0]))
    # its header: origin y = 99.609375, step −0.78125: the box ends at 99.609375 − 255 · 0.78125 = −99.609375
    assert volume.box.corners()[:, 1].min() == pytest.approx(-99.609375, abs=1e-9)


@pytest.mark.volumes
def test_nifti_directions_come_in_lps(real_volumes: Path) -> None:
    pytest.importorskip("SimpleITK")
    # carp: the identity in NIfTI's RAS is diag(−1, −1, 1) in LPS
    np.testing.assert_array_equal(open_volume(real_volumes / "carp.nii.gz").direction, np.diag([-1, -1, 1]))

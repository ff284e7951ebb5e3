"""NRRD, NIfTI and MetaImage: mapped samples equal the library's, placement is LPS, damage is refused."""

from __future__ import annotations

import gzip
import struct
from typing import TYPE_CHECKING

import numpy as np
import pytest

from isosample.errors import InputError
from isosample.volume.readers import open_volume

if TYPE_CHECKING:
    from pathlib import Path

sitk = pytest.importorskip("SimpleITK")

TYPES = ["u1", "i1", "u2", "i2", "u4", "i4", "f4", "f8"]
MAPPED = ["a.nrrd", "a.nhdr", "a.mha", "a.mhd", "a.nii"]
DECODED = ["a.nrrd", "a.mha", "a.mhd", "a.nii.gz"]
TURN = (0.0, -1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0)
MIRROR = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, -1.0)


def samples_of(dtype: str, shape: tuple[int, ...] = (4, 5, 6)) -> np.ndarray:
    return np.random.default_rng(8).integers(0, 120, shape).astype(dtype)


def written(path: Path, samples: np.ndarray, *, compressed: bool = False, vector: bool = False) -> Path:
    image = sitk.GetImageFromArray(samples, isVector=vector)
    if image.GetDimension() == 3:
        image.SetSpacing((1.0, 2.0, 3.0))
        image.SetOrigin((10.0, 20.0, 30.0))
    sitk.WriteImage(image, str(path), compressed)
    return path


@pytest.mark.parametrize("name", MAPPED)
@pytest.mark.parametrize("dtype", TYPES)
def test_plain_samples_are_mapped_and_equal_the_librarys(tmp_path: Path, name: str, dtype: str) -> None:
    path = written(tmp_path / name, samples_of(dtype))
    volume = open_volume(path)
    assert isinstance(volume.array, np.memmap)
    assert volume.array.dtype == np.dtype(dtype)
    np.testing.assert_array_equal(volume.array, sitk.GetArrayFromImage(sitk.ReadImage(str(path))))
    assert volume.spacing == (1, 2, 3)
    assert volume.origin == (10, 20, 30)


@pytest.mark.parametrize("name", DECODED)
def test_compressed_samples_equal_what_was_written(tmp_path: Path, name: str) -> None:
    volume = open_volume(written(tmp_path / name, samples_of("i2"), compressed=True))
    np.testing.assert_array_equal(volume.array, samples_of("i2"))
    assert not isinstance(volume.array, np.memmap)


@pytest.mark.parametrize("name", MAPPED)
@pytest.mark.parametrize("direction", [TURN, MIRROR])
def test_directions_of_either_handedness_are_kept(
    tmp_path: Path, name: str, direction: tuple[float, ...]
) -> None:
    image = sitk.GetImageFromArray(samples_of("u1"))
    image.SetDirection(direction)
    sitk.WriteImage(image, str(tmp_path / name))
    volume = open_volume(tmp_path / name)
    # NIfTI stores the matrix in float32
    np.testing.assert_allclose(volume.direction, np.reshape(direction, (3, 3)), atol=1e-6)


@pytest.mark.parametrize("name", [*MAPPED, "a.nii.gz"])
def test_files_in_patient_coordinates_have_patient_axes(tmp_path: Path, name: str) -> None:
    volume = open_volume(written(tmp_path / name, samples_of("u1")))  # SimpleITK names the space of an NRRD
    spaced = open_volume(tmp_path / name, spacing=(1, 1, 2))
    for one in (volume, volume.in_memory(), spaced, spaced.in_memory()):
        assert one.patient_axes
        assert one.geometry.patient_axes
        assert one.box.patient_axes
    assert not volume.in_index_frame().box.patient_axes


@pytest.mark.parametrize(
    ("placement", "patient"),
    [
        ("spacings: 1 1 1", False),
        ("space dimension: 3\nspace directions: (1,0,0) (0,1,0) (0,0,1)", False),
        ("space: 3D-right-handed\nspace directions: (1,0,0) (0,1,0) (0,0,1)", False),
        ("space: right-anterior-superior\nspace directions: (1,0,0) (0,1,0) (0,0,1)", True),
        ("space: left-posterior-superior\nspace directions: (1,0,0) (0,1,0) (0,0,1)", True),
    ],
)
def test_an_nrrd_has_patient_axes_where_its_space_is_anatomical(
    tmp_path: Path, placement: str, patient: bool
) -> None:
    header = f"NRRD0004\ntype: uchar\ndimension: 3\nsizes: 2 2 2\n{placement}\nencoding: raw\n\n"
    (tmp_path / "a.nrrd").write_bytes(header.encode() + bytes(8))
    assert open_volume(tmp_path / "a.nrrd").patient_axes == patient


@pytest.mark.parametrize("name", ["a.nhdr", "a.mhd"])
def test_a_foreign_byte_order_is_converted(tmp_path: Path, name: str) -> None:
    path = written(tmp_path / name, samples_of("i2"))
    (tmp_path / "a.raw").write_bytes(samples_of(">i2").tobytes())
    text = path.read_text().replace("endian: little", "endian: big").replace("MSB = False", "MSB = True")
    path.write_text(text)
    volume = open_volume(path)
    assert volume.array.dtype.isnative
    np.testing.assert_array_equal(volume.array, samples_of("i2"))


@pytest.mark.parametrize("compressed", [False, True])
def test_a_scaled_nifti_gives_values_not_stored_samples(tmp_path: Path, compressed: bool) -> None:
    path = written(tmp_path / "a.nii", samples_of("u1"))
    content = bytearray(path.read_bytes())
    struct.pack_into("<2f", content, 112, 0.5, -3.0)  # slope, intercept
    path = tmp_path / ("b.nii.gz" if compressed else "b.nii")
    path.write_bytes(gzip.compress(content) if compressed else content)
    volume = open_volume(path)
    assert volume.array.dtype.kind == "f"
    np.testing.assert_array_equal(volume.array, samples_of("f4") * 0.5 - 3)  # exact: powers of two


@pytest.mark.parametrize("name", ["a.nrrd", "a.nii", "a.mha"])
def test_a_channel_of_a_vector_image_is_chosen(tmp_path: Path, name: str) -> None:
    samples = samples_of("f4", (4, 5, 6, 3))
    path = written(tmp_path / name, samples, vector=True)
    np.testing.assert_array_equal(open_volume(path, channel=1).array, samples[..., 1])
    with pytest.raises(InputError, match=r"has 3 channels; a volume has one.*--channel N \(0 to 2\)"):
        open_volume(path)
    with pytest.raises(InputError, match="--channel 3 must be 0 to 2"):
        open_volume(path, channel=3)


@pytest.mark.parametrize("name", ["a.nrrd", "a.nii", "a.nii.gz", "a.mha"])
def test_a_time_step_of_a_four_dimensional_image_is_chosen(tmp_path: Path, name: str) -> None:
    samples = samples_of("i2", (3, 4, 5, 6))
    path = written(tmp_path / name, samples)
    np.testing.assert_array_equal(open_volume(path, time=2).array, samples[2])
    with pytest.raises(InputError, match=r"has 3 time steps; a volume has one.*--time N \(0 to 2\)"):
        open_volume(path)


def test_a_two_dimensional_image_is_refused(tmp_path: Path) -> None:
    sitk.WriteImage(sitk.GetImageFromArray(np.zeros((4, 5), np.uint8)), str(tmp_path / "a.nrrd"))
    with pytest.raises(InputError, match="is a 2-dimensional image; a volume has three axes"):
        open_volume(tmp_path / "a.nrrd")


@pytest.mark.parametrize(("name", "compressed"), [(n, False) for n in MAPPED] + [(n, True) for n in DECODED])
@pytest.mark.parametrize("cut", [1, 60])
def test_a_file_that_ends_early_is_refused_without_a_word_on_standard_error(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], name: str, compressed: bool, cut: int
) -> None:
    path = written(tmp_path / name, samples_of("i2"), compressed=compressed)
    data = next((other for other in tmp_path.iterdir() if other != path), path)
    data.write_bytes(data.read_bytes()[:-cut])
    with pytest.raises(InputError, match=r"incomplete|damaged|need 240") as caught:
        open_volume(path)
    assert "\n" not in str(caught.value)
    assert capfd.readouterr().err == ""


@pytest.mark.parametrize("name", ["a.nhdr", "a.mhd"])
def test_data_beside_a_header_that_do_not_fit_it_are_said_to_be_of_another(tmp_path: Path, name: str) -> None:
    path = written(tmp_path / name, samples_of("i2"))
    data = next(other for other in tmp_path.iterdir() if other != path)
    for content in (data.read_bytes()[:-1], data.read_bytes() + b"x"):
        data.write_bytes(content)
        with pytest.raises(
            InputError, match=rf"{data.name} has .* does not belong to {path.name}, or is incomplete"
        ):
            open_volume(path)


@pytest.mark.parametrize("name", ["a.nrrd", "a.mha"])
def test_compressed_samples_that_are_too_few_are_said_to_be_incomplete(tmp_path: Path, name: str) -> None:
    path = written(tmp_path / name, samples_of("i2"), compressed=True)
    path.write_bytes(path.read_bytes().replace(b"6 5 4", b"6 5 5"))
    with pytest.raises(
        InputError, match=r"240 bytes when inflated; .* need 300\. The file is damaged or incomplete; fetch"
    ):
        open_volume(path)


@pytest.mark.parametrize("cut", [1, 60])
def test_a_scaled_nifti_that_ends_early_is_refused(tmp_path: Path, cut: int) -> None:
    path = written(tmp_path / "a.nii", samples_of("u1"))
    content = bytearray(path.read_bytes())
    struct.pack_into("<2f", content, 112, 0.5, 0.0)
    path.write_bytes(content[:-cut])
    with pytest.raises(InputError, match=rf"has {472 - cut} bytes; its sizes \(6, 5, 4\) need 472"):
        open_volume(path)


@pytest.mark.parametrize("name", ["a.nhdr", "a.mhd"])
@pytest.mark.parametrize("compressed", [False, True])
def test_an_absent_data_file_is_named(tmp_path: Path, name: str, compressed: bool) -> None:
    path = written(tmp_path / name, samples_of("u1"), compressed=compressed)
    data = next(other for other in tmp_path.iterdir() if other != path)
    data.unlink()
    with pytest.raises(InputError, match=rf"names the data file '{data.name}', which is not there"):
        open_volume(path)


def test_a_sheared_nrrd_is_refused(tmp_path: Path) -> None:
    path = written(tmp_path / "a.nhdr", samples_of("u1"))
    path.write_text(path.read_text().replace("(0,2,0)", "(1,2,0)"))
    with pytest.raises(InputError, match=r"not orthonormal; sheared grids are not supported"):
        open_volume(path)


def test_a_sheared_nifti_is_refused(tmp_path: Path) -> None:
    path = written(tmp_path / "a.nii", samples_of("u1"))
    content = bytearray(path.read_bytes())
    struct.pack_into("<2h", content, 252, 0, 2)  # no quaternion; the matrix decides
    struct.pack_into("<12f", content, 280, 1, 0.5, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0)
    path.write_bytes(content)
    with pytest.raises(InputError, match=r"a\.nii: its direction is not orthonormal; sheared grids"):
        open_volume(path)


def test_a_damaged_nifti_header_is_refused(tmp_path: Path) -> None:
    path = written(tmp_path / "a.nii", samples_of("u1"))
    content = bytearray(path.read_bytes())
    struct.pack_into("<8h", content, 40, 3, -5, 5, 4, 1, 1, 1, 1)
    path.write_bytes(content)
    with pytest.raises(InputError, match="damaged NIfTI header"):
        open_volume(path)


@pytest.mark.parametrize("offset", [np.nan, np.inf, -np.inf, -352.0])
def test_a_nifti_whose_samples_begin_nowhere_is_refused(tmp_path: Path, offset: float) -> None:
    path = written(tmp_path / "a.nii", samples_of("u1"))
    content = bytearray(path.read_bytes())
    struct.pack_into("<f", content, 108, offset)
    path.write_bytes(content)
    with pytest.raises(InputError, match=rf"a\.nii has a damaged NIfTI header \(vox_offset {offset:g}\)"):
        open_volume(path)


@pytest.mark.parametrize("name", ["a.nrrd", "a.nii.gz"])
def test_a_flipped_bit_in_compressed_samples_is_refused(tmp_path: Path, name: str) -> None:
    path = written(tmp_path / name, samples_of("i2"), compressed=True)
    content = bytearray(path.read_bytes())
    content[-30] ^= 1
    path.write_bytes(content)
    with pytest.raises(InputError, match="damaged or incomplete"):
        open_volume(path)

"""However a file is damaged, it is refused with one clear line or still opens; nothing else is raised."""

from __future__ import annotations

import gzip
import random
from typing import TYPE_CHECKING

import numpy as np
import pytest
import tifffile
from dicom_files import write_series
from vti_files import vti

from isosample.errors import InputError
from isosample.volume.readers import open_volume

if TYPE_CHECKING:
    from pathlib import Path

SAMPLES = np.random.default_rng(0).integers(0, 999, (4, 5, 6)).astype(np.uint16)
ITK_NAMES = ["a.nrrd", "b.nrrd", "a.mha", "b.mha", "a.nii", "b.nii.gz"]
COMPONENTS = 'NumberOfComponents="1"'
DAT = "ObjectFileName: a.raw\nResolution: 6 5 4\nSliceThickness: 1 2 3.5\nFormat: USHORT\nByteOrder: LittleEndian\n"


def written(path: Path) -> Path:
    """Write `SAMPLES`; names that begin with b are compressed."""
    compressed = path.name.startswith("b")
    if path.suffix == ".npy":
        np.save(path, SAMPLES)
    elif path.suffix == ".tif":
        tifffile.imwrite(path, SAMPLES, photometric="minisblack", compression="zlib" if compressed else None)
    elif path.suffix == ".vti":
        placement = 'Spacing="1 2 3" Origin="0 0 0"'
        form = path.stem[1:]
        path.write_bytes(
            vti(
                form,
                samples=SAMPLES,
                compressed=compressed,
                attributes=placement,
                array_attributes=COMPONENTS,
            )
        )
    elif path.suffix == ".dat":
        (path.parent / "a.raw").write_bytes(SAMPLES.tobytes())
        path.write_text(DAT)
    elif path.suffix == ".h5":
        with pytest.importorskip("h5py").File(path, "w") as file:
            options = {"chunks": (2, 5, 3), "compression": "gzip"} if compressed else {}
            file.create_dataset("scan/samples", data=SAMPLES, **options)
            file["scan/samples"].attrs["element_size_um"] = [3.0, 2.0, 1.0]
    elif path.suffix == ".zarr":
        write_image(path, version=2 if compressed else 3)
    elif path.suffix == ".dcm":
        write_series(path, heights=[1.0, 2.0, 3.0])
    else:
        sitk = pytest.importorskip("SimpleITK")
        sitk.WriteImage(sitk.GetImageFromArray(SAMPLES), str(path), compressed)
    return path


def write_image(folder: Path, version: int) -> None:
    """An OME-Zarr image with the axes t, c, z, y, x."""
    group = pytest.importorskip("zarr").open_group(folder, mode="w", zarr_format=version)
    options = {"shape": (1, 1, *SAMPLES.shape), "chunks": (1, 1, 2, 5, 3), "dtype": SAMPLES.dtype}
    group.create_array("fine", **options)[...] = SAMPLES[None, None]
    scale = {"type": "scale", "scale": [1, 1, 3, 2, 0.5]}
    datasets = [{"path": "fine", "coordinateTransformations": [scale]}]
    images = [{"axes": [{"name": name} for name in "tczyx"], "datasets": datasets}]
    group.attrs.update({"ome": {"multiscales": images}} if version == 3 else {"multiscales": images})


def messages_of_damage(path: Path, places: int, seed: int = 1) -> list[str]:
    """Messages with which 60 cut or altered versions of a file, or of one in a folder, are refused."""
    files = sorted(part for part in path.rglob("*") if part.is_file()) if path.is_dir() else [path]
    chance = random.Random(seed)
    messages = []
    for _ in range(60):
        file = chance.choice(files)
        content = file.read_bytes()
        altered = bytearray(content[: chance.choice([len(content), chance.randrange(1, len(content))])])
        for _ in range(chance.randrange(1, 4)):
            altered[chance.randrange(min(len(altered), places))] = chance.randrange(256)
        file.write_bytes(altered)
        try:
            np.asarray(open_volume(path).array)
        except InputError as error:
            messages.append(str(error))
        file.write_bytes(content)
    return messages


@pytest.mark.parametrize(
    "name",
    [
        "a.npy",
        "a.tif",
        "b.tif",
        *ITK_NAMES,
        "aascii.vti",
        "abinary.vti",
        "bbinary.vti",
        "araw.vti",
        "bbase64.vti",
        "a.dat",
    ],
)
def test_a_cut_or_altered_file_opens_or_is_refused_in_one_line(
    tmp_path: Path, name: str, capfd: pytest.CaptureFixture[str]
) -> None:
    messages = messages_of_damage(written(tmp_path / name), places=400)
    assert messages
    assert not any("\n" in message for message in messages)
    assert capfd.readouterr().err == ""


@pytest.mark.filterwarnings("ignore::UserWarning")  # zarr's, of what it does not recognise
@pytest.mark.parametrize("name", ["a.h5", "b.h5", "a.zarr", "b.zarr", "slices.dcm"])
def test_a_cut_or_altered_file_that_a_library_reads_is_refused_in_one_line(tmp_path: Path, name: str) -> None:
    messages = messages_of_damage(written(tmp_path / name), places=4000)
    assert messages
    assert not any("\n" in message for message in messages)


@pytest.mark.parametrize("name", ["b.nrrd", "b.nii.gz", "b.mha", "b.tif"])
def test_altered_samples_in_a_compressed_file_never_open_as_other_samples(tmp_path: Path, name: str) -> None:
    path = written(tmp_path / name)
    content = path.read_bytes()
    for place in range(len(content) - 100, len(content) - 8):
        altered = bytearray(content)
        altered[place] ^= 4
        path.write_bytes(altered)
        try:
            array = open_volume(path).array
        except InputError:
            continue
        np.testing.assert_array_equal(array, SAMPLES)


def test_an_unknown_flag_in_a_gzip_header_is_refused(tmp_path: Path) -> None:
    altered = bytearray(gzip.compress(bytes(8)))
    altered[2] = 7  # the only method is 8
    (tmp_path / "a.raw.gz").write_bytes(altered)
    with pytest.raises(InputError, match="damaged or incomplete compressed stream"):
        open_volume(tmp_path / "a.raw.gz", shape=(2, 2, 2), dtype="u1")

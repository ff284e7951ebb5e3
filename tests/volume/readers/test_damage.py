"""However a file is damaged, it is refused with one clear line or still opens; nothing else is raised."""

from __future__ import annotations

import gzip
import random
from typing import TYPE_CHECKING

import numpy as np
import pytest
import tifffile

from isosample.errors import InputError
from isosample.volume.readers import open_volume

if TYPE_CHECKING:
    from pathlib import Path

SAMPLES = np.random.default_rng(0).integers(0, 999, (4, 5, 6)).astype(np.uint16)
ITK_NAMES = ["a.nrrd", "b.nrrd", "a.mha", "b.mha", "a.nii", "b.nii.gz"]


def written(path: Path) -> Path:
    """Write `SAMPLES`; names that begin with b are compressed."""
    compressed = path.name.startswith("b")
    if path.suffix == ".npy":
        np.save(path, SAMPLES)
    elif path.suffix == ".tif":
        tifffile.imwrite(path, SAMPLES, photometric="minisblack", compression="zlib" if compressed else None)
    else:
        sitk = pytest.importorskip("SimpleITK")
        sitk.WriteImage(sitk.GetImageFromArray(SAMPLES), str(path), compressed)
    return path


@pytest.mark.parametrize("name", ["a.npy", "a.tif", "b.tif", *ITK_NAMES])
def test_a_cut_or_altered_file_opens_or_is_refused_in_one_line(
    tmp_path: Path, name: str, capfd: pytest.CaptureFixture[str]
) -> None:
    path = written(tmp_path / name)
    content = path.read_bytes()
    chance = random.Random(1)
    messages = []
    for _ in range(60):
        altered = bytearray(content[: chance.choice([len(content), chance.randrange(1, len(content))])])
        for _ in range(chance.randrange(1, 4)):
            altered[chance.randrange(min(len(altered), 400))] = chance.randrange(256)
        path.write_bytes(altered)
        try:
            open_volume(path)
        except InputError as error:
            messages.append(str(error))
    assert messages
    assert not any("\n" in message for message in messages)
    assert capfd.readouterr().err == ""


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

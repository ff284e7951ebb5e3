"""TIFF stacks: pages become slices, uncompressed ones are mapped, and ImageJ's and OME's spacing is kept."""

from __future__ import annotations

import importlib.util
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
import tifffile

from isosample.errors import InputError, MissingDependencyError
from isosample.volume.readers import open_volume

if TYPE_CHECKING:
    from pathlib import Path

SAMPLES = np.random.default_rng(6).integers(0, 60_000, (3, 4, 5), dtype=np.uint16)


def written(folder: Path, samples: np.ndarray = SAMPLES, **options: Any) -> Path:
    path: Path = folder / options.pop("name", "a.tif")
    tifffile.imwrite(path, samples, photometric=options.pop("photometric", "minisblack"), **options)
    return path


@pytest.mark.parametrize("byteorder", ["<", ">"])
@pytest.mark.parametrize("compression", [None, "zlib"])
@pytest.mark.parametrize("bigtiff", [False, True])
def test_a_stack_of_pages_is_a_volume(
    tmp_path: Path, byteorder: Any, compression: str | None, bigtiff: bool
) -> None:
    path = written(tmp_path, byteorder=byteorder, compression=compression, bigtiff=bigtiff)
    volume = open_volume(path)
    np.testing.assert_array_equal(volume.array, SAMPLES)
    assert volume.array.dtype.isnative
    assert volume.spacing == (1, 1, 1)
    assert isinstance(volume.array, np.memmap) == (compression is None and byteorder == "<")


def test_imagej_spacing_is_kept(tmp_path: Path) -> None:
    metadata = {"axes": "ZYX", "spacing": 3.5, "unit": "um"}
    path = written(tmp_path, imagej=True, resolution=(2, 4), metadata=metadata)  # pixels per unit
    assert open_volume(path).spacing == (0.5, 0.25, 3.5)
    assert open_volume(path, spacing=(1, 2, 3)).spacing == (1, 2, 3)


def test_ome_spacing_is_brought_to_one_unit(tmp_path: Path) -> None:
    metadata = {"axes": "ZYX", "PhysicalSizeX": 0.5, "PhysicalSizeY": 0.25, "PhysicalSizeZ": 2.0}
    path = written(tmp_path, name="a.ome.tif", metadata=metadata)
    assert open_volume(path).spacing == (0.5, 0.25, 2.0)
    nanometres = {"PhysicalSizeZ": 2000.0, "PhysicalSizeZUnit": "nm"}
    path = written(tmp_path, name="a.ome.tif", metadata=metadata | nanometres)
    assert open_volume(path).spacing == pytest.approx((0.5, 0.25, 2.0), rel=1e-15)
    path = written(tmp_path, name="a.ome.tif", metadata=metadata | {"PhysicalSizeZUnit": "parsec"})
    with pytest.raises(InputError, match=r"'parsec' is unknown. Give --spacing"):
        open_volume(path)
    assert open_volume(path, spacing=(1, 2, 3)).spacing == (1, 2, 3)


def test_plain_resolution_tags_give_only_the_ratio_of_y_to_x(tmp_path: Path) -> None:
    path = written(tmp_path, resolution=(72, 36), resolutionunit="INCH", metadata=None)
    assert open_volume(path).spacing == (1, 2, 1)


def test_a_channel_and_a_time_step_are_chosen(tmp_path: Path) -> None:
    samples = np.random.default_rng(1).integers(0, 255, (2, 3, 4, 5, 6), dtype=np.uint8)  # T Z C Y X
    path = written(tmp_path, samples, imagej=True, metadata={"axes": "TZCYX"})
    np.testing.assert_array_equal(open_volume(path, time=1, channel=3).array, samples[1, :, 3])
    with pytest.raises(InputError, match=r"has 4 channels.*--channel N"):
        open_volume(path, time=1)
    with pytest.raises(InputError, match=r"has 2 time steps.*--time N"):
        open_volume(path, channel=0)


def test_a_colour_is_chosen(tmp_path: Path) -> None:
    samples = np.random.default_rng(1).integers(0, 255, (3, 4, 5, 3), dtype=np.uint8)
    path = written(tmp_path, samples, photometric="rgb")
    np.testing.assert_array_equal(open_volume(path, channel=2).array, samples[..., 2])
    with pytest.raises(InputError, match="has 3 channels"):
        open_volume(path)


def test_a_stack_without_a_z_axis_is_refused(tmp_path: Path) -> None:
    path = written(tmp_path, imagej=True, metadata={"axes": "TYX"})
    with pytest.raises(InputError, match=r"axes TYX of lengths \(3, 4, 5\); a volume needs one z axis"):
        open_volume(path)


def test_several_series_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.tif"
    with tifffile.TiffWriter(path) as writer:
        writer.write(SAMPLES, photometric="minisblack")
        writer.write(SAMPLES[:, :2], photometric="minisblack")
    with pytest.raises(InputError, match="has 2 image series of shapes"):
        open_volume(path)


@pytest.mark.parametrize(
    ("compression", "kept"), [(None, 0.2), (None, 0.8), ("zlib", 0.2), ("zlib", 0.5), ("zlib", 0.98)]
)
def test_a_cut_stack_is_refused_without_a_word_on_standard_error(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], compression: str | None, kept: float
) -> None:
    samples = np.random.default_rng(6).integers(0, 60_000, (8, 30, 40), dtype=np.uint16)
    path = written(tmp_path, samples, compression=compression)
    content = path.read_bytes()
    path.write_bytes(content[: int(kept * len(content))])
    with pytest.raises(InputError, match=r"a\.tif could not be read as TIFF .* damaged or incomplete"):
        open_volume(path)
    assert capfd.readouterr().err == ""


def test_a_compression_that_needs_another_package_names_it(tmp_path: Path) -> None:
    if importlib.util.find_spec("imagecodecs") is not None:
        pytest.skip("imagecodecs is installed")
    path = written(tmp_path, SAMPLES, compression="zlib", metadata=None)
    with tifffile.TiffFile(path, mode="r+") as tiff:
        for page in tiff.pages:
            page.tags["Compression"].overwrite(5)  # type: ignore[union-attr]
    with pytest.raises(MissingDependencyError, match="pip install imagecodecs"):
        open_volume(path)

"""VTK images: every encoding of the same samples gives the same volume."""

from __future__ import annotations

import itertools
from typing import TYPE_CHECKING

import numpy as np
import pytest
from vti_files import SAMPLES, vti

from isosample.errors import InputError
from isosample.volume.readers import open_volume

if TYPE_CHECKING:
    from pathlib import Path


def opened(tmp_path: Path, content: bytes, **choice: int) -> np.ndarray:
    (tmp_path / "a.vti").write_bytes(content)
    return open_volume(tmp_path / "a.vti", **choice).array  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("form", "order", "word", "compressed"),
    [
        ("ascii", "<", "u4", False),
        *itertools.product(["binary", "raw", "base64"], "<>", ["u4", "u8"], [False, True]),
    ],
)
def test_each_encoding_gives_the_same_samples(
    tmp_path: Path, form: str, order: str, word: str, compressed: bool
) -> None:
    array = opened(tmp_path, vti(form, order=order, word=word, compressed=compressed))
    assert array.dtype == np.dtype(np.float32)
    assert array.dtype.isnative
    np.testing.assert_array_equal(array, SAMPLES)


@pytest.mark.parametrize("dtype", ["u1", "i1", "u2", "i2", "u4", "i4", "u8", "i8", "f4", "f8"])
def test_each_sample_type_is_kept(tmp_path: Path, dtype: str) -> None:
    samples = np.arange(24).reshape(2, 3, 4).astype(dtype)
    for form in ("ascii", "raw"):
        array = opened(tmp_path, vti(form, samples=samples))
        assert array.dtype == np.dtype(dtype)
        np.testing.assert_array_equal(array, samples)


def test_a_header_padded_as_a_base64_group_of_its_own_is_read(tmp_path: Path) -> None:
    np.testing.assert_array_equal(opened(tmp_path, vti("binary", split_groups=True)), SAMPLES)


def test_appended_raw_samples_are_mapped_not_copied(tmp_path: Path) -> None:
    array = opened(tmp_path, vti("raw"))
    assert not array.flags.owndata
    assert not array.flags.writeable


def test_placement_follows_origin_spacing_direction_and_extent(tmp_path: Path) -> None:
    content = vti("ascii", attributes='Origin="10 20 30" Spacing="2 3 4" Direction="0 -1 0 1 0 0 0 0 1"')
    content = content.replace(b'"0 4 0 3 0 2"', b'"1 5 0 3 0 2"')
    (tmp_path / "a.vti").write_bytes(content)
    volume = open_volume(tmp_path / "a.vti")
    assert volume.spacing == (2, 3, 4)
    # the first sample has index (1, 0, 0): scaled to (2, 0, 0), turned to (0, 2, 0)
    assert volume.origin == (10, 22, 30)
    np.testing.assert_array_equal(volume.box.edges[0], [0, 8, 0])


def test_a_negative_spacing_becomes_a_flipped_direction(tmp_path: Path) -> None:
    (tmp_path / "a.vti").write_bytes(vti("ascii", attributes='Spacing="1 -2 1"'))
    volume = open_volume(tmp_path / "a.vti")
    assert volume.spacing == (1, 2, 1)
    np.testing.assert_array_equal(volume.box.edges[1], [0, -6, 0])


def test_a_component_of_a_vector_array_is_chosen(tmp_path: Path) -> None:
    vectors = np.arange(3 * 24, dtype=np.int16).reshape(2, 3, 4, 3)
    content = vti("binary", samples=vectors, array_attributes='NumberOfComponents="3"')
    with pytest.raises(
        InputError, match=r"has 3 channels; a volume has one. Choose with --channel N \(0 to 2\)"
    ):
        opened(tmp_path, content)
    np.testing.assert_array_equal(opened(tmp_path, content, channel=2), vectors[..., 2])


def test_pieces_are_put_together(tmp_path: Path) -> None:
    def piece(low: int, high: int) -> str:
        values = " ".join(map(str, range(low, high + 1)))
        return (
            f'<Piece Extent="{low} {high} 0 0 0 0"><PointData><DataArray type="UInt8" format="ascii">'
            f"{values}</DataArray></PointData></Piece>"
        )

    whole = '<VTKFile type="ImageData"><ImageData WholeExtent="0 5 0 0 0 0">{}</ImageData></VTKFile>'
    array = opened(tmp_path, whole.format(piece(3, 5) + piece(0, 3)).encode())
    np.testing.assert_array_equal(array, [[np.arange(6)]])
    with pytest.raises(InputError, match="its pieces leave 2 of 6 samples out"):
        opened(tmp_path, whole.format(piece(0, 3)).encode())


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (b'type="ImageData"', b'type="PolyData"', None),
        (b"PointData", b"CellData", "only cell data"),
        (b'Scalars="v"', b'Scalars="w"', "none marked by Scalars"),
        (b'"Float32"', b'"String"', "type 'String' are not supported"),
        (b'WholeExtent="0 4', b'WholeExtent="0 5', "leave 12 of 72 samples out"),
        (b'Extent="0 4 0 3 0 2"', b'Extent="0 4 0 3 0 3"', "has 60 values; 5 × 4 × 4 samples"),
        (b'Extent="0 4', b'Extent="x 4', "must be 6 numbers"),
        (b'Extent="0 4', b'Extent="nan 4', "must be whole numbers"),
        (b'Extent="0 4', b'Extent="0.5 4', "must be whole numbers"),
        (b'Extent="0 4', b'Extent="0 1e20', "must be whole numbers"),
        (b'WholeExtent="0 4', b'WholeExtent="5 4', "WholeExtent '5 4 0 3 0 2' is empty"),
        (
            b'Piece Extent="0 4',
            b'Piece Extent="1 5',
            r"its piece '1 5 0 3 0 2' reaches outside .*'0 4 0 3 0 2'",
        ),
        (b'Piece Extent="0 4', b'Piece Extent="-1 3', "reaches outside"),
        (b'WholeExtent="0 4', b'WholeExtent="0 2000000000', "leave 23999999952 of 24000000012 samples out"),
        (
            b'Name="v"',
            b'Name="v" NumberOfComponents="x"',
            "NumberOfComponents 'x' must be a whole number >= 1",
        ),
        (
            b'Name="v"',
            b'Name="v" NumberOfComponents="0"',
            "NumberOfComponents '0' must be a whole number >= 1",
        ),
        (b"</ImageData>", b"", "no complete VTK XML file"),
        (b"<VTKFile", b"<!DOCTYPE x><VTKFile", "declares XML entities"),
        (b"ZLib", b"LZ4", "compressed by vtkLZ4DataCompressor, not by zlib"),
    ],
)
def test_a_vti_file_with_a_mistake_is_refused(
    tmp_path: Path, old: bytes, new: bytes, message: str | None
) -> None:
    content = vti("binary", compressed=True)
    assert old in content
    content = content.replace(old, new)
    if message is None:
        content = content.replace(b"<ImageData", b"<PolyData").replace(b"</ImageData", b"</PolyData")
        message = "holds 'PolyData', not ImageData"
    with pytest.raises(InputError, match=message):
        opened(tmp_path, content)


@pytest.mark.parametrize("form", ["raw", "base64"])
@pytest.mark.parametrize("compressed", [False, True])
def test_a_cut_vti_file_is_refused(tmp_path: Path, form: str, compressed: bool) -> None:
    content = vti(form, compressed=compressed)
    for cut in (60, 150, len(content) - content.find(b"_", content.find(b"<Appended")) - 3):
        with pytest.raises(InputError, match="damaged or incomplete"):
            opened(tmp_path, content[:-cut])

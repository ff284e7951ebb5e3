"""Headerless files are mapped or inflated, and a length that does not fit is refused with its arithmetic."""

from __future__ import annotations

import gzip
from typing import TYPE_CHECKING

import numpy as np
import pytest

from isosample.errors import InputError
from isosample.volume.readers import open_volume

if TYPE_CHECKING:
    from pathlib import Path

SHAPE = (4, 3, 2)
SAMPLES = np.arange(24, dtype=np.uint16).reshape(2, 3, 4) * 300
DAT = "ObjectFileName: a.raw\nResolution: 4 3 2\nSliceThickness: 1 2 3.5\nFormat: USHORT\n"


def test_a_raw_file_is_mapped_with_its_samples(tmp_path: Path) -> None:
    path = tmp_path / "a.raw"
    path.write_bytes(SAMPLES.astype("<u2").tobytes())
    volume = open_volume(path, shape=SHAPE, dtype="uint16", spacing=(1, 2, 3))
    assert isinstance(volume.array, np.memmap)
    np.testing.assert_array_equal(volume.array, SAMPLES)
    assert volume.spacing == (1, 2, 3)


def test_a_foreign_byte_order_is_converted(tmp_path: Path) -> None:
    path = tmp_path / "a.raw"
    path.write_bytes(SAMPLES.astype(">u2").tobytes())
    volume = open_volume(path, shape=SHAPE, dtype=">u2")
    assert volume.array.dtype == np.dtype(np.uint16)
    assert volume.array.dtype.isnative
    np.testing.assert_array_equal(volume.array, SAMPLES)


def test_an_unknown_suffix_is_raw_when_its_samples_are_described(tmp_path: Path) -> None:
    path = tmp_path / "a.volume"
    path.write_bytes(SAMPLES.astype("<u2").tobytes())
    np.testing.assert_array_equal(open_volume(path, shape=SHAPE, dtype="u2").array, SAMPLES)


def test_a_gzipped_raw_file_is_inflated(tmp_path: Path) -> None:
    path = tmp_path / "a.raw.gz"
    path.write_bytes(gzip.compress(SAMPLES.astype("<u2").tobytes()))
    np.testing.assert_array_equal(open_volume(path, shape=SHAPE, dtype="u2").array, SAMPLES)


@pytest.mark.parametrize("suffix", [".raw", ".raw.gz"])
@pytest.mark.parametrize("length", [47, 49])
def test_a_length_that_does_not_fit_is_spelled_out(tmp_path: Path, suffix: str, length: int) -> None:
    path = tmp_path / f"a{suffix}"
    path.write_bytes(gzip.compress(bytes(length)) if suffix.endswith("gz") else bytes(length))
    held = f"holds {length} bytes when inflated" if suffix.endswith("gz") else f"has {length} bytes"
    expected = rf"a{suffix} {held}; 4 × 3 × 2 samples of uint16 \(2 bytes each\) need 48\. Check --shape"
    with pytest.raises(InputError, match=expected):
        open_volume(path, shape=SHAPE, dtype="uint16")


def test_a_shape_beyond_what_gzip_can_hold_is_refused_before_memory_is_asked_for(tmp_path: Path) -> None:
    path = tmp_path / "a.raw.gz"
    path.write_bytes(gzip.compress(bytes(48)))
    with pytest.raises(InputError, match="can inflate to"):
        open_volume(path, shape=(100_000, 100_000, 100_000), dtype="uint8")


@pytest.mark.parametrize("damage", ["cut", "flipped"])
def test_a_damaged_gzip_file_is_refused(tmp_path: Path, damage: str) -> None:
    whole = bytearray(gzip.compress(np.random.default_rng(0).bytes(48)))
    whole[30] ^= 0xFF if damage == "flipped" else 0
    path = tmp_path / "a.raw.gz"
    path.write_bytes(whole[:-12] if damage == "cut" else whole)
    with pytest.raises(InputError, match=r"a\.raw\.gz holds a damaged or incomplete compressed stream"):
        open_volume(path, shape=SHAPE, dtype="uint16")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({}, "has no header; give its size and type, such as --shape 256,256,128 --dtype uint8"),
        ({"shape": SHAPE}, "has no header"),
        ({"shape": (4, 3), "dtype": "u1"}, r"shape \(4, 3\) must be three whole numbers"),
        ({"shape": (4, 3, 0), "dtype": "u1"}, "three whole numbers"),
        ({"shape": SHAPE, "dtype": "uchar8"}, "dtype 'uchar8' is unknown"),
        ({"shape": SHAPE, "dtype": "complex64"}, "no integer or float"),
        ({"shape": SHAPE, "dtype": "u2", "channel": 1}, "has one channel; leave out --channel 1"),
    ],
)
def test_a_missing_or_impossible_description_is_refused(
    tmp_path: Path, arguments: dict[str, object], message: str
) -> None:
    path = tmp_path / "a.raw"
    path.write_bytes(bytes(48))
    with pytest.raises(InputError, match=message):
        open_volume(path, **arguments)  # type: ignore[arg-type]


def test_a_dat_header_states_shape_type_and_spacing(tmp_path: Path) -> None:
    (tmp_path / "a.raw").write_bytes(SAMPLES.astype("<u2").tobytes())
    (tmp_path / "a.dat").write_text(DAT)
    volume = open_volume(tmp_path / "a.dat")
    assert isinstance(volume.array, np.memmap)
    np.testing.assert_array_equal(volume.array, SAMPLES)
    assert volume.spacing == (1, 2, 3.5)


def test_a_dat_headers_inviwo_keys_and_byte_order_are_understood(tmp_path: Path) -> None:
    (tmp_path / "b.raw").write_bytes(SAMPLES.astype(">u2").tobytes())
    (tmp_path / "a.dat").write_text(
        "# comment: 1\nRawfile: b.raw\nResolution: 4 3 2\nFormat: UINT16\nByteOrder: BigEndian\n"
    )
    np.testing.assert_array_equal(open_volume(tmp_path / "a.dat").array, SAMPLES)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("a.raw", "b.raw", r"a\.dat names the data file 'b\.raw', which is not there"),
        ("Resolution: 4 3 2\n", "", "lacks the entry resolution"),
        ("4 3 2", "4 3", r"Resolution '4 3' must be three numbers"),
        (
            "4 3 2",
            "4 3 3",
            r"a\.raw has 48 bytes; 4 × 3 × 3 samples .*\. Check Resolution and Format in a\.dat\.$",
        ),
        ("USHORT", "Vec3UINT8", "Format 'Vec3UINT8' is not supported; known are UCHAR"),
        ("Format", "ByteOrder: middle\nFormat", "ByteOrder 'middle'"),
        ("Format", "BasisVector1: 1 0 0\nFormat", "entry 'basisvector1' is not supported"),
    ],
)
def test_a_dat_header_with_a_mistake_is_refused_by_its_entry(
    tmp_path: Path, old: str, new: str, message: str
) -> None:
    (tmp_path / "a.raw").write_bytes(bytes(48))
    (tmp_path / "a.dat").write_text(DAT.replace(old, new))
    with pytest.raises(InputError, match=message):
        open_volume(tmp_path / "a.dat")


def test_a_binary_dat_file_is_recognised_as_bare_samples(tmp_path: Path) -> None:
    (tmp_path / "a.dat").write_bytes(b"\xff\xfe\xfd" * 16)
    with pytest.raises(InputError, match="give --shape and --dtype"):
        open_volume(tmp_path / "a.dat")
    assert open_volume(tmp_path / "a.dat", shape=SHAPE, dtype="u2").size_xyz == SHAPE

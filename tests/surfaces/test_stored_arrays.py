"""Arrays of an NPZ file in memory: as numpy reads them, or left to numpy."""

from __future__ import annotations

import io
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from isosample.surfaces.stored_arrays import stored_arrays


def archive(save: Any = np.savez, **arrays: Any) -> bytes:
    file = io.BytesIO()
    save(file, **arrays)
    return file.getvalue()


PLAIN: dict[str, npt.NDArray[Any]] = {
    "bytes": np.arange(7, dtype=np.uint8),
    "empty": np.empty(0, dtype=np.float32),
    "none_of_three": np.empty((0, 3), dtype=np.int64),
    "cube": np.random.default_rng(1).random((3, 4, 5)),
    "number": np.array(3.5),
    "flags": np.array([True, False]),
    "single": np.array([[1, -2]], dtype="<i2"),
}


def test_plain_arrays_come_as_numpy_reads_them_and_can_be_written() -> None:
    found = stored_arrays(archive(**PLAIN))
    assert found is not None
    assert list(found) == list(PLAIN)
    for name, expected in PLAIN.items():
        assert (found[name].dtype, found[name].shape) == (expected.dtype, expected.shape)
        assert found[name].tobytes() == expected.tobytes()
        assert found[name].flags.writeable


@pytest.mark.parametrize(
    "data",
    [
        b"",
        b"PK",
        archive(np.savez_compressed, **PLAIN),
        archive(turned=np.asfortranarray(PLAIN["cube"])),
        archive(swapped=np.arange(3, dtype=">f8")),
        archive(rows=np.zeros(2, dtype=[("a", "<i4"), ("b", "<f8")])),
        archive(text=np.array(["a", "bc"])),
        archive(**PLAIN) + b"behind",
    ],
    ids=["nothing", "start", "compressed", "columns first", "big-endian", "rows", "text", "longer"],
)
def test_anything_unusual_is_left_to_numpy(data: bytes) -> None:
    assert stored_arrays(data) is None


def test_no_flipped_bit_changes_an_array_and_every_truncation_is_left() -> None:
    data = archive(**PLAIN)
    expected = {name: (array.dtype, array.shape, array.tobytes()) for name, array in PLAIN.items()}
    refused = 0
    for place in range(len(data)):
        found = stored_arrays(data[:place] + bytes([data[place] ^ 1 << place % 8]) + data[place + 1 :])
        refused += found is None
        for name, array in (found or {}).items():
            if name in expected:  # a name is not covered by a checksum, but stands there twice
                assert (array.dtype, array.shape, array.tobytes()) == expected[name]
        assert found is None or set(found) == set(expected)
    assert refused > len(data) // 2
    assert all(stored_arrays(data[:length]) is None for length in range(len(data)))

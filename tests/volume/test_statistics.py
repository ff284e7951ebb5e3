"""The histogram counts each finite sample once, in bins that suit the sample type."""

from __future__ import annotations

import numpy as np
import pytest

from isosample.errors import InputError
from isosample.volume import statistics
from isosample.volume.grid import SampleArray, Volume
from isosample.volume.statistics import histogram


def test_integers_get_one_bin_per_value() -> None:
    counts, edges = histogram(Volume(np.array([[[3, 3, 5, 6]]], dtype=np.int16)), bins=2)
    np.testing.assert_array_equal(counts, [2, 0, 1, 1])
    np.testing.assert_array_equal(edges, [2.5, 3.5, 4.5, 5.5, 6.5])
    assert counts.dtype == np.int64
    assert edges.dtype == np.float64


def test_wide_integers_get_bins_of_equally_many_whole_values() -> None:
    samples = np.arange(10_000, dtype=np.int32).reshape(10, 10, 100)
    counts, edges = histogram(Volume(samples), bins=300)
    # 10000 / 300 is 34 values per bin, rounded up; 295 bins cover them, the last one holds 10000 − 294·34 = 4
    np.testing.assert_array_equal(counts, [34] * 294 + [4])
    np.testing.assert_array_equal(np.diff(edges), 34)


def test_floats_are_counted_without_those_that_are_not_finite() -> None:
    samples = np.array([[[0.0, 0.1, 0.9, 1.0, np.nan, np.inf]]], dtype=np.float32)
    counts, edges = histogram(Volume(samples), bins=4)
    np.testing.assert_array_equal(counts, [2, 0, 0, 2])
    np.testing.assert_array_equal(edges, [0, 0.25, 0.5, 0.75, 1])


def test_blocks_add_up_to_the_whole(monkeypatch: pytest.MonkeyPatch) -> None:
    samples = np.random.default_rng(0).normal(size=(16, 9, 11)).astype(np.float32)
    whole = histogram(Volume(samples), bins=32)[0]
    monkeypatch.setattr(statistics, "BLOCK_BYTES", 3 * samples[0].nbytes)
    np.testing.assert_array_equal(histogram(Volume(samples), bins=32)[0], whole)
    assert whole.sum() == samples.size


def test_a_constant_volume_fills_one_bin() -> None:
    counts, _ = histogram(Volume(np.full((2, 2, 2), 7.5)), bins=8)
    assert (counts.max(), counts.sum()) == (8, 8)


@pytest.mark.parametrize(
    "samples",
    [
        np.full((2, 2, 2), -1e20),
        np.linspace(1.0, 1.0 + 2.0**-51, 8).reshape(2, 2, 2),  # two steps of float64 at 1
    ],
    ids=["constant", "narrow"],
)
def test_values_that_float64_hardly_tells_apart_are_counted(samples: SampleArray) -> None:
    counts, edges = histogram(Volume(samples), bins=64)
    assert counts.sum() == 8
    assert (np.diff(edges) > 0).all()
    assert len(counts) <= 64


def test_no_bins_are_refused() -> None:
    with pytest.raises(InputError, match="0 bins"):
        histogram(Volume(np.zeros((1, 1, 1))), bins=0)

"""The histogram counts each finite sample once; typical gradients are those of the cells at a value."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest

from isosample.errors import InputError
from isosample.volume import statistics
from isosample.volume.grid import SampleArray, Volume
from isosample.volume.statistics import gradient_at_values, histogram


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


def linear_samples(
    slopes: tuple[float, float, float], shape: tuple[int, int, int] = (6, 7, 8)
) -> SampleArray:
    """Samples that rise by the slopes per step along x, y, z."""
    z, y, x = np.indices(shape, dtype=np.float64)
    samples: SampleArray = slopes[0] * x + slopes[1] * y + slopes[2] * z
    return samples


def rows(*samples: float, shape: tuple[int, int] = (3, 3)) -> npt.NDArray[np.float64]:
    """Volume samples that are the same along every row x."""
    return np.broadcast_to(np.array(samples), (*shape, len(samples))).copy()


def test_the_gradient_of_a_linear_field_is_its_slope_per_voxel() -> None:
    volume = Volume(linear_samples((2.0, -3.0, 6.0)), spacing=(0.1, 4.0, 1.0))
    assert gradient_at_values(volume, [0.5, 10.0]) == pytest.approx([7.0, 7.0], rel=1e-14)  # √(4 + 9 + 36)


def test_the_gradient_is_the_median_of_the_cells_that_straddle_the_value() -> None:
    volume = Volume(rows(0.0, 1.0, 4.0, 2.0, 2.0))
    # 0 < 0.5 <= 1 rises by 1; 1.5 lies on the cell from 1 to 4 alone; 2.5 also on the one from 4 to 2
    assert gradient_at_values(volume, [0.5, 1.5, 2.5]) == [1.0, 3.0, 2.5]


def test_a_value_that_no_cell_straddles_has_no_gradient() -> None:
    volume = Volume(rows(0, 0, 5))
    assert gradient_at_values(volume, [-1.0, 0.0, 5.0, 5.5]) == [None, None, 5.0, None]
    assert gradient_at_values(volume, []) == []


def test_integers_do_not_wrap_around() -> None:
    volume = Volume(rows(0, 255, 0).astype(np.uint8))
    assert gradient_at_values(volume, [100.0]) == [255.0]


def test_cells_with_a_sample_that_is_not_finite_are_left_out() -> None:
    samples = rows(0.0, 1.0, 2.0, 10.0, shape=(2, 2))
    samples[0, 0, 3] = np.nan
    assert gradient_at_values(Volume(samples), [1.5, 5.0]) == [1.0, None]


def test_a_single_slice_has_gradients_in_its_plane() -> None:
    volume = Volume(linear_samples((3.0, 4.0, 0.0), (1, 5, 5)))
    assert gradient_at_values(volume, [10.0]) == pytest.approx([5.0], rel=1e-14)


def test_few_cells_give_nearly_the_same_gradient(monkeypatch: pytest.MonkeyPatch) -> None:
    z, y, x = np.indices((40, 41, 42)) - 20.0
    volume = Volume(np.exp(-(x * x + y * y + z * z) / 200))
    # |∇ exp(−r²/2s²)| = r v / s² with s = 10; at v = 1/2 r = s √(2 ln 2)
    exact = 0.5 * np.sqrt(2 * np.log(2)) / 10
    for cells in (10**6, 5000):
        monkeypatch.setattr(statistics, "GRADIENT_CELLS", cells)
        # a cell's mean gradient differs from the point's by terms of (h/s)² = 1 %, times at most 1
        (typical,) = gradient_at_values(volume, [0.5])
        assert typical == pytest.approx(exact, rel=0.01)
        assert gradient_at_values(volume, [0.5]) == [typical]

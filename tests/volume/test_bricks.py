"""Bricks cover each cell once and their ranges miss no sample."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from isosample.errors import InputError
from isosample.volume.bricks import Brick, brick_ranges, bricks_of
from isosample.volume.grid import Volume

SIZES = st.tuples(*[st.integers(1, 12)] * 3)


@given(size_xyz=SIZES, cells=st.integers(1, 7))
def test_each_cell_lies_in_exactly_one_brick(size_xyz: tuple[int, int, int], cells: int) -> None:
    owners = np.zeros(tuple(n - 1 for n in reversed(size_xyz)), dtype=int)
    for brick in bricks_of(size_xyz, cells):
        z, y, x = brick.slices
        owners[z.start : z.stop - 1, y.start : y.stop - 1, x.start : x.stop - 1] += 1
    assert (owners == 1).all()


@given(size_xyz=SIZES, cells=st.integers(1, 7))
def test_each_sample_lies_in_some_brick(size_xyz: tuple[int, int, int], cells: int) -> None:
    seen = np.zeros(size_xyz[::-1], dtype=bool)
    for brick in bricks_of(size_xyz, cells):
        seen[brick.slices] = True
    assert seen.all()


def test_bricks_are_numbered_x_fastest_and_share_their_border_samples() -> None:
    assert bricks_of((6, 3, 3), cells=3) == [
        Brick(index=(0, 0, 0), start=(0, 0, 0), stop=(3, 2, 2)),
        Brick(index=(1, 0, 0), start=(3, 0, 0), stop=(5, 2, 2)),
    ]
    assert bricks_of((6, 3, 3), cells=3)[1].size_xyz == (3, 3, 3)


def test_a_whole_number_of_bricks_leaves_no_flat_brick_behind() -> None:
    assert [brick.stop for brick in bricks_of((129, 65, 65), cells=64)] == [(64, 64, 64), (128, 64, 64)]


@pytest.mark.parametrize("dtype", [np.uint8, np.int16, np.float32, np.float64])
def test_ranges_equal_the_extremes_of_each_bricks_samples(dtype: type[np.generic]) -> None:
    samples = np.random.default_rng(3).integers(0, 200, (9, 7, 11)).astype(dtype)
    bricks = bricks_of((11, 7, 9), cells=4)
    ranges = brick_ranges(Volume(samples), bricks)
    assert ranges.dtype == np.float64
    for brick, (low, high) in zip(bricks, ranges, strict=True):
        assert (low, high) == (samples[brick.slices].min(), samples[brick.slices].max())


def test_ranges_pass_over_samples_that_are_not_finite() -> None:
    samples = np.zeros((2, 2, 5))
    samples[..., :2] = np.nan  # the first brick holds x = 0, 1, 2
    samples[0, 0, 2], samples[1, 1, 4] = 3.0, np.inf
    ranges = brick_ranges(Volume(samples), bricks_of((5, 2, 2), cells=2))
    np.testing.assert_array_equal(ranges, [[0, 3], [0, 3]])


def test_a_brick_without_a_finite_sample_gets_the_empty_range() -> None:
    samples = np.zeros((2, 2, 3), dtype=np.float32)
    samples[..., :2] = np.nan
    ranges = brick_ranges(Volume(samples), bricks_of((3, 2, 2), cells=1))
    np.testing.assert_array_equal(ranges, [[np.inf, -np.inf], [0, 0]])


def test_integers_that_float64_cannot_hold_are_rounded_outward() -> None:
    # 2**53 + 1 lies halfway between two float64; the nearest is 2**53, which would exclude it from above
    samples = np.array([[[2**53 + 1, 2**53 + 1]]], dtype=np.int64)
    ((low, high),) = brick_ranges(Volume(samples), bricks_of((2, 1, 1)))
    assert (low, high) == (2.0**53, 2.0**53 + 2)


def test_a_brick_outside_the_volume_is_refused() -> None:
    with pytest.raises(InputError, match=r"brick \(0, 0, 0\) ends at sample \(4, 4, 4\), outside array"):
        brick_ranges(Volume(np.zeros((3, 3, 3))), bricks_of((5, 5, 5)))


@pytest.mark.parametrize(("size", "cells"), [((3, 3, 3), 0), ((3, 0, 3), 4)])
def test_impossible_bricks_are_refused(size: tuple[int, int, int], cells: int) -> None:
    with pytest.raises(InputError):
        bricks_of(size, cells)

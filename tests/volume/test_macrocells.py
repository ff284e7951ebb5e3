"""Macrocells bound the field, show what can be seen, and leaps over empty ones touch nothing occupied."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from isosample.errors import InputError
from isosample.volume import macrocells as module
from isosample.volume.grid import Volume
from isosample.volume.macrocells import MacrocellGrid
from isosample.volume.reconstruction import GridSpline, Reconstruction

if TYPE_CHECKING:
    import numpy.typing as npt

    from isosample.volume.grid import F64
    from isosample.volume.macrocells import Bools

U = 2.0**-53
SHAPES = st.tuples(*[st.integers(2, 9)] * 3)


def build(
    samples: F64, reconstruction: Reconstruction = Reconstruction.TRILINEAR, count: int = 64
) -> MacrocellGrid:
    return MacrocellGrid.build(Volume(samples), reconstruction, count)


def random_samples(shape: tuple[int, ...], seed: int = 1) -> F64:
    return np.random.default_rng(seed).normal(size=shape)


def field_at(volume: Volume, reconstruction: Reconstruction, places: F64) -> F64:
    """The reconstruction at index coordinates (x, y, z)."""
    if reconstruction.smooth:
        return GridSpline.build(volume, reconstruction).evaluate(places)[0]
    from scipy.interpolate import RegularGridInterpolator

    axes = [np.arange(count, dtype=np.float64) for count in volume.array.shape]
    found: F64 = RegularGridInterpolator(axes, volume.array)(places[:, ::-1])
    return found


@given(
    shape=SHAPES,
    count=st.integers(1, 10),
    reconstruction=st.sampled_from(list(Reconstruction)),
    seed=st.integers(0, 10**6),
)
def test_the_field_in_a_macrocell_lies_within_its_bounds(
    shape: tuple[int, int, int], count: int, reconstruction: Reconstruction, seed: int
) -> None:
    """At random places, at samples, and on the faces between macrocells, which belong to both."""
    volume = Volume(random_samples(shape, seed))
    grid = MacrocellGrid.build(volume, reconstruction, count)
    rng, last = np.random.default_rng(seed), np.array(shape[::-1]) - 1.0
    places = rng.random((200, 3)) * last
    places[::2] = np.round(places[::2])
    places[1::4, 0] = np.round(places[1::4, 0])
    values = field_at(volume, reconstruction, places)
    # An evaluation takes 30 roundings of weights that sum to 64/27 at most, of the largest bound.
    rounding = 30 * U * 64 / 27 * max(np.abs(grid.low).max(), np.abs(grid.high).max())
    for offset in (0.0, 1e-9):  # a place on a face belongs to the macrocell before, too
        cell = np.maximum(np.floor((places - offset) / grid.cells).astype(int), 0)
        x, y, z = np.minimum(cell, np.array(grid.low.shape[::-1]) - 1).T
        assert (values >= grid.low[z, y, x] - rounding).all()
        assert (values <= grid.high[z, y, x] + rounding).all()


@given(shape=SHAPES, count=st.integers(1, 10))
def test_bounds_of_the_trilinear_field_are_those_of_its_samples(
    shape: tuple[int, int, int], count: int
) -> None:
    samples = random_samples(shape)
    grid = build(samples, count=count)
    assert max(grid.low.shape) <= count
    for z, y, x in np.ndindex(*grid.low.shape):
        block = samples[tuple(slice(grid.cells * n, grid.cells * (n + 1) + 1) for n in (z, y, x))]
        assert (grid.low[z, y, x], grid.high[z, y, x]) == (block.min(), block.max())


def test_macrocells_cover_every_cell_once_and_no_more() -> None:
    """100 cells: 64 macrocells cannot hold them with one cell, so two; the other axes follow the longest."""
    grid = build(np.zeros((101, 4, 1)))
    assert grid.cells == 2
    assert grid.low.shape == (50, 2, 1)


def test_bounds_of_a_smooth_field_are_reached_where_weights_are_negative() -> None:
    """Signs that alternate: in the middle of a cell all weights of bc21 add up, (4 / 3)³ of the samples."""
    z, y, x = np.indices((6, 6, 6))
    signs = (-1.0) ** (x + y + z)
    grid = build(signs, Reconstruction.BC21, 1)
    assert grid.high.item() >= (4.0 / 3.0) ** 3 * (1.0 - 100 * U)
    spline = GridSpline.build(Volume(signs), Reconstruction.BC21)
    assert (grid.low.item(), grid.high.item()) == spline.value_range


def test_bounds_are_local() -> None:
    """One bright sample is seen in the eight macrocells that touch it, and by a spline one sample further away."""
    samples = np.zeros((9, 9, 9))
    samples[4, 4, 4] = 1.0
    assert np.argwhere(build(samples, count=4).high == 1.0).tolist() == [
        [z, y, x] for z in (1, 2) for y in (1, 2) for x in (1, 2)
    ]
    samples[4, 4, 4], samples[5, 4, 4] = 0.0, 1.0
    bright = build(samples, Reconstruction.BSPLINE, 4).high == 1.0
    assert np.flatnonzero(bright.any(axis=(1, 2))).tolist() == [1, 2, 3]


def test_samples_that_are_not_finite_are_left_out() -> None:
    samples = np.arange(27.0).reshape(3, 3, 3)
    samples[0, 0, 0], samples[2, 2, 2], samples[1, 1, 1] = np.nan, np.inf, -np.inf
    grid = build(samples, count=2)
    assert grid.low.min() == 1.0
    assert grid.high.max() == 25.0
    samples[:2, :2, :2] = np.nan
    grid = build(samples, count=2)
    assert (grid.low[0, 0, 0], grid.high[0, 0, 0]) == (np.inf, -np.inf)
    assert not grid.occupancy([[-1e300, 1e300]])[0, 0, 0]
    assert grid.occupancy([[-1e300, 1e300]]).sum() == 7
    assert grid.deviation[0, 0, 0] == 0.0


@given(
    intervals=arrays(np.float64, (5, 2), elements=st.integers(-3, 12)),
    seed=st.integers(0, 1000),
)
def test_a_macrocell_is_occupied_if_it_meets_an_interval(intervals: F64, seed: int) -> None:
    """Whole numbers, so that ends meet often; intervals overlap, touch, and may be points."""
    intervals = np.sort(intervals, axis=1)
    grid = build(np.random.default_rng(seed).integers(0, 10, (6, 5, 4)).astype(np.float64))
    expected = np.zeros(grid.low.shape, dtype=bool)
    for first, last in intervals:
        expected |= (grid.low <= last) & (grid.high >= first)
    assert np.array_equal(grid.occupancy(intervals), expected)
    assert not grid.occupancy(np.empty((0, 2))).any()


@given(occupied=arrays(np.bool_, (5, 6, 7), elements=st.floats(0, 1).map(lambda part: part > 0.95)))
def test_leaps_touch_no_occupied_macrocell_and_are_as_long_as_can_be(occupied: Bools) -> None:
    leaps = build(np.zeros((2, 2, 2))).leaps(occupied)
    assert leaps.shape == (8, *occupied.shape)
    for octant in range(8):
        ascends = [bool(octant & bit) for bit in (4, 2, 1)]  # along z, y, x
        for place in np.ndindex(*occupied.shape):
            leap = int(leaps[octant][place])
            assert (leap == 0) == occupied[place]
            assert not occupied[_cube(place, ascends, leap)].any()
            if leap < module.LARGEST_LEAP:
                assert occupied[_cube(place, ascends, leap + 1)].any()


def _cube(place: tuple[int, ...], ascends: list[bool], edge: int) -> tuple[slice, ...]:
    """Macrocells from one on, along every axis upwards or downwards, as far as the grid goes."""
    return tuple(
        slice(n, n + edge) if up else slice(max(n - edge + 1, 0), n + 1)
        for n, up in zip(place, ascends, strict=True)
    )


def test_leaps_stop_at_what_four_bits_hold() -> None:
    assert module.LARGEST_LEAP == 2**4 - 1
    occupied = np.zeros((1, 1, 40), dtype=np.bool_)
    occupied[0, 0, 0] = True
    leaps = build(np.zeros((2, 2, 2))).leaps(occupied)
    for octant in range(8):
        behind = [0] + [15] * 39  # nothing but the border is ahead, or the one that is occupied
        assert leaps[octant, 0, 0].tolist() == (behind if octant & 1 else [min(n, 15) for n in range(40)])


def test_another_transfer_function_reads_no_sample() -> None:
    samples = random_samples((9, 9, 9))
    grid = build(samples, count=4)
    before = grid.occupancy([[0.5, 0.6]])
    samples[...] = 1e6
    assert np.array_equal(grid.occupancy([[0.5, 0.6]]), before)
    gone = replace(grid, volume=Volume(np.zeros((1, 1, 1))))
    assert np.array_equal(gone.occupancy([[0.5, 0.6]]), before)
    assert np.array_equal(gone.leaps(before), grid.leaps(before))


def test_the_deviation_is_that_of_the_corners_of_the_worst_cell() -> None:
    samples = random_samples((7, 6, 5)) * 1e-3 + 5.0
    grid = build(samples, count=2)
    corners = np.lib.stride_tricks.sliding_window_view(samples, (2, 2, 2)).reshape(6, 5, 4, 8)
    cells = corners.std(axis=-1) / samples.std()
    for z, y, x in np.ndindex(*grid.low.shape):
        block = cells[tuple(slice(grid.cells * n, grid.cells * (n + 1)) for n in (z, y, x))]
        # Variances, of numbers in [0, 1] after scaling, are off by some 20 roundings; the root of one below 0.01.
        assert grid.deviation[z, y, x] == pytest.approx(block.max(), rel=1e-10)


def test_multipliers_are_whole_and_grow_where_the_field_is_smooth() -> None:
    """M = 2 / m + 1: a checkerboard's cells vary as the volume does, m = 1, M = 3; a constant part has the largest."""
    z, y, x = np.indices((9, 9, 9))
    board = np.where(x <= 4, (-1.0) ** (x + y + z), -1.0)
    grid = build(board, count=2)
    m = 1.0 / board.std()
    assert grid.deviation[:, :, 0] == pytest.approx(m)
    assert (grid.multipliers[:, :, 0] == round(2.0 / m + 1.0)).all()
    assert (build(np.full((5, 5, 5), 7.0), count=2).multipliers == 16).all()
    steep = np.zeros((9, 9, 9))
    steep[0, 0, 0] = 1.0  # m = 8.9 in its macrocell, 0 elsewhere
    found = build(steep, count=2).multipliers
    assert found[0, 0, 0] == 1
    assert np.bincount(found.ravel())[16] == 7


def test_whole_numbers_and_files_give_the_bounds_of_floats(tmp_path: object) -> None:
    samples = np.random.default_rng(3).integers(0, 4000, (17, 9, 12)).astype(np.uint16)
    mapped = np.memmap(f"{tmp_path}/samples.raw", dtype=np.uint16, mode="w+", shape=samples.shape)
    mapped[...] = samples
    plain = build(samples.astype(np.float64), count=5)
    for array in (samples, mapped):
        grid = MacrocellGrid.build(Volume(array), Reconstruction.TRILINEAR, 5)
        assert np.array_equal(grid.low, plain.low)
        assert np.array_equal(grid.high, plain.high)
        assert np.array_equal(grid.multipliers, plain.multipliers)


def test_a_wrong_window_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    """Without the samples that macrocells share the bounds are too narrow."""
    over = module._over_windows
    monkeypatch.setattr(
        module,
        "_over_windows",
        lambda ufunc, rows, shape, cells, _width: over(ufunc, rows, shape, cells, cells),
    )
    with pytest.raises(AssertionError):
        test_bounds_are_local()


@pytest.mark.parametrize(
    ("intervals", "message"),
    [
        ([1.0, 2.0], r"shape \(2,\); expected \(N, 2\)"),
        ([[0.0, 1.0], [2.0, 1.0]], r"intervals\[1\] is \[2.0, 1.0\]"),
        ([[0.0, np.nan]], r"intervals\[0\]"),
    ],
)
def test_what_is_no_interval_is_refused(intervals: npt.ArrayLike, message: str) -> None:
    with pytest.raises(InputError, match=message):
        build(np.zeros((2, 2, 2))).occupancy(intervals)


def test_wrong_divisions_are_refused() -> None:
    with pytest.raises(InputError, match="0 macrocells"):
        build(np.zeros((2, 2, 2)), count=0)
    with pytest.raises(InputError, match="two along every axis"):
        build(np.zeros((2, 1, 2)), Reconstruction.CUBIC)


def test_known_bounds_are_taken_where_they_are_those_that_are_asked_for() -> None:
    volume = Volume(np.random.default_rng(5).normal(size=(9, 8, 7)))
    known = MacrocellGrid.build(volume, Reconstruction.CUBIC, 4)
    assert MacrocellGrid.build(volume, Reconstruction.CUBIC, 4, known=known) is known
    for other, reconstruction, count in (
        (Volume(volume.array), Reconstruction.CUBIC, 4),
        (volume, Reconstruction.BSPLINE, 4),
        (volume, Reconstruction.CUBIC, 2),
    ):
        built = MacrocellGrid.build(other, reconstruction, count, known=known)
        assert (built.volume, built.reconstruction) == (other, reconstruction)
        expected = MacrocellGrid.build(other, reconstruction, count)
        np.testing.assert_array_equal(built.low, expected.low)
        assert built is not known

"""Bands of normalised values give the transfer function back, with one band for every value."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from isosample.transfer.transfer_function import ControlPoint, Isosurface, TransferFunction
from isosample.transfer.value_bands import HIGHEST, LOWEST, ValueBands

RED, BLUE = (1.0, 0.0, 0.0), (0.0, 0.0, 1.0)
STEP = TransferFunction(
    [
        ControlPoint(10.0, RED, 1.0),
        ControlPoint(20.0, BLUE, 3.0),
        ControlPoint(20.0, RED, 5.0),
        ControlPoint(30.0, BLUE, 2.0),
    ],
    [Isosurface(15.0, BLUE, 0.5), Isosurface(30.0, RED, 0.25)],
)


def bands(transfer_function: TransferFunction = STEP) -> ValueBands:
    """Bands for values in [10, 30]."""
    return ValueBands.of(transfer_function, 10.0, 1.0 / 20.0)


@given(st.floats(0.0, 60.0))
def test_optics_are_those_of_the_transfer_function(value: float) -> None:
    normalised = np.float32((value - 10.0) / 20.0)
    data_value = 10.0 + 20.0 * float(normalised)
    color, extinction = STEP.evaluate(data_value)
    found = bands().evaluate(float(normalised))
    # The ends of bands are rounded to float32: 2^-25 of a slope of at most 8 extinction per unit, and the last point is
    # raised by 2^-23.
    if data_value <= 30.0 or data_value > 30.0 + 20.0 * 2.0**-23:
        assert found[3] == pytest.approx(float(extinction), abs=8.0 * 2.0**-23)
    if extinction > 0.0:
        np.testing.assert_allclose(found[:3], color, atol=2.0**-20)


def test_a_value_equal_to_a_step_belongs_to_the_band_above_and_the_last_point_to_the_one_below() -> None:
    assert bands().evaluate(0.5).tolist() == [1.0, 0.0, 0.0, 5.0]
    assert bands().evaluate(1.0).tolist() == pytest.approx([0.0, 0.0, 1.0, 2.0], abs=1e-6)
    assert bands().evaluate(0.0).tolist() == [1.0, 0.0, 0.0, 1.0]
    assert bands().evaluate(np.nextafter(np.float32(0.0), np.float32(-1.0)))[3] == 0.0


def test_an_isosurface_at_the_last_point_lies_below_its_closing_level() -> None:
    levels, impulses = bands().levels, bands().impulses
    assert levels[-2] == 1.0
    assert levels[-1] == 1.0 + 2.0**-23
    assert impulses[-2].tolist() == [1.0, 0.0, 0.0, 0.25]
    assert impulses[-1].tolist() == [0.0, 0.0, 0.0, 0.0]


def test_a_last_point_at_zero_is_raised_by_more_than_a_subnormal_number() -> None:
    transfer_function = TransferFunction([ControlPoint(-1.0, RED, 0.0), ControlPoint(10.0, RED, 1.0)])
    assert bands(transfer_function).levels[-1] == 2.0**-24


def points_of(*points: tuple[float, float]) -> list[ControlPoint]:
    """Red control points from (value, extinction)."""
    return [ControlPoint(value, RED, extinction) for value, extinction in points]


def integral(found: ValueBands) -> float:
    """Integral of the extinction over the normalised value."""
    return float((np.diff(found.ends, axis=1)[:, 0] * found.optics[:, :, 3].mean(axis=1)).sum())


@pytest.mark.parametrize("centre", [0.1, 0.5, 0.9, 1.0 - 2.0**-24])
@pytest.mark.parametrize("width", [1e-4, 1e-8, 1e-12])
def test_a_peak_keeps_its_integral_however_narrow(centre: float, width: float) -> None:
    peak = [(centre - width / 2, 0.0), (centre, 3.0 / width), (centre + width / 2, 0.0)]
    found = ValueBands.of(TransferFunction(points_of((0, 0), *peak, (2.0, 0))), 0.0, 1.0)
    # a triangle; the places of its corners are rounded by 2^-53 each, twice that of its width
    assert integral(found) == pytest.approx(1.5, rel=2.0**-51 / width)
    assert (np.diff(found.levels) > 0.0).all()
    # one step of float32 for each of the two bands, and half a step of rounding
    assert np.abs(found.levels[1:4] - centre).max() <= width / 2 + 2.5 * 2.0**-24


@given(
    st.lists(
        st.tuples(st.integers(0, 12), st.sampled_from([0.0, 1e-7, 1e-9, 1e-12]), st.floats(0.0, 50.0)),
        min_size=2,
        max_size=10,
    ),
    st.lists(st.tuples(st.integers(0, 12), st.sampled_from([0.0, 1e-9])), max_size=3, unique=True),
)
def test_levels_never_descend_and_bands_keep_the_integral(
    entries: list[tuple[int, float, float]], surfaces: list[tuple[int, float]]
) -> None:
    points = sorted((number / 12 + more, extinction) for number, more, extinction in entries)
    values = [value for value, _ in points]
    if any(values.count(value) > 2 for value in values):
        return  # a third point at one value
    transfer_function = TransferFunction(
        points_of(*points), [Isosurface(number / 12 + more, BLUE, 0.5) for number, more in surfaces]
    )
    found = ValueBands.of(transfer_function, 0.0, 1.0)
    assert (np.diff([LOWEST, *found.levels, HIGHEST]) >= 0.0).all()
    np.testing.assert_array_equal(found.ends[1:, 0], found.ends[:-1, 1])
    np.testing.assert_array_equal(found.levels, found.levels.astype(np.float32))
    exact = sum(
        0.5 * (slope.high.value - slope.low.value) * (slope.low.extinction + slope.high.extinction)
        for slope in transfer_function.slopes()
    )
    # An isosurface at the last point has a band of its own, one float32 number wide, with what is met there.
    closing = 2.0**-23 * 50.0 if any(s.value == values[-1] for s in transfer_function.isosurfaces) else 0.0
    assert integral(found) == pytest.approx(exact, rel=1e-12, abs=1e-13 + closing)


def test_an_isosurface_just_above_the_last_point_stays_above_it() -> None:
    surface = Isosurface(0.5 + 1e-9, BLUE, 0.5)
    found = ValueBands.of(TransferFunction(points_of((0.0, 1.0), (0.5, 1.0)), [surface]), 0.0, 1.0)
    assert found.levels.tolist() == [0.0, 0.5 + 2.0**-24, 0.5 + 2.0**-24]
    assert found.impulses[:, 3].tolist() == [0.0, 0.0, 0.5]
    assert found.evaluate(0.5)[3] == pytest.approx(1.0, rel=1e-6)


def test_the_upper_side_of_a_step_drawn_as_a_steep_slope_begins_at_its_value() -> None:
    steep = TransferFunction(points_of((0.0, 0.0), (0.3 - 1e-12, 0.0), (0.3, 5.0), (1.0, 5.0)))
    found = ValueBands.of(steep, 0.0, 1.0)
    assert found.evaluate(np.float32(0.3))[3] == pytest.approx(5.0)
    assert found.evaluate(np.float32(0.3) - np.float32(2.0**-23))[3] == 0.0


def test_points_far_outside_keep_the_slope_inside() -> None:
    wide = TransferFunction([ControlPoint(-1e30, RED, 0.0), ControlPoint(1e30, BLUE, 2.0)])
    found = bands(wide)
    assert found.ends.tolist() == [[LOWEST, HIGHEST]]
    assert found.evaluate([0.0, 1.0])[:, 3].tolist() == pytest.approx([1.0, 1.0])

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


def test_points_far_outside_keep_the_slope_inside() -> None:
    wide = TransferFunction([ControlPoint(-1e30, RED, 0.0), ControlPoint(1e30, BLUE, 2.0)])
    found = bands(wide)
    assert found.ends.tolist() == [[LOWEST, HIGHEST]]
    assert found.evaluate([0.0, 1.0])[:, 3].tolist() == pytest.approx([1.0, 1.0])

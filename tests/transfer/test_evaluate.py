from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from isosample.errors import InputError
from isosample.transfer.transfer_function import ControlPoint, Isosurface, TransferFunction

RED, GREEN, BLUE = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)


def tent() -> TransferFunction:
    return TransferFunction([ControlPoint(0, RED, 0), ControlPoint(2, GREEN, 4), ControlPoint(6, BLUE, 0)])


def step_at_one() -> TransferFunction:
    points = [(0, RED, 1), (1, RED, 3), (1, BLUE, 7), (2, BLUE, 9)]
    return TransferFunction([ControlPoint(*point) for point in points])


def test_colour_and_extinction_are_each_linear_between_points() -> None:
    color, extinction = tent().evaluate([0.5, 3.0])
    # quarters of a slope: every product is exact in binary
    np.testing.assert_array_equal(extinction, [1.0, 3.0])
    np.testing.assert_array_equal(color, [[0.75, 0.25, 0], [0, 0.75, 0.25]])


def test_control_points_are_reproduced_exactly() -> None:
    points = [ControlPoint(v, (v / 7, 0.1, 0.3), 1 / (1 + v)) for v in (0.1, 0.7, 3.3, 6.9)]
    color, extinction = TransferFunction(points).evaluate([point.value for point in points])
    np.testing.assert_array_equal(extinction, [point.extinction for point in points])
    np.testing.assert_array_equal(color, [point.color for point in points])


def test_a_step_has_two_limits() -> None:
    tf = step_at_one()
    assert tf.evaluate(1.0, "left")[1] == 3
    assert tf.evaluate(1.0, "right")[1] == 7
    assert tf.evaluate(1.0)[1] == 7
    np.testing.assert_array_equal(tf.evaluate(1.0, "left")[0], RED)
    np.testing.assert_array_equal(tf.evaluate(1.0, "right")[0], BLUE)


def test_extinction_is_zero_outside_and_the_closed_side_keeps_the_last_point() -> None:
    tf = step_at_one()
    np.testing.assert_array_equal(tf.evaluate([-0.1, 2.1, np.nan, np.inf, -np.inf])[1], np.zeros(5))
    assert tf.evaluate(2.0)[1] == tf.evaluate(2.0, "left")[1] == 9
    assert tf.evaluate(2.0, "right")[1] == 0
    assert tf.evaluate(0.0)[1] == 1
    assert tf.evaluate(0.0, "left")[1] == 0


def test_below_the_first_point_its_colour_holds() -> None:
    tf = TransferFunction([ControlPoint(0, RED, 1), ControlPoint(2, BLUE, 9)])
    for value in (-1.0, 0.0):
        np.testing.assert_array_equal(tf.evaluate(value, "left")[0], RED)
    np.testing.assert_array_equal(tf.evaluate(3.0, "left")[0], BLUE)


def test_a_step_down_at_the_last_value_is_closed_from_below() -> None:
    tf = TransferFunction([ControlPoint(0, RED, 1), ControlPoint(1, RED, 5), ControlPoint(1, RED, 0)])
    assert tf.evaluate(1.0)[1] == 5
    assert tf.evaluate(1.0, "right")[1] == 0


def test_shapes_follow_the_values() -> None:
    color, extinction = tent().evaluate(np.zeros((2, 0, 3)))
    assert color.shape == (2, 0, 3, 3)
    assert extinction.shape == (2, 0, 3)
    color, extinction = TransferFunction([], [Isosurface(1, RED, 0.5)]).evaluate([[1.0, 2.0]])
    assert color.shape == (1, 2, 3)
    np.testing.assert_array_equal(extinction, [[0, 0]])


def test_an_unknown_side_is_refused() -> None:
    with pytest.raises(InputError, match="side 'above' must be"):
        tent().evaluate(0.0, "above")  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("points", "isosurfaces", "message"),
    [
        ([(1, 2)], [], r"points\[0\] is \(1, 2\); expected ControlPoint"),
        ([ControlPoint(1, RED, 0), Isosurface(1, RED, 0.5)], [], r"points\[1\] is Isosurface"),
        ([], [ControlPoint(1, RED, 0)], r"isosurfaces\[0\] is ControlPoint.*expected Isosurface.*opacity"),
        (5, [], "points is 5; expected a list of ControlPoint"),
    ],
)
def test_entries_of_another_type_are_refused(points: Any, isosurfaces: Any, message: str) -> None:
    with pytest.raises(InputError, match=message):
        TransferFunction(points, isosurfaces)


def test_slopes_leave_out_steps_and_know_what_they_are() -> None:
    slopes = step_at_one().slopes()
    assert [(s.low.value, s.high.value) for s in slopes] == [(0, 1), (1, 2)]
    points = [(0, RED, 0), (1, RED, 0), (2, RED, 2), (3, RED, 2), (4, BLUE, 2)]
    slopes = TransferFunction([ControlPoint(*point) for point in points]).slopes()
    assert [s.visible for s in slopes] == [False, True, True, True]
    assert [s.constant for s in slopes] == [True, False, True, False]


@pytest.mark.parametrize(
    ("extinctions", "expected"),
    [
        ([0, 1, 0], [1]),
        ([0, 1, 1, 0], [1, 2]),
        ([0, 1, 1, 2, 0], [3]),
        ([2, 1, 3], [0, 2]),
        ([1, 1, 1], [0, 2]),
        ([0, 0, 0], []),
        ([0, 2, 1, 1, 2, 0], [1, 4]),
    ],
)
def test_peaks_are_local_maxima_with_both_ends_of_plateaus(
    extinctions: list[float], expected: list[float]
) -> None:
    tf = TransferFunction([ControlPoint(i, RED, e) for i, e in enumerate(extinctions)])
    assert tf.peaks() == expected


def test_the_higher_side_of_a_step_is_a_peak() -> None:
    points = [(0, RED, 0), (1, RED, 1), (1, RED, 5), (2, RED, 0)]
    assert TransferFunction([ControlPoint(*point) for point in points]).peaks() == [1]


@given(
    st.lists(st.floats(-1e6, 1e6), min_size=2, max_size=6, unique=True),
    st.lists(st.floats(0, 1e3), min_size=6, max_size=6),
    st.floats(0, 1),
)
def test_evaluation_agrees_with_numpys_interpolation(
    values: list[float], extinctions: list[float], where: float
) -> None:
    values = sorted(values)
    tf = TransferFunction([ControlPoint(v, RED, e) for v, e in zip(values, extinctions, strict=False)])
    probe = min(max(values[0] + where * (values[-1] - values[0]), values[0]), values[-1])
    expected = np.interp(probe, values, extinctions[: len(values)])
    # Either side makes at most 6 roundings on terms below 1e3: 2 · 6 · 2^-53 · 1e3 = 1.4e-12. Where a slope
    # is a few ulp wide both are still exact at its ends, and the weight has relative error 3 · 2^-53.
    np.testing.assert_allclose(tf.evaluate(probe)[1], expected, rtol=0, atol=1.4e-12)

"""Compositing is associative with transparent black as its neutral element; bands place values linearly."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from isosample.errors import InputError
from isosample.integral.bands import band_position
from isosample.integral.compositing import over

UNIT = 2.0**-53
CLEAR = np.zeros(4)
colours = arrays(np.float64, 4, elements=st.floats(0.0, 1.0, allow_subnormal=False))


def test_half_covering_front_shows_half_the_back() -> None:
    composited = over([0.25, 0.5, 0.0, 0.5], [1.0, 0.5, 0.25, 1.0])
    assert composited.tolist() == [0.75, 0.75, 0.125, 1.0]


@given(front=colours, back=colours)
def test_opaque_front_hides_and_clear_front_shows_the_back(front: np.ndarray, back: np.ndarray) -> None:
    front[3] = 1.0
    assert over(front, back).tolist() == front.tolist()
    assert over(CLEAR, back).tolist() == over(back, CLEAR).tolist() == back.tolist()


@given(a=colours, b=colours, c=colours)
def test_compositing_is_associative(a: np.ndarray, b: np.ndarray, c: np.ndarray) -> None:
    # Each side takes 6 roundings of sums that stay below 3.
    np.testing.assert_allclose(over(over(a, b), c), over(a, over(b, c)), rtol=0, atol=2 * 6 * 3 * UNIT)


@given(a=colours, b=colours)
def test_transmittances_multiply(a: np.ndarray, b: np.ndarray) -> None:
    assert 1.0 - over(a, b)[3] == pytest.approx((1.0 - a[3]) * (1.0 - b[3]), abs=4 * UNIT)


def test_leading_axes_broadcast_and_the_last_is_checked() -> None:
    assert over(np.ones((5, 1, 4)), np.ones((3, 4))).shape == (5, 3, 4)
    with pytest.raises(InputError, match=r"back has shape \(3,\); expected \(\.\.\., 4\)"):
        over(np.ones(4), np.ones(3))


def test_ends_of_a_band_are_at_zero_and_one() -> None:
    assert band_position(0.25, 4.0, [0.25, 0.375, 0.5]).tolist() == [0.0, 0.5, 1.0]


def test_value_beside_the_band_takes_the_nearer_end() -> None:
    assert band_position(0.25, 4.0, [-1e300, 0.2, 0.6, 1e300]).tolist() == [0.0, 0.0, 1.0, 1.0]


def test_every_value_of_an_empty_band_is_at_zero() -> None:
    assert band_position(0.25, 0.0, [0.0, 0.25, 1.0]).tolist() == [0.0, 0.0, 0.0]


def test_negative_band_width_is_refused() -> None:
    with pytest.raises(InputError, match="inverse_width is -4; expected finite and >= 0"):
        band_position(0.25, -4.0, 0.25)

"""Cubic segments: limits of their slopes, their position in the band, and the emission integral, against quadrature."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given
from hypothesis import strategies as st

from isosample.integral.optics import segment_weights
from isosample.integral.quadrature import panel_nodes
from isosample.integral.segment import (
    LEAVES,
    LEAVES_FAR,
    SPENT,
    bump_height,
    cubic_moments,
    limit_slopes,
    overshoot,
    segment_curve,
    segment_position,
)

F64 = npt.NDArray[np.float64]
SLOPE = st.floats(0.0, 50.0)


def by_quadrature(
    depths: tuple[float, float],
    ends: tuple[float, float],
    slopes: tuple[float, float],
    part: tuple[float, float],
) -> F64:
    """Moments by 1000 panels of 8 nodes, optical depths by the closed form of the cubic's integral."""
    u, weights = panel_nodes(np.linspace(*part, 1001), 8)
    p = np.array([segment_position(*ends, *slopes, place) for place in u.tolist()])
    tau = depths[0] + p * (depths[1] - depths[0])
    rise = ends[1] - ends[0]
    square, cube = 3.0 * rise - 2.0 * slopes[0] - slopes[1], slopes[0] + slopes[1] - 2.0 * rise

    def area(v: F64 | float) -> F64:
        return np.asarray(ends[0] * v + slopes[0] * v**2 / 2 + square * v**3 / 3 + cube * v**4 / 4)

    depth = depths[0] * (u - part[0]) + (area(u) - area(part[0])) * (depths[1] - depths[0])
    seen = weights * tau * np.exp(-depth)
    return np.array([seen.sum(), (seen * p).sum(), (seen * u).sum(), (seen * u * p).sum()])


@given(a=SLOPE, b=SLOPE)
def test_the_height_of_a_bump_is_its_largest_value(a: float, b: float) -> None:
    u = np.linspace(0.0, 1.0, 4001)
    sampled = (a * u * (1 - u) ** 2 + b * u**2 * (1 - u)).max()
    # Between samples a maximum of second derivative 4 (a + b) or less rises by that times (1/8000)² / 2.
    assert (
        sampled - 1e-12 * (a + b) <= bump_height(a, b) <= sampled + 2 * (a + b) / 8000.0**2 + 1e-12 * (a + b)
    )


@given(a=SLOPE, b=SLOPE)
def test_a_limited_bump_stays_in_its_band(a: float, b: float) -> None:
    first, last = limit_slopes(0.0, 0.0, a, -b)
    assert bump_height(first, -last) <= 1.0 + 1e-12
    assert first <= a
    assert -last <= b
    if bump_height(a, b) <= 1.0:
        assert (first, last) == (a, -b)  # and is left alone where it does anyway
    else:
        assert math.isclose(bump_height(first, -last), 1.0, rel_tol=1e-12)


@given(a=SLOPE, b=SLOPE)
def test_a_limited_rise_leaves_its_band_by_little(a: float, b: float) -> None:
    first, last = limit_slopes(0.0, 1.0, a, b)
    u = np.linspace(0.0, 1.0, 501)
    curve = np.array([segment_curve(0.0, 1.0, first, last, part) for part in u.tolist()])
    # Slopes that leave the band by less than LEAVES are kept, by more than LEAVES + LEAVES_FAR made monotone; in
    # between the factor falls, and with it the excess.
    assert curve.min() >= -(LEAVES + LEAVES_FAR)
    assert curve.max() <= 1.0 + LEAVES + LEAVES_FAR
    if overshoot(a, b) >= LEAVES + LEAVES_FAR:
        assert np.diff(curve).min() >= -1e-12
    if overshoot(a, b) <= LEAVES:
        assert (first, last) == (a, b)


@given(a=SLOPE, b=SLOPE, down=st.booleans())
def test_falling_segments_are_rising_ones_upside_down(a: float, b: float, down: bool) -> None:
    back = 0.0 if down else 1.0
    rising = limit_slopes(0.0, back, a, b if back else -b)
    falling = limit_slopes(1.0, 1.0 - back, -a, -b if back else b)
    assert falling == (-rising[0], -rising[1])


def test_the_cubic_is_that_of_hermite() -> None:
    ends, slopes = (0.25, 0.75), (0.9, -0.4)
    assert segment_curve(*ends, *slopes, 0.0) == ends[0]
    assert math.isclose(segment_curve(*ends, *slopes, 1.0), ends[1], rel_tol=1e-15)
    step = 1e-6
    for u, slope in ((0.0, slopes[0]), (1.0 - step, slopes[1])):
        rise = segment_curve(*ends, *slopes, u + step) - segment_curve(*ends, *slopes, u)
        assert math.isclose(rise / step, slope, abs_tol=1e-5)  # second derivative < 10, times the step


@pytest.mark.parametrize("ends", [(0.0, 1.0), (1.0, 0.0), (0.0, 0.0), (1.0, 1.0), (0.3, 1.0)])
@pytest.mark.parametrize("thickness", [1e-3, 0.5, 2.0, 20.0])
def test_moments_agree_with_quadrature(ends: tuple[float, float], thickness: float) -> None:
    up = 1.0 if ends[0] < 0.5 else -1.0
    slopes = (1.2 * up, 0.7 * (up if ends[0] != ends[1] else -up))
    for depths in ((0.0, thickness), (thickness, 0.0), (0.6 * thickness, thickness)):
        for part in ((0.0, 1.0), (0.2, 0.9)):
            found = np.array(cubic_moments(*depths, *ends, *slopes, *part))
            expected = by_quadrature(depths, ends, slopes, part)
            # Opacity is in closed form, as the cubic is integrated exactly, up to what is left out at the end. Three
            # Gauss nodes err by |sixth derivative| / 2016000 for the rest. That of u p τ is 5040 c² times the
            # thickness, with |c| <= 1/2 the cubes of these cubics; the factor exp(−D) and the depth at the nodes, of
            # order 6 too, add less than the thirtieth part of it at depth 1.
            assert abs(found[0] - expected[0]) <= SPENT + 1e-12
            assert np.abs(found - expected).max() <= SPENT + 1300.0 / 2016000.0 * min(thickness, 1.0)


def test_linear_data_gives_the_linear_segment() -> None:
    for low, high in ((0.0, 1.0), (2.0, 0.5), (1e-5, 3e-5)):
        opacity, position, part, both = cubic_moments(low, high, 0.0, 1.0, 1.0, 1.0, 0.0, 1.0)
        front, back = segment_weights(low, high)
        assert math.isclose(opacity, float(front + back), rel_tol=1e-13)
        assert math.isclose(position, float(back), rel_tol=1e-4)  # of three nodes at depth 1 or less
        assert math.isclose(part, position, rel_tol=1e-12)  # p = u there
        assert both < part


def test_more_panels_make_moments_better() -> None:
    """Two halves of a segment, each with panels of its own, are nearer to the truth than the whole."""
    ends, slopes, depths = (0.0, 1.0), (2.0, 0.5), (0.2, 0.95)
    truth = by_quadrature(depths, ends, slopes, (0.0, 1.0))
    whole = np.array(cubic_moments(*depths, *ends, *slopes, 0.0, 1.0))
    first = np.array(cubic_moments(*depths, *ends, *slopes, 0.0, 0.5))
    last = np.array(cubic_moments(*depths, *ends, *slopes, 0.5, 1.0))
    halves = first + (1.0 - first[0]) * last
    errors = [np.abs(moments - truth).max() for moments in (whole, halves)]
    assert 1e-12 < errors[1] < errors[0] / 16.0  # order 6 gives 1/64; a quarter of it is left for other terms


def test_an_opaque_segment_shows_its_front() -> None:
    opacity, position, part, both = cubic_moments(1e6, 1e6, 0.0, 1.0, 1.0, 1.0, 0.0, 1.0)
    assert math.isclose(opacity, 1.0, rel_tol=1e-12)
    # The first panel is 1/576 of the segment; its first node is at 0.113 of it.
    assert 0.0 <= position <= 0.113 / 576
    assert part <= 0.113 / 576
    assert both <= (0.113 / 576) ** 2

"""The field along a ray inside one cell: a cubic in Bernstein form, its extrema, its roots and its parts.

With s in [0, 1] from the point where the ray enters the cell to the point where it leaves it,
f(s) = Σ b_i B_i(s) with the cubic Bernstein polynomials B_i. The coefficients are blossoms (polar forms) of
the trilinear interpolant, thus convex combinations of the eight samples: nothing cancels, and f stays between
the smallest and the largest coefficient [1]_.

References
----------
.. [1] L. Ramshaw, "Blossoms are polar forms", Computer Aided Geometric Design 6(4), 1989.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from isosample.compiled import compiled
from isosample.integral.bernstein import MAX_ROOT_STEPS, ROOT_TOLERANCE

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt

    F64 = npt.NDArray[np.float64]

Cubic = tuple[float, float, float, float]


@compiled
def lerp(low: float, high: float, u: float) -> float:
    """Linear interpolation that is exact at both ends, and constant between equal ends."""
    return high if u == 1.0 else low + u * (high - low)


@compiled
def cubic_between(corners: F64, start: F64, end: F64) -> Cubic:
    """Bernstein coefficients of the trilinear interpolant along a straight line through a cell.

    Parameters
    ----------
    corners : (2, 2, 2) float64
        Samples at the corners, indexed [z, y, x].
    start, end : (3,) float64
        Ends of the line in the cell (x, y, z), in [0, 1].

    Returns
    -------
    b0, b1, b2, b3 : float
        Coefficients; b0 and b3 are the values at the ends. All are equal, exactly, where the samples are.
        On a face of the cell an end's value is the same number from both sides, bit for bit.
    """
    ppp, pqp, ppq, pqq = _at_x(corners, start[0], start, end)
    qpp, qqp, qpq, qqq = _at_x(corners, end[0], start, end)
    b1 = ppp + ((qpp - ppp) + (pqp - ppp) + (ppq - ppp)) / 3.0
    b2 = qqq + ((qqp - qqq) + (qpq - qqq) + (pqq - qqq)) / 3.0
    return ppp, b1, b2, qqq


@compiled
def _at_x(corners: F64, x: float, start: F64, end: F64) -> Cubic:
    """Values at x and (y, z) of the start, (y end, z start), (y start, z end) and of the end."""
    front_low, front_high = (
        lerp(corners[0, 0, 0], corners[0, 0, 1], x),
        lerp(corners[0, 1, 0], corners[0, 1, 1], x),
    )
    back_low, back_high = (
        lerp(corners[1, 0, 0], corners[1, 0, 1], x),
        lerp(corners[1, 1, 0], corners[1, 1, 1], x),
    )
    front_p, front_q = lerp(front_low, front_high, start[1]), lerp(front_low, front_high, end[1])
    back_p, back_q = lerp(back_low, back_high, start[1]), lerp(back_low, back_high, end[1])
    return (
        lerp(front_p, back_p, start[2]),
        lerp(front_q, back_q, start[2]),
        lerp(front_p, back_p, end[2]),
        lerp(front_q, back_q, end[2]),
    )


@compiled
def cubic_value(b0: float, b1: float, b2: float, b3: float, s: float) -> float:
    """Value at s, from the differences of the coefficients: b0 exactly at 0, b3 exactly at 1."""
    if s == 1.0:
        return b3
    d0, d1, d2 = b1 - b0, b2 - b1, b3 - b2
    e0, e1 = d1 - d0, d2 - d1
    return b0 + s * (3.0 * d0 + s * (3.0 * e0 + s * (e1 - e0)))


@compiled
def cubic_slope(b0: float, b1: float, b2: float, b3: float, s: float) -> float:
    """Derivative with respect to s."""
    d0, d1, d2 = b1 - b0, b2 - b1, b3 - b2
    return 3.0 * (d0 + s * (2.0 * (d1 - d0) + s * (d2 - 2.0 * d1 + d0)))


@compiled
def cubic_extrema(b0: float, b1: float, b2: float, b3: float) -> tuple[int, float, float]:
    """Places inside (0, 1) where the slope changes its sign.

    Returns
    -------
    count : int
        0, 1 or 2.
    first, second : float
        Ascending; those beyond `count` are 1.
    """
    d0, d1, d2 = b1 - b0, b2 - b1, b3 - b2
    if (d0 >= 0.0 and d1 >= 0.0 and d2 >= 0.0) or (d0 <= 0.0 and d1 <= 0.0 and d2 <= 0.0):
        return 0, 1.0, 1.0
    square, half, constant = d0 - 2.0 * d1 + d2, d1 - d0, d0  # square s² + 2 half s + constant
    discriminant = half * half - square * constant
    if discriminant <= 0.0:
        return 0, 1.0, 1.0
    larger = -(half + math.copysign(math.sqrt(discriminant), half))  # no cancellation
    first = constant / larger if larger != 0.0 else 2.0
    second = larger / square if square != 0.0 else 2.0
    if first > second:
        first, second = second, first
    has_first, has_second = 0.0 < first < 1.0, 0.0 < second < 1.0
    if has_first and has_second:
        return 2, first, second
    if has_first:
        return 1, first, 1.0
    return (1, second, 1.0) if has_second else (0, 1.0, 1.0)


@compiled
def cubic_root(
    b0: float, b1: float, b2: float, b3: float, level: float, low: float, high: float, rising: bool
) -> float:
    """Place in [low, high] where a monotone piece takes the value `level`.

    Newton's method inside a shrinking bracket, bisection where a step would leave it; the error is a few
    units in the last place of the values divided by the slope. The caller knows that there is a root.
    """
    s = 0.5 * (low + high)
    for _ in range(MAX_ROOT_STEPS):
        residual = cubic_value(b0, b1, b2, b3, s) - level
        if residual == 0.0:
            return s
        if (residual < 0.0) == rising:
            low = s
        else:
            high = s
        slope = cubic_slope(b0, b1, b2, b3, s)
        following = s - residual / slope if slope != 0.0 else -1.0
        if not low < following < high:
            following = 0.5 * (low + high)
        if abs(following - s) <= ROOT_TOLERANCE:
            return following
        s = following
    return s


@compiled
def cubic_part(b0: float, b1: float, b2: float, b3: float, low: float, high: float) -> Cubic:
    """Bernstein coefficients of the part over [low, high], by blossoming; all for the interval [0, 1]."""
    l0, l1, l2 = lerp(b0, b1, low), lerp(b1, b2, low), lerp(b2, b3, low)
    h0, h1, h2 = lerp(b0, b1, high), lerp(b1, b2, high), lerp(b2, b3, high)
    ll0, ll1 = lerp(l0, l1, low), lerp(l1, l2, low)
    lh0, lh1 = lerp(l0, l1, high), lerp(l1, l2, high)
    hh0, hh1 = lerp(h0, h1, high), lerp(h1, h2, high)
    return lerp(ll0, ll1, low), lerp(ll0, ll1, high), lerp(lh0, lh1, high), lerp(hh0, hh1, high)


@compiled
def cubic_through(f0: float, f1: float, f2: float, f3: float) -> Cubic:
    """Bernstein coefficients of the cubic through the values at 0, 1/3, 2/3 and 1."""
    return (
        f0,
        (18.0 * f1 - 5.0 * f0 - 9.0 * f2 + 2.0 * f3) / 6.0,
        (2.0 * f0 - 9.0 * f1 + 18.0 * f2 - 5.0 * f3) / 6.0,
        f3,
    )

"""Polynomials on [0, 1] in Bernstein form, of any degree: bounds, halves, mean, values, crossings of a monotone one.

A polynomial stays between its smallest and largest coefficient; its first and last are its values at the ends,
and it is monotone where its coefficients are [1]_.

References
----------
.. [1] G. Farin, "Curves and surfaces for CAGD", 5th edition, 2002, chapter 5.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from isosample.compiled import compiled

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt

    F64 = npt.NDArray[np.float64]

ROOT_TOLERANCE = 4e-16  # of the interval [0, 1]: the last Newton step is below 2 units in the last place of 1
MAX_ROOT_STEPS = 200  # bisection alone needs 52; Newton's method 4 to 6


@compiled
def polynomial_bounds(polynomial: F64) -> tuple[float, float]:
    """Smallest and largest coefficient."""
    low, high = polynomial[0], polynomial[0]
    for i in range(1, len(polynomial)):
        low, high = min(low, polynomial[i]), max(high, polynomial[i])
    return low, high


@compiled
def polynomial_mean(polynomial: F64) -> float:
    """Mean over the interval."""
    total = 0.0
    for i in range(len(polynomial)):
        total += polynomial[i]
    return total / len(polynomial)


@compiled
def is_monotone(polynomial: F64) -> bool:
    """Whether the coefficients never descend, or never ascend."""
    rises, falls = True, True
    for i in range(len(polynomial) - 1):
        rises = rises and polynomial[i] <= polynomial[i + 1]
        falls = falls and polynomial[i] >= polynomial[i + 1]
    return rises or falls


@compiled
def halve_polynomial(polynomial: F64, front: F64) -> None:
    """Put the first half into `front`, and leave the second half in `polynomial` (de Casteljau)."""
    count = len(polynomial)
    front[0] = polynomial[0]
    for step in range(1, count):
        for i in range(count - step):
            polynomial[i] += 0.5 * (polynomial[i + 1] - polynomial[i])
        front[step] = polynomial[0]


@compiled
def polynomial_value(polynomial: F64, s: float) -> float:
    """Value at a place, by Bernstein's basis, of a polynomial of degree 1 or more ([1]_, section 5.1)."""
    last = len(polynomial) - 1
    u, power, choose = 1.0 - s, 1.0, 1.0
    value = polynomial[0] * u
    for i in range(1, last):
        power *= s
        choose = choose * (last - i + 1) / i
        value = (value + power * choose * polynomial[i]) * u
    return float(value + power * s * polynomial[last])


@compiled
def polynomial_value_slope(polynomial: F64, s: float, scratch: F64) -> tuple[float, float]:
    """Value and derivative at a place; `scratch` has the polynomial's length and is overwritten."""
    count = len(polynomial)
    for i in range(count):
        scratch[i] = polynomial[i]
    for step in range(1, count - 1):
        for i in range(count - step):
            scratch[i] += s * (scratch[i + 1] - scratch[i])
    rise = scratch[1] - scratch[0]
    return scratch[0] + s * rise, (count - 1) * rise


@compiled
def polynomial_root(polynomial: F64, level: float, rising: bool, scratch: F64) -> float:
    """Place in [0, 1] where a monotone polynomial takes a value.

    Newton's method inside a shrinking bracket, bisection where a step would leave it. The caller knows that there
    is a root.
    """
    low, high, s = 0.0, 1.0, 0.5
    for _ in range(MAX_ROOT_STEPS):
        value, slope = polynomial_value_slope(polynomial, s, scratch)
        residual = value - level
        if residual == 0.0:
            return s
        if (residual < 0.0) == rising:
            low = s
        else:
            high = s
        following = s - residual / slope if slope != 0.0 else -1.0
        if not low < following < high:
            following = 0.5 * (low + high)
        if abs(following - s) <= ROOT_TOLERANCE:
            return following
        s = following
    return s

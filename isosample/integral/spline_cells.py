"""A spline along a ray inside one cell: a polynomial of degree 9 in Bernstein form, and its parts.

With s in [0, 1] from the point where the ray enters the cell to the point where it leaves it, every weight of
a tap is a cubic in s, and the field is the sum of products of three of them: f(s) = Σ b_i B_i(s) with the
Bernstein polynomials of degree 9. The coefficients of a weight are its blossoms, those of a product are
convolutions [1]_, so that little cancels, and f stays between the smallest and the largest coefficient.

References
----------
.. [1] R. T. Farouki, V. T. Rajan, "Algorithms for polynomials in Bernstein form", Computer Aided Geometric
   Design 5(1), 1988.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from isosample.compiled import compiled

if TYPE_CHECKING:
    from isosample.integral.cell_cubic import Cubic

F64 = npt.NDArray[np.float64]

DEGREE = 9
BINOMIALS = np.array([math.comb(DEGREE, k) for k in range(DEGREE + 1)], dtype=np.float64)
# A cubic's Bernstein coefficients to those of the same polynomial in degree 9; rows sum to 1.
ELEVATION = np.array(
    [
        [
            math.comb(3, j) * math.comb(6, k - j) / math.comb(9, k) if 0 <= k - j <= 6 else 0.0
            for j in range(4)
        ]
        for k in range(DEGREE + 1)
    ]
)


@compiled
def cell_polynomial(taps: F64, kernel: F64, ends: F64, weights: F64, result: F64) -> None:
    """Bernstein coefficients of the spline along a straight line through a cell.

    Parameters
    ----------
    taps : (4, 4, 4) float64
        Coefficients, indexed [z, y, x].
    kernel : (4, 4) float64
    ends : (2, 3) float64
        Start and end of the line in the cell (x, y, z), in [0, 1].
    weights : (3, 4, 4) float64
        Is overwritten.
    result : (10,) float64
        Is filled in. All are equal, exactly, where the taps are.
    """
    for axis in range(3):
        weights_along(kernel, ends[0, axis], ends[1, axis], weights[axis])
    centre = taps[1, 1, 1]
    weighed_taps(taps, centre, weights, result)
    for i in range(DEGREE + 1):
        result[i] += centre


@compiled
def weighed_taps(taps: F64, centre: float, weights: F64, result: F64) -> None:
    """Fill in the Bernstein coefficients of the sum of the taps, less `centre`, times three weights each."""
    for i in range(DEGREE + 1):
        result[i] = 0.0
    for c in range(4):
        p0, p1, p2, p3, p4, p5, p6 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        for b in range(4):
            r0, r1, r2, r3 = 0.0, 0.0, 0.0, 0.0
            for a in range(4):
                tap = taps[c, b, a] - centre
                w = weights[0, a]
                r0, r1, r2, r3 = r0 + w[0] * tap, r1 + w[1] * tap, r2 + w[2] * tap, r3 + w[3] * tap
            w = weights[1, b]
            p0 += w[0] * r0
            p1 += w[0] * r1 + w[1] * r0
            p2 += w[0] * r2 + w[1] * r1 + w[2] * r0
            p3 += w[0] * r3 + w[1] * r2 + w[2] * r1 + w[3] * r0
            p4 += w[1] * r3 + w[2] * r2 + w[3] * r1
            p5 += w[2] * r3 + w[3] * r2
            p6 += w[3] * r3
        for i in range(4):
            w_i = weights[2, c, i]
            result[i] += w_i * p0
            result[i + 1] += w_i * p1
            result[i + 2] += w_i * p2
            result[i + 3] += w_i * p3
            result[i + 4] += w_i * p4
            result[i + 5] += w_i * p5
            result[i + 6] += w_i * p6
    for i in range(DEGREE + 1):
        result[i] /= BINOMIALS[i]


@compiled
def weights_along(kernel: F64, start: float, end: float, weights: F64) -> None:
    """Bernstein coefficients, times 1, 3, 3, 1, of the four weights from one fraction to another: blossoms."""
    for m in range(4):
        k0, k1, k2, k3 = kernel[m, 0], kernel[m, 1], kernel[m, 2], kernel[m, 3]
        between = start * end
        weights[m, 0] = k0 + start * (k1 + start * (k2 + start * k3))
        weights[m, 1] = (
            3.0 * k0
            + k1 * (2.0 * start + end)
            + k2 * (start * start + 2.0 * between)
            + 3.0 * k3 * start * between
        )
        weights[m, 2] = (
            3.0 * k0 + k1 * (start + 2.0 * end) + k2 * (end * end + 2.0 * between) + 3.0 * k3 * end * between
        )
        weights[m, 3] = k0 + end * (k1 + end * (k2 + end * k3))


@compiled
def hermite_cubic(polynomial: F64) -> Cubic:
    """Bernstein coefficients of the cubic with the polynomial's values and slopes at both ends."""
    front, back = polynomial[0], polynomial[DEGREE]
    rise, fall = 3.0 * (polynomial[1] - front), 3.0 * (back - polynomial[DEGREE - 1])
    return front, front + rise, back - fall, back


@compiled
def hermite_error(polynomial: F64, cubic: Cubic) -> float:
    """Bound of the difference of a polynomial and its Hermite cubic: their largest difference of coefficients."""
    error = 0.0
    for k in range(2, DEGREE - 1):
        raised = cubic[0] * ELEVATION[k, 0] + cubic[1] * ELEVATION[k, 1]
        raised += cubic[2] * ELEVATION[k, 2] + cubic[3] * ELEVATION[k, 3]
        error = max(error, abs(polynomial[k] - raised))
    return error

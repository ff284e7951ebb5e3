"""Value and gradient of a grid's tensor-product spline: four taps along every axis.

Weight `m` (0 to 3, of the samples i − 1 to i + 2) at the fraction u behind sample i is Σ_n kernel[m, n] uⁿ.
Coefficient [k + 1, j + 1, i + 1] belongs to sample (i, j, k): there is one more on each side of the grid.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from isosample.compiled import compiled
from isosample.volume import spline_weights as weights

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt

    F64 = npt.NDArray[np.float64]

Four = tuple[float, float, float, float]


spline_weights = compiled(weights.spline_weights)


@compiled
def spline_weight_slopes(kernel: F64, u: float) -> Four:
    """Derivatives of the weights with respect to the fraction; their sum is 0."""
    return (
        kernel[0, 1] + u * (2.0 * kernel[0, 2] + u * (3.0 * kernel[0, 3])),
        kernel[1, 1] + u * (2.0 * kernel[1, 2] + u * (3.0 * kernel[1, 3])),
        kernel[2, 1] + u * (2.0 * kernel[2, 2] + u * (3.0 * kernel[2, 3])),
        kernel[3, 1] + u * (2.0 * kernel[3, 2] + u * (3.0 * kernel[3, 3])),
    )


@compiled
def cell_of(coordinate: float, count: int) -> int:
    """Cell of an index coordinate along an axis of `count` samples; the last sample belongs to the last cell."""
    return min(max(math.floor(coordinate), 0), count - 2)


@compiled
def spline_value_gradient(coefficients: F64, kernel: F64, x: float, y: float, z: float) -> Four:
    """Value, and derivatives per sample step along x, y, z, at a place inside the grid.

    Parameters
    ----------
    coefficients : (Z + 2, Y + 2, X + 2) float64
    kernel : (4, 4) float64
    x, y, z : float
        Index coordinates, from 0 to the last sample; beyond, the outermost cell's polynomial is continued.

    Returns
    -------
    value, slope_x, slope_y, slope_z : float
    """
    i = cell_of(x, coefficients.shape[2] - 2)
    j = cell_of(y, coefficients.shape[1] - 2)
    k = cell_of(z, coefficients.shape[0] - 2)
    wx, dx = spline_weights(kernel, x - i), spline_weight_slopes(kernel, x - i)
    wy, dy = spline_weights(kernel, y - j), spline_weight_slopes(kernel, y - j)
    wz, dz = spline_weights(kernel, z - k), spline_weight_slopes(kernel, z - k)
    value, slope_x, slope_y, slope_z = 0.0, 0.0, 0.0, 0.0
    for c in range(4):
        plane, plane_x, plane_y = 0.0, 0.0, 0.0
        for b in range(4):
            row, row_x = 0.0, 0.0
            for a in range(4):
                coefficient = coefficients[k + c, j + b, i + a]
                row += wx[a] * coefficient
                row_x += dx[a] * coefficient
            plane += wy[b] * row
            plane_x += wy[b] * row_x
            plane_y += dy[b] * row
        value += wz[c] * plane
        slope_x += wz[c] * plane_x
        slope_y += wz[c] * plane_y
        slope_z += dz[c] * plane
    return value, slope_x, slope_y, slope_z


@compiled
def spline_values_gradients(coefficients: F64, kernel: F64, points: F64, values: F64, gradients: F64) -> None:
    """Fill in values (N,) and gradients (N, 3) at points (N, 3) in index coordinates (x, y, z)."""
    for n in range(len(points)):
        values[n], gradients[n, 0], gradients[n, 1], gradients[n, 2] = spline_value_gradient(
            coefficients, kernel, points[n, 0], points[n, 1], points[n, 2]
        )

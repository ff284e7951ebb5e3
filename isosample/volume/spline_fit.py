"""Coefficients of a cubic spline through samples along one axis, and samples continued beyond the ends of the axis."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    import numpy.typing as npt

    F64 = npt.NDArray[np.float64]

SLAB_SAMPLES = 1 << 20  # the spline is fitted to so many samples at once, so that copies stay small
BANDS = 4  # on either side of the diagonal of the matrix that takes coefficients to samples


def extrapolate_along(coefficients: F64, axis: int, *, parabola: bool) -> None:
    """Continue the samples by one on each side: linearly, or by a parabola where there are three."""
    lines = np.moveaxis(coefficients, axis, 0)
    if parabola and len(lines) > 4:
        lines[0] = 3.0 * (lines[1] - lines[2]) + lines[3]
        lines[-1] = 3.0 * (lines[-2] - lines[-3]) + lines[-4]
        return
    lines[0] = 2.0 * lines[1] - lines[2]
    lines[-1] = 2.0 * lines[-2] - lines[-3]


def fit_along(coefficients: F64, axis: int) -> None:
    """Replace the samples along an axis by the coefficients of the cubic spline through them."""
    from scipy.linalg.lapack import dgbtrf

    lines = np.moveaxis(coefficients, axis, 0)
    room = np.zeros((BANDS, len(lines)))  # above the matrix, for what pivoting fills in
    factors, pivots, _ = dgbtrf(np.concatenate([room, _interpolation_bands(len(lines) - 2)]), BANDS, BANDS)
    thickness = max(1, SLAB_SAMPLES // (lines.shape[0] * lines.shape[2]))
    for start in range(0, lines.shape[1], thickness):
        slab = lines[:, start : start + thickness]
        right = np.array(slab).reshape(
            len(lines), -1
        )  # its first and last row are 0: differences that vanish
        _substitute(factors, pivots.tolist(), right)
        slab[...] = right.reshape(slab.shape)


def _substitute(factors: F64, pivots: list[int], right: F64) -> None:
    """Solve with the factors of a band matrix for all columns of `right`, in place.

    As LAPACK's dgbtrs does, but by whole rows, which lie side by side in memory, and without the zeros of the bands.
    """
    diagonal, last = 2 * BANDS, len(right) - 1
    for row, pivot in enumerate(pivots):
        if pivot != row:
            right[[row, pivot]] = right[[pivot, row]]
        for below in range(1, min(BANDS, last - row) + 1):
            if (factor := factors[diagonal + below, row]) != 0.0:
                right[row + below] -= factor * right[row]
    for row in range(last, -1, -1):
        right[row] /= factors[diagonal, row]
        for above in range(1, min(2 * BANDS, row) + 1):
            if (factor := factors[diagonal - above, row]) != 0.0:
                right[row - above] -= factor * right[row]


def _interpolation_bands(count: int) -> F64:
    """(9, count + 2) float64, the matrix that takes coefficients to samples between two end conditions."""
    size, order = count + 2, min(4, count)
    matrix = np.zeros((9, size))  # entry [4 + row − column, column]
    for offset, weight in ((-1, 1.0), (0, 4.0), (1, 1.0)):
        matrix[4 - offset, 1 + offset : size - 1 + offset] = weight / 6.0
    difference = np.array([[1, -2, 1, 0, 0], [-1, 3, -3, 1, 0], [1, -4, 6, -4, 1]])[order - 2]
    for column in range(order + 1):
        matrix[4 - column, column] = difference[column]
        matrix[4 + column, size - 1 - column] = difference[column]
    return matrix

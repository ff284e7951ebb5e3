"""Roots of a spline on the edges of the grid: compiled, in float64."""

from __future__ import annotations

from typing import TYPE_CHECKING

from isosample.compiled import compiled
from isosample.volume.spline_kernels import spline_value_gradient

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt

    F64 = npt.NDArray[np.float64]
    I64 = npt.NDArray[np.int64]
    Bool = npt.NDArray[np.bool_]


ROOT_STEP = 2.0**-24  # a root is found when it moves by less [voxel]; positions are rounded to 2**-19
ROOT_ROUNDS = 80  # bisection alone needs 24 + 1


@compiled
def edge_roots(
    coefficients: F64,
    kernel: F64,
    isovalue: float,
    lowers: F64,
    axes: I64,
    low_inside: Bool,
    fractions: F64,
) -> None:
    """Replace guesses of where the spline takes the isovalue on grid edges by bracketed roots.

    Parameters
    ----------
    coefficients, kernel
        Of the spline.
    isovalue : float
    lowers : (N, 3) float64
        Lower ends of the edges, in the coefficients' coordinates.
    axes : (N,) int64
        0 = x, 1 = y, 2 = z.
    low_inside : (N,) bool
        Whether the lower end counts as inside; the upper one is on the other side.
    fractions : (N,) float64
        In: guesses in (0, 1). Out: roots in [0, 1].
    """
    for n in range(len(fractions)):
        along_x = 1.0 if axes[n] == 0 else 0.0
        along_y = 1.0 if axes[n] == 1 else 0.0
        along_z = 1.0 if axes[n] == 2 else 0.0
        low, high, u = 0.0, 1.0, fractions[n]
        for _ in range(ROOT_ROUNDS):
            value, gx, gy, gz = spline_value_gradient(
                coefficients,
                kernel,
                lowers[n, 0] + u * along_x,
                lowers[n, 1] + u * along_y,
                lowers[n, 2] + u * along_z,
            )
            if (value >= isovalue) == low_inside[n]:
                low = u
            else:
                high = u
            slope = gx * along_x + gy * along_y + gz * along_z
            following = u - (value - isovalue) / slope if slope != 0.0 else low
            if not low < following < high:
                following = 0.5 * (low + high)
            step, u = abs(following - u), following
            if step < ROOT_STEP:
                break
        fractions[n] = u

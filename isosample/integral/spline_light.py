"""The gradient of a spline along a ray inside one cell, for light."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from isosample.compiled import compiled
from isosample.integral.bernstein import polynomial_bounds
from isosample.integral.cell_gradient import column_length, turn_to_world
from isosample.integral.spline_cells import weighed_taps, weights_along

if TYPE_CHECKING:
    from isosample.integral.cell_light import CellLight

F64 = npt.NDArray[np.float64]


@compiled
def load_spline_gradient(
    taps: F64, kernel: F64, ends: F64, weights: F64, direction: F64, light: CellLight
) -> None:
    """Fill in the gradient of a spline along a ray through a cell.

    Parameters
    ----------
    taps : (4, 4, 4) float64
        Coefficients, indexed [z, y, x].
    kernel : (4, 4) float64
    ends : (2, 3) float64
        Start and end of the line in the cell (x, y, z), in [0, 1].
    weights : (3, 4, 4) float64
        Is overwritten.
    direction : (3,) float64
        Of the ray, in sample indices per world unit.
    light : CellLight
    """
    centre = taps[1, 1, 1]
    for c in range(4):
        for b in range(4):
            for a in range(4):
                light.taps[c, b, a] = abs(taps[c, b, a] - centre)
    largest = 0.0
    for axis in range(3):
        for other in range(3):
            chosen = light.slope_kernel if other == axis else kernel
            weights_along(chosen, ends[0, other], ends[1, other], weights[other])
        weighed_taps(taps, centre, weights, light.gradient[axis])
        for other in range(3):
            for a in range(4):
                for n in range(4):
                    light.sizes[other, a, n] = abs(weights[other, a, n])
        weighed_taps(light.taps, 0.0, light.sizes, light.mixed)
        largest += polynomial_bounds(light.mixed)[1] * column_length(light.world_from_slopes, axis)
    turn_to_world(light, direction, largest)

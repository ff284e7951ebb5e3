"""One explicit step of anisotropic diffusion on a grid with a spacing per axis: compiled."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from isosample.compiled import compiled

if TYPE_CHECKING:
    import numpy.typing as npt

    F32 = npt.NDArray[np.float32]
    F64 = npt.NDArray[np.float64]

Place = tuple[int, int, int]


@compiled
def slope_at(field: F32, place: Place, axis: int, inverse: F64) -> float:
    """Central difference along an axis per world unit; the sample at the border is repeated beyond it."""
    z, y, x = place
    dz, dy, dx = int(axis == 0), int(axis == 1), int(axis == 2)
    ahead = field[
        min(z + dz, field.shape[0] - 1), min(y + dy, field.shape[1] - 1), min(x + dx, field.shape[2] - 1)
    ]
    behind = field[max(z - dz, 0), max(y - dy, 0), max(x - dx, 0)]
    return 0.5 * (float(ahead) - float(behind)) * float(inverse[axis])


@compiled
def flux_behind(field: F32, place: Place, axis: int, inverse: F64, scale: float) -> float:
    """Conductance times slope on the face between a sample and the next one along an axis; 0 on the border.

    Parameters
    ----------
    field : (Z, Y, X) float32
    place : 3 ints
        Sample [z, y, x].
    axis : int
        0 = z, 1 = y, 2 = x.
    inverse : (3,) float64
        1 / spacing along z, y, x [1/world].
    scale : float
        The conductance is exp(−|∇f|² · scale).
    """
    z, y, x = place
    beyond = (z + (axis == 0), y + (axis == 1), x + (axis == 2))
    if beyond[0] >= field.shape[0] or beyond[1] >= field.shape[1] or beyond[2] >= field.shape[2]:
        return 0.0
    slope = (float(field[beyond[0], beyond[1], beyond[2]]) - float(field[z, y, x])) * float(inverse[axis])
    squared = slope * slope
    for across in range(3):
        if across != axis:
            mean = 0.5 * (slope_at(field, place, across, inverse) + slope_at(field, beyond, across, inverse))
            squared += mean * mean
    return slope * math.exp(-squared * scale)


@compiled
def diffuse_layers(
    field: F32, result: F32, first: int, last: int, inverse: F64, scale: float, time_step: float
) -> None:
    """Fill in layers first to last − 1 of the field one step later: f + Δt Σ (flux behind − flux before) / spacing."""
    _, height, width = field.shape
    before_z = np.zeros((height, width))
    if first > 0:
        for y in range(height):
            for x in range(width):
                before_z[y, x] = flux_behind(field, (first - 1, y, x), 0, inverse, scale)
    before_y = np.zeros(width)
    for z in range(first, last):
        before_y[:] = 0.0
        for y in range(height):
            before_x = 0.0
            for x in range(width):
                behind_z = flux_behind(field, (z, y, x), 0, inverse, scale)
                behind_y = flux_behind(field, (z, y, x), 1, inverse, scale)
                behind_x = flux_behind(field, (z, y, x), 2, inverse, scale)
                change = (
                    (behind_z - before_z[y, x]) * inverse[0]
                    + (behind_y - before_y[x]) * inverse[1]
                    + (behind_x - before_x) * inverse[2]
                )
                result[z, y, x] = field[z, y, x] + time_step * change
                before_z[y, x], before_y[x], before_x = behind_z, behind_y, behind_x


@compiled
def squared_slopes(field: F32, first: int, last: int, inverse: F64) -> float:
    """Sum of |∇f|² over the samples of layers first to last − 1, from central differences."""
    total = 0.0
    for z in range(first, last):
        for y in range(field.shape[1]):
            for x in range(field.shape[2]):
                for axis in range(3):
                    slope = slope_at(field, (z, y, x), axis, inverse)
                    total += slope * slope
    return total

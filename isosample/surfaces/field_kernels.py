"""The field inside a brick, trilinear or spline, and its gradient: compiled, in float64.

A place is a cell and fractions u, v, w of a sample step behind the cell's first sample (i, j, k), so that no bit
depends on the brick in whose coordinates the cell is numbered. The trilinear field is that of samples with one more on
each side: sample (i, j, k) is ``[k + 1, j + 1, i + 1]``, as with the coefficients of a spline. At the fraction 0 it is
read from the samples of that grid plane alone: cells on either side give the same bits, and a masked sample beside the
plane does not matter.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from isosample.compiled import compiled
from isosample.volume.spline_kernels import spline_value_gradient

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt

    F64 = npt.NDArray[np.float64]

Three = tuple[float, float, float]
Four = tuple[float, float, float, float]


@compiled
def trilinear_value_gradient(samples: F64, cell: Three, place: Three) -> Four:
    """Value and derivatives per sample step; 0 across a grid plane that holds the place."""
    i, j, k = int(cell[0]), int(cell[1]), int(cell[2])
    u, v, w = place
    left, right = i + 1, i + 1 + (u > 0.0)
    front, back = j + 1, j + 1 + (v > 0.0)
    low, high = k + 1, k + 1 + (w > 0.0)
    a, b = samples[low, front, left], samples[low, front, right]
    c, d = samples[low, back, left], samples[low, back, right]
    e, f = samples[high, front, left], samples[high, front, right]
    g, h = samples[high, back, left], samples[high, back, right]
    ab, cd = a * (1.0 - u) + b * u, c * (1.0 - u) + d * u
    ef, gh = e * (1.0 - u) + f * u, g * (1.0 - u) + h * u
    abcd, efgh = ab * (1.0 - v) + cd * v, ef * (1.0 - v) + gh * v
    slope_low = (b - a) * (1.0 - v) + (d - c) * v
    slope_high = (f - e) * (1.0 - v) + (h - g) * v
    return (
        abcd * (1.0 - w) + efgh * w,
        slope_low * (1.0 - w) + slope_high * w,
        (cd - ab) * (1.0 - w) + (gh - ef) * w,
        efgh - abcd,
    )


@compiled
def field_value_gradient(coefficients: F64, kernel: F64, smooth: bool, cell: Three, place: Three) -> Four:
    """Value and derivatives per sample step of the chosen reconstruction; cells are numbered as coefficients are."""
    if smooth:
        return spline_value_gradient(
            coefficients, kernel, cell[0] + place[0], cell[1] + place[1], cell[2] + place[2]
        )
    return trilinear_value_gradient(coefficients, cell, place)


@compiled
def sample_slope(samples: F64, k: int, j: int, i: int, axis: int) -> float:
    """Central difference at sample (i, j, k) per sample step, one-sided next to NaN, 0 between two NaN."""
    dx, dy, dz = int(axis == 0), int(axis == 1), int(axis == 2)
    here: float = samples[k + 1, j + 1, i + 1]
    ahead: float = samples[k + 1 + dz, j + 1 + dy, i + 1 + dx]
    behind: float = samples[k + 1 - dz, j + 1 - dy, i + 1 - dx]
    slope = 0.5 * (ahead - behind)
    if not math.isnan(slope):
        return slope
    if not math.isnan(ahead):
        return ahead - here
    return 0.0 if math.isnan(behind) else here - behind


@compiled
def interpolated_gradient(samples: F64, x: float, y: float, z: float) -> Three:
    """Trilinear interpolation of the central differences at samples; never −0."""
    i, j, k = math.floor(x), math.floor(y), math.floor(z)
    u, v, w = x - i, y - j, z - k
    right, back, high = i + (u > 0.0), j + (v > 0.0), k + (w > 0.0)
    found = (0.0, 0.0, 0.0)
    for axis in range(3):
        a, b = sample_slope(samples, k, j, i, axis), sample_slope(samples, k, j, right, axis)
        c, d = sample_slope(samples, k, back, i, axis), sample_slope(samples, k, back, right, axis)
        e, f = sample_slope(samples, high, j, i, axis), sample_slope(samples, high, j, right, axis)
        g, h = sample_slope(samples, high, back, i, axis), sample_slope(samples, high, back, right, axis)
        ab, cd = a * (1.0 - u) + b * u, c * (1.0 - u) + d * u
        ef, gh = e * (1.0 - u) + f * u, g * (1.0 - u) + h * u
        mixed = (ab * (1.0 - v) + cd * v) * (1.0 - w) + (ef * (1.0 - v) + gh * v) * w + 0.0
        if axis == 0:
            found = (mixed, found[1], found[2])
        elif axis == 1:
            found = (found[0], mixed, found[2])
        else:
            found = (found[0], found[1], mixed)
    return found


@compiled
def vertex_gradients(
    coefficients: F64, kernel: F64, smooth: bool, origin: F64, places: F64, found: F64
) -> None:
    """Fill in gradients (N, 3) at places (N, 3) in the brick's coordinates: the spline's, or interpolated."""
    for n in range(len(places)):
        x, y, z = places[n, 0], places[n, 1], places[n, 2]
        if smooth:
            _, gx, gy, gz = spline_value_gradient(
                coefficients, kernel, x + origin[0], y + origin[1], z + origin[2]
            )
        else:
            gx, gy, gz = interpolated_gradient(coefficients, x, y, z)
        found[n, 0], found[n, 1], found[n, 2] = gx, gy, gz

"""The gradient along a ray inside one cell, as polynomials, and where its component along the ray changes its sign.

The gradient is the one that the renderers light by. Of the trilinear field it interpolates, trilinearly too, the
central differences at the samples: one-sided at the volume's faces and beside samples that are not finite, 0 between
two such. Of a spline it is the spline's own (`spline_light`). So each component is a polynomial along a ray: of
degree 3, or 9.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from isosample.compiled import compiled
from isosample.integral.bernstein import halve_polynomial, is_monotone, polynomial_bounds, polynomial_root
from isosample.integral.cell_cubic import cubic_between
from isosample.integral.cell_light import CHANGE, DOUBT, MOST_TURN_HALVINGS, START, TURNS, WIDTH

if TYPE_CHECKING:
    from isosample.integral.cell_grid import CellGrid
    from isosample.integral.cell_light import CellLight

F64 = npt.NDArray[np.float64]
I64 = npt.NDArray[np.int64]

ROUNDING = 16 * 2.0**-53  # of a component of the gradient, relative to the largest that it is mixed from


@compiled
def slope_at(samples: npt.NDArray[Any], place: tuple[int, int, int], axis: int) -> float:
    """Central difference at a sample (x, y, z) per sample step: one-sided beside what is not there, or 0."""
    x, y, z = place
    dx, dy, dz = int(axis == 0), int(axis == 1), int(axis == 2)
    here = float(samples[z, y, x])
    ahead, behind = math.nan, math.nan
    if place[axis] + 1 < samples.shape[2 - axis]:
        ahead = float(samples[z + dz, y + dy, x + dx])
    if place[axis] > 0:
        behind = float(samples[z - dz, y - dy, x - dx])
    if math.isfinite(ahead):
        return 0.5 * (ahead - behind) if math.isfinite(behind) else ahead - here
    return here - behind if math.isfinite(behind) else 0.0


@compiled
def load_gradient(grid: CellGrid, cell: I64, ends: F64, direction: F64, light: CellLight) -> None:
    """Fill in the gradient of the trilinear field along a ray through a cell.

    Parameters
    ----------
    grid : CellGrid
    cell : (3,) int64
        (x, y, z)
    ends : (2, 3) float64
        Where the ray enters and leaves the cell, in [0, 1].
    direction : (3,) float64
        Of the ray, in sample indices per world unit.
    light : CellLight
    """
    x, y, z = int(cell[0]), int(cell[1]), int(cell[2])
    largest = 0.0
    for axis in range(3):
        slopes, sizes = light.slopes[0], light.slopes[1]
        for k in range(2):
            for j in range(2):
                for i in range(2):
                    slopes[k, j, i] = slope_at(grid.samples, (x + i, y + j, z + k), axis)
                    sizes[k, j, i] = abs(slopes[k, j, i])
        cubic, mixed = cubic_between(slopes, ends[0], ends[1]), cubic_between(sizes, ends[0], ends[1])
        for n in range(4):
            light.gradient[axis, n] = cubic[n]
        steepest = max(max(mixed[0], mixed[1]), max(mixed[2], mixed[3]))
        largest += steepest * column_length(light.world_from_slopes, axis)
    turn_to_world(light, direction, largest)


@compiled
def column_length(matrix: F64, column: int) -> float:
    """Length of a column of a (3, 3) matrix."""
    return math.sqrt(matrix[0, column] ** 2 + matrix[1, column] ** 2 + matrix[2, column] ** 2)


@compiled
def turn_to_world(light: CellLight, direction: F64, largest: float) -> None:
    """Turn derivatives per sample step into the world's, add the component along the ray, and divide by the largest.

    `largest` is a bound of the sizes of all that is mixed, mixed alike [data units / world]; where no more is left than
    its rounding, the gradient is taken for 0.
    """
    gradient, matrix = light.gradient, light.world_from_slopes
    most = 0.0
    for n in range(gradient.shape[1]):
        x, y, z = gradient[0, n], gradient[1, n], gradient[2, n]
        gradient[3, n] = x * direction[0] + y * direction[1] + z * direction[2]
        for row in range(3):
            gradient[row, n] = matrix[row, 0] * x + matrix[row, 1] * y + matrix[row, 2] * z
            most = max(most, abs(gradient[row, n]))
    light.numbers[START], light.numbers[WIDTH], light.numbers[DOUBT] = 0.0, 1.0, 0.0
    light.numbers[CHANGE], light.numbers[TURNS] = 0.0, 0.0
    if most <= ROUNDING * largest:
        gradient[:] = 0.0
        return
    light.numbers[DOUBT] = ROUNDING * max(1.0, largest / most)
    for n in range(gradient.shape[1]):
        for row in range(4):
            gradient[row, n] /= most
    last = gradient.shape[1] - 1
    for n in range(last):
        change = 0.0
        for row in range(3):
            change += (last * (gradient[row, n + 1] - gradient[row, n])) ** 2
        light.numbers[CHANGE] = max(light.numbers[CHANGE], math.sqrt(change))
    find_turns(light)


@compiled
def find_turns(light: CellLight) -> None:
    """Find where the component along the ray changes its sign: it is halved until it is of one sign, or monotone."""
    waiting, doubt = light.waiting, light.numbers[DOUBT]
    count = len(light.row)
    for i in range(count):
        waiting[0, i] = light.gradient[3, i]
    waiting[0, count] = 1.0  # what part of the cell it is
    start, top, before = 0.0, 0, 0.0
    while top >= 0:
        part, width = waiting[top, :count], waiting[top, count]
        low, high = polynomial_bounds(part)
        mixed = low < -doubt and high > doubt
        monotone = mixed and is_monotone(part)
        if mixed and not monotone and width > 0.5**MOST_TURN_HALVINGS:
            waiting[top, count] = waiting[top + 1, count] = 0.5 * width
            halve_polynomial(part, waiting[top + 1, :count])
            top += 1
            continue
        first = part[0] if mixed else (high if high > doubt else (low if low < -doubt else 0.0))
        if before * first < 0.0:
            _add_turn(light, start)
        before = first if first != 0.0 else before
        if monotone:
            _add_turn(light, start + width * polynomial_root(part, 0.0, part[0] < part[count - 1], light.row))
            before = part[count - 1]
        start += width
        top -= 1


@compiled
def _add_turn(light: CellLight, place: float) -> None:
    found = int(light.numbers[TURNS])
    if found < len(light.turns):
        light.turns[found] = place
        light.numbers[TURNS] = found + 1.0

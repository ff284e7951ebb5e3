"""Vertices moved onto the isosurface, inside their cell: compiled, in float64."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from isosample.compiled import compiled
from isosample.surfaces.field_kernels import field_value_gradient
from isosample.surfaces.positions import POSITION_STEPS, SMALLEST_FRACTION
from isosample.surfaces.root_kernels import ROOT_ROUNDS, ROOT_STEP

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt

    F64 = npt.NDArray[np.float64]

Three = tuple[float, float, float]


@compiled
def ahead(place: Three, direction: Three, distance: float) -> Three:
    """Return the place at a distance along a direction."""
    return (
        place[0] + distance * direction[0],
        place[1] + distance * direction[1],
        place[2] + distance * direction[2],
    )


@compiled
def distance_along(
    coefficients: F64,
    kernel: F64,
    smooth: bool,
    isovalue: float,
    cell: Three,
    place: Three,
    direction: Three,
    height: float,
    slope: float,
    reach: float,
) -> float:
    """Distance from a place to the isosurface along a unit vector, NaN if none is found within `reach`.

    `height` = field − isovalue and `slope` = size of its derivative along the vector at the place, where the
    field runs towards the isovalue. Newton steps inside a bracket, which is halved where they leave it.
    """
    inside = height >= 0.0
    guess = abs(height) / slope
    high = min(2.0 * guess, reach)
    end = field_value_gradient(coefficients, kernel, smooth, cell, ahead(place, direction, high))[0]
    if (end >= isovalue) == inside:
        high = reach
        end = field_value_gradient(coefficients, kernel, smooth, cell, ahead(place, direction, high))[0]
        if (end >= isovalue) == inside:
            return math.nan
    low = 0.0
    s = guess if guess < high else 0.5 * high
    for _ in range(ROOT_ROUNDS):
        value, gx, gy, gz = field_value_gradient(
            coefficients, kernel, smooth, cell, ahead(place, direction, s)
        )
        if (value >= isovalue) == inside:
            low = s
        else:
            high = s
        along = gx * direction[0] + gy * direction[1] + gz * direction[2]
        following = s - (value - isovalue) / along if along != 0.0 else low
        if not low < following < high:
            following = 0.5 * (low + high)
        step, s = abs(following - s), following
        if step < ROOT_STEP:
            break
    return s


@compiled
def room(place: float, direction: float) -> float:
    """How far one may go along one coordinate inside a cell, of which a border of 2**-19 is left free."""
    if direction > 0.0:
        return max(1.0 - SMALLEST_FRACTION - place, 0.0) / direction
    if direction < 0.0:
        return max(place - SMALLEST_FRACTION, 0.0) / -direction
    return math.inf


@compiled
def rounded(coordinate: float) -> float:
    """Return the nearest multiple of 2**-19, ties to even."""
    return round(coordinate * POSITION_STEPS) / POSITION_STEPS


@compiled
def settled(before: float, after: float, direction: float) -> float:
    """Fraction where a move along one coordinate ends: rounded, and not farther into the border than it began."""
    if direction == 0.0:
        return before
    low, high = min(before, SMALLEST_FRACTION), max(before, 1.0 - SMALLEST_FRACTION)
    return min(max(rounded(after), low), high)


@compiled
def free_room(place: Three, direction: Three) -> tuple[float, int]:
    """How far one may go along a direction inside a cell, and the axis that ends it."""
    x, y, z = room(place[0], direction[0]), room(place[1], direction[1]), room(place[2], direction[2])
    if x <= y and x <= z:
        return x, 0
    return (y, 1) if y <= z else (z, 2)


@compiled
def moved_onto_isosurface(
    coefficients: F64,
    kernel: F64,
    smooth: bool,
    isovalue: float,
    cell: Three,
    place: Three,
    direction: Three,
    height: float,
    slope: float,
    reach: float,
) -> tuple[bool, Three]:
    """Whether the isosurface lies within `reach` along a unit vector, and the place moved there.

    Components of `direction` that are 0 keep their coordinate.
    """
    s = distance_along(coefficients, kernel, smooth, isovalue, cell, place, direction, height, slope, reach)
    if math.isnan(s):
        return False, place
    x, y, z = ahead(place, direction, s)
    return True, (
        settled(place[0], x, direction[0]),
        settled(place[1], y, direction[1]),
        settled(place[2], z, direction[2]),
    )


@compiled
def towards(height: float, gradient: Three) -> tuple[float, Three]:
    """Size of a gradient, and the unit vector along it on which the field runs towards the isovalue."""
    gx, gy, gz = gradient
    slope = math.sqrt(gx * gx + gy * gy + gz * gz)
    scale = -math.copysign(1.0 / slope, height) if slope > 0.0 else 0.0
    return slope, (scale * gx, scale * gy, scale * gz)


@compiled
def shifted(cell: Three, origin: F64) -> Three:
    """The cell numbered as the coefficients are."""
    return cell[0] + origin[0], cell[1] + origin[1], cell[2] + origin[2]


@compiled
def place_centres(
    coefficients: F64, kernel: F64, smooth: bool, origin: F64, isovalue: float, reach: float, places: F64
) -> None:
    """Move vertices inside cells (N, 3) along the gradient onto the isosurface, if it is within `reach`."""
    for n in range(len(places)):
        cell = (math.floor(places[n, 0]), math.floor(places[n, 1]), math.floor(places[n, 2]))
        place = (places[n, 0] - cell[0], places[n, 1] - cell[1], places[n, 2] - cell[2])
        there = shifted(cell, origin)
        value, gx, gy, gz = field_value_gradient(coefficients, kernel, smooth, there, place)
        height = value - isovalue
        slope, direction = towards(height, (gx, gy, gz))
        if height == 0.0 or slope == 0.0:
            continue
        limit = min(reach, free_room(place, direction)[0])
        _, (u, v, w) = moved_onto_isosurface(
            coefficients, kernel, smooth, isovalue, there, place, direction, height, slope, limit
        )
        places[n, 0], places[n, 1], places[n, 2] = cell[0] + u, cell[1] + v, cell[2] + w

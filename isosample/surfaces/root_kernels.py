"""Places on the isosurface: roots on grid edges, vertices that divide the edges of a mesh; compiled, in float64."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from isosample.compiled import compiled
from isosample.surfaces.field_kernels import field_value_gradient, trilinear_value_gradient
from isosample.surfaces.positions import POSITION_STEPS, SMALLEST_FRACTION
from isosample.volume.spline_kernels import spline_value_gradient

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt

    F64 = npt.NDArray[np.float64]
    I64 = npt.NDArray[np.int64]
    Bool = npt.NDArray[np.bool_]

Three = tuple[float, float, float]
Four = tuple[float, float, float, float]

LARGEST_SHIFT = 0.5  # of an edge's length: an edge whose isosurface is farther from its middle stays whole
TINY = 1e-300
STEEPEST = 0.5  # least sine of the angle between gradient and edge: across it the isosurface must lie
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
def middle(a: float, b: float) -> float:
    """Fraction halfway between two in a cell, rounded; on a grid plane only where both are."""
    if a == b:
        return a
    return min(max(rounded(0.5 * a + 0.5 * b), SMALLEST_FRACTION), 1.0 - SMALLEST_FRACTION)


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
def without_frozen(vector: Three, frozen: int) -> Three:
    """The vector with the components 0 whose bits are set."""
    return (
        0.0 if frozen & 1 else vector[0],
        0.0 if frozen & 2 else vector[1],
        0.0 if frozen & 4 else vector[2],
    )


@compiled
def across(gradient: Three, edge: Three) -> Three:
    """The part of a gradient at right angles to an edge."""
    square = edge[0] * edge[0] + edge[1] * edge[1] + edge[2] * edge[2]
    along = (gradient[0] * edge[0] + gradient[1] * edge[1] + gradient[2] * edge[2]) / max(square, TINY)
    return gradient[0] - along * edge[0], gradient[1] - along * edge[1], gradient[2] - along * edge[2]


@compiled
def size(vector: Three) -> float:
    """Length of a vector."""
    return math.sqrt(vector[0] * vector[0] + vector[1] * vector[1] + vector[2] * vector[2])


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


@compiled
def slope_across(samples: F64, cell: Three, place: Three, value: float, axis: int) -> float:
    """Derivative of the trilinear field across a grid plane: the mean of both sides, or of the one that there is."""
    x, y, z = place
    if axis == 0:
        after = trilinear_value_gradient(samples, cell, (1.0, y, z))[0] - value
        before = value - trilinear_value_gradient(samples, (cell[0] - 1.0, cell[1], cell[2]), place)[0]
    elif axis == 1:
        after = trilinear_value_gradient(samples, cell, (x, 1.0, z))[0] - value
        before = value - trilinear_value_gradient(samples, (cell[0], cell[1] - 1.0, cell[2]), place)[0]
    else:
        after = trilinear_value_gradient(samples, cell, (x, y, 1.0))[0] - value
        before = value - trilinear_value_gradient(samples, (cell[0], cell[1], cell[2] - 1.0), place)[0]
    if math.isnan(after):
        return 0.0 if math.isnan(before) else before
    return after if math.isnan(before) else 0.5 * (before + after)


@compiled
def divide_edges(
    coefficients: F64,
    kernel: F64,
    smooth: bool,
    origin: F64,
    isovalue: float,
    tolerance: float,
    positions: F64,
    edges: I64,
    places: F64,
    divided: Bool,
) -> None:
    """Decide which edges (E, 2) of a mesh are divided, and where their new vertices lie.

    An edge is divided if its middle is farther than `tolerance` [voxel] from the isosurface (to first order) and
    the isosurface is found at right angles to the edge, at most half its length away and inside the cell: an edge
    that is shorter than 2 tolerances stays whole. An edge on a grid plane keeps its vertex on the plane. All depends
    on the two ends alone, in either order.
    """
    for e in range(len(edges)):
        a, b = edges[e, 0], edges[e, 1]
        edge = (
            positions[b, 0] - positions[a, 0],
            positions[b, 1] - positions[a, 1],
            positions[b, 2] - positions[a, 2],
        )
        if size(edge) <= tolerance / LARGEST_SHIFT:
            continue
        cell = (
            math.floor(min(positions[a, 0], positions[b, 0])),
            math.floor(min(positions[a, 1], positions[b, 1])),
            math.floor(min(positions[a, 2], positions[b, 2])),
        )
        place = (
            middle(positions[a, 0] - cell[0], positions[b, 0] - cell[0]),
            middle(positions[a, 1] - cell[1], positions[b, 1] - cell[1]),
            middle(positions[a, 2] - cell[2], positions[b, 2] - cell[2]),
        )
        there = shifted(cell, origin)
        value, gx, gy, gz = field_value_gradient(coefficients, kernel, smooth, there, place)
        if not smooth:
            gx = slope_across(coefficients, there, place, value, 0) if place[0] == 0.0 else gx
            gy = slope_across(coefficients, there, place, value, 1) if place[1] == 0.0 else gy
            gz = slope_across(coefficients, there, place, value, 2) if place[2] == 0.0 else gz
        height, gradient = value - isovalue, (gx, gy, gz)
        if abs(height) <= tolerance * size(gradient):
            continue
        frozen = int(place[0] == 0.0) + 2 * int(place[1] == 0.0) + 4 * int(place[2] == 0.0)
        for _ in range(2):
            free = without_frozen(gradient, frozen)
            slope, direction = towards(height, across(free, without_frozen(edge, frozen)))
            if slope <= STEEPEST * size(free):
                break
            freedom, blocking = free_room(place, direction)
            reach = LARGEST_SHIFT * size(edge)
            found, (u, v, w) = moved_onto_isosurface(
                coefficients,
                kernel,
                smooth,
                isovalue,
                there,
                place,
                direction,
                height,
                slope,
                min(reach, freedom),
            )
            if found:
                places[e, 0], places[e, 1], places[e, 2] = cell[0] + u, cell[1] + v, cell[2] + w
                divided[e] = True
            if found or freedom >= reach:
                break
            frozen |= 1 << blocking

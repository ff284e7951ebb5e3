"""Which edges of a mesh are divided, and where their new vertices lie: compiled, in float64."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from isosample.compiled import compiled
from isosample.surfaces.field_kernels import field_value_gradient, trilinear_value_gradient
from isosample.surfaces.placement_kernels import free_room, moved_onto_isosurface, rounded, shifted, towards
from isosample.surfaces.positions import SMALLEST_FRACTION

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt

    F64 = npt.NDArray[np.float64]
    I64 = npt.NDArray[np.int64]
    Bool = npt.NDArray[np.bool_]

Three = tuple[float, float, float]

LARGEST_SHIFT = 0.5  # of an edge's length: an edge whose isosurface is farther from its middle stays whole
TINY = 1e-300
STEEPEST = 0.5  # least sine of the angle between gradient and edge: across it the isosurface must lie


@compiled
def middle(a: float, b: float) -> float:
    """Fraction halfway between two in a cell, rounded; on a grid plane only where both are."""
    if a == b:
        return a
    return min(max(rounded(0.5 * a + 0.5 * b), SMALLEST_FRACTION), 1.0 - SMALLEST_FRACTION)


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

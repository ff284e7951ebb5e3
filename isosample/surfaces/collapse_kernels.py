"""Half-edge collapses on one mesh, each measured against the field before it is made: compiled, in float64.

The linked lists of corners are those of `ring_kernels`.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from isosample.compiled import compiled
from isosample.surfaces.residual_kernels import largest_distance
from isosample.surfaces.ring_kernels import (
    LARGEST_RING,
    NONE,
    fan_of,
    keeps_topology,
    move_onto,
    ordered_ring,
)

if TYPE_CHECKING:
    import numpy.typing as npt

    F64 = npt.NDArray[np.float64]
    I32 = npt.NDArray[np.int32]

LEAST_COSINE = 0.25  # between a new triangle's normal and the gradients at its corners
LEAST_SHAPE = 0.005  # of a new triangle: 1 is equilateral, 0 a line
FIRST_SHARE = 1.0 / 8.0  # of the tolerance: collapses that cost little come first
STALLED = 0.02  # share of the vertices that one more pass must remove


@compiled
def collapse(
    coefficients: F64,
    kernel: F64,
    smooth: bool,
    origin: F64,
    isovalue: float,
    positions: F64,
    gradients: F64,
    triangles: I32,
    tolerance: float,
) -> None:
    """Move vertices onto neighbours while every new triangle stays within `tolerance` [voxel] of the isosurface.

    A vertex on the border of the mesh, or where the mesh is no manifold, stays. Collapses keep the topology (the link
    condition of Dey, Edelsbrunner, Guha and Nekhayev, "Topology preserving edge contraction", 1999).

    Parameters
    ----------
    coefficients, kernel, smooth, origin
        Of the brick, see `BrickSamples`.
    isovalue : float
    positions : (V, 3) float64
        In the brick's index coordinates [voxel].
    gradients : (V, 3) float64
        Per sample step.
    triangles : (T, 3) int32
        Changed in place; triangles that are gone have −1 at their first corner.
    tolerance : float
        Largest distance from the isosurface of a new triangle, see `largest_distance` [voxel].
    """
    count = len(positions)
    first = np.full(count, NONE, dtype=np.int32)
    following = np.full(triangles.size, NONE, dtype=np.int32)
    for t in range(len(triangles)):
        for i in range(3):
            corner = 3 * t + i
            following[corner] = first[triangles[t, i]]
            first[triangles[t, i]] = corner
    waiting = np.ones(count, dtype=np.bool_)  # vertices whose surroundings changed since they were looked at
    fixed = np.zeros(count, dtype=np.bool_)
    touched = np.full(count, NONE, dtype=np.int32)  # the pass in which a vertex's surroundings changed
    marked = np.full(count, NONE, dtype=np.int32)
    ring = np.empty(LARGEST_RING, dtype=np.int32)
    fan = np.empty((LARGEST_RING, 3), dtype=np.int32)
    left, number, share, marks = count, 0, FIRST_SHARE, 0
    while True:
        removed = 0
        for vertex in range(count):
            if fixed[vertex] or not waiting[vertex] or touched[vertex] == number:
                continue
            size = ordered_ring(vertex, triangles, first, following, ring)
            if size == 0:
                fixed[vertex] = True
                continue
            waiting[vertex] = False
            for n in range(size):
                marked[ring[n]] = marks
            onto = cheapest(
                vertex,
                ring,
                size,
                positions,
                gradients,
                triangles,
                first,
                following,
                marked,
                marks,
                share * tolerance,
            )
            marks += 1
            if onto == NONE:
                continue
            fan_size = fan_of(ring, size, onto, fan)
            if not keeps_shape(fan, fan_size, positions, gradients):
                continue
            far = largest_distance(
                coefficients, kernel, smooth, origin, isovalue, positions, fan[:fan_size], tolerance
            )
            if far > tolerance:
                continue
            move_onto(vertex, ring[onto], triangles, first, following)
            fixed[vertex] = True
            removed += 1
            for n in range(size):
                touched[ring[n]] = number
                waiting[ring[n]] = True
        number += 1
        left -= removed
        if removed <= STALLED * left:
            if share == 1.0:
                return
            share *= 2.0
            waiting[:] = True


@compiled
def cheapest(
    vertex: int,
    ring: I32,
    size: int,
    positions: F64,
    gradients: F64,
    triangles: I32,
    first: I32,
    following: I32,
    marked: I32,
    mark: int,
    limit: float,
) -> int:
    """Place in the ring of the neighbour onto which the vertex is moved at least cost; −1 if none costs below `limit`.

    The cost is the sagitta of the new sides, as the gradients at their ends tell it. `marked` has `mark` at the ring.
    """
    best, least = NONE, limit
    for n in range(size):
        cost = 0.0
        for step in range(2, size - 1):
            cost = max(cost, sagitta(ring[n], ring[(n + step) % size], positions, gradients))
            if cost >= least:
                break
        # moving along an almost straight side is preferred to moving across one that bends
        cost = max(cost, sagitta(vertex, ring[n], positions, gradients))
        if cost < least and keeps_topology(vertex, ring, size, n, triangles, first, following, marked, mark):
            best, least = n, cost
    return best


@compiled
def sagitta(a: int, b: int, positions: F64, gradients: F64) -> float:
    """How far the isosurface is from the middle of a side, to second order [voxel]: (G_a − G_b) · (b − a) / 8 |G|."""
    bend, square = 0.0, 0.0
    for axis in range(3):
        bend += (gradients[a, axis] - gradients[b, axis]) * (positions[b, axis] - positions[a, axis])
        mean = 0.5 * (gradients[a, axis] + gradients[b, axis])
        square += mean * mean
    if square == 0.0:
        return math.inf
    return abs(bend) / (8.0 * math.sqrt(square))


@compiled
def keeps_shape(fan: I32, size: int, positions: F64, gradients: F64) -> bool:
    """Whether triangles face the falling values, as the gradients at their corners have it, and are no slivers."""
    for n in range(size):
        a, b, c = fan[n, 0], fan[n, 1], fan[n, 2]
        ux, uy, uz = difference(positions, a, b)
        vx, vy, vz = difference(positions, a, c)
        wx, wy, wz = difference(positions, b, c)
        x, y, z = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
        area = math.sqrt(x * x + y * y + z * z)  # twice the triangle's
        sides = ux * ux + uy * uy + uz * uz + vx * vx + vy * vy + vz * vz + wx * wx + wy * wy + wz * wz
        if 2.0 * math.sqrt(3.0) * area < LEAST_SHAPE * sides:
            return False
        for i in range(3):
            corner = fan[n, i]
            gx, gy, gz = gradients[corner, 0], gradients[corner, 1], gradients[corner, 2]
            if -(x * gx + y * gy + z * gz) < LEAST_COSINE * area * math.sqrt(gx * gx + gy * gy + gz * gz):
                return False
    return True


@compiled
def difference(positions: F64, a: int, b: int) -> tuple[float, float, float]:
    """Vector from vertex a to vertex b."""
    return (
        positions[b, 0] - positions[a, 0],
        positions[b, 1] - positions[a, 1],
        positions[b, 2] - positions[a, 2],
    )

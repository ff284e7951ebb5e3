"""The field sampled inside triangles, flat and corrected: compiled, in float64."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from isosample.compiled import compiled
from isosample.surfaces.field_kernels import field_value_gradient

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt

    F64 = npt.NDArray[np.float64]
    I32 = npt.NDArray[np.int32]

Three = tuple[float, float, float]
Four = tuple[float, float, float, float]

LARGEST_MOVE = 0.5  # of a corrected point [voxel]
LARGEST_DISTANCE = math.sqrt(3.0)  # a cell's diagonal [voxel]
_ROOT = math.sqrt(15.0)
_SIDE, _CORNER = (6.0 + _ROOT) / 21.0, (6.0 - _ROOT) / 21.0
SIDE_WEIGHT, CORNER_WEIGHT, CENTRE_WEIGHT = (155.0 + _ROOT) / 1200.0, (155.0 - _ROOT) / 1200.0, 9.0 / 40.0
POINTS = (
    (1.0 / 3.0, 1.0 / 3.0, 1.0 / 3.0, CENTRE_WEIGHT),
    (_SIDE, _SIDE, 1.0 - 2.0 * _SIDE, SIDE_WEIGHT),
    (_SIDE, 1.0 - 2.0 * _SIDE, _SIDE, SIDE_WEIGHT),
    (1.0 - 2.0 * _SIDE, _SIDE, _SIDE, SIDE_WEIGHT),
    (_CORNER, _CORNER, 1.0 - 2.0 * _CORNER, CORNER_WEIGHT),
    (_CORNER, 1.0 - 2.0 * _CORNER, _CORNER, CORNER_WEIGHT),
    (1.0 - 2.0 * _CORNER, _CORNER, _CORNER, CORNER_WEIGHT),
)
POINT_SHARES = tuple(point[:3] for point in POINTS)


@compiled
def between(place: float, low: float, high: float) -> float:
    """The nearest number in [low, high]."""
    return min(max(place, low), high)


@compiled
def distance_of(height: float, gx: float, gy: float, gz: float) -> float:
    """First-order distance from the isosurface [voxel], at most a cell's diagonal; that too where there is no field."""
    steepness = math.sqrt(gx * gx + gy * gy + gz * gz)
    if height < LARGEST_DISTANCE * steepness:
        return height / steepness
    return 0.0 if height == 0.0 else LARGEST_DISTANCE


@compiled
def correction(
    positions: F64, gradients: F64, corners: I32, shares: Three, cell: Three, place: Three
) -> Three:
    """Return the step [voxel] that takes a point of a triangle to where the quadratic has the isovalue."""
    error, gx, gy, gz = 0.0, 0.0, 0.0, 0.0
    for corner in range(3):
        n, share = corners[corner], shares[corner]
        error += share * (
            gradients[n, 0] * (place[0] - (positions[n, 0] - cell[0]))
            + gradients[n, 1] * (place[1] - (positions[n, 1] - cell[1]))
            + gradients[n, 2] * (place[2] - (positions[n, 2] - cell[2]))
        )
        gx += share * gradients[n, 0]
        gy += share * gradients[n, 1]
        gz += share * gradients[n, 2]
    square = gx * gx + gy * gy + gz * gz
    if square == 0.0:
        return 0.0, 0.0, 0.0
    scale = -0.5 * error / square
    length = abs(scale) * math.sqrt(square)
    if length > LARGEST_MOVE:
        scale *= LARGEST_MOVE / length
    return scale * gx, scale * gy, scale * gz


@compiled
def common_cell(positions: F64, corners: I32) -> tuple[bool, Three]:
    """Whether the corners of a triangle lie in one cell, and which; of larger ones, that of their lowest corner."""
    a, b, c = corners[0], corners[1], corners[2]
    x, y, z = (
        math.floor(min(positions[a, 0], min(positions[b, 0], positions[c, 0]))),
        math.floor(min(positions[a, 1], min(positions[b, 1], positions[c, 1]))),
        math.floor(min(positions[a, 2], min(positions[b, 2], positions[c, 2]))),
    )
    one = (
        max(positions[a, 0], max(positions[b, 0], positions[c, 0])) <= x + 1.0
        and max(positions[a, 1], max(positions[b, 1], positions[c, 1])) <= y + 1.0
        and max(positions[a, 2], max(positions[b, 2], positions[c, 2])) <= z + 1.0
    )
    return one, (x, y, z)


@compiled
def place_in(positions: F64, corners: I32, shares: Three, one: bool, cell: Three) -> tuple[Three, Three]:
    """The cell of the point of a triangle with barycentric coordinates `shares`, and the fractions there.

    `one` and `cell` are what `common_cell` found. Rounding takes no point beyond the corners.
    """
    x, y, z = 0.0, 0.0, 0.0
    for corner in range(3):
        n, share = corners[corner], shares[corner]
        x += share * (positions[n, 0] - cell[0])
        y += share * (positions[n, 1] - cell[1])
        z += share * (positions[n, 2] - cell[2])
    if one:
        return cell, (between(x, 0.0, 1.0), between(y, 0.0, 1.0), between(z, 0.0, 1.0))
    a, b, c = corners[0], corners[1], corners[2]
    x = between(x, 0.0, max(positions[a, 0], max(positions[b, 0], positions[c, 0])) - cell[0])
    y = between(y, 0.0, max(positions[a, 1], max(positions[b, 1], positions[c, 1])) - cell[1])
    z = between(z, 0.0, max(positions[a, 2], max(positions[b, 2], positions[c, 2])) - cell[2])
    i, j, k = math.floor(x), math.floor(y), math.floor(z)
    return (cell[0] + i, cell[1] + j, cell[2] + k), (x - i, y - j, z - k)


@compiled
def field_near(coefficients: F64, kernel: F64, smooth: bool, cell: Three, place: Three) -> Four:
    """Value and derivatives near a cell; in the cell where the field ends before the place."""
    if smooth:
        last_x, last_y, last_z = (
            coefficients.shape[2] - 3.0,
            coefficients.shape[1] - 3.0,
            coefficients.shape[0] - 3.0,
        )
        place = (
            between(place[0], -cell[0], last_x - cell[0]),
            between(place[1], -cell[1], last_y - cell[1]),
            between(place[2], -cell[2], last_z - cell[2]),
        )
        return field_value_gradient(coefficients, kernel, smooth, cell, place)
    i, j, k = math.floor(place[0]), math.floor(place[1]), math.floor(place[2])
    found = field_value_gradient(
        coefficients,
        kernel,
        smooth,
        (cell[0] + i, cell[1] + j, cell[2] + k),
        (place[0] - i, place[1] - j, place[2] - k),
    )
    if not math.isnan(found[0]):
        return found
    place = between(place[0], 0.0, 1.0), between(place[1], 0.0, 1.0), between(place[2], 0.0, 1.0)
    return field_value_gradient(coefficients, kernel, smooth, cell, place)


@compiled
def area_of(positions: F64, corners: I32) -> float:
    """Area of a triangle [voxel²]."""
    a, b, c = corners[0], corners[1], corners[2]
    ux, uy, uz = (
        positions[b, 0] - positions[a, 0],
        positions[b, 1] - positions[a, 1],
        positions[b, 2] - positions[a, 2],
    )
    vx, vy, vz = (
        positions[c, 0] - positions[a, 0],
        positions[c, 1] - positions[a, 1],
        positions[c, 2] - positions[a, 2],
    )
    x, y, z = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    return 0.5 * math.sqrt(x * x + y * y + z * z)


@compiled
def largest_distance(
    coefficients: F64,
    kernel: F64,
    smooth: bool,
    origin: F64,
    isovalue: float,
    positions: F64,
    triangles: I32,
    limit: float,
) -> float:
    """Largest first-order distance from the isosurface of points of the triangles [voxel], or one above `limit`.

    Seven points each, those of `POINTS`, and where a side is longer than a voxel the centroids of the parts of a
    regular division into triangles whose sides are not. Where there is no gradient, the distance is that of
    `LARGEST_DISTANCE`.
    """
    largest = 0.0
    for t in range(len(triangles)):
        corners = triangles[t]
        one, lowest = common_cell(positions, corners)
        parts = math.ceil(longest_side(positions, corners))
        count = len(POINTS) + (parts * parts if parts > 1 else 0)
        for n in range(count):
            shares = POINT_SHARES[n] if n < len(POINTS) else part_centre(n - len(POINTS), parts)
            cell, place = place_in(positions, corners, shares, one, lowest)
            there = (cell[0] + origin[0], cell[1] + origin[1], cell[2] + origin[2])
            value, gx, gy, gz = field_value_gradient(coefficients, kernel, smooth, there, place)
            if gx == 0.0 and gy == 0.0 and gz == 0.0:
                return LARGEST_DISTANCE
            largest = max(largest, distance_of(abs(value - isovalue), gx, gy, gz))
            if largest > limit:
                return largest
    return largest


@compiled
def longest_side(positions: F64, corners: I32) -> float:
    """Length of a triangle's longest side [voxel]."""
    longest = 0.0
    for corner in range(3):
        a, b = corners[corner], corners[(corner + 1) % 3]
        x, y, z = (
            positions[b, 0] - positions[a, 0],
            positions[b, 1] - positions[a, 1],
            positions[b, 2] - positions[a, 2],
        )
        longest = max(longest, x * x + y * y + z * z)
    return math.sqrt(longest)


@compiled
def part_centre(number: int, parts: int) -> Three:
    """Barycentric coordinates of the centroid of one of parts² equal triangles into which a triangle is divided."""
    row, column = number // parts, number % parts
    turned = row + column >= parts  # the other half of the parallelogram, folded back: triangles upside down
    i, j = (parts - 1 - row, parts - 1 - column) if turned else (row, column)
    third = 2.0 / 3.0 if turned else 1.0 / 3.0
    u, v = (i + third) / parts, (j + third) / parts
    return u, v, 1.0 - u - v


@compiled
def triangle_residuals(
    coefficients: F64,
    kernel: F64,
    smooth: bool,
    origin: F64,
    isovalue: float,
    positions: F64,
    gradients: F64,
    triangles: I32,
    residuals: F64,
    sums: F64,
) -> None:
    """Raise `residuals` (V, 2) to the largest abs(field − isovalue) around each vertex, and fill in `sums`.

    `sums` (5,): area, ∫ flat distance², largest flat distance, ∫ corrected distance², largest corrected one.
    """
    for t in range(len(triangles)):
        corners = triangles[t]
        area = area_of(positions, corners)
        sums[0] += area
        flat, curved = 0.0, 0.0
        one, lowest = common_cell(positions, corners)
        for la, lb, lc, weight in POINTS:
            shares = (la, lb, lc)
            cell, place = place_in(positions, corners, shares, one, lowest)
            there = (cell[0] + origin[0], cell[1] + origin[1], cell[2] + origin[2])
            value, gx, gy, gz = field_value_gradient(coefficients, kernel, smooth, there, place)
            height = abs(value - isovalue)
            flat = max(flat, height)
            distance = distance_of(height, gx, gy, gz)
            sums[1] += area * weight * distance * distance
            sums[2] = max(sums[2], distance)
            step = correction(positions, gradients, corners, shares, cell, place)
            moved = (place[0] + step[0], place[1] + step[1], place[2] + step[2])
            value, gx, gy, gz = field_near(coefficients, kernel, smooth, there, moved)
            height = abs(value - isovalue)
            curved = max(curved, height)
            distance = distance_of(height, gx, gy, gz)
            sums[3] += area * weight * distance * distance
            sums[4] = max(sums[4], distance)
        for corner in range(3):
            n = corners[corner]
            residuals[n, 0] = max(residuals[n, 0], flat)
            residuals[n, 1] = max(residuals[n, 1], curved)

"""The field inside a brick, trilinear or spline, and places on its isosurface: compiled, in float64.

The trilinear field is that of samples with one more on each side: sample (i, j, k) is ``[k + 1, j + 1, i + 1]``,
as with the coefficients of a spline. On a grid plane it is read from the samples of that plane alone, so that a
brick on either side computes the same bits and a masked sample beside the plane does not matter.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from isosample.compiled import compiled
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
STEEPEST = 0.5  # least sine of the angle between gradient and edge: across it the isosurface must lie
ROOT_STEP = 2.0**-24  # a root is found when it moves by less [voxel]; positions are rounded to 2**-17
ROOT_ROUNDS = 80  # bisection alone needs 24 + 1


@compiled
def trilinear_value_gradient(samples: F64, x: float, y: float, z: float) -> Four:
    """Value and derivatives per sample step; 0 across a grid plane that holds the place."""
    i, j, k = math.floor(x), math.floor(y), math.floor(z)
    u, v, w = x - i, y - j, z - k
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
def field_value_gradient(coefficients: F64, kernel: F64, smooth: bool, x: float, y: float, z: float) -> Four:
    """Value and derivatives per sample step of the chosen reconstruction, in the coefficients' coordinates."""
    if smooth:
        return spline_value_gradient(coefficients, kernel, x, y, z)
    return trilinear_value_gradient(coefficients, x, y, z)


@compiled
def interpolated_gradient(gradients: F64, x: float, y: float, z: float) -> Three:
    """Trilinear interpolation of gradients (Z, Y, X, 3) at samples; never −0."""
    i, j, k = math.floor(x), math.floor(y), math.floor(z)
    u, v, w = x - i, y - j, z - k
    right, back, high = i + (u > 0.0), j + (v > 0.0), k + (w > 0.0)
    found = (0.0, 0.0, 0.0)
    for axis in range(3):
        ab = gradients[k, j, i, axis] * (1.0 - u) + gradients[k, j, right, axis] * u
        cd = gradients[k, back, i, axis] * (1.0 - u) + gradients[k, back, right, axis] * u
        ef = gradients[high, j, i, axis] * (1.0 - u) + gradients[high, j, right, axis] * u
        gh = gradients[high, back, i, axis] * (1.0 - u) + gradients[high, back, right, axis] * u
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
    coefficients: F64, kernel: F64, smooth: bool, origin: F64, gradients: F64, places: F64, found: F64
) -> None:
    """Fill in gradients (N, 3) at places (N, 3) in the brick's coordinates: the spline's, or interpolated."""
    for n in range(len(places)):
        x, y, z = places[n, 0], places[n, 1], places[n, 2]
        if smooth:
            _, gx, gy, gz = spline_value_gradient(
                coefficients, kernel, x + origin[0], y + origin[1], z + origin[2]
            )
        else:
            gx, gy, gz = interpolated_gradient(gradients, x, y, z)
        found[n, 0], found[n, 1], found[n, 2] = gx, gy, gz


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
def distance_along(
    coefficients: F64,
    kernel: F64,
    smooth: bool,
    isovalue: float,
    place: Three,
    direction: Three,
    height: float,
    slope: float,
    reach: float,
) -> float:
    """Distance from a place to the isosurface along a unit vector, NaN if none is found within `reach`.

    `height` = field − isovalue and `slope` = size of its derivative along the vector at the place, where the
    field runs towards the isovalue. Newton steps inside a bracket, which the bracket halves where they leave it.
    """
    x, y, z = place
    dx, dy, dz = direction
    inside = height >= 0.0
    guess = abs(height) / slope
    high = min(2.0 * guess, reach)
    end = field_value_gradient(coefficients, kernel, smooth, x + high * dx, y + high * dy, z + high * dz)[0]
    if (end >= isovalue) == inside:
        high = reach
        end = field_value_gradient(coefficients, kernel, smooth, x + high * dx, y + high * dy, z + high * dz)[
            0
        ]
        if (end >= isovalue) == inside:
            return math.nan
    low = 0.0
    s = guess if guess < high else 0.5 * high
    for _ in range(ROOT_ROUNDS):
        value, gx, gy, gz = field_value_gradient(
            coefficients, kernel, smooth, x + s * dx, y + s * dy, z + s * dz
        )
        if (value >= isovalue) == inside:
            low = s
        else:
            high = s
        along = gx * dx + gy * dy + gz * dz
        following = s - (value - isovalue) / along if along != 0.0 else low
        if not low < following < high:
            following = 0.5 * (low + high)
        step, s = abs(following - s), following
        if step < ROOT_STEP:
            break
    return s


@compiled
def room(place: float, direction: float, low: float, high: float) -> float:
    """How far one may go along one coordinate before it leaves [low, high]."""
    if direction > 0.0:
        return max(high - place, 0.0) / direction
    if direction < 0.0:
        return max(place - low, 0.0) / -direction
    return math.inf


@compiled
def rounded(coordinate: float) -> float:
    """Return the nearest multiple of 2**-17, ties to even."""
    return round(coordinate * POSITION_STEPS) / POSITION_STEPS


@compiled
def moved_onto_isosurface(
    coefficients: F64,
    kernel: F64,
    smooth: bool,
    origin: F64,
    isovalue: float,
    place: Three,
    direction: Three,
    height: float,
    slope: float,
    reach: float,
) -> Four:
    """Return the place moved along a unit vector onto the isosurface, inside its cell, and the distance.

    Components of `direction` that are 0 keep their coordinate. The distance is NaN (and the place unmoved) if no
    isosurface is found within `reach` inside the cell, of which a border of 2**-14 voxel is left free.
    """
    x, y, z = place
    dx, dy, dz = direction
    low_x = min(x, math.floor(x) + SMALLEST_FRACTION)
    low_y = min(y, math.floor(y) + SMALLEST_FRACTION)
    low_z = min(z, math.floor(z) + SMALLEST_FRACTION)
    high_x = max(x, math.floor(x) + 1.0 - SMALLEST_FRACTION)
    high_y = max(y, math.floor(y) + 1.0 - SMALLEST_FRACTION)
    high_z = max(z, math.floor(z) + 1.0 - SMALLEST_FRACTION)
    reach = min(reach, room(x, dx, low_x, high_x), room(y, dy, low_y, high_y), room(z, dz, low_z, high_z))
    start = (x + origin[0], y + origin[1], z + origin[2])
    s = distance_along(coefficients, kernel, smooth, isovalue, start, direction, height, slope, reach)
    if math.isnan(s):
        return x, y, z, s
    return (
        min(max(rounded(x + s * dx), low_x), high_x),
        min(max(rounded(y + s * dy), low_y), high_y),
        min(max(rounded(z + s * dz), low_z), high_z),
        s,
    )


@compiled
def place_centres(
    coefficients: F64, kernel: F64, smooth: bool, origin: F64, isovalue: float, reach: float, places: F64
) -> None:
    """Move vertices inside cells (N, 3) along the gradient onto the isosurface, if it is within `reach`."""
    for n in range(len(places)):
        x, y, z = places[n, 0], places[n, 1], places[n, 2]
        value, gx, gy, gz = field_value_gradient(
            coefficients, kernel, smooth, x + origin[0], y + origin[1], z + origin[2]
        )
        height, slope = value - isovalue, math.sqrt(gx * gx + gy * gy + gz * gz)
        if height == 0.0 or slope == 0.0:
            continue
        scale = -math.copysign(1.0 / slope, height)
        direction = (scale * gx, scale * gy, scale * gz)
        x, y, z, _ = moved_onto_isosurface(
            coefficients, kernel, smooth, origin, isovalue, (x, y, z), direction, height, slope, reach
        )
        places[n, 0], places[n, 1], places[n, 2] = x, y, z


@compiled
def on_plane(first: float, second: float) -> bool:
    """Whether both ends of an edge lie on one grid plane across an axis."""
    return first == second and first == math.floor(first)


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
    the isosurface is found at right angles to the edge, at most half its length away and inside the cell. An edge
    on a grid plane keeps its vertex on the plane. All depends on the two ends alone, in either order.
    """
    for e in range(len(edges)):
        a, b = edges[e, 0], edges[e, 1]
        tx = positions[b, 0] - positions[a, 0]
        ty = positions[b, 1] - positions[a, 1]
        tz = positions[b, 2] - positions[a, 2]
        length = math.sqrt(tx * tx + ty * ty + tz * tz)
        x = rounded(0.5 * (positions[a, 0] + positions[b, 0]))
        y = rounded(0.5 * (positions[a, 1] + positions[b, 1]))
        z = rounded(0.5 * (positions[a, 2] + positions[b, 2]))
        value, gx, gy, gz = field_value_gradient(
            coefficients, kernel, smooth, x + origin[0], y + origin[1], z + origin[2]
        )
        height = value - isovalue
        if length == 0.0 or abs(height) <= tolerance * math.sqrt(gx * gx + gy * gy + gz * gz):
            continue
        gx = 0.0 if on_plane(positions[a, 0], positions[b, 0]) else gx
        gy = 0.0 if on_plane(positions[a, 1], positions[b, 1]) else gy
        gz = 0.0 if on_plane(positions[a, 2], positions[b, 2]) else gz
        steepness = math.sqrt(gx * gx + gy * gy + gz * gz)
        along = (gx * tx + gy * ty + gz * tz) / (length * length)
        gx, gy, gz = gx - along * tx, gy - along * ty, gz - along * tz
        slope = math.sqrt(gx * gx + gy * gy + gz * gz)
        if slope <= STEEPEST * steepness:
            continue
        scale = -math.copysign(1.0 / slope, height)
        direction = (scale * gx, scale * gy, scale * gz)
        x, y, z, distance = moved_onto_isosurface(
            coefficients,
            kernel,
            smooth,
            origin,
            isovalue,
            (x, y, z),
            direction,
            height,
            slope,
            LARGEST_SHIFT * length,
        )
        if not math.isnan(distance):
            places[e, 0], places[e, 1], places[e, 2] = x, y, z
            divided[e] = True

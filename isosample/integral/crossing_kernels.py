"""Crossings of rays with the isosurfaces of a grid: one polynomial in every cell that needs one."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import numpy.typing as npt

from isosample.compiled import compiled
from isosample.integral.band_walk import band_above
from isosample.integral.cell_cubic import cubic_between
from isosample.integral.cell_trace import trace_capacity, trace_cells
from isosample.integral.crossing_rows import (
    FLAT,
    cross_levels,
    cross_polynomial,
    crossing_scratch,
    record_border,
)
from isosample.integral.ray_cells import load_cell, place_ends
from isosample.integral.spline_cells import DEGREE, cell_polynomial
from isosample.integral.spline_grid import load_taps, spline_shape
from isosample.volume.spline_kernels import spline_value_gradient

if TYPE_CHECKING:
    from isosample.integral.cell_grid import CellGrid
    from isosample.integral.crossing_rows import CrossingRows, Levels
    from isosample.integral.spline_grid import SplineGrid

F64 = npt.NDArray[np.float64]
I64 = npt.NDArray[np.int64]
Bool = npt.NDArray[np.bool_]

# What is known of a cell: its polynomial, that it holds no isovalue, or that a sample is not finite.
POLYNOMIAL, PLAIN, MASKED = 0, 1, 2


class RayCells(NamedTuple):
    """Room for the cells of one ray: (x, y, z), ray parameters at both ends, what is known, polynomials."""

    cells: I64
    spans: F64
    known: I64
    polynomials: F64


@compiled
def cross_trilinear_rays(
    grid: CellGrid, levels: Levels, rays: tuple[F64, F64, F64], first: I64, rows: CrossingRows
) -> None:
    """List the crossings of rays with the trilinear interpolant.

    Parameters
    ----------
    grid, levels
        The volume and the isovalues.
    rays : origins (N, 3), directions (N, 3), intervals (N, 2)
        In sample indices (x, y, z); the ray parameter stays in world units.
    first : (N + 1,) int64
        Is filled in: the first row of every ray.
    rows : CrossingRows
        Is filled in.
    """
    origins, directions, intervals = rays
    shape = grid.samples.shape
    room, corners, ends = _room(shape, 4), np.empty((2, 2, 2)), np.empty((2, 3))
    for ray in range(len(origins)):
        line = (origins[ray], directions[ray])
        count = _trace(line, intervals[ray], shape, grid.visible, room)
        for n in range(count):
            room.known[n] = MASKED
            if load_cell(grid, room.cells[n], corners):
                low, high = _corner_bounds(corners)
                room.known[n] = PLAIN if _no_level_between(levels, low, high) else POLYNOMIAL
        for n in range(count):
            if _is_needed(room.known, n, count):
                load_cell(grid, room.cells[n], corners)
                place_ends(line, room.cells[n], room.spans[n], ends)
                b0, b1, b2, b3 = cubic_between(corners, ends[0], ends[1])
                b = room.polynomials[n]
                b[0], b[1], b[2], b[3] = b0, b1, b2, b3
        _walk_cells(room, count, levels, rows)
        first[ray + 1] = rows.used[0]
        for row in range(first[ray], min(first[ray + 1], len(rows.distance))):
            cell = room.cells[rows.cell[row]]
            load_cell(grid, cell, corners)
            rows.slope[row] = abs(_trilinear_slope(corners, line, cell, rows.distance[row]))


@compiled
def cross_spline_rays(
    grid: SplineGrid, levels: Levels, rays: tuple[F64, F64, F64], first: I64, rows: CrossingRows
) -> None:
    """List the crossings of rays with a spline; see `cross_trilinear_rays`."""
    origins, directions, intervals = rays
    shape = spline_shape(grid)
    room, ends = _room(shape, DEGREE + 1), np.empty((2, 3))
    taps, weights = np.empty((4, 4, 4)), np.empty((3, 4, 4))
    for ray in range(len(origins)):
        line = (origins[ray], directions[ray])
        count = _trace(line, intervals[ray], shape, grid.visible, room)
        for n in range(count):
            low, high = load_taps(grid, room.cells[n], taps)
            room.known[n] = PLAIN if _no_level_between(levels, low, high) else POLYNOMIAL
            if _is_needed(room.known, n, count):
                place_ends(line, room.cells[n], room.spans[n], ends)
                cell_polynomial(taps, grid.kernel, ends, weights, room.polynomials[n])
        _walk_cells(room, count, levels, rows)
        first[ray + 1] = rows.used[0]
        for row in range(first[ray], min(first[ray + 1], len(rows.distance))):
            rows.slope[row] = abs(_spline_slope(grid, line, rows.distance[row]))


@compiled
def _trilinear_slope(corners: F64, line: tuple[F64, F64], cell: I64, t: float) -> float:
    """Derivative of the trilinear interpolant of a cell along a ray [data units per ray parameter]."""
    origin, direction = line
    u = min(max(origin[0] + t * direction[0] - cell[0], 0.0), 1.0)
    v = min(max(origin[1] + t * direction[1] - cell[1], 0.0), 1.0)
    w = min(max(origin[2] + t * direction[2] - cell[2], 0.0), 1.0)
    slope = 0.0
    for k in range(2):
        in_z = w if k == 1 else 1.0 - w
        for j in range(2):
            in_y = v if j == 1 else 1.0 - v
            for i in range(2):
                in_x = u if i == 1 else 1.0 - u
                weight = (2 * i - 1) * direction[0] * in_y * in_z
                weight += (2 * j - 1) * direction[1] * in_x * in_z
                weight += (2 * k - 1) * direction[2] * in_x * in_y
                slope += weight * (corners[k, j, i] - corners[0, 0, 0])
    return slope


@compiled
def _spline_slope(grid: SplineGrid, line: tuple[F64, F64], t: float) -> float:
    """Derivative of a spline along a ray [data units per ray parameter]."""
    origin, direction = line
    x, y, z = origin[0] + t * direction[0], origin[1] + t * direction[1], origin[2] + t * direction[2]
    _, slope_x, slope_y, slope_z = spline_value_gradient(grid.coefficients, grid.kernel, x, y, z)
    return float(slope_x * direction[0] + slope_y * direction[1] + slope_z * direction[2])


@compiled
def _room(shape: tuple[int, int, int], coefficients: int) -> RayCells:
    """Room for the longest ray."""
    most = trace_capacity(shape)
    return RayCells(
        np.empty((most, 3), dtype=np.int64),
        np.empty((most, 2)),
        np.zeros(most, dtype=np.int64),
        np.empty((most, coefficients)),
    )


@compiled
def _trace(
    line: tuple[F64, F64], interval: F64, shape: tuple[int, int, int], visible: Bool, room: RayCells
) -> int:
    """List the cells of a ray; return their number."""
    if not interval[0] < interval[1]:
        return 0
    count, _ = trace_cells(line, interval, shape, visible, (room.cells, room.spans))
    return count


@compiled
def _corner_bounds(corners: F64) -> tuple[float, float]:
    """Smallest and largest of the eight samples."""
    low, high = corners[0, 0, 0], corners[0, 0, 0]
    for k in range(2):
        for j in range(2):
            for i in range(2):
                low, high = min(low, corners[k, j, i]), max(high, corners[k, j, i])
    return low, high


@compiled
def _no_level_between(levels: Levels, low: float, high: float) -> bool:
    """Whether a closed range of values holds no isovalue, with some rounding to spare."""
    slack = FLAT * max(abs(low), abs(high))
    above = np.searchsorted(levels.edges, low - slack, side="left")
    return bool(levels.edges[above] > high + slack)


@compiled
def _is_needed(known: I64, n: int, count: int) -> bool:
    """Whether the walk asks for the polynomial of a cell: it holds an isovalue, or the field begins or ends."""
    if known[n] != PLAIN:
        return bool(known[n] == POLYNOMIAL)
    begins = n == 0 or known[n - 1] == MASKED
    ends = n == count - 1 or known[n + 1] == MASKED
    return bool(begins or ends)


@compiled
def _walk_cells(room: RayCells, count: int, levels: Levels, rows: CrossingRows) -> None:
    """Walk through the cells of a ray, and record border points where the field begins and ends."""
    width = room.polynomials.shape[1]
    scratch = crossing_scratch(width)
    inside, known, band, value = False, False, 0, 0.0
    for n in range(count):
        start = room.spans[n, 0]
        polynomial = room.polynomials[n]
        if room.known[n] == MASKED:
            if inside:
                _record_end(rows, levels, band, room, n - 1, (known, value))
            inside, known = False, False
            continue
        if not inside:
            band = band_above(levels.edges, band, polynomial[0])
            record_border(rows, levels, band, polynomial[0], (start, n), True)
            inside = True
        if room.known[n] == PLAIN:
            known = False
            continue
        if known:
            polynomial[0] = value  # that of the cell before: rounding can neither make nor lose a crossing
        value, known = polynomial[width - 1], True
        span = (start, room.spans[n, 1], n)
        band = cross_polynomial(rows, levels, band, polynomial, span, scratch)
    if inside:
        _record_end(rows, levels, band, room, count - 1, (known, value))


@compiled
def _record_end(
    rows: CrossingRows, levels: Levels, band: int, room: RayCells, n: int, state: tuple[bool, float]
) -> None:
    """Leave the field behind cell `n`, and cross the level on which it ends, if it does (the level is inside)."""
    known, value = state
    value = value if known else room.polynomials[n, room.polynomials.shape[1] - 1]
    end = room.spans[n, 1]
    band = cross_levels(rows, band, band_above(levels.edges, band, value), end, n)
    record_border(rows, levels, band, value, (end, n), False)

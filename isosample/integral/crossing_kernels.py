"""Crossings of a ray with isosurfaces, from the field along it: one polynomial in every cell.

As in `band_walk`, the values at the ends of monotone pieces decide which levels lie between, by comparison
alone, so that the crossings of a ray always continue each other, however the roots are rounded.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import numpy.typing as npt

from isosample.compiled import compiled
from isosample.integral.band_walk import band_above, band_below
from isosample.integral.bernstein import (
    halve_polynomial,
    is_monotone,
    polynomial_bounds,
    polynomial_root,
    polynomial_value_slope,
)
from isosample.integral.cell_cubic import cubic_between
from isosample.integral.cell_trace import trace_capacity, trace_cells
from isosample.integral.ray_cells import load_cell, place_in_cell
from isosample.integral.spline_cells import DEGREE, cell_polynomial
from isosample.integral.spline_grid import load_taps, spline_shape

if TYPE_CHECKING:
    from isosample.integral.cell_grid import CellGrid
    from isosample.integral.spline_grid import SplineGrid

F64 = npt.NDArray[np.float64]
I64 = npt.NDArray[np.int64]
Bool = npt.NDArray[np.bool_]

# What is known of a cell: its polynomial, that it holds no isovalue, or that a sample is not finite.
POLYNOMIAL, PLAIN, MASKED = 0, 1, 2
MAX_HALVINGS = 40  # an extremum within rounding of a level is isolated after some 26
FLAT = 2.0**-48  # of the largest value of a cell: a piece with so little change is what its ends say


class Levels(NamedTuple):
    """The isovalues as a walk compares with them.

    Attributes
    ----------
    isovalues : (K,) float64
        Ascending.
    edges : (K + 2,) float64
        −inf, the isovalues less the base, +inf.
    base : float
    """

    isovalues: F64
    edges: F64
    base: float


class CrossingRows(NamedTuple):
    """Room for the entries of `CrossingLists`; those that do not fit are only counted."""

    used: I64  # (1,), number of entries
    distance: F64
    level: I64
    rising: Bool
    slope: F64
    value: F64


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
                _place_ends(line, room.cells[n], room.spans[n], ends)
                b0, b1, b2, b3 = cubic_between(corners, ends[0], ends[1])
                b = room.polynomials[n]
                b[0], b[1], b[2], b[3] = b0, b1, b2, b3
        _walk_cells(room, count, levels, rows)
        first[ray + 1] = rows.used[0]


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
                _place_ends(line, room.cells[n], room.spans[n], ends)
                cell_polynomial(taps, grid.kernel, ends, weights, room.polynomials[n])
        _walk_cells(room, count, levels, rows)
        first[ray + 1] = rows.used[0]


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
def _place_ends(line: tuple[F64, F64], cell: I64, span: F64, ends: F64) -> None:
    """Fill in the positions in a cell, (2, 3) in [0, 1], at which a ray enters and leaves it."""
    for i in range(2):
        place_in_cell(line[0], line[1], cell, span[i], ends[i])


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
    scratch = (np.empty((MAX_HALVINGS + 2, width)), np.empty((MAX_HALVINGS + 2, 2)), np.empty(width))
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
            _record_border(rows, levels, band, polynomial[0], start, True)
            inside = True
        if room.known[n] == PLAIN:
            known = False
            continue
        if known:
            polynomial[0] = value  # that of the cell before: rounding can neither make nor lose a crossing
        value, known = polynomial[width - 1], True
        band = _cross_polynomial(rows, levels, band, polynomial, (start, room.spans[n, 1]), scratch)
    if inside:
        _record_end(rows, levels, band, room, count - 1, (known, value))


@compiled
def _record_end(
    rows: CrossingRows, levels: Levels, band: int, room: RayCells, n: int, state: tuple[bool, float]
) -> None:
    """Leave the field behind cell `n`, and cross the level on which it ends, if it does (the level is inside)."""
    known, value = state
    last = room.polynomials[n, room.polynomials.shape[1] - 1]
    before = room.polynomials[n, room.polynomials.shape[1] - 2]
    value = value if known else last
    end = room.spans[n, 1]
    slope = (room.polynomials.shape[1] - 1) * abs(last - before) / (end - room.spans[n, 0])
    band = _cross_levels(rows, band, band_above(levels.edges, band, value), end, slope)
    _record_border(rows, levels, band, value, end, False)


@compiled
def _record_border(
    rows: CrossingRows, levels: Levels, band: int, value: float, distance: float, enters: bool
) -> None:
    """Record a border point; adding the base again must not move its value out of its band."""
    exact = value + levels.base
    if band > 0:
        exact = max(exact, levels.isovalues[band - 1])
    if band < len(levels.isovalues) and exact >= levels.isovalues[band]:
        exact = np.nextafter(levels.isovalues[band], -math.inf)
    _record(rows, distance, -1, enters, 0.0, exact)


@compiled
def _record(
    rows: CrossingRows, distance: float, level: int, rising: bool, slope: float, value: float
) -> None:
    """Add an entry; rounding must not let distances descend (a ray begins with a border point)."""
    n = rows.used[0]
    rows.used[0] = n + 1
    if n < len(rows.distance):
        entry = level < 0 and rising
        rows.distance[n] = distance if entry else max(distance, rows.distance[n - 1])
        rows.level[n], rows.rising[n], rows.slope[n], rows.value[n] = level, rising, slope, value


@compiled
def _cross_levels(rows: CrossingRows, band: int, target: int, distance: float, slope: float) -> int:
    """Record the levels between two bands, in the direction of travel; return `target`."""
    while band < target:
        _record(rows, distance, band, True, slope, 0.0)
        band += 1
    while band > target:
        band -= 1
        _record(rows, distance, band, False, slope, 0.0)
    return band


@compiled
def _cross_polynomial(
    rows: CrossingRows,
    levels: Levels,
    band: int,
    polynomial: F64,
    span: tuple[float, float],
    scratch: tuple[F64, F64, F64],
) -> int:
    """Record the crossings along a polynomial in the span between two ray parameters; return the band at its end."""
    waiting, places, values = scratch
    low, high = polynomial_bounds(polynomial)
    flat = FLAT * (max(abs(low), abs(high)) + abs(levels.base))
    for i in range(len(polynomial)):
        waiting[0, i] = polynomial[i]
    places[0, 0], places[0, 1] = 0.0, 1.0
    top = 0
    while top >= 0:
        piece = waiting[top]
        low, high = polynomial_bounds(piece)
        begin, width = places[top, 0], places[top, 1]
        if levels.edges[band] < low and high < levels.edges[band + 1]:
            top -= 1
        elif is_monotone(piece) or high - low <= flat or width <= 0.5**MAX_HALVINGS:
            band = _cross_monotone(rows, levels, band, piece, (begin, width), span, values)
            top -= 1
        else:
            halve_polynomial(piece, waiting[top + 1])
            places[top, 0], places[top, 1] = begin + 0.5 * width, 0.5 * width
            places[top + 1, 0], places[top + 1, 1] = begin, 0.5 * width
            top += 1
    return band


@compiled
def _cross_monotone(
    rows: CrossingRows,
    levels: Levels,
    band: int,
    piece: F64,
    place: tuple[float, float],
    span: tuple[float, float],
    scratch: F64,
) -> int:
    """Record the crossings along a monotone piece that begins at a place in the span and has a width there."""
    start_value, end_value = piece[0], piece[len(piece) - 1]
    edges = levels.edges
    length = span[1] - span[0]
    begin = span[0] + place[0] * length
    steepness = 1.0 / (place[1] * length)
    _, slope = polynomial_value_slope(piece, 0.0, scratch)
    at_start = (
        band_below(edges, band, start_value)
        if start_value > end_value
        else (band_above(edges, band, start_value))
    )
    band = _cross_levels(rows, band, at_start, begin, abs(slope) * steepness)
    if start_value == end_value:
        return band
    rising = start_value < end_value
    last = band_below(edges, band, end_value) if rising else band_above(edges, band, end_value)
    while band != last:
        level = edges[band + 1] if rising else edges[band]
        root, slope = polynomial_root(piece, level, rising, scratch)
        distance = min(span[0] + (place[0] + root * place[1]) * length, span[1])
        band = _cross_levels(rows, band, band + 1 if rising else band - 1, distance, abs(slope) * steepness)
    return band

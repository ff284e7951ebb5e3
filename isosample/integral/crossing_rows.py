"""The crossings of a ray with levels, recorded one by one along one polynomial after the other.

As in `band_walk`, the values at the ends of monotone pieces decide which levels lie between, by comparison
alone, so that the crossings of a ray always continue each other, however the roots are rounded.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from isosample.compiled import compiled
from isosample.integral.band_walk import band_above, band_below
from isosample.integral.bernstein import (
    halve_polynomial,
    is_monotone,
    polynomial_bounds,
    polynomial_root,
)

F64 = npt.NDArray[np.float64]
I64 = npt.NDArray[np.int64]
Bool = npt.NDArray[np.bool_]

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
    cell: I64  # of the ray, in order


@compiled
def crossing_scratch(coefficients: int) -> tuple[F64, F64, F64]:
    """Room for the halves of a polynomial that wait, for their places, and for one more."""
    return np.empty((MAX_HALVINGS + 2, coefficients)), np.empty((MAX_HALVINGS + 2, 2)), np.empty(coefficients)


@compiled
def record_border(
    rows: CrossingRows, levels: Levels, band: int, value: float, place: tuple[float, int], enters: bool
) -> None:
    """Record a border point at a distance in a cell; adding the base again must not move its value out of its band.

    It cannot fall below the band: isovalues within the values' range are within a factor of 2 of a base that is not
    0, so that subtracting it from them was exact.
    """
    exact = value + levels.base
    if band < len(levels.isovalues) and exact >= levels.isovalues[band]:
        exact = np.nextafter(levels.isovalues[band], -math.inf)
    _record(rows, place, -1, enters, exact)


@compiled
def _record(rows: CrossingRows, place: tuple[float, int], level: int, rising: bool, value: float) -> None:
    """Add an entry at a distance in a cell; rounding must not let distances descend behind a ray's first entry."""
    n = rows.used[0]
    rows.used[0] = n + 1
    if n < len(rows.distance):
        entry = level < 0 and rising
        rows.distance[n] = place[0] if entry else max(place[0], rows.distance[n - 1])
        rows.level[n], rows.rising[n], rows.value[n], rows.cell[n] = level, rising, value, place[1]


@compiled
def cross_levels(rows: CrossingRows, band: int, target: int, distance: float, cell: int) -> int:
    """Record the levels between two bands, in the direction of travel; return `target`."""
    while band < target:
        _record(rows, (distance, cell), band, True, 0.0)
        band += 1
    while band > target:
        band -= 1
        _record(rows, (distance, cell), band, False, 0.0)
    return band


@compiled
def cross_polynomial(
    rows: CrossingRows,
    levels: Levels,
    band: int,
    polynomial: F64,
    span: tuple[float, float, int],
    scratch: tuple[F64, F64, F64],
) -> int:
    """Record the crossings along a polynomial; `span` is its ray parameters and cell. Return the band at its end."""
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
    span: tuple[float, float, int],
    scratch: F64,
) -> int:
    """Record the crossings along a monotone piece that begins at a place in the span and has a width there."""
    start_value, end_value = piece[0], piece[len(piece) - 1]
    edges = levels.edges
    length = span[1] - span[0]
    begin = span[0] + place[0] * length
    at_start = (
        band_below(edges, band, start_value)
        if start_value > end_value
        else (band_above(edges, band, start_value))
    )
    band = cross_levels(rows, band, at_start, begin, span[2])
    if start_value == end_value:
        return band
    rising = start_value < end_value
    last = band_below(edges, band, end_value) if rising else band_above(edges, band, end_value)
    while band != last:
        level = edges[band + 1] if rising else edges[band]
        root = polynomial_root(piece, level, rising, scratch)
        distance = min(span[0] + (place[0] + root * place[1]) * length, span[1])
        band = cross_levels(rows, band, band + 1 if rising else band - 1, distance, span[2])
    return band

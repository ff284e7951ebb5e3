"""Marching a ray through the cells of a spline, and on the way through the bands.

In a cell the field is a polynomial of degree 9 along the ray. It is halved until it lies in one band, where it
is integrated as it is, or the cubic through its ends agrees with it; that cubic is walked as those of a
trilinear field are.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from isosample.compiled import compiled
from isosample.integral.band_walk import (
    OPAQUE,
    PANELS,
    TRANSMITTANCE,
    WALK_SIZE,
    absorb,
    band_above,
    band_below,
    start_walk,
    walk_cubic,
)
from isosample.integral.bernstein import halve_polynomial, polynomial_bounds, polynomial_mean
from isosample.integral.cell_light import begin_lit_ray, end_lit_ray, set_part
from isosample.integral.cell_trace import trace_capacity, trace_cells
from isosample.integral.ray_cells import (
    BLOCKS,
    CELLS,
    PANEL_COUNT,
    UNSEEN,
    leave_field,
    nowhere,
    place_ends,
)
from isosample.integral.spline_cells import (
    DEGREE,
    cell_polynomial,
    hermite_cubic,
    hermite_error,
)
from isosample.integral.spline_grid import load_taps, spline_shape
from isosample.integral.spline_light import load_spline_gradient
from isosample.integral.spline_panels import absorb_polynomial, panel_depth

if TYPE_CHECKING:
    from isosample.integral.band_table import BandTable, Optics
    from isosample.integral.cell_light import CellLight
    from isosample.integral.ray_cells import State
    from isosample.integral.spline_grid import SplineGrid
    from isosample.integral.spline_panels import Accuracy

F64 = npt.NDArray[np.float64]
I64 = npt.NDArray[np.int64]
Scratch = tuple[F64, F64, F64, F64, F64, F64]  # taps, weights, ends, polynomials, lengths, places

MAX_HALVINGS = 24  # errors fall by 16 per halving: rounding is reached after 14
ROUNDING = 2.0**-49  # of a polynomial's coefficients: agreement to so little is agreement


@compiled
def integrate_spline_block(
    grid: SplineGrid,
    optics: Optics,
    accuracy: Accuracy,
    rays: tuple[F64, F64, F64],
    rgba: F64,
    counts: I64,
    light: CellLight | None,
) -> None:
    """Integrate rays one after the other.

    Parameters
    ----------
    grid, optics
        The volume and the transfer function.
    accuracy : Accuracy
    rays, rgba, counts, light
        As for `ray_cells.integrate_ray_block`.
    """
    origins, directions, intervals = rays
    walk, scratch = np.empty(WALK_SIZE), spline_scratch()
    shape = spline_shape(grid)
    capacity = trace_capacity(shape)
    cells, spans = np.empty((capacity, 3), dtype=np.int64), np.empty((capacity, 2))
    for ray in range(len(origins)):
        start_walk(walk)
        if light is not None:
            begin_lit_ray(light)
        line = (origins[ray], directions[ray])
        count, counts[ray, BLOCKS] = trace_cells(line, intervals[ray], shape, grid.visible, (cells, spans))
        state = nowhere()
        for n in range(count):
            if walk[TRANSMITTANCE] < OPAQUE:
                break
            if n > 0 and spans[n, 0] != spans[n - 1, 1]:
                state = leave_field(walk, optics, state, light)
            place_ends(line, cells[n], spans[n], scratch[2])
            length = spans[n, 1] - spans[n, 0]
            cell = (cells[n], line[1], length)
            state = _walk_cell(walk, scratch, grid, optics, accuracy, cell, state, counts[ray], light)
        leave_field(walk, optics, state, light)
        for i in range(4):
            rgba[ray, i] = walk[i]
        counts[ray, PANEL_COUNT] = np.int64(walk[PANELS])
        if light is not None:
            end_lit_ray(light, ray)


@compiled
def spline_scratch() -> Scratch:
    """Room for one cell: its taps, weights and ends, the polynomials that wait, with their lengths, one more."""
    waiting = MAX_HALVINGS + 2
    return (
        np.empty((4, 4, 4)),
        np.empty((3, 4, 4)),
        np.empty((2, 3)),
        np.empty((waiting, DEGREE + 1)),
        np.empty(waiting),
        np.empty(DEGREE + 1),
    )


@compiled
def _walk_cell(
    walk: F64,
    scratch: Scratch,
    grid: SplineGrid,
    optics: Optics,
    accuracy: Accuracy,
    cell: tuple[I64, F64, float],
    state: State,
    counts: I64,
    light: CellLight | None,
) -> State:
    """Walk through one cell whose ends are placed; return what is known at its end.

    `cell`: its (x, y, z), the direction of the ray in sample indices, and the length of the ray's part in it [world].
    """
    known, band, value = state
    taps, weights, ends, polynomials, _, _ = scratch
    counts[CELLS] += 1
    low, high = load_taps(grid, cell[0], taps)
    bands = optics.bands
    if not known:
        band = band_above(bands.edges, band, 0.5 * (low + high))
    if _inside(bands, band, low, high) and _unseen(bands, band):
        counts[UNSEEN] += 1
        return False, band, 0.0  # strictly inside the band, so the next cell starts afresh
    cell_polynomial(taps, grid.kernel, ends, weights, polynomials[0])
    if known:
        polynomials[0, 0] = value  # that of the cell before: rounding can neither make nor lose a crossing
    else:
        band = band_above(bands.edges, band, polynomials[0, 0])
    value = polynomials[0, DEGREE]
    if light is not None:
        load_spline_gradient(taps, grid.kernel, ends, weights, cell[1], light)
    band = _walk_polynomial(walk, band, scratch, optics, accuracy, cell[2], light)
    return True, band, value


@compiled
def _walk_polynomial(
    walk: F64,
    band: int,
    scratch: Scratch,
    optics: Optics,
    accuracy: Accuracy,
    length: float,
    light: CellLight | None,
) -> int:
    """Walk along the first of the polynomials, over a length [world]; return the band at its end."""
    polynomials, lengths = scratch[3], scratch[4]
    lengths[0] = length
    top, done = 0, 0.0
    while top >= 0 and walk[TRANSMITTANCE] >= OPAQUE:
        polynomial = polynomials[top]
        if light is not None:
            set_part(light, done / length, lengths[top] / length)
        low, high = polynomial_bounds(polynomial)
        if _inside(optics.bands, band, low, high):
            mean = polynomial_mean(polynomial)
            if _only_mean_counts(optics.bands, band, light is not None):
                absorb(walk, band, (mean, mean, mean, mean), (0.0, 1.0), lengths[top], optics, light)
                done += lengths[top]
                top -= 1
                continue
            extent = (lengths[top], panel_depth(optics.bands, band, mean, lengths[top]))
            if extent[1] <= accuracy.rules.depth_limits[-1]:
                absorb_polynomial(
                    walk, band, polynomial, extent, optics.bands, accuracy.rules, scratch[5], light
                )
                done += lengths[top]
                top -= 1
                continue
        cubic = hermite_cubic(polynomial)
        allowed = max(
            _agreement_between(optics.bands, band, accuracy.agreement, low, high),
            ROUNDING * max(abs(low), abs(high)),
        )
        if lengths[top] <= length * 0.5**MAX_HALVINGS or hermite_error(polynomial, cubic) <= allowed:
            band = walk_cubic(walk, band, cubic, lengths[top], optics, light)
            done += lengths[top]
            top -= 1
            continue
        lengths[top] *= 0.5
        lengths[top + 1] = lengths[top]
        halve_polynomial(polynomial, polynomials[top + 1])
        top += 1
    return band


@compiled
def _inside(bands: BandTable, band: int, low: float, high: float) -> bool:
    """Whether values lie strictly inside a band."""
    return bool(bands.edges[band] < low and high < bands.edges[band + 1])


@compiled
def _unseen(bands: BandTable, band: int) -> bool:
    """Whether a band has no extinction."""
    return bool(bands.extinction[band, 0] == 0.0 and bands.extinction[band, 1] == 0.0)


@compiled
def _only_mean_counts(bands: BandTable, band: int, lit: bool) -> bool:
    """Whether a band has one colour and is not lit, so that the optical depth alone decides, or no extinction."""
    color = bands.color[band]
    same = (
        not lit and color[0, 0] == color[1, 0] and color[0, 1] == color[1, 1] and color[0, 2] == color[1, 2]
    )
    return bool(same or _unseen(bands, band))


@compiled
def _agreement_between(bands: BandTable, band: int, agreement: F64, low: float, high: float) -> float:
    """Smallest agreement of the bands that a closed range of values meets."""
    first, last = band_below(bands.edges, band, low), band_above(bands.edges, band, high)
    least = float(agreement[first])
    for other in range(first + 1, last + 1):
        least = min(least, agreement[other])
    return least

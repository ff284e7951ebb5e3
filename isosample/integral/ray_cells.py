"""Marching a ray through the cells of a grid (3D-DDA), and on the way through the bands."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from isosample.compiled import compiled
from isosample.integral.band_walk import (
    OPAQUE,
    PANELS,
    TRANSMITTANCE,
    WALK_SIZE,
    band_above,
    cross_levels,
    start_walk,
    walk_cubic,
)
from isosample.integral.cell_cubic import cubic_between
from isosample.integral.cell_gradient import load_gradient
from isosample.integral.cell_grid import BLOCK_CELLS
from isosample.integral.cell_light import begin_lit_ray, end_lit_ray

if TYPE_CHECKING:
    from isosample.integral.band_table import BandTable, Optics
    from isosample.integral.cell_grid import CellGrid
    from isosample.integral.cell_light import CellLight

F64 = npt.NDArray[np.float64]
I64 = npt.NDArray[np.int64]
State = tuple[bool, int, float]  # is the field's value known where the march is; its band; the value

COUNT_NAMES = ("cells", "cells_without_extinction", "blocks_skipped", "cells_masked", "quadrature_panels")
CELLS, UNSEEN, BLOCKS, MASKED, PANEL_COUNT = range(len(COUNT_NAMES))


@compiled
def integrate_ray_block(
    grid: CellGrid,
    optics: Optics,
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
    rays : origins (N, 3), directions (N, 3), intervals (N, 2)
        In sample indices (x, y, z); the ray parameter stays in world units.
    rgba : (N, 4) float64
        Is filled in.
    counts : (N, 5) int64
        Is filled in, see ``COUNT_NAMES``.
    light : CellLight or None
    """
    origins, directions, intervals = rays
    walk, scratch = np.empty(WALK_SIZE), (np.empty((2, 2, 2)), np.empty((2, 3)))
    for ray in range(len(origins)):
        start_walk(walk)
        if light is not None:
            begin_lit_ray(light)
        if intervals[ray, 0] < intervals[ray, 1]:
            line = (origins[ray], directions[ray])
            _march(walk, scratch, grid, optics, line, intervals[ray], counts[ray], light)
        for i in range(4):
            rgba[ray, i] = walk[i]
        counts[ray, PANEL_COUNT] = np.int64(walk[PANELS])
        if light is not None:
            end_lit_ray(light, ray)


@compiled
def _march(
    walk: F64,
    scratch: tuple[F64, F64],
    grid: CellGrid,
    optics: Optics,
    line: tuple[F64, F64],
    interval: F64,
    counts: I64,
    light: CellLight | None,
) -> None:
    """March one ray through the cells of its interval."""
    origin, direction = line
    cell, following = np.zeros(3, dtype=np.int64), np.zeros(3, dtype=np.int64)
    t, stop = interval[0], interval[1]
    find_cell(origin, direction, t, grid.samples.shape, cell)
    state = nowhere()
    while t < stop and walk[TRANSMITTANCE] >= OPAQUE:
        seen = grid.visible[cell[2] // BLOCK_CELLS, cell[1] // BLOCK_CELLS, cell[0] // BLOCK_CELLS]
        leave = min(leave_cell(origin, direction, cell, 1 if seen else BLOCK_CELLS, following), stop)
        if leave > t:
            if seen and load_cell(grid, cell, scratch[0]):
                state = _walk_cell(walk, scratch, grid, optics, line, cell, (t, leave), state, counts, light)
            else:
                counts[MASKED if seen else BLOCKS] += 1
                state = leave_field(walk, optics, state, light)
        if not seen:
            find_cell(origin, direction, leave, grid.samples.shape, cell)
        elif leave < stop:
            cell[0], cell[1], cell[2] = following[0], following[1], following[2]
        t = leave
    leave_field(walk, optics, state, light)


@compiled
def nowhere() -> State:
    """Return the state before the first cell."""
    return False, 0, 0.0


@compiled
def _walk_cell(
    walk: F64,
    scratch: tuple[F64, F64],
    grid: CellGrid,
    optics: Optics,
    line: tuple[F64, F64],
    cell: I64,
    between: tuple[float, float],
    state: State,
    counts: I64,
    light: CellLight | None,
) -> State:
    """Walk through one cell whose corners are loaded; return what is known at its end."""
    known, band, _ = state
    corners, ends = scratch
    counts[CELLS] += 1
    if not known:
        band = band_above(optics.bands.edges, band, corners[0, 0, 0])
    if _invisible(corners, optics.bands, band):
        counts[UNSEEN] += 1
        return False, band, 0.0  # strictly inside the band, so the next cell starts afresh
    for i in range(2):
        place_in_cell(line[0], line[1], cell, between[i], ends[i])
    cubic = cubic_between(corners, ends[0], ends[1])  # its first value is the last of the cell before
    if not known:
        band = band_above(optics.bands.edges, band, cubic[0])
    if light is not None:
        load_gradient(grid, cell, ends, line[1], light)
    band = walk_cubic(walk, band, cubic, between[1] - between[0], optics, light)
    return True, band, cubic[3]


@compiled
def leave_field(walk: F64, optics: Optics, state: State, light: CellLight | None) -> State:
    """Cross the level on which the field ends, if it does: the level itself is inside."""
    known, band, value = state
    if known and walk[TRANSMITTANCE] >= OPAQUE:
        cross_levels(walk, band, band_above(optics.bands.edges, band, value), optics.bands, light, 1.0)
    return False, band, 0.0


@compiled
def plane_distance(origin: float, direction: float, plane: int) -> float:
    """Ray parameter at a plane of samples; every place computes it by this one expression."""
    return (plane - origin) / direction


@compiled
def find_cell(origin: F64, direction: F64, t: float, shape: tuple[int, int, int], cell: I64) -> None:
    """Cell in which the ray goes on from `t`: (x, y, z), inside the grid.

    At a plane of samples it is the cell behind the plane, judged by `plane_distance`, not by the position.
    """
    for axis in range(3):
        last = shape[2 - axis] - 2
        o, d = origin[axis], direction[axis]
        i = min(max(math.floor(o + t * d), 0), last)
        if d > 0.0:
            while i < last and plane_distance(o, d, i + 1) <= t:
                i += 1
            while i > 0 and plane_distance(o, d, i) > t:
                i -= 1
        elif d < 0.0:
            while i > 0 and plane_distance(o, d, i) <= t:
                i -= 1
            while i < last and plane_distance(o, d, i + 1) > t:
                i += 1
        cell[axis] = i


@compiled
def leave_cell(
    origin: F64,
    direction: F64,
    cell: I64,
    cells: int,
    following: I64,
) -> float:
    """Ray parameter where the ray leaves the cell, or its block of `cells`³; fills in the cell that follows.

    Through an edge or a corner, all axes step at once. Where a block ends beyond the grid the parameter is
    too large: the caller takes the end of the ray's interval.
    """
    leave = math.inf
    for axis in range(3):
        following[axis] = cell[axis]
        if direction[axis] != 0.0:
            first = cell[axis] - cell[axis] % cells
            plane = first + cells if direction[axis] > 0.0 else first
            leave = min(leave, plane_distance(origin[axis], direction[axis], plane))
    for axis in range(3):
        if direction[axis] != 0.0:
            step = 1 if direction[axis] > 0.0 else -1
            plane = cell[axis] + (1 if step > 0 else 0)
            if plane_distance(origin[axis], direction[axis], plane) == leave:
                following[axis] += step
    return leave


@compiled
def place_ends(line: tuple[F64, F64], cell: I64, span: F64 | tuple[float, float], ends: F64) -> None:
    """Fill in the positions in a cell, (2, 3) in [0, 1], at which a ray enters and leaves it."""
    for i in range(2):
        place_in_cell(line[0], line[1], cell, span[i], ends[i])


@compiled
def place_in_cell(origin: F64, direction: F64, cell: I64, t: float, place: F64) -> None:
    """Position in the cell, in [0, 1]; exactly 0 or 1 on the planes of samples."""
    for axis in range(3):
        o, d = origin[axis], direction[axis]
        if d != 0.0 and t == plane_distance(o, d, cell[axis]):
            place[axis] = 0.0
        elif d != 0.0 and t == plane_distance(o, d, cell[axis] + 1):
            place[axis] = 1.0
        else:
            place[axis] = min(max(o + t * d - cell[axis], 0.0), 1.0)


@compiled
def load_cell(grid: CellGrid, cell: I64, corners: F64) -> bool:
    """Fill in the eight samples, less the base; False if one of them is not finite."""
    x, y, z = cell[0], cell[1], cell[2]
    check = 0.0
    for k in range(2):
        for j in range(2):
            for i in range(2):
                value = grid.samples[z + k, y + j, x + i] - grid.base
                corners[k, j, i] = value
                check += 0.0 * value  # NaN for NaN and infinities
    return check == 0.0


@compiled
def _invisible(corners: F64, bands: BandTable, band: int) -> bool:
    """Whether all corners lie inside `band` and it has no extinction."""
    if bands.extinction[band, 0] > 0.0 or bands.extinction[band, 1] > 0.0:
        return False
    low, high = bands.edges[band], bands.edges[band + 1]
    for k in range(2):
        for j in range(2):
            for i in range(2):
                if not low < corners[k, j, i] < high:
                    return False
    return True


@compiled
def integrate_piece_block(
    pieces: tuple[I64, F64, F64],
    optics: Optics,
    rgba: F64,
) -> None:
    """Integrate rays along which the field is given as consecutive cubics.

    Parameters
    ----------
    pieces : first (N + 1,), coefficients (P, 4), lengths (P,)
        Ray `r` has the pieces from ``first[r]`` up to ``first[r + 1]``; neighbours share their end values.
    optics
        The transfer function.
    rgba : (N, 4) float64
        Is filled in.
    """
    first, coefficients, lengths = pieces
    walk = np.empty(WALK_SIZE)
    for ray in range(len(first) - 1):
        start_walk(walk)
        state = nowhere()
        for piece in range(first[ray], first[ray + 1]):
            b = coefficients[piece]
            band = state[1]
            if piece == first[ray]:
                band = band_above(optics.bands.edges, band, b[0])
            band = walk_cubic(walk, band, (b[0], b[1], b[2], b[3]), lengths[piece], optics, None)
            state = (True, band, b[3])
            if walk[TRANSMITTANCE] < OPAQUE:
                break
        leave_field(walk, optics, state, None)
        for i in range(4):
            rgba[ray, i] = walk[i]

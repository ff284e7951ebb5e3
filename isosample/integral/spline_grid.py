"""A spline as the reference integrator reads it, and the blocks of cells that it can skip."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import numpy.typing as npt

from isosample.compiled import compiled
from isosample.integral.cell_grid import BLOCK_CELLS, any_shown

if TYPE_CHECKING:
    from isosample.integral.band_table import BandTable
    from isosample.volume.reconstruction import GridSpline

F64 = npt.NDArray[np.float64]
Bool = npt.NDArray[np.bool_]

# Rounding of a coefficient: 3 sums of 4 products, each of a weight (7 roundings) and what was summed before.
COEFFICIENT_ROUNDING = 64 * 2.0**-53  # of the largest tap


class SplineGrid(NamedTuple):
    """A spline as the reference integrator reads it, and which blocks of cells can be seen.

    Attributes
    ----------
    coefficients : (Z + 2, Y + 2, X + 2) float64
    kernel : (4, 4) float64
        As `isosample.volume.reconstruction.GridSpline` has them.
    widening : float
        By how much of the taps' range the field may lie beyond it on either side; 0 for positive weights.
    base : float
        Subtracted from every coefficient.
    visible : (BZ, BY, BX) bool
        False where a block has neither extinction nor an isosurface.
    """

    coefficients: F64
    kernel: F64
    widening: float
    base: float
    visible: Bool

    @classmethod
    def whole(cls, spline: GridSpline, base: float) -> SplineGrid:
        """Prepare a spline of which every block is looked at."""
        cells = [count - 3 for count in spline.coefficients.shape]
        visible = np.ones([-(-count // BLOCK_CELLS) for count in cells], dtype=np.bool_)
        widening = 0.5 * (spline.absolute_sum**3 - 1.0)
        return cls(spline.coefficients, spline.kernel, widening, base, visible)

    @classmethod
    def build(cls, spline: GridSpline, base: float, bands: BandTable) -> SplineGrid:
        """Prepare a spline whose values are seen through bands, both less the base."""
        grid = cls.whole(spline, base)
        find_visible_spline_blocks(grid, bands.edges, (bands.extinction.max(axis=1) > 0, bands.level_visible))
        return grid


@compiled
def find_visible_spline_blocks(grid: SplineGrid, edges: F64, shown: tuple[Bool, Bool]) -> None:
    """Fill in `SplineGrid.visible`; `shown`: which bands have extinction, which levels are isosurfaces."""
    size_z, size_y, size_x = grid.coefficients.shape
    for z in range(grid.visible.shape[0]):
        for y in range(grid.visible.shape[1]):
            for x in range(grid.visible.shape[2]):
                low, high = math.inf, -math.inf
                for k in range(z * BLOCK_CELLS, min((z + 1) * BLOCK_CELLS + 3, size_z)):
                    for j in range(y * BLOCK_CELLS, min((y + 1) * BLOCK_CELLS + 3, size_y)):
                        for i in range(x * BLOCK_CELLS, min((x + 1) * BLOCK_CELLS + 3, size_x)):
                            value = grid.coefficients[k, j, i] - grid.base
                            low, high = min(low, value), max(high, value)
                low, high = widened(low, high, grid.widening)
                grid.visible[z, y, x] = any_shown(low, high, edges, shown)


@compiled
def widened(low: float, high: float, widening: float) -> tuple[float, float]:
    """Bounds of the field, from the smallest and the largest tap, rounding included."""
    beyond = widening * (high - low) + COEFFICIENT_ROUNDING * max(abs(low), abs(high))
    return low - beyond, high + beyond


@compiled
def load_taps(grid: SplineGrid, cell: npt.NDArray[np.int64], taps: F64) -> tuple[float, float]:
    """Fill in the 64 coefficients of a cell, less the base; return bounds of the field there."""
    x, y, z = cell[0], cell[1], cell[2]
    low, high = math.inf, -math.inf
    for k in range(4):
        for j in range(4):
            for i in range(4):
                value = grid.coefficients[z + k, y + j, x + i] - grid.base
                taps[k, j, i] = value
                low, high = min(low, value), max(high, value)
    return widened(low, high, grid.widening)


@compiled
def spline_shape(grid: SplineGrid) -> tuple[int, int, int]:
    """Number of samples along z, y, x."""
    shape = grid.coefficients.shape
    return shape[0] - 2, shape[1] - 2, shape[2] - 2

"""The cells of a grid that a ray passes, in order, without the blocks of cells that need no look."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from isosample.compiled import compiled
from isosample.integral.cell_grid import BLOCK_CELLS
from isosample.integral.ray_cells import find_cell, leave_cell

if TYPE_CHECKING:
    import numpy.typing as npt

    F64 = npt.NDArray[np.float64]
    I64 = npt.NDArray[np.int64]
    Bool = npt.NDArray[np.bool_]


@compiled
def trace_capacity(shape: tuple[int, int, int]) -> int:
    """Most cells that a straight line passes in a grid of so many samples, and some to spare."""
    return shape[0] + shape[1] + shape[2] + 3


@compiled
def trace_cells(
    line: tuple[F64, F64],
    interval: F64,
    shape: tuple[int, int, int],
    visible: Bool,
    trace: tuple[I64, F64],
) -> tuple[int, int]:
    """List the cells of a ray that lie in visible blocks.

    Parameters
    ----------
    line : origin (3,), direction (3,)
        In sample indices (x, y, z).
    interval : (2,) float64
        Ray parameters where it enters and leaves the grid.
    shape : 3 ints
        Number of samples along z, y, x.
    visible : (BZ, BY, BX) bool
        Which blocks of `BLOCK_CELLS`³ cells count.
    trace : cells (L, 3) int64, spans (L, 2) float64
        Are filled in, L = `trace_capacity`: the cell (x, y, z), and the ray parameters at its ends. The
        spans of neighbouring cells share their ends, bit for bit.

    Returns
    -------
    count, skipped : int
        Number of cells listed, and of passages through blocks that are not visible.
    """
    origin, direction = line
    cells, spans = trace
    cell, following = np.zeros(3, dtype=np.int64), np.zeros(3, dtype=np.int64)
    count, skipped = 0, 0
    t, stop = interval[0], interval[1]
    find_cell(origin, direction, t, shape, cell)
    while t < stop:
        seen = visible[cell[2] // BLOCK_CELLS, cell[1] // BLOCK_CELLS, cell[0] // BLOCK_CELLS]
        leave = min(leave_cell(origin, direction, cell, 1 if seen else BLOCK_CELLS, following), stop)
        if leave > t:
            if seen:
                cells[count, 0], cells[count, 1], cells[count, 2] = cell[0], cell[1], cell[2]
                spans[count, 0], spans[count, 1] = t, leave
                count += 1
            else:
                skipped += 1
        if not seen:
            find_cell(origin, direction, leave, shape, cell)
        elif leave < stop:
            cell[0], cell[1], cell[2] = following[0], following[1], following[2]
        t = leave
    return count, skipped

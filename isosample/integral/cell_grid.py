"""The samples of a grid as the reference integrator reads them, and the blocks of cells that it can skip."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import numpy.typing as npt

from isosample.compiled import compiled
from isosample.integral.band_walk import band_above, band_below

if TYPE_CHECKING:
    from typing import Any

    from isosample.integral.band_table import BandTable
    from isosample.volume.grid import Volume

F64 = npt.NDArray[np.float64]

BLOCK_CELLS = 8  # cells per axis of the blocks that are skipped as a whole


class CellGrid(NamedTuple):
    """Samples and which blocks of cells can be seen.

    Attributes
    ----------
    samples : (Z, Y, X) float32 or float64
    base : float
        Subtracted from every sample in float64.
    visible : (BZ, BY, BX) bool
        False where a block has neither extinction nor an isosurface.
    """

    samples: npt.NDArray[Any]
    base: float
    visible: npt.NDArray[np.bool_]

    @classmethod
    def whole(cls, volume: Volume, base: float) -> CellGrid:
        """Prepare a volume of which every block is looked at.

        The samples are kept as float32 where that is exact, else as float64 (one compiled kernel for each).
        """
        array = volume.array
        dtype = np.float32 if np.can_cast(array.dtype, np.float32, casting="safe") else np.float64
        samples = np.ascontiguousarray(array, dtype=dtype).view()
        samples.setflags(write=False)
        visible = np.ones([-(-(count - 1) // BLOCK_CELLS) for count in samples.shape], dtype=np.bool_)
        return cls(samples, base, visible)

    @classmethod
    def build(cls, volume: Volume, base: float, bands: BandTable) -> CellGrid:
        """Prepare a volume whose values are seen through bands, both less the base."""
        grid = cls.whole(volume, base)
        shown = (bands.extinction.max(axis=1) > 0, bands.level_visible)
        find_visible_blocks(grid.samples, base, bands, shown, grid.visible)
        return grid


@compiled
def find_visible_blocks(
    samples: npt.NDArray[Any],
    base: float,
    bands: BandTable,
    shown: tuple[npt.NDArray[np.bool_], npt.NDArray[np.bool_]],
    visible: npt.NDArray[np.bool_],
) -> None:
    """Fill in `CellGrid.visible`; `shown`: which bands have extinction, which levels are isosurfaces."""
    size_z, size_y, size_x = samples.shape
    blocks_z, blocks_y, blocks_x = visible.shape
    for z in range(blocks_z):
        for y in range(blocks_y):
            for x in range(blocks_x):
                low, high = math.inf, -math.inf
                for k in range(z * BLOCK_CELLS, min((z + 1) * BLOCK_CELLS + 1, size_z)):
                    for j in range(y * BLOCK_CELLS, min((y + 1) * BLOCK_CELLS + 1, size_y)):
                        for i in range(x * BLOCK_CELLS, min((x + 1) * BLOCK_CELLS + 1, size_x)):
                            value = samples[k, j, i] - base
                            if math.isfinite(value):
                                low, high = min(low, value), max(high, value)
                visible[z, y, x] = low <= high and any_shown(low, high, bands.edges, shown)


@compiled
def any_shown(
    low: float, high: float, edges: F64, shown: tuple[npt.NDArray[np.bool_], npt.NDArray[np.bool_]]
) -> bool:
    """Whether a closed range of values meets a band with extinction or an isosurface."""
    first, last = band_below(edges, 0, low), band_above(edges, 0, high)
    found = False
    for band in range(first, last + 1):
        found = found or shown[0][band] or (band < last and shown[1][band])
    return found

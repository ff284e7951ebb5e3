"""The macrocells on the GPU: which are empty, how far one may leap from them, and how coarsely they are sampled."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from isosample.gl.memory import with_room
from isosample.rendering.frame import shared_constants

if TYPE_CHECKING:
    import moderngl

    from isosample.rendering.raycast_settings import RaycastSettings
    from isosample.volume.grid import F64
    from isosample.volume.macrocells import MacrocellGrid

TEXEL_BYTES = 4
LEAP_BITS = int(shared_constants()["LEAP_BITS"])


class DeviceMacrocells:
    """The texture of the macrocells.

    Parameters
    ----------
    ctx : moderngl.Context
    grid : MacrocellGrid
    settings : RaycastSettings
        Whether macrocells are skipped, and whether their steps are adapted.
    intervals : (N, 2) float64
        Closed intervals of the values that can be seen [data units].

    Raises
    ------
    CapacityError
        If the driver has no room for them.
    """

    def __init__(
        self, ctx: moderngl.Context, grid: MacrocellGrid, settings: RaycastSettings, intervals: F64
    ) -> None:
        self._grid = grid
        self._settings = settings
        z, y, x = grid.low.shape
        room = (f"{x} x {y} x {z} macrocells", TEXEL_BYTES * x * y * z, "Ask for fewer with --macrocells.")
        self._texture = with_room(ctx, ctx.texture3d((x, y, z), 1, dtype="u4"), *room)
        self._texture.filter = (ctx.NEAREST, ctx.NEAREST)
        self._texture.repeat_x = self._texture.repeat_y = self._texture.repeat_z = False
        self.occupied = 0
        self.update(intervals)

    def update(self, intervals: F64) -> None:
        """Find the empty macrocells again, for another transfer function; the volume is not read."""
        occupied = self._grid.occupancy(intervals)
        self.occupied = int(occupied.sum())
        multipliers = self._grid.multipliers if self._settings.adaptive else np.uint8(1)
        texels = np.full(occupied.shape, multipliers, dtype=np.uint32) << LEAP_BITS
        if self._settings.skipping:
            packed = np.zeros(occupied.shape, dtype=np.uint32)
            for octant, leaps in enumerate(self._grid.leaps(occupied)):
                packed |= leaps.astype(np.uint32) << (octant * LEAP_BITS)
            texels[~occupied] = packed[~occupied]
        self._texture.write(texels.tobytes())

    @property
    def count(self) -> int:
        """Number of macrocells."""
        return int(self._grid.low.size)

    def fill(self, block: np.void) -> None:
        """Fill in the members of a struct Raycast that say how the volume is divided."""
        block["macrocells"] = (*self._grid.low.shape[::-1], self._grid.cells)

    def samplers(self) -> dict[str, str]:
        """Type of the texture by its name in the shaders."""
        return {"macrocells": "usampler3D"}

    def bind(self) -> None:
        """Bind the texture."""
        self._texture.use(shared_constants()["UNIT_MACROCELLS"])

    def release(self) -> None:
        """Free the texture."""
        self._texture.release()

"""The build pass into slots: rasterises all surfaces of a tile, and groups its pixels by the length of their lists."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from isosample.errors import CapacityError
from isosample.rendering.crossing_slots import MOST_GROUPS, packet_total
from isosample.rendering.frame import shared_constants
from isosample.rendering.settings import BuildStage, ResolveStage
from isosample.rendering.supplies import group_supply

if TYPE_CHECKING:
    from isosample.rendering.frame_statistics import FrameStatistics
    from isosample.rendering.pass_resources import PassResources
    from isosample.rendering.picture_frame import PictureFrame, PictureFrames
    from isosample.rendering.tiles import Tile
    from isosample.rendering.triangle_raster import TriangleRaster

WORK_GROUP = 64  # local size of group_packets.comp


class SlotBuilder:
    """Fills slots, and remembers how many the pixels of the last picture needed.

    Parameters
    ----------
    shared : PassResources
    frames : PictureFrames
    raster : TriangleRaster
        Of the same scene.
    """

    def __init__(self, shared: PassResources, frames: PictureFrames, raster: TriangleRaster) -> None:
        self._shared = shared
        self._frames = frames
        self._raster = raster
        self._groups = 1
        self._refused: FrameStatistics | None = None  # of the last picture without slots

    def suits(self, frame: PictureFrame) -> bool:
        """Whether a picture is to be tried: rasterised by compute shaders, and not one of lists that were too long."""
        settings = frame.settings
        if frame.slots_suit and self._was_deep():
            self._refuse(frame)
        return (
            frame.slots_suit
            and not frame.residuals
            and settings.stage is ResolveStage.AUTO
            and settings.sort_capacity >= self._most
            and self._raster.suits(frame)
        )

    def parts(self, tile: Tile, frame: PictureFrame) -> list[Tile]:
        """Strips of a tile whose slots fit the budget; the tile itself where none does."""
        budget, lit = frame.settings.fragment_budget_bytes, bool(frame.shading)
        rows = self._shared.slots.most_rows(tile.width, self._groups, lit=lit, budget_bytes=budget)
        if rows < 1:
            frame.slots_suit = False
            return [tile]
        return [
            replace(tile, y=tile.y + y, height=min(rows, tile.height - y))
            for y in range(0, tile.height, rows)
        ]

    def build(self, tile: Tile, frame: PictureFrame) -> int | None:
        """Put all crossings of a tile into slots.

        Returns
        -------
        rasterised : int or None
            Fragments, counted triangle by triangle. None if there are no such lists: if `suits` still holds, the
            tile is to be cut into `parts` and tried again.

        Raises
        ------
        CapacityError
            If the driver has no room, and compute shaders were asked for.
        """
        shared = self._shared
        budget, lit = frame.settings.fragment_budget_bytes, bool(frame.shading)
        with shared.timer.stage("build"):
            try:
                shared.slots.begin_tile(tile, self._groups, lit=lit, budget_bytes=budget)
            except CapacityError:
                if frame.settings.build_stage is BuildStage.COMPUTE:
                    raise
                self._refuse(frame)
                return None
            shared.pool.begin_picture(budget - shared.slots.size_bytes)
            shared.pool.clear_lists(tile)
            shared.bind(tile, frame)
            passes = self._frames.tile_passes(frame, tile)
            frame.unsuited = not self._raster.build(frame, passes, slots=self._groups * self._group)
            if not frame.unsuited:
                shared.slots.bind()  # the residuals had the place of the packets
                shared.programs.compute("group_packets.comp", group_supply()).run(
                    -(-packet_total(tile) // WORK_GROUP)
                )
                shared.ctx.memory_barrier()
            counters = shared.pool.counters()
            frame.unsuited |= int(counters["unsuited"]) > 0
            needed = -(-int(counters["max_depth_complexity"]) // self._group)
            if frame.unsuited or needed > MOST_GROUPS:
                self._refuse(frame)
                return None
            if needed > self._groups:
                self._groups = needed
                return None
            return int(counters["rasterised"])

    @property
    def _group(self) -> int:
        return shared_constants()["SLOT_GROUP"]

    @property
    def _most(self) -> int:
        """Crossings of the longest list that is taken."""
        return self._group * MOST_GROUPS

    def _was_deep(self) -> bool:
        """Whether the picture before was refused, and had lists that are too long."""
        return self._refused is not None and self._refused.max_depth_complexity > self._most

    def _refuse(self, frame: PictureFrame) -> None:
        """Leave the rest of a picture to linked lists."""
        frame.slots_suit = False
        self._refused = frame.statistics
        self._shared.slots.release()

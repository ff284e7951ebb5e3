"""The build pass into slots: rasterises all surfaces of a tile, and groups its pixels by the length of their lists."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from isosample.errors import CapacityError
from isosample.rendering.crossing_slots import MOST_SLOT_GROUPS, packet_total
from isosample.rendering.frame import shared_constants
from isosample.rendering.settings import ResolveStage
from isosample.rendering.stage import line_groups
from isosample.rendering.supplies import group_supply
from isosample.rendering.triangle_raster import RESTING

if TYPE_CHECKING:
    from isosample.rendering.frame_statistics import FrameStatistics
    from isosample.rendering.pass_resources import PassResources
    from isosample.rendering.picture_frame import PictureFrame, PictureFrames
    from isosample.rendering.tiles import Tile
    from isosample.rendering.triangle_raster import TriangleRaster

MOST_STRIPS = 8  # of a tile


class SlotBuilder:
    """Fills slots, and remembers how many the pixels of the picture before needed.

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
        self._resting = 0  # pictures that are not tried,
        self._tried_with = 0  # with a budget no larger than that [byte]
        self._last: FrameStatistics | None = None  # of the last picture that was drawn

    def begin_picture(self, frame: PictureFrame) -> None:
        """Begin with as many slots as the picture before needed; where its lists were longer, with none."""
        if frame.residuals:  # its lists are read back, not drawn
            return
        longest = 0 if self._last is None else self._last.max_depth_complexity
        self._groups = max(-(-longest // self._group), 1)
        frame.slots_suit = self._groups <= MOST_SLOT_GROUPS
        if self._resting and self._tried_with >= frame.settings.fragment_budget_bytes and self.suits(frame):
            self._resting -= 1
            frame.slots_suit = False
        self._last = frame.statistics

    def suits(self, frame: PictureFrame) -> bool:
        """Whether a tile is to be tried: rasterised by compute shaders, and no list was too long so far."""
        return (
            frame.slots_suit
            and not frame.residuals
            and frame.settings.stage is ResolveStage.AUTO
            and frame.settings.sort_capacity >= self._group * self._groups
            and self._raster.suits(frame)
        )

    def parts(self, tile: Tile, frame: PictureFrame) -> list[Tile]:
        """Strips of a tile whose slots fit the budget; the tile itself where none does."""
        budget, lit = frame.settings.fragment_budget_bytes, bool(frame.shading)
        rows = self._shared.slots.most_rows(tile.width, self._groups, lit=lit, budget_bytes=budget)
        # Strips draw again what reaches over their edges; streamed meshes are uploaded again for each.
        if rows < 1 or -(-tile.height // rows) > (1 if frame.streamed else MOST_STRIPS):
            self.refuse(frame)
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
        """
        shared = self._shared
        with shared.timer.stage("build"):
            if not self._begin_tile(tile, frame):
                return None
            passes = self._frames.tile_passes(frame, tile)
            built = self._raster.build(frame, passes, slots=self._groups * self._group)
            if built:
                shared.slots.bind()  # the residuals had the place of the packets
                program = shared.programs.compute("group_packets.comp", group_supply())
                program.run(line_groups(packet_total(tile)))
                shared.ctx.memory_barrier()
            counters = shared.pool.counters()
            if not built or int(counters["unsuited"]) > 0:
                self._raster.rest(frame)
            needed = -(-int(counters["max_depth_complexity"]) // self._group)
            if frame.unsuited or needed > MOST_SLOT_GROUPS:
                self.refuse(frame)
                return None
            if needed > self._groups:
                self._groups = needed
                return None
            return int(counters["rasterised"])

    @property
    def _group(self) -> int:
        return shared_constants()["SLOT_GROUP"]

    def _begin_tile(self, tile: Tile, frame: PictureFrame) -> bool:
        """Make room, within the budget, and empty all lists; False if the driver has no room."""
        shared, lit = self._shared, bool(frame.shading)
        budget = frame.settings.fragment_budget_bytes
        shared.pool.keep_within(budget - shared.slots.bytes_with(tile, self._groups, lit=lit))
        try:
            shared.slots.begin_tile(tile, self._groups, lit=lit, budget_bytes=budget)
        except CapacityError:
            self.refuse(frame)
            return False
        shared.pool.clear_lists(tile)
        shared.bind(tile, frame)
        return True

    def rest(self, frame: PictureFrame) -> None:
        """Leave the rest of a picture to linked lists, as too many are no chains, and the pictures that follow, too."""
        self.refuse(frame)
        self._resting, self._tried_with = RESTING, frame.settings.fragment_budget_bytes

    def refuse(self, frame: PictureFrame) -> None:
        """Leave the rest of a picture to linked lists, which have the budget to themselves."""
        frame.slots_suit = False
        self._shared.slots.release()
        self._shared.pool.keep_within(0)

"""The build pass: rasterises all surfaces into the lists of one tile after the other, each of which fits the budget."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from isosample.gl.context import limits
from isosample.rendering.slot_building import SlotBuilder
from isosample.rendering.supplies import mask_supply, mesh_supply
from isosample.rendering.tiles import Tile, strips, tiles_that_fit
from isosample.rendering.triangle_raster import TriangleRaster

if TYPE_CHECKING:
    from collections.abc import Iterator

    import moderngl

    from isosample.rendering.pass_resources import PassResources
    from isosample.rendering.picture_frame import PictureFrame, PictureFrames

QUERY_SATURATED = 0xFFFFFFFF  # an occlusion query read as 32 bits stops here
PLAIN = {"CURVED": 0, "RESIDUAL": 0}  # vertices of the passes that only count


class ListBuilder:
    """Builds the lists of pictures, and remembers whether the last one had to be split.

    Parameters
    ----------
    shared : PassResources
    frames : PictureFrames
        Of the same scene.
    """

    def __init__(self, shared: PassResources, frames: PictureFrames) -> None:
        self._shared = shared
        self._frames = frames
        self._was_split = False
        self._compute = TriangleRaster(shared, frames.geometry)
        self._slots = SlotBuilder(shared, frames, self._compute)
        self._query = shared.ctx.query(samples=True)
        self._rasteriser: moderngl.Framebuffer | None = None
        self._linked: Tile | None = None

    def release(self) -> None:
        """Free the framebuffer, and the images of the vertices."""
        self._compute.release()
        self._release_framebuffer()

    def _release_framebuffer(self) -> None:
        if self._rasteriser is not None:
            self._rasteriser.release()
        self._rasteriser = None

    def resize(self, size: tuple[int, int]) -> None:
        """Make a framebuffer without attachments for pictures of (width, height) pixels."""
        if self._rasteriser is None or self._rasteriser.size != size:
            self._release_framebuffer()
            self._rasteriser = self._shared.ctx.empty_framebuffer(size)

    def built_tiles(self, frame: PictureFrame, size: tuple[int, int]) -> Iterator[tuple[Tile, int]]:
        """Build the lists of one tile after the other; yields each with its fragments by an independent count."""
        parts = [(tile, False) for tile in strips(*size, self._shared.pool.max_pixels)]
        self._compute.begin_picture(frame)
        self._slots.begin_picture(frame)
        were_split = False
        while parts:
            part, counted = parts.pop(0)
            smaller, rasterised = self._build_or_split(part, frame, counted=counted)
            counted |= len(smaller) > 0 and not frame.in_slots
            parts = [(tile, counted) for tile in smaller] + parts
            were_split |= len(smaller) > 1 and not frame.in_slots
            if not smaller:
                self._linked = None
                yield part, rasterised
                if self._linked is not None:
                    parts.insert(0, (self._linked, False))
        self._was_split = were_split

    def link(self, tile: Tile, frame: PictureFrame) -> None:
        """Have the tile that came last built once more, it and the rest of the picture with linked lists."""
        self._slots.rest(frame)
        frame.statistics.slot_tiles -= 1
        frame.statistics.compute_tiles -= 1
        self._linked = tile

    def _build_or_split(self, tile: Tile, frame: PictureFrame, *, counted: bool) -> tuple[list[Tile], int]:
        """Build a tile's lists, or return smaller tiles to build in its place because they do not fit.

        Where the last picture did not fit, this one probably does not either: its fragments are counted first
        (unless `counted`), rather than built in vain.
        """
        frame.in_slots = self._slots.suits(frame)
        if frame.in_slots:
            return self._fill_slots(tile, frame)
        self._shared.slots.release()  # the budget is the nodes' alone
        budget = frame.settings.fragment_budget_bytes
        if self._shared.pool.is_empty and frame.streamed:
            self._shared.pool.fill(budget)  # rather than loading all meshes once more to measure
        elif self._shared.pool.is_empty:
            with self._shared.timer.stage("measure"):
                measured = self._measure(tile, frame)
            if not self._shared.pool.grow(measured, budget):
                return self._split(tile, frame), 0
        elif self._was_split and not counted:
            return self._split(tile, frame), 0
        counters, rasterised, by_compute = self._build(tile, frame)
        asked = int(counters["node_count"])
        if by_compute and counted and asked > self._shared.pool.capacity:
            frame.unsuited = (
                True  # more than the pipeline has counted: only that one's lists are known to fit
            )
            return [tile], 0
        if rasterised == QUERY_SATURATED or asked > self._shared.pool.capacity:
            needed = max(asked, rasterised)
            return ([tile] if self._shared.pool.grow(needed, budget) else self._split(tile, frame)), 0
        self._note_compute(frame, by_compute=by_compute)
        return [], rasterised

    def _fill_slots(self, tile: Tile, frame: PictureFrame) -> tuple[list[Tile], int]:
        """As `_build_or_split`, into slots; also where these turn out not to do, the tile is to be built once more."""
        parts = self._slots.parts(tile, frame)
        if len(parts) > 1 or not frame.slots_suit:
            return parts, 0
        rasterised = self._slots.build(tile, frame)
        if rasterised is None:
            return [tile], 0
        self._note_compute(frame, by_compute=True)
        frame.statistics.slot_tiles += 1
        return [], rasterised

    def _note_compute(self, frame: PictureFrame, *, by_compute: bool) -> None:
        frame.statistics.compute_tiles += int(by_compute)
        frame.statistics.projected_bytes = self._compute.size_bytes

    def _measure(self, tile: Tile, frame: PictureFrame) -> int:
        """Fragments of a tile, counted by an occlusion query (saturates at `QUERY_SATURATED`)."""
        self._shared.bind(tile, frame)
        return self._draw("measure.frag", "measure.frag", tile, frame, PLAIN, {})

    def _split(self, tile: Tile, frame: PictureFrame) -> list[Tile]:
        """Tiles whose lists fit, from a count of every pixel's fragments."""
        with self._shared.timer.stage("count"):
            self._shared.pool.clear_counts(tile)
            self._shared.bind(tile, frame)
            self._draw("count.frag", "count.frag", tile, frame, PLAIN, {})
            self._shared.ctx.memory_barrier()
            counts = self._shared.pool.heads(tile)
        self._shared.pool.grow(int(counts.sum(dtype=np.int64)), frame.settings.fragment_budget_bytes)
        return tiles_that_fit(tile, counts.reshape(tile.height, tile.width), self._shared.pool.capacity)

    def _build(self, tile: Tile, frame: PictureFrame) -> tuple[np.void, int, bool]:
        """Fill the lists; return counters, fragments by an independent count, and whether by compute shaders."""
        with self._shared.timer.stage("build"):
            if self._compute.suits(frame):
                counters = self._build_by_compute(tile, frame)
                if counters is not None:
                    return counters, int(counters["rasterised"]), True
            self._shared.pool.clear_lists(tile)
            self._shared.bind(tile, frame)
            edges = {"SUBPIXEL_BITS": limits(self._shared.ctx).subpixel_bits}
            common = edges | self._shared.pool.constants
            constants = frame.build_constants | common
            rasterised = self._draw("build.frag", "build_mask.frag", tile, frame, constants, common)
            self._shared.ctx.memory_barrier()
            return self._shared.pool.counters(), rasterised, False

    def _build_by_compute(self, tile: Tile, frame: PictureFrame) -> np.void | None:
        """Fill the lists without the graphics pipeline; None where the meshes do not suit that."""
        self._shared.pool.clear_lists(tile)
        self._shared.bind(tile, frame)
        if not self._compute.build(frame, self._frames.tile_passes(frame, tile)):
            self._compute.rest(frame)
            return None
        counters = self._shared.pool.counters()
        if int(counters["unsuited"]) > 0:
            self._compute.rest(frame)
        return None if frame.unsuited else counters

    def _draw(
        self,
        fragment: str,
        mask_fragment: str,
        tile: Tile,
        frame: PictureFrame,
        constants: dict[str, int],
        mask_constants: dict[str, int],
    ) -> int:
        """Rasterise the meshes without attachments; return the fragments by an occlusion query."""
        assert self._rasteriser is not None
        programs = self._shared.programs
        program = programs.graphics("build.vert", fragment, mesh_supply(), **constants)
        mask_program = None
        if self._shared.scene.has_mask:
            mask_program = programs.graphics(
                "build_mask.vert", mask_fragment, mask_supply(), **mask_constants
            )
        passes = self._frames.tile_passes(frame, tile)
        budget = frame.settings.mesh_budget_bytes
        with self._query:
            self._shared.scene.draw(
                program, mask_program, self._rasteriser, tile, passes, budget, curved=frame.curved
            )
        return int(self._query.samples)

"""The A-buffer: rasterises all surfaces into per-pixel lists, sorts them and integrates the VRI over each.

Source: Lindholm et al., "Towards data centric sampling for volume rendering", Algorithm 1.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Self

import numpy as np
import numpy.typing as npt

from isosample.errors import CapacityError, LostFragmentsError
from isosample.gl.timer import StageTimer
from isosample.integral.segment_rule import SegmentRule
from isosample.rendering.culling import Culling
from isosample.rendering.detail_choice import DetailChoice
from isosample.rendering.device_scene import DeviceScene, residual_column
from isosample.rendering.fragment_lists import FragmentLists, decode_lists
from isosample.rendering.fragment_pool import FragmentPool
from isosample.rendering.frame import frame_block, head_start, set_tile, shared_constants, uniform_dtype
from isosample.rendering.frame_statistics import FrameStatistics as FrameStatistics
from isosample.rendering.picture_target import PictureTarget
from isosample.rendering.programs import Programs
from isosample.rendering.settings import ResolveStage, check_size
from isosample.rendering.stage import resolve_stage, work_groups
from isosample.rendering.tiles import Tile, strips, tiles_that_fit

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    import moderngl

    from isosample.rendering.camera import Camera
    from isosample.rendering.culling import Pass
    from isosample.rendering.scene import Scene
    from isosample.rendering.settings import RenderSettings

F32 = npt.NDArray[np.float32]

QUERY_SATURATED = 0xFFFFFFFF  # an occlusion query read as 32 bits stops here
SEGMENT_RULES = {
    SegmentRule.CONSTANT: 0,
    SegmentRule.CONSTANT_FIRST_ORDER: 1,
    SegmentRule.LINEAR: 2,
    SegmentRule.CUBIC: 3,
}
# Classes of lists by length, in runs of 16 nodes; 0: empty. Each takes one program, which resolves the chains among
# the lists that the one before left; see shaders/pass/chain.glsl. More classes take longer: every program loads in
# vain what it leaves.
RUN = 16
CHAIN_CLASSES = (0, 6, 16)
LARGEST_ARRAY = (
    16  # nodes of a list that is no chain: longer ones are sorted on their links, which takes no longer
)
LONGEST_LIST = 7_000  # up to 9 loop iterations per node in one shader call stay below llvmpipe's 65535


@dataclass(slots=True)
class _Frame:
    """One picture in the making."""

    block: npt.NDArray[np.void]
    settings: RenderSettings
    passes: tuple[Pass, ...]
    curved: bool
    residuals: bool = False
    streamed: bool = False
    statistics: FrameStatistics = field(default_factory=FrameStatistics)

    @property
    def shading(self) -> int:
        return int(self.settings.material is not None)


class ABuffer:
    """Renders one scene from any camera; holds its meshes, programs and fragment pool on the GPU.

    Parameters
    ----------
    ctx : moderngl.Context
    scene : Scene

    Raises
    ------
    CapacityError
        If the scene has more levels or larger tables than the device takes.

    Notes
    -----
    Use as a context manager, or call `release`. `timer.seconds` holds the seconds of every stage so far.
    """

    def __init__(self, ctx: moderngl.Context, scene: Scene) -> None:
        self._ctx = ctx
        self._geometry = scene.geometry
        self._scene = scene
        self.timer = StageTimer(ctx)
        self._programs = Programs(ctx)
        with self.timer.stage("upload"):
            self._device = DeviceScene(ctx, scene)
        self._culling = Culling(self._device.meshes.chunks)
        self._details = DetailChoice(self._device.meshes.chunks, max(scene.geometry.spacing))
        self._pool = FragmentPool(ctx)
        self._was_split = False
        self._frame_buffer = ctx.buffer(reserve=uniform_dtype("Frame").itemsize)
        self._query = ctx.query(samples=True)
        self._target = PictureTarget(ctx)
        self._rasteriser: moderngl.Framebuffer | None = None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.release()

    def release(self) -> None:
        """Free everything on the GPU."""
        self._target.release()
        self._release_rasteriser()
        self._device.release()
        self._programs.release()
        self._pool.release()
        self._frame_buffer.release()

    def render(
        self,
        camera: Camera,
        size: tuple[int, int],
        settings: RenderSettings,
        progress: Callable[[int, int], None] | None = None,
    ) -> tuple[F32, FrameStatistics]:
        """Render one picture.

        Parameters
        ----------
        camera : Camera
        size : (width, height)
            Pixels.
        settings : RenderSettings
        progress : callable, optional
            Called with pixels done and pixels in all.

        Returns
        -------
        rgba : (height, width, 4) float32
            Premultiplied linear RGBA, row 0 on top.
        statistics : FrameStatistics

        Raises
        ------
        InputError
            If the size is not two whole numbers >= 1.
        CapacityError
            If the picture is larger than the driver's framebuffers, or one pixel's list does not fit the
            budget or is longer than `LONGEST_LIST`.
        LostFragmentsError
            If the lists hold another number of fragments than the rasteriser counted.
        """
        width, height = check_size(size)
        self._make_targets(width, height)
        frame = self._frame(camera, (width, height), settings)
        done = 0
        for tile, rasterised in self._built_tiles(frame, width, height):
            self._resolve(tile, frame)
            self._account(rasterised, frame.statistics)
            frame.statistics.tiles += 1
            done += tile.pixel_count
            if progress is not None:
                progress(done, width * height)
        frame.statistics.pool_bytes = self._pool.size_bytes
        uploads = self._device.meshes.uploads
        frame.statistics.mesh_batches, frame.statistics.mesh_bytes = uploads.batches, uploads.largest_bytes
        with self.timer.stage("read back"):
            rgba = self._target.read()
        return rgba, frame.statistics

    def fragment_lists(
        self, camera: Camera, size: tuple[int, int], settings: RenderSettings
    ) -> FragmentLists:
        """All lists of a picture at once; see `fragment_list_parts`.

        Raises
        ------
        CapacityError
            If the lists do not fit the budget; and as `render`.
        """
        parts = list(self.fragment_list_parts(camera, size, settings))
        if len(parts) > 1:
            raise CapacityError(
                f"the lists come in {len(parts)} parts, as they do not fit the budget; make the picture smaller."
            )
        return parts[0]

    def fragment_list_parts(
        self, camera: Camera, size: tuple[int, int], settings: RenderSettings
    ) -> Iterator[FragmentLists]:
        """Read back the lists of a picture, instead of resolving them, in parts that fit the budget.

        Parameters
        ----------
        camera, size, settings
            As for `render`.

        Yields
        ------
        lists : FragmentLists
            Of some of the pixels; every pixel is in one of the parts.

        Raises
        ------
        CapacityError
            As `render`.
        """
        width, height = check_size(size)
        self._make_targets(width, height)
        frame = self._frame(camera, (width, height), settings, residuals=True)
        start = head_start(camera.rays(width / height), self._geometry.box)
        for tile, _ in self._built_tiles(frame, width, height):
            yield decode_lists(tile, (width, height), self._pool.heads(tile), self._pool.nodes(), start=start)

    def reach(self, camera: Camera, size: tuple[int, int], settings: RenderSettings) -> float:
        """How far apart crossings of one place may lie in the wrong order in a picture [world]; see `DetailChoice`."""
        _, chosen = self._block_and_details(camera, size, settings)
        return float(np.linalg.norm(self._geometry.spacing)) * self._details.reach(chosen)

    # -- one tile ---------------------------------------------------------------------------------

    def _built_tiles(self, frame: _Frame, width: int, height: int) -> Iterator[tuple[Tile, int]]:
        """Build the lists of one tile after the other; yields each with its fragments by an independent count."""
        parts = [(tile, False) for tile in strips(width, height, self._pool.max_pixels)]
        were_split = False
        while parts:
            part, counted = parts.pop(0)
            smaller, rasterised = self._build_or_split(part, frame, counted=counted)
            parts = [(tile, True) for tile in smaller] + parts
            were_split |= len(smaller) > 1
            if not smaller:
                yield part, rasterised
        self._was_split = were_split

    def _build_or_split(self, tile: Tile, frame: _Frame, *, counted: bool) -> tuple[list[Tile], int]:
        """Build a tile's lists, or return smaller tiles to build in its place because they do not fit.

        Where the last picture did not fit, this one probably does not either: its fragments are counted first
        (unless `counted`), rather than built in vain.
        """
        budget = frame.settings.fragment_budget_bytes
        if self._pool.is_empty and frame.streamed:
            self._pool.fill(budget)  # rather than loading all meshes once more to measure
        elif self._pool.is_empty:
            with self.timer.stage("measure"):
                measured = self._measure(tile, frame)
            if not self._pool.grow(measured, budget):
                return self._split(tile, frame), 0
        elif self._was_split and not counted:
            return self._split(tile, frame), 0
        counters, rasterised = self._build(tile, frame)
        asked = int(counters["node_count"])
        if rasterised == QUERY_SATURATED or asked > self._pool.capacity:
            needed = max(asked, rasterised)
            return ([tile] if self._pool.grow(needed, budget) else self._split(tile, frame)), 0
        return [], rasterised

    def _measure(self, tile: Tile, frame: _Frame) -> int:
        """Fragments of a tile, counted by an occlusion query (saturates at `QUERY_SATURATED`)."""
        self._bind(tile, frame)
        return self._draw("measure.frag", "measure.frag", tile, frame)

    def _split(self, tile: Tile, frame: _Frame) -> list[Tile]:
        """Tiles whose lists fit, from a count of every pixel's fragments."""
        with self.timer.stage("count"):
            self._pool.clear_counts(tile)
            self._bind(tile, frame)
            self._draw("count.frag", "count.frag", tile, frame)
            self._ctx.memory_barrier()
            counts = self._pool.heads(tile)
        self._pool.grow(int(counts.sum(dtype=np.int64)), frame.settings.fragment_budget_bytes)
        return tiles_that_fit(tile, counts.reshape(tile.height, tile.width), self._pool.capacity)

    def _build(self, tile: Tile, frame: _Frame) -> tuple[np.void, int]:
        """Fill the lists; return the counters and the number of fragments by an independent count."""
        with self.timer.stage("build"):
            self._pool.clear_lists(tile)
            self._bind(tile, frame)
            constants = {
                "SHADING": frame.shading,
                "CURVED": int(frame.curved),
                "RESIDUAL": int(frame.residuals),
            }
            rasterised = self._draw("build.frag", "build_mask.frag", tile, frame, **constants)
            self._ctx.memory_barrier()
            return self._pool.counters(), rasterised

    def _draw(self, fragment: str, mask_fragment: str, tile: Tile, frame: _Frame, **constants: int) -> int:
        """Rasterise the meshes without attachments; return the fragments by an occlusion query."""
        assert self._rasteriser is not None
        program = self._programs.graphics(
            "build.vert", fragment, **({"CURVED": 0, "RESIDUAL": 0} | constants)
        )
        masked = self._device.has_mask
        mask_program = self._programs.graphics("build_mask.vert", mask_fragment) if masked else None
        passes = self._culling.tile(frame.block[0], tile, frame.passes)
        budget = frame.settings.mesh_budget_bytes
        with self._query:
            self._device.draw(
                program, mask_program, self._rasteriser, tile, passes, budget, curved=frame.curved
            )
        return int(self._query.samples)

    def _resolve(self, tile: Tile, frame: _Frame) -> None:
        """Sort and integrate the lists of a tile into the target."""
        with self.timer.stage("resolve"):
            chains = not self._device.has_mask and frame.settings.sort_capacity >= RUN
            if not chains or self._resolve_chains(tile, frame):
                self._resolve_rest(tile, frame, first=not chains)

    def _resolve_chains(self, tile: Tile, frame: _Frame) -> bool:
        """Resolve the lists that are chains, by classes of length; return whether any list is left."""
        counters = self._pool.counters()
        for number, runs in enumerate(CHAIN_CLASSES):
            if RUN * runs > frame.settings.sort_capacity:
                return True
            longer = int(counters["longer_lists"])
            self._run_resolve("resolve_chain", tile, frame, first=number == 0, RUNS=runs)
            counters = self._pool.counters()
            if int(counters["longer_lists"]) == longer:
                return int(counters["broken_chains"]) > 0
        return True

    def _resolve_rest(self, tile: Tile, frame: _Frame, *, first: bool) -> None:
        """Resolve all lists that are left; very long ones take a second round."""
        constants = shared_constants()
        capacity = min(frame.settings.sort_capacity, LARGEST_ARRAY)
        self._run_resolve("resolve", tile, frame, first=first, SORT_CAPACITY=capacity)
        longest = int(self._pool.counters()["max_depth_complexity"])
        if longest > constants["LINK_SORT_LIMIT"]:
            self._merge_long_lists(tile, longest)
            frame.block["longest_walked"] = LONGEST_LIST
            self._bind(tile, frame)
            self._run_resolve("resolve", tile, frame, first=False, SORT_CAPACITY=capacity)
            frame.block["longest_walked"] = constants["LINK_SORT_LIMIT"]

    def _run_resolve(self, entry: str, tile: Tile, frame: _Frame, *, first: bool, **constants: int) -> None:
        """Run one program of the resolve pass over a tile: the first one, or one that finds something done."""
        constants |= self._device.constants | {
            "SHADING": frame.shading,
            "SEGMENT_RULE": SEGMENT_RULES[frame.settings.segment],
        }
        if resolve_stage(self._ctx, frame.settings.stage) is ResolveStage.FRAGMENT:
            screen = "screen.vert" if first else "open_blocks.vert"
            broken = {} if first else {"BROKEN": int(entry == "resolve")}
            program = self._programs.graphics(screen, f"{entry}.frag", **broken, **constants)
            if first:
                self._target.fill(tile, program)
            else:
                self._target.fill_blocks(tile, program, shared_constants()["RESOLVE_BLOCK"])
        else:
            self._target.fill(tile, self._programs.compute(f"{entry}.comp", **constants))
        self._ctx.memory_barrier()

    def _merge_long_lists(self, tile: Tile, longest: int) -> None:
        """Sort the lists above LINK_SORT_LIMIT, one merge pass per call."""
        if longest > LONGEST_LIST:
            raise CapacityError(
                f"one pixel has {longest} fragments; at most {LONGEST_LIST} can be sorted. "
                "Use fewer isovalues."
            )
        program = self._programs.compute("merge_lists.comp", SORT_CAPACITY=1)
        run = 1
        while run < longest:
            program["run"] = run
            program.run(*work_groups(tile))
            self._ctx.memory_barrier()
            run *= 2

    def _account(self, rasterised: int, statistics: FrameStatistics) -> None:
        """Add a tile's counters; raise if its lists lack fragments."""
        counters = self._pool.counters()
        walked, built = int(counters["walked_count"]), int(counters["node_count"])
        lost = max(abs(rasterised - walked), abs(built - walked))
        if lost:
            raise LostFragmentsError(
                f"{rasterised} fragments were rasterised, {built} stored and {walked} found in the lists. "
                f"The driver {self._ctx.info['GL_RENDERER']!r} lost some; see `isosample doctor`."
            )
        unfinished = int(counters["unfinished_rays"])
        if unfinished:
            raise LostFragmentsError(
                f"{unfinished} rays were not walked to their end: the driver {self._ctx.info['GL_RENDERER']!r} ends "
                f"long loops. The longest list has {int(counters['max_depth_complexity'])} fragments; use fewer "
                "isovalues, or --segment linear."
            )
        statistics.fragments += walked
        statistics.max_depth_complexity = max(
            statistics.max_depth_complexity, int(counters["max_depth_complexity"])
        )
        statistics.band_violations += int(counters["band_violations"])
        statistics.reordered_fragments += int(counters["reordered_fragments"])
        statistics.unrepaired_pixels += int(counters["unrepaired_pixels"])
        statistics.saturated_segments += int(counters["saturated_segments"])
        statistics.terminated_rays += int(counters["terminated_rays"])

    # -- camera and memory ------------------------------------------------------------------------

    def _frame(
        self, camera: Camera, size: tuple[int, int], settings: RenderSettings, *, residuals: bool = False
    ) -> _Frame:
        block, chosen = self._block_and_details(camera, size, settings)
        coarser = self._device.meshes.chunks["detail"] > 0
        block[0]["reach"] *= self._details.reach(chosen)
        curved = self._scene.smooth if settings.curved is None else settings.curved
        frame = _Frame(block=block, settings=settings, passes=(), curved=curved, residuals=residuals)
        # Lists that are read back are judged, not resolved: there the clip planes rule out nothing; nor where cells are
        # masked, whose border is drawn in any case.
        found = self._culling.picture(
            block[0],
            self._sides(camera, size[0] / size[1]),
            clip=not (residuals or self._device.has_mask),
            chosen=chosen,
        )
        frame.passes = found.passes
        statistics = frame.statistics
        statistics.chunks, statistics.chunks_outside_view = found.pieces, found.outside_view
        statistics.chunks_clipped, statistics.triangles_drawn = found.clipped, found.triangles
        statistics.chunks_coarser = int((chosen & coarser).sum())
        self._upload(frame)
        return frame

    def _block_and_details(
        self, camera: Camera, size: tuple[int, int], settings: RenderSettings
    ) -> tuple[npt.NDArray[np.void], npt.NDArray[np.bool_]]:
        """The frame block of a picture, and the pieces of the details that it takes."""
        block = frame_block(self._scene, camera, size, settings)
        return block, self._details.chosen(block[0], settings.screen_error)

    def _upload(self, frame: _Frame) -> None:
        """Put the meshes of a picture on the GPU, if they fit; else every pass uploads them in batches."""
        meshes, budget = self._device.meshes, frame.settings.mesh_budget_bytes
        meshes.begin_picture(budget)
        residual = residual_column(frame.curved) if frame.residuals else None
        needed = np.any([one.shown for one in frame.passes], axis=0)
        rows = meshes.missing(needed, budget, residual)
        if len(rows):
            with self.timer.stage("upload"):
                meshes.upload(rows, residual)
        frame.streamed = not meshes.has(needed, residual)

    def _sides(self, camera: Camera, aspect: float) -> tuple[float, ...]:
        """+1 for what is in front of the eye; −1 too if a perspective eye is inside the box."""
        rays = camera.rays(aspect)
        box = self._geometry.box
        unit = np.linalg.inv(box.edges.T) @ (rays.eye - box.corner)
        inside = bool(np.all((unit >= 0.0) & (unit <= 1.0)))
        return (1.0, -1.0) if rays.perspective and inside else (1.0,)

    def _make_targets(self, width: int, height: int) -> None:
        """Targets of the picture's size: the picture, and a framebuffer without attachments for the lists."""
        if self._target.resize(width, height) or self._rasteriser is None:
            self._release_rasteriser()
            self._rasteriser = self._ctx.empty_framebuffer((width, height))

    def _release_rasteriser(self) -> None:
        if self._rasteriser is not None:
            self._rasteriser.release()
        self._rasteriser = None

    def _bind(self, tile: Tile, frame: _Frame) -> None:
        """Write the frame block and bind every buffer."""
        set_tile(frame.block, tile, self._pool.capacity)
        self._frame_buffer.write(frame.block.tobytes())
        self._frame_buffer.bind_to_uniform_block(shared_constants()["BINDING_FRAME"])
        self._device.bind()
        self._pool.bind()

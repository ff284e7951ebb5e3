"""The A-buffer: rasterises all surfaces into per-pixel lists, sorts them and integrates the VRI over each.

Source: Lindholm et al., "Towards data centric sampling for volume rendering", Algorithm 1.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Self

import numpy as np
import numpy.typing as npt

from isosample.errors import CapacityError, LostFragmentsError
from isosample.gl.ownership import Owner
from isosample.rendering.fragment_lists import FragmentLists, decode_lists
from isosample.rendering.frame import head_start
from isosample.rendering.list_building import ListBuilder
from isosample.rendering.pass_resources import PassResources
from isosample.rendering.picture_frame import PictureFrames
from isosample.rendering.picture_target import PictureTarget
from isosample.rendering.resolve_pass import ResolvePass
from isosample.rendering.settings import check_size

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    import moderngl

    from isosample.rendering.camera import Camera
    from isosample.rendering.frame_statistics import FrameStatistics
    from isosample.rendering.picture_frame import PictureFrame
    from isosample.rendering.scene import Scene
    from isosample.rendering.settings import RenderSettings

F32 = npt.NDArray[np.float32]


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
        with Owner() as made:
            self._shared = made.keep(PassResources(ctx, scene))
            self.timer = self._shared.timer
            self._frames = PictureFrames(scene, self._shared.scene.meshes.chunks)
            self._builder = made.keep(ListBuilder(self._shared, self._frames))
            self._target = made.keep(PictureTarget(ctx))
            self._resolve_pass = ResolvePass(self._shared, self._target)
            self._made = made.pop_all()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.release()

    def release(self) -> None:
        """Free everything on the GPU."""
        self._made.close()

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
            budget or is longer than `resolve_pass.LONGEST_LIST`.
        LostFragmentsError
            If the lists hold another number of fragments than the rasteriser counted.
        """
        width, height = check_size(size)
        frame = self._begin(camera, (width, height), settings)
        done = 0
        for tile, rasterised in self._builder.built_tiles(frame, (width, height)):
            if not self._resolve_pass.resolve(tile, frame):
                self._builder.link(tile, frame)  # which comes once more
                continue
            self._account(rasterised, frame.statistics)
            frame.statistics.tiles += 1
            done += tile.pixel_count
            if progress is not None:
                progress(done, width * height)
        frame.statistics.pool_bytes = self._shared.pool.size_bytes + self._shared.slots.size_bytes
        uploads = self._shared.scene.meshes.uploads
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
        CapacityError, LostFragmentsError
            As `render`.
        """
        width, height = check_size(size)
        frame = self._begin(camera, (width, height), settings, residuals=True)
        start = head_start(camera.rays(width / height), self._geometry.box)
        pool = self._shared.pool
        for tile, rasterised in self._builder.built_tiles(frame, (width, height)):
            built = int(pool.counters()["node_count"])
            lists = decode_lists(tile, (width, height), pool.heads(tile), pool.nodes()[:built], start=start)
            self._check_whole(rasterised, built, len(lists.pixels))
            yield lists

    def reach(self, camera: Camera, size: tuple[int, int], settings: RenderSettings) -> float:
        """How far apart crossings of one place may lie in the wrong order in a picture [world]; see `DetailChoice`."""
        return self._frames.reach(camera, size, settings)

    def _begin(
        self, camera: Camera, size: tuple[int, int], settings: RenderSettings, *, residuals: bool = False
    ) -> PictureFrame:
        """Make targets of the picture's size, choose what is drawn, and upload it."""
        self._target.resize(*size)
        self._builder.resize(size)
        self._shared.pool.keep_within(settings.fragment_budget_bytes)
        frame = self._frames.begin(camera, size, settings, residuals=residuals)
        self._upload(frame)
        return frame

    def _upload(self, frame: PictureFrame) -> None:
        """Put the meshes of a picture on the GPU, if they fit; else every pass uploads them in batches."""
        meshes, budget = self._shared.scene.meshes, frame.settings.mesh_budget_bytes
        meshes.begin_picture(budget)
        residual = frame.residual
        needed = np.any([one.shown for one in frame.passes], axis=0)
        rows = meshes.missing(needed, budget, residual)
        if len(rows):
            with self.timer.stage("upload"):
                meshes.upload(rows, residual)
        frame.streamed = not meshes.has(needed, residual)

    def _check_whole(self, rasterised: int, built: int, found: int) -> None:
        """Raise if the lists of a tile do not hold what the rasteriser counted."""
        if not rasterised == built == found:
            raise LostFragmentsError(
                f"{rasterised} fragments were rasterised, {built} stored and {found} found in the lists. "
                f"The driver {self._ctx.info['GL_RENDERER']!r} lost some; see `isosample doctor`."
            )

    def _account(self, rasterised: int, statistics: FrameStatistics) -> None:
        """Add a tile's counters; raise if its lists lack fragments."""
        counters = self._shared.pool.counters()
        walked = int(counters["walked_count"])
        self._check_whole(rasterised, int(counters["node_count"]), walked)
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
        statistics.repaired_pixels += int(counters["repaired_pixels"])
        statistics.unrepaired_pixels += int(counters["unrepaired_pixels"])
        statistics.saturated_segments += int(counters["saturated_segments"])
        statistics.terminated_rays += int(counters["terminated_rays"])

"""The ray caster: the volume itself, sampled along the ray of every pixel on the GPU.

Source: Knoll et al. 2009, "Volume ray casting with peak finding and differential sampling".
"""

from __future__ import annotations

import time
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Self

import numpy as np
import numpy.typing as npt

from isosample.defaults import DEFAULT_SIZE
from isosample.gl.context import shared_context
from isosample.gl.ownership import Owner
from isosample.gl.timer import StageTimer
from isosample.rendering.camera import Camera
from isosample.rendering.device_macrocells import DeviceMacrocells
from isosample.rendering.device_transfer import DeviceTransfer
from isosample.rendering.device_volume import DeviceVolume
from isosample.rendering.frame import camera_block, set_tile, uniform_dtype
from isosample.rendering.image import Image
from isosample.rendering.picture_target import PictureTarget
from isosample.rendering.programs import Programs
from isosample.rendering.ray_blocks import RayBlocks
from isosample.rendering.ray_buffers import RayBuffers
from isosample.rendering.ray_sampling import fill_sampling
from isosample.rendering.ray_statistics import RayStatistics
from isosample.rendering.raycast_settings import RaycastSettings
from isosample.rendering.scene import ValueScale
from isosample.rendering.settings import RenderSettings, ResolveStage, check_size
from isosample.rendering.stage import resolve_stage
from isosample.rendering.supplies import ray_supply
from isosample.rendering.tiles import Tile, strips
from isosample.surfaces.settings import ExtractionSettings, check_volume
from isosample.transfer.transfer_function import TransferFunction, check_is_transfer_function
from isosample.volume.macrocells import MacrocellGrid
from isosample.volume.reconstruction import GridSpline

if TYPE_CHECKING:
    from isosample.rendering.programs import Program
    from isosample.rendering.stage_progress import Progress
    from isosample.volume.grid import Volume

TILE_PIXELS = 1 << 18  # a call is then far from the seconds after which drivers give up on it
LOOP_LIMIT = 1024  # stretches and macrocells of a ray in one call; llvmpipe ends all loops after 65535 turns


def raycast(
    volume: Volume,
    transfer_function: TransferFunction | None = None,
    *,
    camera: Camera | None = None,
    size: tuple[int, int] = DEFAULT_SIZE,
    settings: RenderSettings | None = None,
    raycast: RaycastSettings | None = None,
    nan_masked: bool = False,
    progress: Progress | None = None,
) -> Image:
    """Render a volume by casting rays through it: post-classified, pre-integrated, or with peak finding.

    Parameters
    ----------
    volume : Volume
    transfer_function : TransferFunction, optional
        `TransferFunction.suggest(volume)` by default.
    camera : Camera, optional
        `Camera.default(volume.box, size)` by default: from the front.
    size : (width, height)
        Pixels.
    settings : RenderSettings, optional
        Shading, background, clip planes, stage, `min_transmittance`; what belongs to the A-buffer (segment
        rule, budgets) has no meaning here.
    raycast : RaycastSettings, optional
        Classification and sampling.
    nan_masked : bool
        Leave out what touches a NaN or infinite sample (a stretch between two samples of the ray is left out
        whole); otherwise such samples are an error.
    progress : callable, optional
        Called with the stage ("render"), pixels done and pixels in all.

    Returns
    -------
    image : Image
        Premultiplied linear RGBA, float32, with statistics.

    Raises
    ------
    InputError
        If the volume cannot be rendered as asked (thin, not finite) or an option is out of range.
    CapacityError
        If the volume or a table is larger than the driver's textures.
    OpenGLError
        If there is no usable OpenGL.
    """
    with RayCaster(volume, transfer_function, raycast=raycast, nan_masked=nan_masked) as caster:
        return caster.render(camera=camera, size=size, settings=settings, progress=progress)


class RayCaster:
    """A volume and a transfer function on the GPU, for as many pictures as you like.

    Parameters
    ----------
    volume, transfer_function, raycast, nan_masked
        As for `raycast`.
    macrocells : MacrocellGrid, optional
        Of an earlier look at this volume; built anew if `raycast` has another reconstruction or number.

    Raises
    ------
    InputError, CapacityError, OpenGLError
        As `raycast`.

    Notes
    -----
    Use as a context manager, or call `release`.
    """

    def __init__(
        self,
        volume: Volume,
        transfer_function: TransferFunction | None = None,
        *,
        raycast: RaycastSettings | None = None,
        nan_masked: bool = False,
        macrocells: MacrocellGrid | None = None,
    ) -> None:
        started = time.perf_counter()
        self._settings = raycast or RaycastSettings()
        reconstruction = self._settings.reconstruction
        check_volume(volume, ExtractionSettings(nan_masked=nan_masked, reconstruction=reconstruction))
        self._ctx = shared_context()
        self._geometry = volume.geometry
        self._scale = ValueScale(*volume.value_range)
        spline = GridSpline.build(volume, reconstruction) if reconstruction.smooth else None
        count = self._settings.macrocells
        grid = MacrocellGrid.build(volume, reconstruction, count, spline=spline, known=macrocells)
        self.timer = StageTimer(self._ctx)
        self.timer.seconds["prepare"] = time.perf_counter() - started
        with Owner() as made:
            self._programs = made.keep(Programs(self._ctx))
            with self.timer.stage("upload"):
                filtering = self._settings.filtering
                device = DeviceVolume(
                    self._ctx, volume, self._scale, reconstruction, filtering, spline=spline
                )
                self._volume = made.keep(device)
                self._transfer_function = transfer_function or TransferFunction.suggest(volume)
                self._transfer = self._device_transfer(self._transfer_function, self._settings)
                made.callback(lambda: self._transfer.release())
                self._macrocells = made.keep(
                    DeviceMacrocells(self._ctx, grid, self._settings, self._transfer.visible_intervals())
                )
            self._buffers = made.keep(RayBuffers(self._ctx, TILE_PIXELS))
            self._tile_number = 0
            self._blocks = made.keep(RayBlocks(self._ctx))
            self._target = made.keep(PictureTarget(self._ctx))
            self._made = made.pop_all()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.release()

    def release(self) -> None:
        """Free everything on the GPU."""
        self._made.close()

    def set_transfer_function(self, transfer_function: TransferFunction) -> None:
        """Show the volume with another transfer function; neither the volume nor its macrocells are made anew.

        Raises
        ------
        CapacityError
            If a table is larger than the driver's textures.
        """
        self._take(self._device_transfer(transfer_function, self._settings))
        self._transfer_function = transfer_function
        self._macrocells.update(self._transfer.visible_intervals())

    def set_step(self, step: float) -> None:
        """Take even samples `step` voxels apart, with volume and macrocells as they are; raises as `raycast`."""
        settings = replace(self._settings, step=step)
        self._take(self._device_transfer(self._transfer_function, settings))
        self._settings = settings

    def render(
        self,
        *,
        camera: Camera | None = None,
        size: tuple[int, int] = DEFAULT_SIZE,
        settings: RenderSettings | None = None,
        progress: Progress | None = None,
    ) -> Image:
        """Render one picture; parameters and errors as `raycast`."""
        width, height = check_size(size)
        settings = settings or RenderSettings()
        camera = camera or Camera.default(self._geometry.box, (width, height))
        self._target.resize(width, height)
        frame = camera_block(self._geometry, camera, (width, height), settings)
        block = self._raycast_block(camera, (width, height))
        found = RayStatistics()
        done = 0
        if self._settings.skipping:
            with self.timer.stage("render"):
                self._write(frame, block)
                self._blocks.find((width, height), self._programs)
                self._target.clear(frame[0]["background"])
        for tile in strips(width, height, TILE_PIXELS):
            with self.timer.stage("render"):
                self._cast(tile, frame, block, settings, found)
            done += tile.pixel_count
            if progress is not None:
                progress("render", done, width * height)
        with self.timer.stage("read back"):
            rgba = self._target.read()
        seconds = {stage: round(spent, 6) for stage, spent in self.timer.seconds.items()}
        self.timer.seconds.clear()
        return Image(rgba, self._statistics(found, (width, height), seconds))

    def _cast(
        self,
        tile: Tile,
        frame: npt.NDArray[np.void],
        block: npt.NDArray[np.void],
        settings: RenderSettings,
        found: RayStatistics,
    ) -> None:
        """March the rays of a tile to their ends, in as many calls as the longest one takes."""
        set_tile(frame, tile, 0)
        self._tile_number += 1
        block[0]["tile_number"] = self._tile_number
        self._write(frame, block)
        found.tiles += 1
        unfinished, resumed = tile.pixel_count, False
        while unfinished:
            self._buffers.clear_counters()
            self._blocks.fill(self._target, tile, self._program(settings, resumed=resumed))
            self._ctx.memory_barrier()
            counters = self._buffers.counters()
            found.add(counters)
            unfinished = int(counters["unfinished_rays"])
            resumed = True

    def _write(self, frame: npt.NDArray[np.void], block: npt.NDArray[np.void]) -> None:
        """Give the shaders their blocks, buffers and textures."""
        self._buffers.write(frame, block)
        for part in (self._volume, self._transfer, self._macrocells):
            part.bind()

    def _program(self, settings: RenderSettings, *, resumed: bool) -> Program:
        constants = self._volume.constants() | self._transfer.constants()
        constants |= {"ADAPTIVE": int(self._settings.adaptive), "BLOCKS": int(self._settings.skipping)}
        constants |= {"SHADING": int(settings.material is not None), "RESUMED": int(resumed)}
        samplers = self._volume.samplers() | self._transfer.samplers() | self._macrocells.samplers()
        samplers |= {"spans": "sampler2D"} if self._settings.skipping else {}
        compute = resolve_stage(self._ctx, settings.stage) is ResolveStage.COMPUTE
        supply = ray_supply(samplers, compute=compute)
        if compute:
            return self._programs.compute("raycast.comp", supply, **constants)
        points = "ray_blocks.vert" if self._settings.skipping else "screen.vert"
        return self._programs.graphics(points, "raycast.frag", supply, **constants)

    def _raycast_block(self, camera: Camera, size: tuple[int, int]) -> npt.NDArray[np.void]:
        block = np.zeros(1, dtype=uniform_dtype("Raycast"))
        fill_sampling(block[0], self._settings, self._geometry, camera.rays(size[0] / size[1]), size)
        block[0]["loop_limit"] = LOOP_LIMIT
        for part in (self._volume, self._transfer, self._macrocells):
            part.fill(block[0])
        return block

    def _device_transfer(
        self, transfer_function: TransferFunction, settings: RaycastSettings
    ) -> DeviceTransfer:
        check_is_transfer_function(transfer_function)
        length = settings.step * min(self._geometry.spacing)
        return DeviceTransfer(self._ctx, transfer_function, self._scale, settings, length)

    def _take(self, transfer: DeviceTransfer) -> None:
        self._transfer.release()
        self._transfer = transfer

    def _statistics(
        self, found: RayStatistics, size: tuple[int, int], seconds: dict[str, float]
    ) -> dict[str, Any]:
        own = self._settings
        return {
            "renderer": self._ctx.info["GL_RENDERER"],
            "method": own.classification.value,
            "sampling": own.sampling.value,
            "size": list(size),
            "seconds": seconds,
            **found.to_dict(size, self._macrocells.occupied, self._macrocells.count),
            "reconstruction": own.reconstruction.value,
            "not_shown": self._transfer.not_shown,
        }

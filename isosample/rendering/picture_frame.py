"""One picture in the making: its frame block, and the pieces of the meshes that each pass draws."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from isosample.rendering.culling import Culling
from isosample.rendering.detail_choice import DetailChoice
from isosample.rendering.device_scene import residual_column
from isosample.rendering.frame import frame_block
from isosample.rendering.frame_statistics import FrameStatistics

if TYPE_CHECKING:
    from isosample.rendering.camera import Camera
    from isosample.rendering.culling import Pass
    from isosample.rendering.scene import Scene
    from isosample.rendering.settings import RenderSettings
    from isosample.rendering.tiles import Tile
    from isosample.volume.geometry import GridGeometry


@dataclass(slots=True)
class PictureFrame:
    """What is drawn, how, and what it has cost so far.

    Attributes
    ----------
    block : (1,) struct Frame
    settings : RenderSettings
    passes : tuple of Pass
        Of the whole picture; see `PictureFrames.tile_passes`.
    curved : bool
        Whether crossings are moved onto curved triangles.
    residuals : bool
        Whether the lists are read back to be judged.
    streamed : bool
        Whether every pass uploads the meshes anew, in batches.
    unsuited : bool
        Whether compute shaders turned out not to be able to rasterise what is drawn.
    slots_suit : bool
        False where slots turned out not to be able to hold the lists, or did so in a picture before.
    in_slots : bool
        Whether the lists of the present tile are in slots, see `SlotBuilder`; else they are linked.
    statistics : FrameStatistics
    """

    block: npt.NDArray[np.void]
    settings: RenderSettings
    passes: tuple[Pass, ...]
    curved: bool
    residuals: bool = False
    streamed: bool = False
    unsuited: bool = False
    slots_suit: bool = True
    in_slots: bool = False
    statistics: FrameStatistics = field(default_factory=FrameStatistics)

    @property
    def shading(self) -> int:
        """Of the shaders: whether the picture is lit."""
        return int(self.settings.material is not None)

    @property
    def residual(self) -> int | None:
        """Column of the residuals that the build pass reads; None where it reads none."""
        return residual_column(self.curved) if self.residuals else None

    @property
    def build_constants(self) -> dict[str, int]:
        """Of the shaders that append crossings to the lists."""
        return {"SHADING": self.shading, "CURVED": int(self.curved), "RESIDUAL": int(self.residuals)}


class PictureFrames:
    """Begins the pictures of one scene: chooses details, and rules out what no pixel shows.

    Parameters
    ----------
    scene : Scene
    chunks : (C,) `CHUNK_DTYPE`
        Of `DeviceMeshes`.
    """

    def __init__(self, scene: Scene, chunks: npt.NDArray[np.void]) -> None:
        self._scene = scene
        self._geometry = scene.geometry
        self._coarser = chunks["detail"] > 0
        self._culling = Culling(chunks)
        self._details = DetailChoice(chunks, max(scene.geometry.spacing))

    @property
    def geometry(self) -> GridGeometry:
        """Of the scene's volume."""
        return self._geometry

    def begin(
        self, camera: Camera, size: tuple[int, int], settings: RenderSettings, *, residuals: bool = False
    ) -> PictureFrame:
        """Begin a picture; `residuals`: its lists are to be read back and judged."""
        block, chosen = self._block_and_details(camera, size, settings)
        block[0]["reach"] *= self._details.reach(chosen)
        # Lists that are read back are judged, not resolved: there the clip planes rule out nothing; nor where cells are
        # masked, whose border is drawn in any case.
        found = self._culling.picture(
            block[0],
            self._sides(camera, size[0] / size[1]),
            clip=not (residuals or self._scene.mask is not None),
            chosen=chosen,
        )
        curved = self._scene.smooth if settings.curved is None else settings.curved
        frame = PictureFrame(block, settings, found.passes, curved, residuals)
        statistics = frame.statistics
        statistics.chunks, statistics.chunks_outside_view = found.pieces, found.outside_view
        statistics.chunks_clipped, statistics.triangles_drawn = found.clipped, found.triangles
        statistics.chunks_coarser = int((chosen & self._coarser).sum())
        return frame

    def tile_passes(self, frame: PictureFrame, tile: Tile) -> tuple[Pass, ...]:
        """What each pass draws of a tile."""
        return self._culling.tile(frame.block[0], tile, frame.passes)

    def reach(self, camera: Camera, size: tuple[int, int], settings: RenderSettings) -> float:
        """How far apart crossings of one place may lie in the wrong order in a picture [world]; see `DetailChoice`."""
        _, chosen = self._block_and_details(camera, size, settings)
        return float(np.linalg.norm(self._geometry.spacing)) * self._details.reach(chosen)

    def _block_and_details(
        self, camera: Camera, size: tuple[int, int], settings: RenderSettings
    ) -> tuple[npt.NDArray[np.void], npt.NDArray[np.bool_]]:
        """The frame block of a picture, and the pieces of the details that it takes."""
        block = frame_block(self._scene, camera, size, settings)
        return block, self._details.chosen(block[0], settings.screen_error)

    def _sides(self, camera: Camera, aspect: float) -> tuple[float, ...]:
        """+1 for what is in front of the eye; −1 too if a perspective eye is inside the box."""
        rays = camera.rays(aspect)
        box = self._geometry.box
        unit = np.linalg.inv(box.edges.T) @ (rays.eye - box.corner)
        inside = bool(np.all((unit >= 0.0) & (unit <= 1.0)))
        return (1.0, -1.0) if rays.perspective and inside else (1.0,)

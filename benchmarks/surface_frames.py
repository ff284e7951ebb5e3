"""Frames of the data-centric renderer, ready to be drawn again and again beside those of other programs."""

from __future__ import annotations

from typing import TYPE_CHECKING

from isosample.gl.context import shared_context
from isosample.rendering.pipeline import Renderer
from isosample.rendering.preparation import prepare_surfaces
from isosample.rendering.settings import RenderSettings

if TYPE_CHECKING:
    from typing import Any

    import numpy as np
    import numpy.typing as npt

    from benchmarks.raycast_scenes import RaycastScene
    from isosample.rendering.camera import Camera
    from isosample.rendering.quality import Quality
    from isosample.surfaces.surface_set import SurfaceSet
    from isosample.transfer.isovalue_plan import IsovaluePlan

    F32 = npt.NDArray[np.float32]


class SurfaceFrames:
    """The A-buffer over surfaces that were extracted before; `stats` are those of the last picture."""

    def __init__(
        self,
        surfaces: SurfaceSet,
        plan: IsovaluePlan,
        camera: Camera,
        size: int,
        settings: RenderSettings | None = None,
    ) -> None:
        self._camera = camera
        self._size = (size, size)
        self._settings = settings or RenderSettings()
        self._context = shared_context()
        with self._context:  # another program's context may be current
            self._renderer = Renderer(surfaces, plan)
        self.samples = 0.0  # fragments per ray
        self.root_evaluations = 0.0
        self.stats: dict[str, Any] = {}

    @classmethod
    def of_scene(
        cls, scene: RaycastScene, size: int, quality: Quality, settings: RenderSettings | None = None
    ) -> SurfaceFrames:
        """Extract what a quality asks for; that is not a part of any frame."""
        surfaces, plan, _, _ = prepare_surfaces(scene.volume, scene.transfer_function, quality)
        return cls(surfaces, plan, scene.camera, size, settings)

    def render(self) -> F32:
        """Draw and read back."""
        with self._context:
            image = self._renderer.render(camera=self._camera, size=self._size, settings=self._settings)
        self.stats = image.stats
        self.samples = image.stats["samples_per_ray"]["mean"]
        return image.rgba

    def release(self) -> None:
        """Free everything on the GPU."""
        with self._context:
            self._renderer.release()

"""The methods of the comparison at equal errors, each with the settings that it is swept through."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from benchmarks.bench_raycast import OURS as RAY_CASTERS
from benchmarks.bench_raycast import has_vtk, settings_of
from benchmarks.raycast_curves import OurFrames
from benchmarks.surface_frames import SurfaceFrames
from isosample.rendering.method_choice import is_sharp
from isosample.rendering.preparation import prepare_surfaces
from isosample.rendering.quality import Quality, plan_for
from isosample.rendering.raycast_settings import Classification, Crossings, Integration
from isosample.rendering.settings import RenderSettings
from isosample.surfaces.detail import MOST_DETAILS

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from benchmarks.raycast_curves import Frames
    from benchmarks.raycast_scenes import RaycastScene
    from isosample.rendering.preparation import PreparedSurfaces

    Makers = dict[str, tuple[Callable[[float], Frames], Sequence[float]]]

PER_SLOPE = (0.0, 1.0, 2.0, 4.0, 8.0)
SCAN_PER_SLOPE = (0.0, 1.0, 2.0)  # of a scan: what is left of the error is then the meshes'
REFINED_PER_SLOPE = (2.0, 4.0, 8.0)
REFINED_COARSER_PER_SLOPE = (1.0, 2.0)  # fewer: the error is not the meshes'; more: longer than any step
REFINEMENTS = (1.0, 2.0, 4.0)
STEPS = (8.0, 4.0, 2.0, 1.0, 0.5, 0.25, 0.125, 0.0625)
NARROW_STEPS = (2.0, 1.0, 0.5, 0.25, 0.125)  # of VTK for a near-Dirac peak, which it samples in vain
ONE_STEP = (4.0,)  # its picture does not depend on the step
DATA_CENTRIC, REFINED = "data-centric", "data-centric, triangles divided by 2"
COARSER = "data-centric, coarser details"
REFINED_COARSER = f"{REFINED}, coarser details, 1/8 pixel"  # divided only where that shows
# By the largest screen error [pixel]: curved triangles are about as good as flat ones with half of it.
LOOKS = {
    DATA_CENTRIC: RenderSettings(screen_error=0.0),
    COARSER: RenderSettings(),
    f"{COARSER}, curved triangles, 1/8 pixel": RenderSettings(curved=True, screen_error=1 / 8),
    f"{COARSER}, curved triangles, 1/4 pixel": RenderSettings(curved=True, screen_error=1 / 4),
}
VTK_GPU, VTK_ISO, VTK_FIXED = "VTK, GPU mapper", "VTK, GPU mapper, isosurface mode", "VTK, fixed-point mapper"
# Of the ray caster's methods these take longer than another one at every error (see RESULTS.md).
LEFT_OUT = ("post-classified, trapezoid", "peak finding, integral weights, secant")


def makers_of(scene: RaycastScene, size: int) -> Makers:
    """Every method with its settings from cheap to good."""
    found: Makers = {}
    if scene.transfer_function.isosurfaces:
        found[DATA_CENTRIC] = (
            lambda refine: SurfaceFrames.of_scene(scene, size, Quality(refine=int(refine))),
            REFINEMENTS,
        )
    else:
        sampled = scene.volume.array.dtype == np.float32
        counts = PER_SLOPE if sampled else SCAN_PER_SLOPE
        surfaces = _Surfaces(scene, size)
        for name, look in LOOKS.items():
            found[name] = (partial(surfaces.frames, look), counts)
        divided = _Surfaces(scene, size, refine=2)
        found[REFINED_COARSER] = (
            partial(divided.frames, RenderSettings(screen_error=1 / 8)),
            REFINED_COARSER_PER_SLOPE,
        )
        if sampled:  # four times the triangles of a scan, all of them, take longer than any step
            found[REFINED] = (
                lambda count: SurfaceFrames.of_scene(scene, size, Quality(per_slope=int(count), refine=2)),
                REFINED_PER_SLOPE,
            )
    for name in casters_for(scene):
        found[name] = _caster(scene, size, name)
    if has_vtk():
        from benchmarks.peer_vtk import VtkRayCaster

        mapper = partial(VtkRayCaster, scene.volume, scene.transfer_function, scene.camera, size)
        if scene.transfer_function.isosurfaces:
            found[VTK_ISO] = (lambda step: mapper(step=step), STEPS)
        else:
            steps = NARROW_STEPS if sharp(scene) else STEPS
            found[VTK_GPU] = (lambda step: mapper(step=step), steps)
            found[VTK_FIXED] = (lambda step: mapper(step=step, fixed_point=True), steps)
    return found


def sharp(scene: RaycastScene) -> bool:
    """Whether there are isosurfaces, or peaks that are as good as that."""
    return is_sharp(plan_for(scene.volume, scene.transfer_function, Quality()))


def casters_for(scene: RaycastScene) -> list[str]:
    """The ray caster's methods that suit a transfer function: tables and samples of it see no peak as narrow."""
    names = [name for name in RAY_CASTERS if name not in LEFT_OUT]
    if not sharp(scene):
        return names
    return [
        name
        for name in names
        if RAY_CASTERS[name]["classification"] is not Classification.POST_CLASSIFIED
        and RAY_CASTERS[name].get("integration") is not Integration.TABLE_2D
    ]


class _Surfaces:
    """Frames of a scene's surfaces with all details, which are extracted once for all that show them."""

    def __init__(self, scene: RaycastScene, size: int, *, refine: int = 1) -> None:
        self._scene = scene
        self._size = size
        self._refine = refine
        self._count = -1
        self._prepared: PreparedSurfaces | None = None

    def frames(self, look: RenderSettings, count: float) -> Frames:
        """Frames with so many isovalues per slope."""
        if self._prepared is None or self._count != int(count):
            self._prepared, self._count = None, int(count)
            quality = Quality(per_slope=self._count, refine=self._refine, details=MOST_DETAILS)
            self._prepared = prepare_surfaces(self._scene.volume, self._scene.transfer_function, quality)
        return SurfaceFrames(
            self._prepared.surfaces, self._prepared.plan, self._scene.camera, self._size, look
        )


def _caster(scene: RaycastScene, size: int, name: str) -> tuple[Callable[[float], Frames], Sequence[float]]:
    options = RAY_CASTERS[name]
    steps = ONE_STEP if options.get("crossings") is Crossings.EXACT else STEPS
    return lambda step: OurFrames(scene, size, settings_of(options, step)), steps


def label(scene: RaycastScene, method: str, setting: float) -> str:
    """A setting in words."""
    if not method.startswith(DATA_CENTRIC):
        return f"step {setting:g}"
    return f"refine {setting:g}" if scene.transfer_function.isosurfaces else f"{setting:g} per slope"

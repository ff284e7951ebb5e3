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
from isosample.rendering.quality import Quality, plan_for
from isosample.rendering.raycast_settings import Classification, Crossings, Integration
from isosample.rendering.settings import RenderSettings
from isosample.surfaces.detail import MOST_DETAILS

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from benchmarks.raycast_curves import Frames
    from benchmarks.raycast_scenes import RaycastScene

    Makers = dict[str, tuple[Callable[[float], Frames], Sequence[float]]]

PER_SLOPE = (0.0, 1.0, 2.0, 4.0, 8.0)
REFINED_PER_SLOPE = (2.0, 4.0, 8.0)
REFINEMENTS = (1.0, 2.0, 4.0)
STEPS = (8.0, 4.0, 2.0, 1.0, 0.5, 0.25, 0.125, 0.0625)
NARROW_STEPS = (2.0, 1.0, 0.5, 0.25, 0.125)  # of VTK for a near-Dirac peak, which it samples in vain
ONE_STEP = (4.0,)  # its picture does not depend on the step
DATA_CENTRIC, REFINED = "data-centric", "data-centric, triangles divided by 2"
COARSER = "data-centric, coarser details"
# By the largest screen error [pixel]: curved triangles are about as good as flat ones with half of it.
CURVED_LOOKS = {
    f"{COARSER}, curved triangles, {part} pixel": RenderSettings(curved=True, screen_error=error)
    for part, error in (("1/8", 1 / 8), ("1/4", 1 / 4))
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
        found[DATA_CENTRIC] = (_surfaces(scene, size), PER_SLOPE)
        found[COARSER] = (_surfaces(scene, size, details=MOST_DETAILS), PER_SLOPE)
        for name, look in CURVED_LOOKS.items():
            found[name] = (_surfaces(scene, size, details=MOST_DETAILS, look=look), PER_SLOPE)
        if (
            scene.volume.array.dtype == np.float32
        ):  # four times the triangles of a scan take longer than any step
            found[REFINED] = (_surfaces(scene, size, refine=2), REFINED_PER_SLOPE)
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


def _surfaces(
    scene: RaycastScene,
    size: int,
    *,
    refine: int = 1,
    details: int = 0,
    look: RenderSettings | None = None,
) -> Callable[[float], Frames]:
    return lambda count: SurfaceFrames.of_scene(
        scene, size, Quality(per_slope=int(count), refine=refine, details=details), look
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

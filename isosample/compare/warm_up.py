"""What is run once before anything of a comparison is timed."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from isosample.compare.contenders import ComparedScene, Parameter, Setting, contender
from isosample.defaults import DATA_CENTRIC
from isosample.rendering.camera import Camera
from isosample.surfaces.extract import extract_surfaces
from isosample.volume.grid import Volume

if TYPE_CHECKING:
    from collections.abc import Callable

    from isosample.compare.sweep import Sweep
    from isosample.volume.reconstruction import Reconstruction

    Progress = Callable[[str, int, int], None]

TOY_SAMPLES = 12  # along an edge of the volume that warms up compilers


def warm_up(scene: ComparedScene, sweep: Sweep, progress: Progress | None = None) -> None:
    """Let every compiler run once on a small ramp: machine code of extraction and search, shaders of every method.

    Then the volume itself is extracted once, which is discarded: its pages, its type's machine code and what is
    remembered of its samples no contender pays for, and the first setting is timed as the others are.

    Parameters
    ----------
    scene : ComparedScene
    sweep : Sweep
    progress : callable, optional
        Called with the stage ("warm up"), steps done and steps in all, from 0 on.
    """
    low, high = scene.volume.value_range
    if high <= low:
        return  # the contenders tell what is wrong with such a volume
    toy = _toy(scene, low, high)
    steps = [
        partial(_draw, toy, setting)
        for settings in sweep.settings(scene.raycast.sampling)
        for setting in {one.parameter: one for one in reversed(settings)}.values()  # the coarsest of each
    ]
    if DATA_CENTRIC in sweep.methods:
        if sweep.tolerances:
            steps.append(partial(_search, scene.raycast.reconstruction))
        steps.append(partial(_extract, scene))
    for number, step in enumerate(steps):
        if progress:
            progress("warm up", number, len(steps))
        step()
    if progress:
        progress("warm up", len(steps), len(steps))


def _toy(scene: ComparedScene, low: float, high: float) -> ComparedScene:
    """The same of a small ramp, in small pictures."""
    ramp = np.linspace(low, high, TOY_SAMPLES, dtype=np.float32)
    return ComparedScene(
        volume=Volume(np.ascontiguousarray(np.broadcast_to(ramp, (TOY_SAMPLES,) * 3))),
        transfer_function=scene.transfer_function,
        size=(16, 16),
        render=scene.render,
        raycast=scene.raycast,
    )


def _draw(toy: ComparedScene, setting: Setting) -> None:
    camera = Camera.orbit(toy.volume.box, azimuth=30.0, elevation=20.0)
    one = contender(toy, setting)
    one.prepare()
    one.load([camera])
    one.frame(camera)
    one.release()


def _search(reconstruction: Reconstruction) -> None:
    """Divide edges and measure distances, as searches for a tolerance do: x y z bends inside of cells, too."""
    edge = np.arange(1, TOY_SAMPLES + 1, dtype=np.float32)
    bent = Volume(edge[:, None, None] * edge[:, None] * edge)
    extract_surfaces(
        bent, [bent.value_range[1] / 8.0], reconstruction=reconstruction, refine=2, residuals=True
    )


def _extract(scene: ComparedScene) -> None:
    discarded = contender(scene, Setting(DATA_CENTRIC, Parameter.PER_SLOPE, 1))
    discarded.prepare()
    discarded.release()

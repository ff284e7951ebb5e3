"""The ray caster's step for a tolerance: shortened until small pictures from all sides show the truth."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from isosample.defaults import SHOWN_QUANTILE
from isosample.rendering.planning_views import PlanningViews
from isosample.rendering.raycast_settings import RaycastSettings, Sampling
from isosample.rendering.raycaster import RayCaster
from isosample.rendering.search_options import check_tolerance, views_to_try
from isosample.rendering.shown_error import shown_error
from isosample.rendering.stage_progress import of_stage
from isosample.transfer.transfer_function import check_is_transfer_function
from isosample.volume.grid import check_is_volume

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from isosample.rendering.camera import Camera
    from isosample.rendering.stage_progress import Progress
    from isosample.transfer.transfer_function import TransferFunction
    from isosample.volume.grid import Volume

PIXELS = 48
LONGEST, SHORTEST = 2.0, 1.0 / 128.0  # steps that are tried [voxel]
AIM = 0.7  # share of the tolerance that the next step aims for
LEAST_SHARE, LARGEST_SHARE = 0.25, 0.75  # of a step, that the next one is
ROUNDS = 12


@dataclass(frozen=True, slots=True)
class StepSearch:
    """A step, and how it was found.

    Attributes
    ----------
    step : float
        [voxel]
    error : float
        What a thousandth of the pixels of the views exceed.
    report : dict
        JSON-ready: ``tolerance``, ``reached``, ``missed`` (None or "step"), ``step``, ``views``, ``pixels``,
        ``quantile`` and ``rounds`` (step and error).
    """

    step: float
    error: float
    report: dict[str, Any]


def step_for_tolerance(
    volume: Volume,
    transfer_function: TransferFunction,
    tolerance: float,
    *,
    raycast: RaycastSettings | None = None,
    views: Sequence[Camera] | None = None,
    nan_masked: bool = False,
    progress: Progress | None = None,
) -> StepSearch:
    """Return the first of ever shorter even steps with which pictures are within a tolerance.

    Parameters
    ----------
    volume : Volume
    transfer_function : TransferFunction
    tolerance : float
        Largest error of a component of a pixel (premultiplied linear RGBA), for all but a thousandth of the pixels.
    raycast : RaycastSettings, optional
        Everything but the step.
    views : sequence of Camera, optional
        By default four from all sides.
    nan_masked : bool
    progress : callable, optional
        Called with the stage ("truth", "step"), steps done and steps in all.

    Returns
    -------
    found : StepSearch
        Where no step reaches the tolerance, the best that was tried; the report says so.

    Raises
    ------
    InputError
        As `RayCaster`; also if the tolerance is out of range, or the views are no cameras.
    CapacityError, OpenGLError
        As `RayCaster`.

    Notes
    -----
    Methods of order 2: the next step aims for `AIM` of the tolerance by that. Other views are not proven to be within
    the tolerance, as with `plan_for_tolerance`.
    """
    check_tolerance(tolerance)
    check_is_volume(volume)
    check_is_transfer_function(transfer_function)
    cameras = views_to_try(volume.box, views)
    own = replace(raycast or RaycastSettings(), sampling=Sampling.UNIFORM, step=LONGEST)
    # Made first, as it tells of a volume that cannot be rendered, and of a missing driver, before the long work.
    with RayCaster(volume, transfer_function, raycast=own, nan_masked=nan_masked) as caster:
        tried = PlanningViews.trace(
            volume,
            transfer_function,
            cameras,
            PIXELS,
            tolerance=tolerance,
            reconstruction=own.reconstruction,
            progress=of_stage(progress, "truth"),
        )
        rounds = _rounds(caster, tried, tolerance, of_stage(progress, "step"))
    best = min(rounds, key=lambda one: one["error"])
    report = {
        "tolerance": tolerance,
        "reached": best["error"],
        "missed": None if best["error"] <= tolerance else "step",
        "step": best["step"],
        "views": tried.describe(),
        "pixels": PIXELS,
        "quantile": SHOWN_QUANTILE,
        "rounds": rounds,
    }
    return StepSearch(best["step"], best["error"], report)


def _rounds(
    caster: RayCaster,
    views: PlanningViews,
    tolerance: float,
    progress: Callable[[int, int], None] | None,
) -> list[dict[str, float]]:
    """Steps that were tried in turn, with their errors; the caster begins with the longest."""
    rounds: list[dict[str, float]] = []
    step = LONGEST
    while True:
        error = _error(caster, views)
        rounds.append({"step": step, "error": error})
        if progress is not None:
            progress(len(rounds), ROUNDS)
        if error <= tolerance or step <= SHORTEST or len(rounds) == ROUNDS:
            return rounds
        share = math.sqrt(AIM * tolerance / error)
        step = max(step * min(max(share, LEAST_SHARE), LARGEST_SHARE), SHORTEST)
        caster.set_step(step)


def _error(caster: RayCaster, views: PlanningViews) -> float:
    """Error of the ray caster's pictures of the views."""
    size = (views.pixels, views.pixels)
    pictures = [caster.render(camera=camera, size=size).rgba.reshape(-1, 4) for camera in views.cameras]
    return shown_error(views.errors(np.concatenate(pictures)))

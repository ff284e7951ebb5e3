"""How far coarser meshes may be off in a picture that has to keep to a tolerance."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

from isosample.defaults import DEFAULT_SCREEN_ERROR
from isosample.errors import InputError
from isosample.rendering.expected_error import expected_error
from isosample.rendering.settings import RenderSettings, check_size

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence
    from typing import Any

    from isosample.rendering.camera import Camera
    from isosample.rendering.pipeline import Renderer
    from isosample.surfaces.stored_surfaces import StoredSurfaces
    from isosample.surfaces.surface_set import SurfaceSet
    from isosample.transfer.isovalue_plan import IsovaluePlan

LOOKED_AT = 192  # pixels of the longer edge of the pictures whose errors are looked at
HALVINGS = 3
ESTIMATES = ("indicator", "mesh")  # of `expected_error`


def settings_within(
    renderer: Renderer,
    surfaces: SurfaceSet | StoredSurfaces,
    plan: IsovaluePlan,
    *,
    cameras: Sequence[Camera],
    size: tuple[int, int],
    settings: RenderSettings,
    progress: Callable[[int, int], None] | None = None,
) -> RenderSettings:
    """Return settings whose `screen_error` keeps to the tolerance that a plan was made for.

    Parameters
    ----------
    renderer : Renderer
        Of `surfaces` and `plan`.
    surfaces, plan
        Where there are no coarser meshes, no residuals to judge them by, or no tolerance, the settings stay as they
        are.
    cameras, size, settings, progress
        As for `screen_error_within`.
    """
    if not (plan.report and surfaces.details and surfaces.settings.residuals):
        return settings
    allowed = screen_error_within(renderer, plan.report, cameras, size, settings, progress)
    return replace(settings, screen_error=allowed)


def screen_error_within(
    renderer: Renderer,
    report: Mapping[str, Any],
    cameras: Sequence[Camera],
    size: tuple[int, int],
    settings: RenderSettings | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> float:
    """Return the `screen_error` at which pictures keep to a tolerance.

    Parameters
    ----------
    renderer : Renderer
        Of surfaces with details and residuals.
    report : mapping
        Of the plan that was made for the tolerance (`IsovaluePlan.report`).
    cameras : sequence of Camera
        Views to look at, at least one; others are not known.
    size : (width, height)
        Of the pictures; those that are looked at are smaller, with the same details.
    settings : RenderSettings, optional
    progress : callable, optional
        Called with pictures looked at and the most there may be.

    Returns
    -------
    screen_error : float
        The default, or a half, quarter or eighth of it, the largest with which no view's expected error exceeds the
        tolerance (see `expected_error`). An estimate that was 0 for the plan may grow from what it is in the finest
        picture of the same view, and not at all from 0. 0 if nothing coarser keeps to the tolerance, or the plan
        itself missed it.

    Raises
    ------
    InputError
        If there is no camera, or the surfaces were extracted without residuals.

    Notes
    -----
    No estimate sees silhouettes, of the finest meshes or of coarser ones: where a ray passes an isosurface's outline
    on the other side than the mesh's, the picture errs by more. Coarser meshes move outlines by about `screen_error`
    pixels at most.
    """
    width, height = check_size(size)
    if not len(cameras):
        raise InputError("cameras is empty; give at least one view to look at.")
    if report["missed"] is not None:
        return 0.0
    scale = min(1.0, LOOKED_AT / max(width, height))
    small = max(1, round(scale * width)), max(1, round(scale * height))
    settings = settings or RenderSettings()
    unknown = [name for name in ESTIMATES if not report["estimates"][name] > 0.0]
    most, done = len(cameras) * (HALVINGS + 1 + bool(unknown)), 0

    def looked_at(camera: Camera, screen_error: float) -> dict[str, float]:
        nonlocal done
        scaled = replace(settings, screen_error=scale * screen_error)
        found = renderer.error_map(camera=camera, size=small, settings=scaled).percentiles()
        done += 1
        if progress is not None:
            progress(done, most)
        return found

    reports = [
        _completed(report, looked_at(camera, 0.0), unknown) if unknown else report for camera in cameras
    ]
    allowed = 0.0
    for halvings in range(HALVINGS + 1):
        tried = DEFAULT_SCREEN_ERROR / 2**halvings
        errors = (
            _error(looked_at(camera, tried), known) for camera, known in zip(cameras, reports, strict=True)
        )
        if all(error <= report["tolerance"] for error in errors):
            allowed = tried
            break
    if progress is not None:
        progress(most, most)
    return allowed


def _completed(
    report: Mapping[str, Any], finest: Mapping[str, float], unknown: Sequence[str]
) -> Mapping[str, Any]:
    """The report with what a view's finest picture tells of the estimates that were 0 for the plan."""
    return {**report, "estimates": {**report["estimates"], **{name: finest[name] for name in unknown}}}


def _error(found: Mapping[str, float], report: Mapping[str, Any]) -> float:
    """Error that a thousandth of a view's pixels are expected to exceed; infinite where an estimate grew from 0."""
    known = report["estimates"]
    if any(found[name] > 0.0 and not known[name] > 0.0 for name in ESTIMATES):
        return math.inf
    return expected_error(found, report)

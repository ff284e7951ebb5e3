"""How far coarser meshes may be off in a picture that has to keep to a tolerance."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from isosample.defaults import DEFAULT_SCREEN_ERROR
from isosample.rendering.settings import RenderSettings, check_size
from isosample.rendering.tolerance import expected_error

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from typing import Any

    from isosample.rendering.camera import Camera
    from isosample.rendering.pipeline import Renderer

LOOKED_AT = 192  # pixels of the longer edge of the pictures whose errors are looked at
HALVINGS = 3


def screen_error_within(
    renderer: Renderer,
    report: Mapping[str, Any],
    cameras: Sequence[Camera],
    size: tuple[int, int],
    settings: RenderSettings | None = None,
) -> float:
    """Return the `screen_error` at which pictures keep to a tolerance.

    Parameters
    ----------
    renderer : Renderer
        Of surfaces with details and residuals.
    report : mapping
        Of the plan that was made for the tolerance (`IsovaluePlan.report`).
    cameras : sequence of Camera
        Views to look at; others are not known.
    size : (width, height)
        Of the pictures; those that are looked at are smaller, with the same details.
    settings : RenderSettings, optional

    Returns
    -------
    screen_error : float
        The default, or a half, quarter or eighth of it, the largest with which no view's expected error exceeds the
        tolerance (see `expected_error`); 0 if all do.

    Raises
    ------
    InputError
        If the surfaces were extracted without residuals.
    """
    width, height = check_size(size)
    scale = min(1.0, LOOKED_AT / max(width, height))
    small = max(1, round(scale * width)), max(1, round(scale * height))
    settings = settings or RenderSettings()

    def error_at(screen_error: float) -> float:
        scaled = replace(settings, screen_error=scale * screen_error)
        maps = (
            renderer.error_map(camera=camera, size=small, settings=scaled).percentiles() for camera in cameras
        )
        return max(expected_error(found, report) for found in maps)

    tried = (DEFAULT_SCREEN_ERROR / 2**halvings for halvings in range(HALVINGS + 1))
    return next((one for one in tried if error_at(one) <= report["tolerance"]), 0.0)

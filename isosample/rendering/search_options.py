"""What a search for a tolerance is given, checked before its long work."""

from __future__ import annotations

from typing import TYPE_CHECKING, cast

import numpy as np

from isosample.defaults import SMALLEST_ERROR
from isosample.errors import InputError
from isosample.rendering.camera import Camera
from isosample.rendering.planning_views import orbit_views
from isosample.surfaces.settings import REFINEMENTS

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from isosample.volume.geometry import Box


def check_tolerance(tolerance: object) -> None:
    """Raise `InputError` unless a tolerance can be searched for."""
    number = isinstance(tolerance, (int, float, np.floating)) and not isinstance(tolerance, bool)
    if not number or not SMALLEST_ERROR <= cast("float", tolerance) <= 1:
        raise InputError(
            f"tolerance {tolerance!r} must be a number from {SMALLEST_ERROR:g} to 1, for instance 1/256."
        )


def check_limits(max_refine: object, counts: Mapping[str, tuple[object, int]]) -> None:
    """Raise `InputError` for a limit out of range; `counts` are whole numbers and the least each may be."""
    for name, (count, least) in counts.items():
        if isinstance(count, bool) or not isinstance(count, (int, np.integer)) or count < least:
            raise InputError(f"{name} {count!r} must be a whole number >= {least}.")
    if isinstance(max_refine, bool) or max_refine not in REFINEMENTS:
        raise InputError(f"max_refine {max_refine!r} must be one of {REFINEMENTS}.")


def views_to_try(box: Box, views: Sequence[Camera] | None) -> tuple[Camera, ...]:
    """Return the cameras given, checked, or the default views of a box for None.

    Raises
    ------
    InputError
        If there are none, or something else is among them.
    """
    if views is None:
        return orbit_views(box)
    if not len(views):
        raise InputError("views is empty; give at least one camera, or None for views from all sides.")
    for i, camera in enumerate(views):
        if not isinstance(camera, Camera):
            raise InputError(f"views[{i}] is {camera!r}; expected a Camera.")
    return tuple(views)

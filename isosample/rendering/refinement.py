"""How finely meshes are refined that are to be near enough to their isosurfaces."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, TypeVar

from isosample.defaults import AUTO_DISTANCE, DEFAULT_MAX_TRIANGLES
from isosample.rendering.quality import mesh_distance
from isosample.surfaces.settings import LARGEST_GROWTH, REFINEMENTS

if TYPE_CHECKING:
    from collections.abc import Callable

    from isosample.surfaces.settings import ExtractionSettings
    from isosample.surfaces.stored_surfaces import StoredSurfaces
    from isosample.surfaces.surface_set import SurfaceSet

    Surfaces = TypeVar("Surfaces", SurfaceSet, StoredSurfaces)


def refined_enough(
    extract: Callable[[ExtractionSettings], Surfaces], settings: ExtractionSettings
) -> tuple[Surfaces, float]:
    """Return surfaces within `AUTO_DISTANCE` of the isosurfaces, or the finest that may be had, and their distance.

    Parameters
    ----------
    extract : callable
        Surfaces in memory or in a store, with settings.
    settings : ExtractionSettings
        All but `refine`, which is tried in turn, and `residuals`, which are needed.

    Returns
    -------
    surfaces : SurfaceSet or StoredSurfaces
        The first that are near enough; else the finest, or those after which the next might have more than
        `DEFAULT_MAX_TRIANGLES` triangles.
    distance : float
        Largest rms distance of a level from its isosurface [voxel].
    """
    for refine in REFINEMENTS:
        surfaces = extract(replace(settings, refine=refine, residuals=True))
        distance = mesh_distance(surfaces)
        largest_next = LARGEST_GROWTH * sum(surfaces.statistics.triangles)
        if distance <= AUTO_DISTANCE or largest_next > DEFAULT_MAX_TRIANGLES:
            break
    return surfaces, distance

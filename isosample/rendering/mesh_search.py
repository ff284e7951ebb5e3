"""How finely meshes must be refined for a tolerance: pictures of the views, until they show the truth."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from isosample.rendering.pipeline import Renderer
from isosample.rendering.planning_views import reached
from isosample.rendering.settings import RenderSettings, SegmentRule
from isosample.surfaces.extract import extract_surfaces
from isosample.surfaces.settings import LARGEST_GROWTH, REFINEMENTS

if TYPE_CHECKING:
    from collections.abc import Callable

    import numpy.typing as npt

    from isosample.rendering.planning_views import PlanningViews
    from isosample.surfaces.settings import ExtractionSettings
    from isosample.surfaces.surface_set import SurfaceSet
    from isosample.transfer.isovalue_plan import IsovaluePlan
    from isosample.volume.grid import Volume

LEAST_GAIN = (
    0.9  # a refinement that leaves more than this of the error and of the pixels above the tolerance did
)
# not help, and no further one will
MARGIN = 0.7  # share of the tolerance that the views are to keep to, so that other views keep to all of it
SMALL_SHARE = (
    1.3  # where the picture errs by less than this many times the exact crossings, finer meshes cannot help
)
DOMINANT = 2.0  # the mesh dominates where the picture errs by more than this many times the exact crossings


@dataclass(frozen=True, slots=True)
class MeshSearch:
    """A refinement, the error of its pictures, and how it was found.

    Attributes
    ----------
    refine : int
    surfaces : SurfaceSet
    error : float
        What a thousandth of the pixels exceed.
    missed : str or None
        None where the tolerance is reached, else "isovalues" or "mesh".
    reason : str
        Why the mesh is not refined further, in words.
    rounds : list of dict
        ``refine``, ``triangles``, ``error`` and ``above`` (share of the pixels above the tolerance) of every
        refinement that was tried, JSON-ready.
    limited : bool
        Whether the number of triangles ended the search.
    """

    refine: int
    surfaces: SurfaceSet
    error: float
    missed: str | None
    reason: str
    rounds: list[dict[str, Any]]
    limited: bool = False


def search_mesh(
    volume: Volume,
    plan: IsovaluePlan,
    views: PlanningViews,
    settings: ExtractionSettings,
    *,
    tolerance: float,
    exact_error: float,
    max_refine: int,
    max_triangles: int,
    progress: Callable[[int, int], None] | None = None,
) -> MeshSearch:
    """Refine the meshes of a plan until the pictures of the views are within the tolerance.

    Parameters
    ----------
    volume : Volume
    plan : IsovaluePlan
    views : PlanningViews
    settings : ExtractionSettings
        Reconstruction, treatment of samples that are not finite, and whether residuals are measured.
    tolerance : float
        Largest error for all but a thousandth of the pixels.
    exact_error : float
        What the same plan leaves with exact crossings.
    max_refine, max_triangles : int
        Limits of the refinement; triangles are predicted from the growth so far, fourfold at first.
    progress : callable, optional
        Called with the refinements tried and those possible.

    Notes
    -----
    Of the refinements that were tried, the one with the smallest error is taken; the search ends at the first
    that is within 0.7 of the tolerance, or that errs hardly more than exact crossings.
    """
    rounds: list[dict[str, Any]] = []
    best: tuple[float, int, SurfaceSet] | None = None
    limited = False
    possible = [refine for refine in REFINEMENTS if refine <= max_refine]
    reason = f"refine {max_refine} is the limit"
    for done, refine in enumerate(possible, start=1):
        if done > 1 and (stop := _no_further(rounds, max_triangles)):
            reason, limited = stop, "triangles" in stop
            break
        surfaces = extract_surfaces(
            volume,
            plan.isovalues,
            nan_masked=settings.nan_masked,
            reconstruction=settings.reconstruction,
            refine=refine,
            residuals=settings.residuals,
        )
        errors = views.errors(_pictures(surfaces, plan, views))
        error, triangles = reached(errors), sum(surfaces.statistics.triangles)
        above = float(np.mean(errors > tolerance))
        rounds.append({"refine": refine, "triangles": triangles, "error": error, "above": above})
        if best is None or error < best[0]:
            best = (error, refine, surfaces)
        if progress is not None:
            progress(done, len(possible))
        if error <= max(MARGIN * tolerance, SMALL_SHARE * exact_error):
            reason = "its error is no longer the larger part"
            break
    assert best is not None
    missed = None if best[0] <= tolerance else "mesh" if best[0] > DOMINANT * exact_error else "isovalues"
    return MeshSearch(best[1], best[2], best[0], missed, reason, rounds, limited)


def _no_further(rounds: list[dict[str, Any]], max_triangles: int) -> str:
    """Why a further refinement is not tried; empty where it is."""
    last = rounds[-1]
    growth = float(LARGEST_GROWTH)
    if len(rounds) > 1:
        growth = min(growth, last["triangles"] / max(rounds[-2]["triangles"], 1))
        if all(last[measure] > LEAST_GAIN * rounds[-2][measure] for measure in ("error", "above")):
            return f"refining from {rounds[-2]['refine']} to {last['refine']} did not help"
    predicted = int(growth * last["triangles"])
    if predicted > max_triangles:
        return f"a finer one could have {predicted} triangles, more than {max_triangles}"
    return ""


def _pictures(surfaces: SurfaceSet, plan: IsovaluePlan, views: PlanningViews) -> npt.NDArray[np.float32]:
    """(N, 4) float32, the views as the GPU draws them."""
    settings = RenderSettings(segment=SegmentRule.CUBIC)
    size = (views.pixels, views.pixels)
    with Renderer(surfaces, plan) as renderer:
        images = [renderer.render(camera=c, size=size, settings=settings) for c in views.cameras]
    return np.concatenate([image.rgba.reshape(-1, 4) for image in images])

"""How finely meshes must be refined for a tolerance: pictures of the views, until they show the truth."""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from isosample.rendering.pipeline import Renderer
from isosample.rendering.settings import RenderSettings, SegmentRule
from isosample.rendering.shown_error import shown_error
from isosample.surfaces.extract import extract_surfaces
from isosample.surfaces.settings import LARGEST_GROWTH, LEAST_FLATNESS, REFINEMENTS
from isosample.surfaces.surface_set import count_per_level

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    import numpy.typing as npt

    from isosample.rendering.planning_views import PlanningViews
    from isosample.rendering.settings import Material
    from isosample.surfaces.mesh import BrickMesh
    from isosample.surfaces.settings import ExtractionSettings
    from isosample.surfaces.surface_set import SurfaceSet
    from isosample.transfer.isovalue_plan import IsovaluePlan
    from isosample.volume.grid import Volume

# A refinement that leaves more than this of the error and of the pixels above the tolerance did not help, and no
# further one will; unless hardly an edge was long enough to be divided, so that there are fewer triangles than so many
# times those before: that says nothing of the next one.
LEAST_GAIN, TELLING_GROWTH = 0.9, 1.2
MARGIN = 0.7  # share of the tolerance that the views are to keep to, so that other views keep to all of it
# Where the picture errs by less than this many times the exact crossings, finer meshes cannot help.
SMALL_SHARE = 1.3
MORE_STEPS = 2  # with half the flatness each, after the largest refinement
DOMINANT = 2.0  # the mesh dominates where the picture errs by more than this many times the exact crossings


class Stop(NamedTuple):
    """Why a mesh is not refined further, in words, and whether for the number of its triangles."""

    reason: str
    too_many_triangles: bool = False


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
    stop : Stop
        Why the mesh is not refined further.
    rounds : list of dict
        ``refine``, ``flatness``, ``triangles``, ``error`` and ``above`` (share of the pixels above the tolerance) of
        every refinement that was tried, JSON-ready.
    """

    refine: int
    surfaces: SurfaceSet
    error: float
    missed: str | None
    stop: Stop
    rounds: list[dict[str, Any]]


class Step(NamedTuple):
    """How finely a mesh is refined, and edges nearer to the isosurface than what [voxel] are not divided."""

    refine: int
    flatness: float


def steps_of_search(max_refine: int, flatness: float) -> list[Step]:
    """Refinements in the order in which they are tried: each has about twice the triangles of the one before.

    At refine 4 the flatness is that given [voxel], and half or twice as much one step after or before; where an edge
    can be divided no more often, smaller ones go on.
    """
    possible = [refine for refine in REFINEMENTS if refine <= max_refine]
    more = [max_refine] * (MORE_STEPS if max_refine > 1 else 0)
    return [
        Step(refine, max(flatness * 2.0 ** (3 - number), LEAST_FLATNESS))
        for number, refine in enumerate([*possible, *more], start=1)
    ]


class KnownMeshes:
    """Isosurfaces of a volume, each extracted once: one search after another comes back to the same isovalues.

    Parameters
    ----------
    volume : Volume
    settings : ExtractionSettings
        All but the refinement and its flatness.
    """

    def __init__(self, volume: Volume, settings: ExtractionSettings) -> None:
        self._volume = volume
        self._settings = settings
        self._known: dict[tuple[float, Step], list[BrickMesh]] = {}

    def surfaces(self, isovalues: npt.NDArray[np.float64], step: Step) -> SurfaceSet:
        """Isosurfaces at isovalues (K,), as `extract_surfaces` gives them; other isovalues are forgotten."""
        wanted = isovalues.tolist()
        missing = [value for value in wanted if (value, step) not in self._known]
        settings = replace(self._settings, refine=step.refine, flatness=step.flatness)
        found = extract_surfaces(self._volume, missing, **settings.as_keywords())
        kept = set(wanted)
        self._known = {key: pieces for key, pieces in self._known.items() if key[0] in kept}
        self._known |= {(value, step): [] for value in missing}
        for piece in found.meshes:
            self._known[piece.isovalue, step].append(piece)
        meshes = tuple(piece for value in wanted for piece in self._known[value, step])
        statistics = replace(
            found.statistics,
            triangles=count_per_level(isovalues, meshes, "triangles"),
            vertices=count_per_level(isovalues, meshes, "positions"),
            levels_reused=len(wanted) - len(missing),
        )
        return replace(found, isovalues=isovalues, meshes=meshes, statistics=statistics)


def search_mesh(
    known: KnownMeshes,
    plan: IsovaluePlan,
    views: PlanningViews,
    *,
    tolerance: float,
    exact_error: float,
    steps: Sequence[Step],
    max_triangles: int,
    progress: Callable[[int, int], None] | None = None,
) -> MeshSearch:
    """Refine the meshes of a plan until the pictures of the views are within the tolerance.

    Parameters
    ----------
    known : KnownMeshes
        Extracts what it does not have.
    plan : IsovaluePlan
    views : PlanningViews
    tolerance : float
        Largest error for all but a thousandth of the pixels.
    exact_error : float
        What the same plan leaves with exact crossings.
    steps : sequence of Step
        To be tried in turn.
    max_triangles : int
        Limit of the refinement; triangles are predicted from the growth so far, fourfold at first.
    progress : callable, optional
        Called with the refinements tried and those possible.

    Notes
    -----
    Of the refinements that were tried, the one with the smallest error is taken; the search ends at the first
    that is within 0.7 of the tolerance, or that errs hardly more than exact crossings.
    """
    rounds: list[dict[str, Any]] = []
    best: tuple[float, int, SurfaceSet] | None = None
    stop = Stop(f"refine {steps[-1].refine} is the limit")
    for done, step in enumerate(steps, start=1):
        if done > 1 and (found := _no_further(rounds, max_triangles)) is not None:
            stop = found
            break
        surfaces = known.surfaces(plan.isovalues, step)
        errors = views.errors(pictures_of(surfaces, plan, views))
        error, triangles = shown_error(errors), sum(surfaces.statistics.triangles)
        above = float(np.mean(errors > tolerance))
        rounds.append({**step._asdict(), "triangles": triangles, "error": error, "above": above})
        if best is None or error < best[0]:
            best = (error, step.refine, surfaces)
        if progress is not None:
            progress(done, len(steps))
        if error <= max(MARGIN * tolerance, SMALL_SHARE * exact_error):
            stop = Stop("its error is no longer the larger part")
            break
    assert best is not None
    missed = None if best[0] <= tolerance else "mesh" if best[0] > DOMINANT * exact_error else "isovalues"
    return MeshSearch(best[1], best[2], best[0], missed, stop, rounds)


def _no_further(rounds: list[dict[str, Any]], max_triangles: int) -> Stop | None:
    """Why a further refinement is not tried; None where it is."""
    last = rounds[-1]
    growth = _next_growth([entry["triangles"] for entry in rounds])
    coarser = [entry for entry in rounds[:-1] if last["triangles"] >= TELLING_GROWTH * entry["triangles"]]
    if coarser and all(last[part] > LEAST_GAIN * coarser[-1][part] for part in ("error", "above")):
        return Stop(f"refining from {_named(coarser[-1])} to {_named(last)} did not help")
    predicted = int(growth * last["triangles"])
    if predicted > max_triangles:
        told = f"a finer one could have {predicted} triangles, more than {max_triangles}"
        return Stop(told, too_many_triangles=True)
    return None


def _named(entry: dict[str, Any]) -> str:
    """What a round was: several have the same refinement, and another flatness."""
    flatness = f", flatness {entry['flatness']:.3g}" if entry["refine"] > 1 else ""
    return f"refine {entry['refine']}{flatness}"


def _next_growth(triangles: list[int]) -> float:
    """By how much the next refinement is expected to multiply the triangles.

    Ever fewer edges are left that are not flat enough: what a round adds shrinks about as it did the last time.
    """
    growth = [float(LARGEST_GROWTH)]
    growth += [min(LARGEST_GROWTH, b / max(a, 1)) for a, b in itertools.pairwise(triangles)]
    if len(growth) > 2 and growth[-2] > 1.0:
        return 1.0 + (growth[-1] - 1.0) * min((growth[-1] - 1.0) / (growth[-2] - 1.0), 1.0)
    return growth[-1]


def pictures_of(
    surfaces: SurfaceSet, plan: IsovaluePlan, views: PlanningViews, material: Material | None = None
) -> npt.NDArray[np.float32]:
    """(N, 4) float32, the views as the GPU draws them."""
    settings = RenderSettings(segment=SegmentRule.CUBIC, material=material)
    size = (views.pixels, views.pixels)
    with Renderer(surfaces, plan) as renderer:
        images = [renderer.render(camera=c, size=size, settings=settings) for c in views.cameras]
    return np.concatenate([image.rgba.reshape(-1, 4) for image in images])

"""A plan for a tolerance: as many isovalues and as fine a mesh as the picture needs, found by trying."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from isosample.defaults import DEFAULT_MAX_ISOVALUES, DEFAULT_MAX_TRIANGLES, SHOWN_QUANTILE, SMALLEST_ERROR
from isosample.errors import InputError
from isosample.gl.context import shared_context
from isosample.rendering.camera import Camera
from isosample.rendering.error_map import PANELS, ErrorMap
from isosample.rendering.isovalue_search import search_isovalues
from isosample.rendering.mesh_search import KnownMeshes, Stop, search_mesh, steps_of_search
from isosample.rendering.picture_lists import least_sheet_slope
from isosample.rendering.pipeline import Renderer
from isosample.rendering.planning_views import PlanningViews, orbit_views
from isosample.rendering.quality import shares_for_light
from isosample.surfaces.settings import REFINEMENTS, ExtractionSettings, check_volume
from isosample.volume.reconstruction import GridSpline, Reconstruction
from isosample.volume.statistics import gradient_at_values

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from isosample.rendering.isovalue_search import IsovalueSearch
    from isosample.rendering.mesh_search import MeshSearch
    from isosample.surfaces.surface_set import SurfaceSet
    from isosample.transfer.isovalue_plan import IsovaluePlan
    from isosample.transfer.sheets import Gradients
    from isosample.transfer.transfer_function import TransferFunction
    from isosample.volume.grid import Volume

    Progress = Callable[[str, int, int], None]

SAFETY = 0.5  # share of the tolerance for the isovalues; the rest is the mesh's
LOOSENED = (
    1.0,
    2.0,
    4.0,
    8.0,
)  # targets for the isovalues, tried in turn while the triangles limit the refinement
DEFAULT_PIXELS = 48
FLATNESS_RANGE = (1e-4, 0.05)  # of meshes at refine 4 [voxel]; between these it is the tolerance itself


@dataclass(frozen=True, slots=True, eq=False)
class TolerancePlan:
    """What a tolerance needs.

    Attributes
    ----------
    plan : IsovaluePlan
        Its `report` is the same as this one's.
    refine : int
        Into how many pieces an edge of the mesh is divided, for `extract_surfaces`.
    surfaces : SurfaceSet
        The meshes of this plan and refinement.
    report : dict
        JSON-ready: ``tolerance``, ``reached`` (the error that a thousandth of the planning pixels exceed),
        ``missed`` (None; "isovalues" or "mesh" where the tolerance is not reached, and what it failed on),
        ``reason`` in words, ``reconstruction``, ``refine``, ``flatness`` [voxel], ``views``, ``pixels``, ``quantile``,
        ``rounds`` (isovalues and error by exact crossings) and ``refinements`` (refine, flatness, triangles, error of
        the pictures and ``above``, their share of pixels above the tolerance).
    """

    plan: IsovaluePlan
    refine: int
    surfaces: SurfaceSet
    report: dict[str, Any]

    @property
    def missed(self) -> str | None:
        """None where the tolerance is reached, else "isovalues" or "mesh"."""
        missed: str | None = self.report["missed"]
        return missed

    @property
    def reached(self) -> float:
        """Error that a thousandth of the planning pixels exceed."""
        return float(self.report["reached"])


def plan_for_tolerance(
    volume: Volume,
    transfer_function: TransferFunction,
    tolerance: float,
    *,
    reconstruction: Reconstruction = Reconstruction.TRILINEAR,
    views: Sequence[Camera] | None = None,
    pixels: int = DEFAULT_PIXELS,
    max_isovalues: int = DEFAULT_MAX_ISOVALUES,
    max_refine: int = REFINEMENTS[-1],
    max_triangles: int = DEFAULT_MAX_TRIANGLES,
    nan_masked: bool = False,
    lit: bool = False,
    progress: Progress | None = None,
) -> TolerancePlan:
    """Return isovalues and a refinement of their meshes such that pictures are within a tolerance.

    Parameters
    ----------
    volume : Volume
    transfer_function : TransferFunction
    tolerance : float
        Largest error of a component of a pixel (premultiplied linear RGBA), for all but a thousandth of the
        pixels; 1e-5 to 1.
    reconstruction : Reconstruction
        The field between the samples: what is true.
    views : sequence of Camera, optional
        Views to try; by default four from all sides. The report has them.
    pixels : int
        Width and height of the pictures of the views, >= 8.
    max_isovalues : int
        Isovalues at most, unless the control points alone are more; >= 1.
    max_refine : int
        Refinement at most: 1, 2, 4 or 8.
    max_triangles : int
        A refinement that would exceed so many triangles is not tried, >= 1.
    nan_masked : bool
        Leave out the cells that touch a NaN or infinite sample; otherwise such samples are an error.
    lit : bool
        Whether pictures will be lit: slopes of constant extinction and colour are then given isovalues too. What is
        reached is measured without light all the same, as the reference has none.
    progress : callable, optional
        Called with the stage ("truth", "isovalues", "refine"), steps done and steps in all.

    Returns
    -------
    found : TolerancePlan
        Where the tolerance cannot be reached within the limits, the best that was found, and what it failed on.

    Raises
    ------
    InputError
        If the volume cannot be rendered, or an option is out of range.
    OpenGLError
        If there is no usable OpenGL.

    Notes
    -----
    First the isovalues: with exact crossings the picture is to err by half the tolerance at most
    (`search_isovalues`). Then the mesh: it is refined until the pictures that the GPU draws are within the
    tolerance (`search_mesh`). Isosurfaces of the transfer function and sheets are kept as they are.

    The error is measured on the views, against the reference integral of the same reconstruction. Other views
    are not proven to be within the tolerance: the margin of the isovalues is what they have. Views of one
    picture should be given where that one alone counts.
    """
    least = {"pixels": (pixels, 8), "max_isovalues": (max_isovalues, 1), "max_triangles": (max_triangles, 1)}
    _check(tolerance, max_refine, least)
    settings = ExtractionSettings(
        nan_masked=nan_masked,
        reconstruction=reconstruction,
        residuals=True,
        flatness=float(np.clip(tolerance, *FLATNESS_RANGE)),
    )
    check_volume(volume, settings)
    cameras = orbit_views(volume.box) if views is None else tuple(views)
    _check_views(cameras)
    shared_context()  # a missing driver is told before the long work
    tried = PlanningViews.trace(
        volume,
        transfer_function,
        cameras,
        pixels,
        tolerance=tolerance,
        reconstruction=reconstruction,
        progress=_stage(progress, "truth"),
    )
    isovalues, meshes = _search(
        volume,
        transfer_function,
        tried,
        settings,
        (tolerance, max_isovalues, max_refine, max_triangles),
        progress,
        lit=lit,
    )
    report = {
        "tolerance": tolerance,
        "reached": meshes.error,
        "missed": meshes.missed,
        "reason": _reason(isovalues, meshes, max_isovalues),
        "reconstruction": reconstruction.value,
        "refine": meshes.refine,
        "flatness": meshes.surfaces.settings.flatness,
        "views": tried.describe(),
        "pixels": pixels,
        "quantile": SHOWN_QUANTILE,
        "rounds": isovalues.rounds,
        "refinements": meshes.rounds,
        "estimates": _estimates(meshes.surfaces, isovalues.plan, tried),
    }
    plan = dataclasses.replace(isovalues.plan, report=report)
    return TolerancePlan(plan, meshes.refine, meshes.surfaces, report)


def _search(
    volume: Volume,
    transfer_function: TransferFunction,
    views: PlanningViews,
    settings: ExtractionSettings,
    limits: tuple[float, int, int, int],
    progress: Progress | None,
    *,
    lit: bool,
) -> tuple[IsovalueSearch, MeshSearch]:
    """Isovalues and meshes; fewer isovalues where their triangles leave no room for the refinement that is needed."""
    tolerance, max_isovalues, max_refine, max_triangles = limits
    best: tuple[IsovalueSearch, MeshSearch] | None = None
    known = KnownMeshes(volume, settings)
    for looser in LOOSENED:
        if best is not None and SAFETY * looser * tolerance >= best[1].error:
            break  # exact crossings may then err as much as the meshes that are there
        isovalues = _search_isovalues(
            volume,
            transfer_function,
            views,
            SAFETY * looser * tolerance,
            settings.reconstruction,
            max_isovalues,
            progress,
            lit=lit,
        )
        meshes = search_mesh(
            known,
            isovalues.plan,
            views,
            tolerance=tolerance,
            exact_error=isovalues.error,
            steps=steps_of_search(max_refine, settings.flatness),
            max_triangles=max_triangles,
            progress=_stage(progress, "refine"),
        )
        if best is None or meshes.error < best[1].error:
            best = (isovalues, meshes)
        if not (meshes.missed == "mesh" and meshes.stop.too_many_triangles):
            break
    assert best is not None
    isovalues, meshes = best
    if meshes.missed and looser > 1.0:
        told = (
            f"meshes of more isovalues, refined as they need, would have more than {max_triangles} triangles"
        )
        meshes = dataclasses.replace(meshes, missed="mesh", stop=Stop(told, too_many_triangles=True))
    return isovalues, meshes


def expected_error(estimates: Mapping[str, float], report: Mapping[str, Any]) -> float:
    """Error that a thousandth of a view's pixels are expected to exceed.

    Parameters
    ----------
    estimates : mapping
        `ErrorMap.percentiles` of the view.
    report : mapping
        Of the plan.

    Returns
    -------
    error : float
        What was reached on the views of the plan, times the larger of the ratios by which the indicator and the
        estimate of the mesh's error are larger here than there (1 at least); one that was 0 there is left out.
        Neither promises anything, and neither sees silhouettes.
    """
    known = report["estimates"]
    ratios = [estimates[name] / known[name] for name in ("indicator", "mesh") if known[name] > 0.0]
    return float(report["reached"] * max([1.0, *ratios]))


def _estimates(surfaces: SurfaceSet, plan: IsovaluePlan, views: PlanningViews) -> dict[str, float]:
    """Percentiles of the error maps of all views together."""
    with Renderer(surfaces, plan) as renderer:
        maps = [renderer.error_map(camera=c, size=(views.pixels, views.pixels)) for c in views.cameras]
    together = ErrorMap(*(np.stack([getattr(m, name) for m in maps]) for name in PANELS))
    return together.percentiles()


def _search_isovalues(
    volume: Volume,
    transfer_function: TransferFunction,
    views: PlanningViews,
    target: float,
    reconstruction: Reconstruction,
    max_isovalues: int,
    progress: Progress | None,
    *,
    lit: bool,
) -> IsovalueSearch:
    """Isovalues for exact crossings of the volume's own field."""
    from isosample.integral.grid_crossings import grid_crossings

    smooth = reconstruction.smooth
    low, high = GridSpline.build(volume, reconstruction).value_range if smooth else volume.value_range
    origins, directions = views.rays
    return search_isovalues(
        views,
        transfer_function,
        (low, high),
        lambda values: grid_crossings(volume, values, origins, directions, reconstruction=reconstruction),
        target=target,
        max_isovalues=max_isovalues,
        gradients=_remembered(partial(gradient_at_values, volume)),
        least_slope=least_sheet_slope((low, high), volume.box),
        lit=lit,
        shares=shares_for_light(volume, transfer_function) if lit else None,
        progress=_stage(progress, "isovalues"),
    )


def _reason(isovalues: IsovalueSearch, meshes: MeshSearch, max_isovalues: int) -> str:
    """Why the search ended, in words."""
    count = len(isovalues.plan.isovalues)
    if meshes.missed is None:
        return f"{count} isovalues and refine {meshes.refine} reach the tolerance on the views"
    if meshes.missed == "mesh":
        return f"the mesh errs more than the tolerance, and {meshes.stop.reason}"
    allowed = count < max_isovalues // 2  # a round doubles their number at most
    limit = "no band can be divided further" if allowed else f"at most {max_isovalues} were allowed"
    return f"{count} isovalues leave an error of {isovalues.error:.3g} with exact crossings; {limit}"


def _remembered(gradients: Gradients) -> Gradients:
    """Gradients that are measured once for every list of values."""
    known: dict[tuple[float, ...], Sequence[float | None]] = {}

    def look_up(values: Sequence[float]) -> Sequence[float | None]:
        key = tuple(values)
        if key not in known:
            known[key] = gradients(values)
        return known[key]

    return look_up


def _check(tolerance: object, max_refine: object, counts: Mapping[str, tuple[object, int]]) -> None:
    """Raise `InputError` for an option out of range; `counts` are whole numbers and the least each may be."""
    number = isinstance(tolerance, (int, float, np.floating)) and not isinstance(tolerance, bool)
    if not number or not SMALLEST_ERROR <= cast("float", tolerance) <= 1:
        raise InputError(
            f"tolerance {tolerance!r} must be a number from {SMALLEST_ERROR:g} to 1, for instance 1/256."
        )
    for name, (count, least) in counts.items():
        if isinstance(count, bool) or not isinstance(count, (int, np.integer)) or count < least:
            raise InputError(f"{name} {count!r} must be a whole number >= {least}.")
    if isinstance(max_refine, bool) or max_refine not in REFINEMENTS:
        raise InputError(f"max_refine {max_refine!r} must be one of {REFINEMENTS}.")


def _check_views(cameras: Sequence[object]) -> None:
    """Raise `InputError` unless there are cameras and nothing else."""
    if not cameras:
        raise InputError("views is empty; give at least one camera, or None for views from all sides.")
    for i, camera in enumerate(cameras):
        if not isinstance(camera, Camera):
            raise InputError(f"views[{i}] is {camera!r}; expected a Camera.")


def _stage(progress: Progress | None, stage: str) -> Callable[[int, int], None] | None:
    return None if progress is None else partial(progress, stage)

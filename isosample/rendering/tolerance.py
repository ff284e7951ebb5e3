"""A plan for a tolerance: as many isovalues and as fine a mesh as the picture needs, found by trying."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from isosample.defaults import DEFAULT_MAX_ISOVALUES, DEFAULT_MAX_TRIANGLES, SHOWN_QUANTILE
from isosample.gl.context import shared_context
from isosample.rendering.error_map import PANELS, ErrorMap
from isosample.rendering.isovalue_search import search_field
from isosample.rendering.mesh_search import KnownMeshes, Stop, pictures_of, search_mesh, steps_of_search
from isosample.rendering.pipeline import Renderer
from isosample.rendering.planning_views import PlanningViews
from isosample.rendering.search_options import check_limits, check_tolerance, views_to_try
from isosample.rendering.settings import Material
from isosample.rendering.shown_error import shown_error
from isosample.rendering.stage_progress import of_stage
from isosample.surfaces.settings import REFINEMENTS, ExtractionSettings, check_volume
from isosample.volume.reconstruction import Reconstruction

if TYPE_CHECKING:
    from collections.abc import Sequence

    from isosample.rendering.camera import Camera
    from isosample.rendering.isovalue_search import IsovalueSearch
    from isosample.rendering.mesh_search import MeshSearch
    from isosample.rendering.stage_progress import Progress
    from isosample.surfaces.surface_set import SurfaceSet
    from isosample.transfer.isovalue_plan import IsovaluePlan
    from isosample.transfer.transfer_function import TransferFunction
    from isosample.volume.grid import Volume

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
        the pictures and ``above``, their share of pixels above the tolerance). Of a plan for light ``lit``: the
        ``material`` (ambient, diffuse, specular, shininess), and ``reached``, the same error of the lit pictures.
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
        reached is measured without light all the same, as exact crossings are integrated without; then the error of
        the lit pictures is measured, too, with the default material.
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
    check_tolerance(tolerance)
    check_limits(max_refine, least)
    settings = ExtractionSettings(
        nan_masked=nan_masked,
        reconstruction=reconstruction,
        residuals=True,
        flatness=float(np.clip(tolerance, *FLATNESS_RANGE)),
    )
    check_volume(volume, settings)
    cameras = views_to_try(volume.box, views)
    shared_context()  # a missing driver is told before the long work
    tried = PlanningViews.trace(
        volume,
        transfer_function,
        cameras,
        pixels,
        tolerance=tolerance,
        reconstruction=reconstruction,
        progress=of_stage(progress, "truth"),
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
    if lit:
        report["lit"] = _lit_error(
            volume, transfer_function, (meshes.surfaces, isovalues.plan), tried, tolerance, reconstruction
        )
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
        isovalues = search_field(
            volume,
            transfer_function,
            views,
            settings.reconstruction,
            target=SAFETY * looser * tolerance,
            max_isovalues=max_isovalues,
            lit=lit,
            progress=of_stage(progress, "isovalues"),
        )
        meshes = search_mesh(
            known,
            isovalues.plan,
            views,
            tolerance=tolerance,
            exact_error=isovalues.error,
            steps=steps_of_search(max_refine, settings.flatness),
            max_triangles=max_triangles,
            progress=of_stage(progress, "refine"),
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


def _estimates(surfaces: SurfaceSet, plan: IsovaluePlan, views: PlanningViews) -> dict[str, float]:
    """Percentiles of the error maps of all views together."""
    with Renderer(surfaces, plan) as renderer:
        maps = [renderer.error_map(camera=c, size=(views.pixels, views.pixels)) for c in views.cameras]
    together = ErrorMap(*(np.stack([getattr(m, name) for m in maps]) for name in PANELS))
    return together.percentiles()


def _lit_error(
    volume: Volume,
    transfer_function: TransferFunction,
    found: tuple[SurfaceSet, IsovaluePlan],
    views: PlanningViews,
    tolerance: float,
    reconstruction: Reconstruction,
) -> dict[str, Any]:
    """What the pictures of the views err with the default material, against the reference with the same."""
    material = Material()
    lit = PlanningViews.trace(
        volume,
        transfer_function,
        views.cameras,
        views.pixels,
        tolerance=tolerance,
        reconstruction=reconstruction,
        material=material,
    )
    errors = lit.errors(pictures_of(*found, lit, material))
    return {"material": list(material.factors), "reached": shown_error(errors)}


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

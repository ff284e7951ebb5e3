"""From a volume and a transfer function to surfaces: as many and as fine as one asks for, or as a tolerance needs."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple

from isosample.defaults import AUTO_DISTANCE, DEFAULT_MAX_ISOVALUES, DEFAULT_MAX_TRIANGLES, DEFAULT_PER_SLOPE
from isosample.errors import InputError
from isosample.surfaces.cache import extract_with_cache
from isosample.surfaces.detail_sets import check_details, with_details
from isosample.surfaces.extract import extract_surfaces
from isosample.surfaces.out_of_core import SurfaceLists, extract_into_store
from isosample.surfaces.settings import LARGEST_GROWTH, REFINEMENTS, ExtractionSettings
from isosample.surfaces.store import MeshStore
from isosample.transfer.isovalues import plan_isovalues
from isosample.volume.reconstruction import GridSpline, Reconstruction
from isosample.volume.statistics import gradient_at_values

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from isosample.surfaces.stored_surfaces import StoredSurfaces
    from isosample.surfaces.surface_set import SurfaceSet
    from isosample.transfer.isovalue_plan import IsovaluePlan
    from isosample.transfer.transfer_function import TransferFunction
    from isosample.volume.grid import Volume
    from isosample.volume.scan import BrickScan

    Progress = Callable[[str, int, int], None]


@dataclass(frozen=True, slots=True, kw_only=True)
class Quality:
    """How many isovalues a picture gets, and how well its meshes follow the field.

    Attributes
    ----------
    per_slope : int or None
        Isovalues inside each visible slope of the transfer function; None: the default, or what the tolerance
        needs.
    tolerance : float or None
        Largest error of a component of a pixel, for all but a thousandth of the pixels; the isovalues and the
        refinement are then searched for. None: `per_slope` decides.
    max_isovalues : int
        At most so many isovalues for a tolerance.
    reconstruction : Reconstruction
        The field between the samples.
    refine : int or None
        Into how many pieces an edge of the mesh may be divided: 1, 2, 4 or 8. None: as many as the meshes need to
        come within 0.01 voxel (rms) of the isosurfaces, or as the tolerance needs.
    curved : bool or None
        Which triangles `refine=None` measures, see `RenderSettings.curved`.
    details : int
        0 to 5: so many coarser details are extracted too, for frames that are rendered again and again; see
        `surfaces.detail`.

    Raises
    ------
    InputError
        If two options contradict each other or one is out of range.
    """

    per_slope: int | None = None
    tolerance: float | None = None
    max_isovalues: int = DEFAULT_MAX_ISOVALUES
    reconstruction: Reconstruction = Reconstruction.TRILINEAR
    refine: int | None = 1
    curved: bool | None = None
    details: int = 0

    def __post_init__(self) -> None:
        if self.tolerance is not None and self.per_slope is not None:
            raise InputError(
                f"per_slope {self.per_slope} and tolerance {self.tolerance:g} both decide about the isovalues; "
                "leave out one of them."
            )
        if self.tolerance is not None and not self.tolerance > 0.0:
            raise InputError(f"tolerance {self.tolerance!r} must be above 0, for instance 1/255.")
        if self.max_isovalues < 1:
            raise InputError(f"max_isovalues {self.max_isovalues!r} must be a whole number >= 1.")
        if self.refine is not None and self.refine not in REFINEMENTS:
            raise InputError(
                f"refine {self.refine!r} must be one of {REFINEMENTS}, or None for as much as is needed."
            )
        check_details(self.details)


class PreparedSurfaces(NamedTuple):
    """Surfaces and the plan they were extracted for.

    Attributes
    ----------
    surfaces : SurfaceSet
    plan : IsovaluePlan
    seconds : dict of str to float
        Of both stages.
    mesh_distance : float or None
        With ``refine=None``: largest rms distance of a level from its isosurface [voxel].
    """

    surfaces: SurfaceSet
    plan: IsovaluePlan
    seconds: dict[str, float]
    mesh_distance: float | None = None


def prepare_surfaces(
    volume: Volume,
    transfer_function: TransferFunction,
    quality: Quality,
    *,
    nan_masked: bool = False,
    residuals: bool = False,
    cache: Path | None = None,
    plain: bool = False,
    budget_bytes: int | None = None,
    progress: Progress | None = None,
) -> PreparedSurfaces:
    """Plan and extract what a picture needs.

    Parameters
    ----------
    volume : Volume
    transfer_function : TransferFunction
    quality : Quality
    nan_masked : bool
        Leave out the cells that touch a NaN or infinite sample; otherwise such samples are an error.
    residuals : bool
        Measure the distance of the meshes from the isosurfaces, for error maps; always done for a tolerance and
        for ``refine=None``.
    cache : path, optional
        Folder whose surfaces of this volume are used again and added to.
    plain, budget_bytes
        As for `extract_with_cache`, where there is a `cache`.
    progress : callable, optional
        Called with the stage, steps done and steps in all.

    Returns
    -------
    prepared : PreparedSurfaces
        The plan has a `report` where a tolerance was asked for.

    Raises
    ------
    InputError, CacheError
        As `extract_with_cache`, `plan_isovalues` and `plan_for_tolerance`.
    OpenGLError
        If a tolerance is asked for and there is no usable OpenGL.
    """
    start = time.perf_counter()
    if quality.tolerance is not None:
        found = _for_tolerance(
            volume,
            transfer_function,
            quality,
            nan_masked,
            progress,
            cache=cache,
            plain=plain,
            budget_bytes=budget_bytes,
        )
        return _with_details(found, volume, quality.details, _Cache(cache, plain), progress)
    plan = plan_for(volume, transfer_function, quality)
    planned = time.perf_counter()
    refine, distance = quality.refine, None
    options: dict[str, Any] = {"nan_masked": nan_masked, "reconstruction": quality.reconstruction}
    options |= _told(progress)
    if refine is None:
        surfaces, distance = _refined_enough(volume, plan, quality, options)
        refine = surfaces.settings.refine
    if cache is not None:
        kept: dict[str, Any] = {"plain": plain, "budget_bytes": budget_bytes}
        surfaces = _extract_into(
            cache, volume, plan.isovalues, refine=refine, residuals=residuals, **options, **kept
        )
    elif distance is None:
        surfaces = extract_surfaces(volume, plan.isovalues, refine=refine, residuals=residuals, **options)
    seconds = {"plan": planned - start, "extract": time.perf_counter() - planned}
    found = PreparedSurfaces(surfaces, plan, seconds, distance)
    return _with_details(found, volume, quality.details, _Cache(cache, plain), progress)


class _Cache(NamedTuple):
    """A cache folder, where there is one, and what kind of chunks are added to it."""

    folder: Path | None
    plain: bool


def _with_details(
    prepared: PreparedSurfaces, volume: Volume, details: int, cache: _Cache, progress: Progress | None
) -> PreparedSurfaces:
    """Add coarser details, from the cache folder where there is one."""
    if details == 0:
        return prepared
    start = time.perf_counter()
    surfaces = prepared.surfaces
    isovalues = prepared.plan.isovalues

    def extracted(detail: int) -> SurfaceSet:
        if detail == 0:
            return surfaces
        options = replace(surfaces.settings, detail=detail).as_keywords() | _told(progress, detail)
        if cache.folder is not None:  # without a budget: it might make room by what the finest needs
            return _extract_into(cache.folder, volume, isovalues, plain=cache.plain, **options)
        return extract_surfaces(volume, isovalues, **options)

    coarser = with_details(extracted, details)
    seconds = prepared.seconds | {"details": time.perf_counter() - start}
    return prepared._replace(surfaces=coarser, seconds=seconds)


def _told(progress: Progress | None, detail: int = 0) -> dict[str, Any]:
    """The progress of one detail's extraction, as a keyword."""
    stage = f"detail {detail}" if detail else "extract"
    return {"progress": None if progress is None else partial(progress, stage)}


def _refined_enough(
    volume: Volume, plan: IsovaluePlan, quality: Quality, options: dict[str, Any]
) -> tuple[SurfaceSet, float]:
    """Surfaces within AUTO_DISTANCE of the isosurfaces, or the finest that may be had; and their distance."""
    for refine in REFINEMENTS:
        surfaces = extract_surfaces(volume, plan.isovalues, refine=refine, residuals=True, **options)
        distance = mesh_distance(surfaces, quality.curved)
        if (
            distance <= AUTO_DISTANCE
            or LARGEST_GROWTH * sum(surfaces.statistics.triangles) > DEFAULT_MAX_TRIANGLES
        ):
            break
    return surfaces, distance


class PreparedInStore(NamedTuple):
    """Surfaces that stay in a store, the plan they were extracted for, and the seconds of both stages."""

    surfaces: StoredSurfaces
    plan: IsovaluePlan
    seconds: dict[str, float]


def prepare_stored_surfaces(
    volume: Volume,
    transfer_function: TransferFunction,
    quality: Quality,
    lists: SurfaceLists,
    *,
    memory: int,
    scan: BrickScan,
    nan_masked: bool = False,
    residuals: bool = False,
    plain: bool = False,
    progress: Progress | None = None,
) -> PreparedInStore:
    """Plan and extract what a picture needs into a cache folder, with a memory budget.

    Parameters
    ----------
    volume, transfer_function, quality, nan_masked, residuals, plain, progress
        As for `prepare_surfaces`.
    lists : SurfaceLists
        Name the cache folder and the volume's content; what its chunks hold is not extracted again.
    memory : int
        Bytes that the whole process may take at its peak.
    scan : BrickScan
        Of this volume, for bricks of the default size.

    Raises
    ------
    InputError
        As `extract_into_store` and `plan_isovalues`; also if a tolerance is asked for, whose search needs surfaces in
        memory.
    CacheError
        If the folder cannot be written.
    """
    if quality.tolerance is not None:
        raise InputError(
            f"tolerance {quality.tolerance:g} is searched for on surfaces in memory, without a budget. Leave out "
            "--memory, or ask for --per-slope."
        )
    start = time.perf_counter()
    scan.tell(volume)
    plan = plan_for(volume, transfer_function, quality)
    planned = time.perf_counter()
    choices = REFINEMENTS if quality.refine is None else (quality.refine,)

    def extracted(refine: int, detail: int = 0) -> StoredSurfaces:
        settings = ExtractionSettings(
            nan_masked=nan_masked,
            reconstruction=quality.reconstruction,
            refine=refine,
            residuals=residuals or quality.refine is None,
            detail=detail,
        )
        store = MeshStore(lists.folder, plain=plain)
        told = _told(progress, detail)
        return extract_into_store(
            volume, plan.isovalues, store, settings=settings, memory=memory, scan=scan, lists=lists, **told
        )

    for refine in choices:
        surfaces = extracted(refine)
        if quality.refine is None and mesh_distance(surfaces, quality.curved) <= AUTO_DISTANCE:
            break
    coarser = with_details(lambda detail: extracted(refine, detail) if detail else surfaces, quality.details)
    return PreparedInStore(coarser, plan, {"plan": planned - start, "extract": time.perf_counter() - planned})


def plan_for(volume: Volume, transfer_function: TransferFunction, quality: Quality) -> IsovaluePlan:
    """Isovalues with so many per slope, of the range that the reconstruction can take."""
    per_slope = DEFAULT_PER_SLOPE if quality.per_slope is None else quality.per_slope
    smooth = quality.reconstruction.smooth
    value_range = (
        GridSpline.build(volume, quality.reconstruction).value_range if smooth else volume.value_range
    )
    return plan_isovalues(
        transfer_function, value_range, per_slope=per_slope, gradients=partial(gradient_at_values, volume)
    )


def mesh_distance(surfaces: SurfaceSet | StoredSurfaces, curved: bool | None) -> float:
    """Largest rms distance of a level from its isosurface, as it is rendered [voxel]."""
    errors = [error for error in surfaces.mesh_errors if error is not None]
    bent = surfaces.settings.reconstruction.smooth if curved is None else curved
    return max((error.curved_rms if bent else error.flat_rms for error in errors), default=0.0)


def _extract_into(cache: Path, volume: Volume, isovalues: object, **options: object) -> SurfaceSet:
    return extract_with_cache(volume, isovalues, cache, **options)  # type: ignore[arg-type]  # passed through


def _for_tolerance(
    volume: Volume,
    transfer_function: TransferFunction,
    quality: Quality,
    nan_masked: bool,
    progress: Progress | None,
    *,
    cache: Path | None,
    **kept: Any,
) -> PreparedSurfaces:
    """Search for a plan; its surfaces go through the cache where there is one."""
    from isosample.rendering.tolerance import plan_for_tolerance

    assert quality.tolerance is not None
    start = time.perf_counter()
    found = plan_for_tolerance(
        volume,
        transfer_function,
        quality.tolerance,
        reconstruction=quality.reconstruction,
        max_isovalues=quality.max_isovalues,
        max_refine=quality.refine or REFINEMENTS[-1],
        nan_masked=nan_masked,
        progress=progress,
    )
    planned = time.perf_counter()
    surfaces = found.surfaces
    if cache is not None:
        surfaces = _extract_into(
            cache,
            volume,
            found.plan.isovalues,
            nan_masked=nan_masked,
            reconstruction=quality.reconstruction,
            refine=found.refine,
            residuals=True,
            **_told(progress),
            **kept,
        )
    return PreparedSurfaces(
        surfaces, found.plan, {"plan": planned - start, "extract": time.perf_counter() - planned}
    )

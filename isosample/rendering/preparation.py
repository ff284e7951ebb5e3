"""From a volume and a transfer function to surfaces: as many and as fine as one asks for, or as a tolerance needs."""

from __future__ import annotations

import time
from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple

from isosample.defaults import AUTO_DISTANCE, DEFAULT_MAX_TRIANGLES
from isosample.rendering.quality import mesh_distance, plan_for
from isosample.rendering.stage_progress import of_detail
from isosample.surfaces.cache import extract_with_cache
from isosample.surfaces.detail_sets import with_details
from isosample.surfaces.extract import extract_surfaces
from isosample.surfaces.settings import LARGEST_GROWTH, REFINEMENTS

if TYPE_CHECKING:
    from pathlib import Path

    from isosample.rendering.quality import Quality
    from isosample.rendering.stage_progress import Progress
    from isosample.surfaces.surface_set import SurfaceSet
    from isosample.transfer.isovalue_plan import IsovaluePlan
    from isosample.transfer.transfer_function import TransferFunction
    from isosample.volume.grid import Volume


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
        Folder whose surfaces of this volume are used again and added to. With ``refine=None`` or a tolerance the
        search extracts all that it tries, though the folder may hold it; what it finds is added to the folder.
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
    options: dict[str, Any] = {"nan_masked": nan_masked, "reconstruction": quality.reconstruction}
    options["progress"] = of_detail(progress, 0)
    refined, distance = None, None
    if quality.refine is None:
        refined, distance = _refined_enough(volume, plan, options)
        options |= refined.settings.as_keywords()
    else:
        options |= {"refine": quality.refine, "residuals": residuals}
    if cache is not None:
        kept: dict[str, Any] = {"plain": plain, "budget_bytes": budget_bytes, "extracted": refined}
        surfaces = _extract_into(cache, volume, plan.isovalues, **options, **kept)
    else:
        surfaces = refined or extract_surfaces(volume, plan.isovalues, **options)
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
        options = replace(surfaces.settings, detail=detail).as_keywords()
        options["progress"] = of_detail(progress, detail)
        if cache.folder is not None:  # without a budget: it might make room by what the finest needs
            return _extract_into(cache.folder, volume, isovalues, plain=cache.plain, **options)
        return extract_surfaces(volume, isovalues, **options)

    coarser = with_details(extracted, details)
    seconds = prepared.seconds | {"details": time.perf_counter() - start}
    return prepared._replace(surfaces=coarser, seconds=seconds)


def _refined_enough(volume: Volume, plan: IsovaluePlan, options: dict[str, Any]) -> tuple[SurfaceSet, float]:
    """Surfaces within AUTO_DISTANCE of the isosurfaces, or the finest that may be had; and their distance."""
    for refine in REFINEMENTS:
        surfaces = extract_surfaces(volume, plan.isovalues, refine=refine, residuals=True, **options)
        distance = mesh_distance(surfaces)
        if (
            distance <= AUTO_DISTANCE
            or LARGEST_GROWTH * sum(surfaces.statistics.triangles) > DEFAULT_MAX_TRIANGLES
        ):
            break
    return surfaces, distance


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
        lit=quality.lit,
        progress=progress,
    )
    planned = time.perf_counter()
    surfaces = found.surfaces
    if cache is not None:
        options = surfaces.settings.as_keywords() | kept | {"progress": of_detail(progress, 0)}
        surfaces = _extract_into(cache, volume, found.plan.isovalues, extracted=surfaces, **options)
    return PreparedSurfaces(
        surfaces, found.plan, {"plan": planned - start, "extract": time.perf_counter() - planned}
    )

"""From a volume and a transfer function to surfaces: as many and as fine as one asks for, or as a tolerance needs."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, NamedTuple

from isosample.rendering.quality import plan_for
from isosample.rendering.refinement import refined_enough
from isosample.rendering.stage_progress import of_detail
from isosample.surfaces.cache import extract_with_cache
from isosample.surfaces.detail_sets import with_details
from isosample.surfaces.extract import extract_surfaces
from isosample.surfaces.settings import REFINEMENTS, ExtractionSettings

if TYPE_CHECKING:
    from pathlib import Path

    from isosample.rendering.quality import Quality
    from isosample.rendering.stage_progress import Progress
    from isosample.surfaces.surface_set import SurfaceSet
    from isosample.transfer.isovalue_plan import IsovaluePlan
    from isosample.transfer.transfer_function import TransferFunction
    from isosample.volume.grid import F64, Volume


class PreparedSurfaces(NamedTuple):
    """Surfaces and the plan they were extracted for.

    Attributes
    ----------
    surfaces : SurfaceSet
    plan : IsovaluePlan
    seconds : dict of str to float
        Of both stages.
    mesh_distance : float or None
        With ``refine="auto"``: largest rms distance of a level from its isosurface [voxel].
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
        for ``refine="auto"``.
    cache : path, optional
        Folder whose surfaces of this volume are used again and added to; with ``refine="auto"`` those of every
        refinement that is tried. A tolerance's search extracts all that it tries, and only what it finds is added.
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
    extractor = _Extractor(
        volume=volume, cache=cache, plain=plain, budget_bytes=budget_bytes, progress=progress
    )
    if quality.tolerance is not None:
        found = _for_tolerance(volume, transfer_function, quality, nan_masked, extractor)
        return _with_details(found, quality.details, extractor)
    plan = plan_for(volume, transfer_function, quality)
    planned = time.perf_counter()
    settings = ExtractionSettings(
        nan_masked=nan_masked, reconstruction=quality.reconstruction, residuals=residuals
    )
    distance = None
    if quality.most_pieces is None:
        surfaces, distance = refined_enough(partial(extractor.surfaces, plan.isovalues), settings)
    else:
        surfaces = extractor.surfaces(plan.isovalues, replace(settings, refine=quality.most_pieces))
    seconds = {"plan": planned - start, "extract": time.perf_counter() - planned}
    return _with_details(PreparedSurfaces(surfaces, plan, seconds, distance), quality.details, extractor)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Extractor:
    """Extracts surfaces of a volume, by way of a cache folder where there is one."""

    volume: Volume
    cache: Path | None
    plain: bool
    budget_bytes: int | None
    progress: Progress | None

    def surfaces(
        self, isovalues: F64, settings: ExtractionSettings, extracted: SurfaceSet | None = None
    ) -> SurfaceSet:
        """Return surfaces; those that are at hand (`extracted`) are only added to the folder."""
        progress = of_detail(self.progress, settings.detail)
        if self.cache is None:
            return extracted or extract_surfaces(
                self.volume, isovalues, progress=progress, **settings.as_keywords()
            )
        return extract_with_cache(
            self.volume,
            isovalues,
            self.cache,
            settings=settings,
            plain=self.plain,
            # Coarser meshes have none: they might make room by what the finest needs.
            budget_bytes=None if settings.detail else self.budget_bytes,
            extracted=extracted,
            progress=progress,
        )


def _with_details(prepared: PreparedSurfaces, details: int, extractor: _Extractor) -> PreparedSurfaces:
    """Add coarser details."""
    if details == 0:
        return prepared
    start = time.perf_counter()
    surfaces = prepared.surfaces

    def extracted(detail: int) -> SurfaceSet:
        if detail == 0:
            return surfaces
        return extractor.surfaces(prepared.plan.isovalues, replace(surfaces.settings, detail=detail))

    coarser = with_details(extracted, details)
    seconds = prepared.seconds | {"details": time.perf_counter() - start}
    return prepared._replace(surfaces=coarser, seconds=seconds)


def _for_tolerance(
    volume: Volume,
    transfer_function: TransferFunction,
    quality: Quality,
    nan_masked: bool,
    extractor: _Extractor,
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
        max_refine=quality.most_pieces or REFINEMENTS[-1],
        nan_masked=nan_masked,
        lit=quality.lit,
        progress=extractor.progress,
    )
    planned = time.perf_counter()
    surfaces = extractor.surfaces(found.plan.isovalues, found.surfaces.settings, found.surfaces)
    return PreparedSurfaces(
        surfaces, found.plan, {"plan": planned - start, "extract": time.perf_counter() - planned}
    )

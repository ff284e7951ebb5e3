"""From a volume and a transfer function to surfaces that stay in a cache folder, within a memory budget."""

from __future__ import annotations

import time
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

from isosample.errors import InputError
from isosample.rendering.quality import Quality, plan_for
from isosample.rendering.refinement import refined_enough
from isosample.rendering.stage_progress import of_detail
from isosample.surfaces.detail_sets import with_details
from isosample.surfaces.out_of_core import SurfaceLists, extract_into_store
from isosample.surfaces.settings import ExtractionSettings
from isosample.surfaces.store import MeshStore

if TYPE_CHECKING:
    from isosample.rendering.stage_progress import Progress
    from isosample.surfaces.stored_surfaces import StoredSurfaces
    from isosample.transfer.isovalue_plan import IsovaluePlan
    from isosample.transfer.transfer_function import TransferFunction
    from isosample.volume.grid import Volume
    from isosample.volume.scan import BrickScan


class PreparedInStore(NamedTuple):
    """Surfaces that stay in a store, the plan they were extracted for; the others as of `PreparedSurfaces`."""

    surfaces: StoredSurfaces
    plan: IsovaluePlan
    seconds: dict[str, float]
    mesh_distance: float | None = None


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
        Name the cache folder and the volume's content; what its chunks hold is not extracted again. With
        ``refine="auto"`` every refinement that is tried is added.
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
    settings = ExtractionSettings(
        nan_masked=nan_masked, reconstruction=quality.reconstruction, residuals=residuals
    )

    def extracted(settings: ExtractionSettings) -> StoredSurfaces:
        return extract_into_store(
            volume,
            plan.isovalues,
            MeshStore(lists.folder, plain=plain),
            settings=settings,
            memory=memory,
            scan=scan,
            lists=lists,
            progress=of_detail(progress, settings.detail),
        )

    distance = None
    if quality.most_pieces is None:
        surfaces, distance = refined_enough(extracted, settings)
    else:
        surfaces = extracted(replace(settings, refine=quality.most_pieces))

    def of_one_detail(detail: int) -> StoredSurfaces:
        return extracted(replace(surfaces.settings, detail=detail)) if detail else surfaces

    detailed = with_details(of_one_detail, quality.details)
    seconds = {"plan": planned - start, "extract": time.perf_counter() - planned}
    return PreparedInStore(detailed, plan, seconds, distance)

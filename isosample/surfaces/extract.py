"""From a volume and isovalues to isosurface meshes, brick by brick; bricks that miss a value are skipped."""

from __future__ import annotations

import os
from concurrent.futures import ThreadPoolExecutor
from typing import TYPE_CHECKING

import numpy as np

from isosample.surfaces.field import Field, active_levels
from isosample.surfaces.settings import FLATNESS
from isosample.surfaces.settings import ExtractionSettings as ExtractionSettings
from isosample.surfaces.settings import check_isovalues as check_isovalues
from isosample.surfaces.settings import check_volume as check_volume
from isosample.surfaces.surface_set import ExtractionStatistics as ExtractionStatistics
from isosample.surfaces.surface_set import SurfaceSet as SurfaceSet
from isosample.surfaces.surface_set import count_per_level
from isosample.tally import EXTRACTIONS, tally
from isosample.volume.bricks import BRICK_CELLS, brick_ranges, bricks_of, finite_ranges
from isosample.volume.grid import check_is_volume
from isosample.volume.reconstruction import Reconstruction

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from isosample.surfaces.mesh import BrickMesh, Mesh
    from isosample.volume.bricks import Brick
    from isosample.volume.grid import F64, Volume

SCANNED_TOGETHER = 32  # bricks whose ranges one thread looks for at a time
VISITED_TOGETHER = 8  # bricks that a thread extracts in a row, so that handing them over costs little
SHARES = 4  # of what is left a thread takes one in so many: all end at about the same time


def extract_surfaces(
    volume: Volume,
    isovalues: Sequence[float] | F64,
    *,
    brick_cells: int = BRICK_CELLS,
    nan_masked: bool = False,
    reconstruction: Reconstruction = Reconstruction.TRILINEAR,
    refine: int = 1,
    residuals: bool = False,
    detail: int = 0,
    flatness: float = FLATNESS,
    progress: Callable[[int, int], None] | None = None,
) -> SurfaceSet:
    """Return the isosurfaces of a volume at the given values.

    Parameters
    ----------
    volume : Volume
        At least 2 samples along each axis; read brick by brick, so a memory-mapped file stays mapped (a smooth
        reconstruction needs it whole, in float64).
    isovalues : (K,) float64
        Strictly ascending, finite, in data units. A value outside the data's range gives an empty surface.
        A sample equal to an isovalue counts as inside.
    brick_cells : int
        Cells per brick along each axis, 1 to 32. Geometry does not depend on it, bit for bit.
    nan_masked : bool
        True: cells with a non-finite corner have no triangles, and surfaces end there, open.
    reconstruction : Reconstruction
        The field between the samples. With a smooth one vertices lie on its isosurface and gradients are its
        own; else gradients are central differences.
    refine : int
        1, 2, 4 or 8: into how many pieces an edge of the mesh may be divided where the surface bends; see
        `isosample.surfaces.refine`. The topology stays that of marching cubes.
    residuals : bool
        True: measure how far the triangles are from the isosurface (`BrickMesh.residuals`,
        `SurfaceSet.mesh_errors`), which takes about twice as long as the extraction itself.
    detail : int
        0, or 1 to 5 for coarser meshes, within 1/32 to 1/2 voxel of the isosurfaces; see `isosample.surfaces.detail`.
        Pieces that would hardly get coarser are left out.
    flatness : float
        With `refine`: edges whose middle is nearer to the isosurface stay whole [voxel], 1e-5 to 0.5.
    progress : callable, optional
        Called with (bricks done, bricks to do) after every brick.

    Returns
    -------
    surfaces : SurfaceSet

    Raises
    ------
    InputError
        If an axis has a single sample, the isovalues are not as above, samples are not finite and not masked
        (a smooth reconstruction cannot mask), the data span more than float32 can hold, or a setting is impossible.
    """
    settings = ExtractionSettings(
        brick_cells=brick_cells,
        nan_masked=nan_masked,
        reconstruction=reconstruction,
        refine=refine,
        residuals=residuals,
        detail=detail,
        flatness=flatness,
    )
    levels = check_isovalues(isovalues)
    check_is_volume(volume)
    tally(EXTRACTIONS)
    volume = volume.in_memory()
    bricks = bricks_of(volume.size_xyz, brick_cells)
    ranges = None if reconstruction.smooth else _ranges(volume, bricks)
    check_volume(volume, settings)
    field = Field(volume, settings)
    field.prepare()
    active = active_levels(_ranges(field.nodes, bricks) if ranges is None else ranges, levels)
    visits = [(bricks[row], levels[active[row]]) for row in np.flatnonzero(active.any(axis=1))]
    meshes: list[BrickMesh] = []
    for done, found in enumerate(_visit_bricks(field, visits), start=1):
        meshes += found
        if progress is not None:
            progress(done, len(visits))
    meshes.sort(key=lambda mesh: mesh.isovalue)  # stable: the order of the bricks stays
    return SurfaceSet(
        geometry=volume.geometry,
        isovalues=levels,
        meshes=tuple(meshes),
        boundary=field.boundary,
        value_range=field.value_range,
        settings=settings,
        statistics=ExtractionStatistics(
            bricks_total=len(bricks),
            brick_visits=int(active.sum()),
            brick_visits_skipped=int((~active).sum()),
            triangles=count_per_level(levels, meshes, "triangles"),
            vertices=count_per_level(levels, meshes, "positions"),
        ),
    )


def extract_meshes(
    volume: Volume,
    isovalues: Sequence[float] | F64,
    *,
    nan_masked: bool = False,
    reconstruction: Reconstruction = Reconstruction.TRILINEAR,
    refine: int = 1,
) -> list[Mesh]:
    """Return one welded mesh in world space per isovalue.

    Parameters
    ----------
    volume, isovalues, nan_masked, reconstruction, refine
        As for `extract_surfaces`.

    Returns
    -------
    meshes : list of Mesh
        In the order of the isovalues; a mesh may be empty.

    Raises
    ------
    InputError
        As `extract_surfaces`.
    """
    surfaces = extract_surfaces(
        volume, isovalues, nan_masked=nan_masked, reconstruction=reconstruction, refine=refine
    )
    return [surfaces.mesh(level) for level in range(len(surfaces.isovalues))]


def _visit_bricks(field: Field, visits: Sequence[tuple[Brick, F64]]) -> Iterator[list[BrickMesh]]:
    """Yield the meshes of every brick, in order, extracted by one thread per core.

    The kernels release the interpreter's lock.
    """
    workers = os.cpu_count() or 1
    groups = _groups(visits, workers)
    pool = ThreadPoolExecutor(max_workers=workers)
    try:
        for found in pool.map(lambda group: [field.meshes(*task) for task in group], groups):
            yield from found
    finally:
        pool.shutdown(cancel_futures=True)


def _groups(visits: Sequence[tuple[Brick, F64]], workers: int) -> Iterator[Sequence[tuple[Brick, F64]]]:
    """Divide visits into parts that a thread takes at a time: some at first, single ones at last."""
    first = 0
    while first < len(visits):
        count = min(max((len(visits) - first) // (SHARES * workers), 1), VISITED_TOGETHER)
        yield visits[first : first + count]
        first += count


def _ranges(volume: Volume, bricks: Sequence[Brick]) -> F64:
    """(B, 2) float64, as `brick_ranges` gives, looked for by one thread per core.

    Where all samples turn out to be finite, the volume is told so, and its range.
    """
    groups = [bricks[first : first + SCANNED_TOGETHER] for first in range(0, len(bricks), SCANNED_TOGETHER)]
    with ThreadPoolExecutor(max_workers=os.cpu_count()) as pool:
        found = list(pool.map(lambda group: finite_ranges(volume, group), groups))
        if any(part is None for part in found):
            return np.concatenate(list(pool.map(lambda group: brick_ranges(volume, group), groups)))
    ranges = np.concatenate([part for part in found if part is not None])
    known = vars(volume)
    known["value_range"] = volume.checked_range(float(ranges[:, 0].min()), float(ranges[:, 1].max()))
    known["nonfinite_counts"] = (0, 0)
    return ranges

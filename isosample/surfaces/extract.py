"""From a volume and isovalues to isosurface meshes, brick by brick; bricks that miss a value are skipped."""

from __future__ import annotations

import os
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from isosample.errors import InputError
from isosample.surfaces.boundary import BoundarySlices
from isosample.surfaces.brick_samples import BrickSamples, load_brick
from isosample.surfaces.marching_cubes import LARGEST_BRICK_CELLS, march
from isosample.surfaces.mesh import BrickMesh, Mesh, weld
from isosample.volume.bricks import BRICK_CELLS, brick_ranges, bricks_of

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from isosample.volume.bricks import Brick
    from isosample.volume.grid import F64, GridGeometry, Volume

LARGEST_SPAN = float(np.finfo(np.float32).max)  # gradients are float32


@dataclass(frozen=True, slots=True, kw_only=True)
class ExtractionSettings:
    """What decides about the meshes, besides the samples and the isovalue.

    Attributes
    ----------
    brick_cells : int
        Cells per brick along each axis, 1 to 128.
    nan_masked : bool
        Whether cells with a non-finite corner are left out; otherwise such samples are an error.
    """

    brick_cells: int = BRICK_CELLS
    nan_masked: bool = False

    def __post_init__(self) -> None:
        if not 1 <= self.brick_cells <= LARGEST_BRICK_CELLS:
            raise InputError(
                f"bricks of {self.brick_cells} cells are not possible; choose 1 to {LARGEST_BRICK_CELLS}."
            )


@dataclass(frozen=True, slots=True, kw_only=True)
class ExtractionStatistics:
    """What an extraction did and what it skipped.

    Attributes
    ----------
    bricks_total : int
        Bricks of the volume.
    brick_visits : int
        (brick, isovalue) pairs whose samples lie on both sides of the isovalue: these were extracted.
    brick_visits_skipped : int
        (brick, isovalue) pairs that the range of the brick ruled out.
    triangles, vertices : tuple of int
        Per level, summed over the bricks; a vertex that bricks share counts in each.
    levels_reused : int
        Levels that came from a cache and were not extracted.
    """

    bricks_total: int
    brick_visits: int
    brick_visits_skipped: int
    triangles: tuple[int, ...]
    vertices: tuple[int, ...]
    levels_reused: int = 0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SurfaceSet:
    """The isosurfaces of one volume, with all that a renderer needs in place of the volume.

    Attributes
    ----------
    geometry : GridGeometry
        Places the samples in world space.
    isovalues : (K,) float64
        Strictly ascending, in data units.
    meshes : tuple of BrickMesh
        Ordered by (level, brick); pieces without triangles are left out.
    boundary : BoundarySlices
        Samples on the faces of the volume.
    value_range : 2 floats
        Smallest and largest finite sample, in data units.
    settings : ExtractionSettings
    statistics : ExtractionStatistics
    """

    geometry: GridGeometry
    isovalues: F64
    meshes: tuple[BrickMesh, ...]
    boundary: BoundarySlices
    value_range: tuple[float, float]
    settings: ExtractionSettings
    statistics: ExtractionStatistics

    def pieces(self, level: int) -> tuple[BrickMesh, ...]:
        """Return the meshes of one level, in the order of the bricks.

        Raises
        ------
        InputError
            If there is no such level.
        """
        if not 0 <= level < len(self.isovalues):
            raise InputError(
                f"level {level} does not exist; there are {len(self.isovalues)}, counted from 0."
            )
        isovalue = float(self.isovalues[level])
        return tuple(mesh for mesh in self.meshes if mesh.isovalue == isovalue)

    def mesh(self, level: int) -> Mesh:
        """Return one level as a welded mesh in world space; raises as `pieces` does."""
        return weld(self.pieces(level), self.geometry, isovalue=float(self.isovalues[level]))


def extract_surfaces(
    volume: Volume,
    isovalues: Sequence[float] | F64,
    *,
    brick_cells: int = BRICK_CELLS,
    nan_masked: bool = False,
    progress: Callable[[int, int], None] | None = None,
) -> SurfaceSet:
    """Return the isosurfaces of a volume at the given values.

    Parameters
    ----------
    volume : Volume
        At least 2 samples along each axis; read brick by brick, so a memory-mapped file stays mapped.
    isovalues : (K,) float64
        Strictly ascending, finite, in data units. A value outside the data's range gives an empty surface.
        A sample equal to an isovalue counts as inside.
    brick_cells : int
        Cells per brick along each axis, 1 to 128. Geometry does not depend on it, bit for bit.
    nan_masked : bool
        True: cells with a non-finite corner have no triangles, and surfaces end there, open.
    progress : callable, optional
        Called with (bricks done, bricks to do) after every brick.

    Returns
    -------
    surfaces : SurfaceSet

    Raises
    ------
    InputError
        If an axis has a single sample, the isovalues are not as above, samples are not finite and not masked,
        or the data span more than float32 can hold.
    """
    settings = ExtractionSettings(brick_cells=brick_cells, nan_masked=nan_masked)
    levels = check_isovalues(isovalues)
    check_volume(volume, settings)
    bricks = bricks_of(volume.size_xyz, brick_cells)
    active = _active_levels(brick_ranges(volume, bricks), levels)
    visits = [(bricks[row], levels[active[row]]) for row in np.flatnonzero(active.any(axis=1))]
    meshes: list[BrickMesh] = []
    for done, found in enumerate(_visit_bricks(volume, visits), start=1):
        meshes += found
        if progress is not None:
            progress(done, len(visits))
    meshes.sort(key=lambda mesh: mesh.isovalue)  # stable: the order of the bricks stays
    return SurfaceSet(
        geometry=volume.geometry,
        isovalues=levels,
        meshes=tuple(meshes),
        boundary=BoundarySlices.from_volume(volume),
        value_range=volume.value_range,
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
    volume: Volume, isovalues: Sequence[float] | F64, *, nan_masked: bool = False
) -> list[Mesh]:
    """Return one welded mesh in world space per isovalue.

    Parameters
    ----------
    volume, isovalues, nan_masked
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
    surfaces = extract_surfaces(volume, isovalues, nan_masked=nan_masked)
    return [surfaces.mesh(level) for level in range(len(surfaces.isovalues))]


def check_isovalues(isovalues: Sequence[float] | F64) -> F64:
    """Return isovalues as a read-only (K,) float64 array, or raise InputError naming what is wrong."""
    try:
        levels = np.array(isovalues, dtype=np.float64)
    except (TypeError, ValueError):
        levels = np.array(np.nan)
    if levels.ndim != 1 or not np.isfinite(levels).all():
        raise InputError(f"isovalues {isovalues!r} must be a list of finite numbers.")
    if (np.diff(levels) <= 0).any():
        at = int(np.flatnonzero(np.diff(levels) <= 0)[0])
        raise InputError(
            f"isovalue {levels[at + 1]} at place {at + 1} does not exceed {levels[at]} before it; "
            "pass them in ascending order, each once."
        )
    levels.setflags(write=False)
    return levels


def check_volume(volume: Volume, settings: ExtractionSettings) -> None:
    """Raise InputError if a volume has no cells, unexpected non-finite samples, or too wide a range."""
    if min(volume.size_xyz) < 2:
        raise InputError(
            f"{volume.name} has {volume.size_xyz} samples (x, y, z); "
            "a volume needs at least 2 samples along each axis to have surfaces."
        )
    nan_count, infinity_count = volume.nonfinite_counts
    if nan_count + infinity_count and not settings.nan_masked:
        raise InputError(
            f"{volume.name} has {nan_count} NaN and {infinity_count} infinite samples; surfaces need finite "
            "ones. Pass --nan masked (nan_masked=True) to leave out the cells that they touch."
        )
    low, high = volume.value_range
    if high / 2 - low / 2 > LARGEST_SPAN / 2:
        raise InputError(
            f"{volume.name} ranges from {low} to {high}, more than float32 gradients can hold. "
            "Rescale the data."
        )


def extract_brick(samples: BrickSamples, isovalue: float, brick: Brick, geometry: GridGeometry) -> BrickMesh:
    """Return one isosurface in one brick, vertices named in the whole volume, wound for world space."""
    local = march(samples, isovalue)
    z, y, x = np.unravel_index(local.samples, samples.values.shape)
    size_x, size_y, size_z = geometry.size_xyz
    linear = (x + brick.start[0]) + size_x * ((y + brick.start[1]) + size_y * (z + brick.start[2]))
    sample_count = size_x * size_y * size_z
    keys = np.where(local.axes < 3, local.axes + 3 * linear, 3 * sample_count + linear)
    mirrored = np.linalg.det(geometry.direction) < 0
    return BrickMesh(
        isovalue=isovalue,
        brick=brick.index,
        start=brick.start,
        positions=local.positions,
        gradients=local.gradients,
        edge_keys=keys.astype(np.int64),
        triangles=np.ascontiguousarray(local.triangles[:, [0, 2, 1]]) if mirrored else local.triangles,
    )


def count_per_level(levels: F64, meshes: Sequence[BrickMesh], field: str) -> tuple[int, ...]:
    """Return the rows of a field of the meshes per level, summed over the bricks."""
    level_of = np.searchsorted(levels, [mesh.isovalue for mesh in meshes]).astype(np.int64)
    totals = np.zeros(len(levels), dtype=np.int64)
    np.add.at(totals, level_of, np.array([len(getattr(mesh, field)) for mesh in meshes], dtype=np.int64))
    return tuple(totals.tolist())


def _visit_bricks(volume: Volume, visits: Sequence[tuple[Brick, F64]]) -> Iterator[list[BrickMesh]]:
    """Yield the meshes of every brick, in order, extracted by one thread per core.

    numpy releases the interpreter's lock inside its loops: two threads on two free cores take 0.6 times as
    long as one.
    """

    def visit(task: tuple[Brick, F64]) -> list[BrickMesh]:
        brick, isovalues = task
        samples = load_brick(volume, brick)
        found = (extract_brick(samples, value, brick, volume.geometry) for value in isovalues.tolist())
        return [mesh for mesh in found if len(mesh.triangles)]

    pool = ThreadPoolExecutor(max_workers=os.cpu_count())
    try:
        yield from pool.map(visit, visits)
    finally:
        pool.shutdown(cancel_futures=True)


def _active_levels(ranges: F64, levels: F64) -> np.ndarray[tuple[int, ...], np.dtype[np.bool_]]:
    """(B, K) bool, whether a brick has samples on both sides: low < isovalue <= high, equal being inside."""
    return (ranges[:, :1] < levels) & (levels <= ranges[:, 1:])

"""From a volume and isovalues to isosurface meshes, brick by brick; bricks that miss a value are skipped."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from isosample.errors import InputError
from isosample.surfaces.boundary import BoundarySlices
from isosample.surfaces.marching_cubes import LARGEST_BRICK_CELLS, BrickSamples, march
from isosample.surfaces.mesh import BrickMesh, Mesh, weld
from isosample.volume.bricks import BRICK_CELLS, brick_ranges, bricks_of

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

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
    to_visit = np.flatnonzero(active.any(axis=1))
    found: list[list[BrickMesh]] = [[] for _ in levels]
    for done, row in enumerate(to_visit, start=1):
        samples = load_brick(volume, bricks[row])
        for level in np.flatnonzero(active[row]):
            mesh = extract_brick(samples, float(levels[level]), bricks[row], volume.geometry)
            if len(mesh.triangles):
                found[level].append(mesh)
        if progress is not None:
            progress(done, len(to_visit))
    return SurfaceSet(
        geometry=volume.geometry,
        isovalues=levels,
        meshes=tuple(mesh for pieces in found for mesh in pieces),
        boundary=BoundarySlices.from_volume(volume),
        value_range=volume.value_range,
        settings=settings,
        statistics=ExtractionStatistics(
            bricks_total=len(bricks),
            brick_visits=int(active.sum()),
            brick_visits_skipped=int((~active).sum()),
            triangles=tuple(sum(len(mesh.triangles) for mesh in pieces) for pieces in found),
            vertices=tuple(sum(len(mesh.positions) for mesh in pieces) for pieces in found),
        ),
    )


def check_isovalues(isovalues: Sequence[float] | F64) -> F64:
    """Return isovalues as a read-only (K,) float64 array, or raise InputError naming what is wrong."""
    levels = np.array(isovalues, dtype=np.float64)
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


def load_brick(volume: Volume, brick: Brick) -> BrickSamples:
    """Read one brick with a border of one sample, and differentiate it.

    Notes
    -----
    Gradients are central differences, one-sided next to the volume's border or a non-finite sample, and
    zero along an axis on which neither neighbour is finite. The border of one sample makes the gradient at a
    sample the same in all bricks that hold it.
    """
    padded = _padded_samples(volume, brick)
    core = padded[1:-1, 1:-1, 1:-1]
    gradients = np.stack([_difference(padded, 2 - axis).ravel() for axis in range(3)], axis=1)
    finite = np.isfinite(core)
    if finite.all():
        return BrickSamples(values=np.ascontiguousarray(core), gradients=gradients, usable_cells=None)
    usable = finite[:-1] & finite[1:]
    usable = usable[:, :-1] & usable[:, 1:]
    usable = usable[:, :, :-1] & usable[:, :, 1:]
    return BrickSamples(values=np.where(finite, core, 0.0), gradients=gradients, usable_cells=usable)


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


def _active_levels(ranges: F64, levels: F64) -> np.ndarray[tuple[int, ...], np.dtype[np.bool_]]:
    """(B, K) bool, whether a brick has samples on both sides: low < isovalue <= high, equal being inside."""
    return (ranges[:, :1] < levels) & (levels <= ranges[:, 1:])


def _padded_samples(volume: Volume, brick: Brick) -> F64:
    """Brick samples with a border of one sample, float64; NaN outside the volume and where not finite."""
    x, y, z = brick.size_xyz
    padded = np.full((z + 2, y + 2, x + 2), np.nan)
    source, target = [], []
    for axis in (2, 1, 0):
        first, last = brick.start[axis] - 1, brick.stop[axis] + 1
        low, high = max(first, 0), min(last, volume.size_xyz[axis] - 1)
        source.append(slice(low, high + 1))
        target.append(slice(low - first, high - first + 1))
    padded[tuple(target)] = volume.array[tuple(source)]
    if volume.array.dtype.kind == "f":
        padded[np.isinf(padded)] = np.nan
    return padded


def _difference(padded: F64, axis: int) -> F64:
    """Return the derivative per sample step along an array axis at all but the border samples."""
    core = [slice(1, -1)] * 3
    ahead_of, behind_of = list(core), list(core)
    ahead_of[axis], behind_of[axis] = slice(2, None), slice(None, -2)
    ahead, here, behind = padded[tuple(ahead_of)], padded[tuple(core)], padded[tuple(behind_of)]
    slope: F64 = 0.5 * (ahead - behind)
    one_sided = np.nonzero(np.isnan(slope))
    forward = ahead[one_sided] - here[one_sided]
    backward = here[one_sided] - behind[one_sided]
    slope[one_sided] = np.where(np.isnan(forward), np.where(np.isnan(backward), 0.0, backward), forward)
    return slope

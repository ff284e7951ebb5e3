"""Ground truth of the volume-rendering integral of a grid, in float64.

The field is the trilinear interpolant of the samples, exactly: along a ray it is a cubic in every cell. Each
cubic is cut at its extrema and where it takes a value at which the transfer function bends, steps or has an
isosurface. On each part opacity has a closed form; so has radiance where the colour does not change, and
elsewhere Gauss-Legendre panels err by less than the tolerance (`band_table.PanelRules` has the proof).

>>> rgba = integrate_rays(volume, transfer_function, origins, directions)
"""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from isosample.errors import InputError
from isosample.integral.band_table import BandTable, Optics, PanelRules
from isosample.integral.checks import last_axis

if TYPE_CHECKING:
    from isosample.integral.cell_grid import CellGrid
    from isosample.transfer.transfer_function import TransferFunction
    from isosample.volume.grid import Volume

F64 = npt.NDArray[np.float64]
I64 = npt.NDArray[np.int64]
Plane = tuple[float, float, float, float]
Progress = Callable[[int, int], None]

DEFAULT_TOLERANCE = 1e-10
RAYS_PER_BLOCK = 512  # a block of work for one thread: a few milliseconds to a second
UNIT_TOLERANCE = 1e-9  # by how much a direction's length may differ from 1
# Cells: a ray that drifts less than this along an axis is parallel to it; one this far outside is inside.
GRAZING = 1e-12


def integrate_rays(
    volume: Volume,
    transfer_function: TransferFunction,
    origins: npt.ArrayLike,
    directions: npt.ArrayLike,
    *,
    clip_planes: Sequence[Plane] = (),
    tolerance: float = DEFAULT_TOLERANCE,
    panels: int = 1,
    progress: Progress | None = None,
) -> F64:
    r"""Radiance and opacity of rays through the trilinear interpolant of a volume.

    Parameters
    ----------
    volume : Volume
        At least two samples along every axis. A cell with a corner that is not finite contributes nothing.
    transfer_function : TransferFunction
    origins, directions : (N, 3) array_like of float
        World space, directions of unit length. Only what lies in front of the origin counts.
    clip_planes : sequence of (nx, ny, nz, d)
        The side where nx·x + ny·y + nz·z + d >= 0 is kept [world].
    tolerance : float
        Largest absolute error of a component by quadrature, 1e-13 to 1e-2; rounding (about 1e-14 times the
        number of cells on the ray) comes on top.
    panels : int
        Divides every quadrature panel again; the result must not change by more than `tolerance`.
    progress : callable, optional
        Called with the number of rays done and of all rays.

    Returns
    -------
    rgba : (N, 4) float64
        Premultiplied linear RGBA, without background.

    Raises
    ------
    InputError
        If an array has another shape, a direction is not of unit length, a number is not finite or out of
        range, or the volume is thinner than two samples.

    Notes
    -----
    .. math:: I = \int c(f)\,\tau(f)\,e^{-\int_0^t \tau(f)\,ds}\,dt

    A crossing composites the opacity of its isosurface once. A value equal to an isovalue is inside: the ray
    that reaches the isovalue and stays there crosses, one that touches it and turns back does not. Where the
    field is constant at the value of a step, the extinction from above holds, at the very last control point
    that from below. A ray ends where less than 1e-14 is transmitted.
    """
    tracer = ReferenceTracer.build(volume, transfer_function, tolerance=tolerance, panels=panels)
    return tracer.integrate(origins, directions, clip_planes=clip_planes, progress=progress)[0]


@dataclass(frozen=True, slots=True, eq=False)
class ReferenceTracer:
    """A volume and a transfer function, prepared for many calls; see `integrate_rays`.

    The samples are kept as float32 where that is exact (integers up to 16 bits, float16, float32), else as
    float64; arrays that are already so are not copied.
    """

    grid: CellGrid
    index_from_world: F64
    optics: Optics

    @classmethod
    def build(
        cls,
        volume: Volume,
        transfer_function: TransferFunction,
        *,
        tolerance: float = DEFAULT_TOLERANCE,
        panels: int = 1,
    ) -> ReferenceTracer:
        """Prepare a volume and a transfer function; arguments and errors as `integrate_rays`."""
        from isosample.integral.cell_grid import BLOCK_CELLS, CellGrid, find_visible_blocks

        if min(volume.size_xyz) < 2:
            raise InputError(
                f"{volume.name} has {volume.size_xyz} samples (x, y, z); a cell needs two along every axis."
            )
        if panels < 1:
            raise InputError(f"panels {panels} must be a whole number >= 1.")
        samples = _floating(volume.array)
        base = offset_of(*volume.value_range)
        bands = BandTable.from_transfer_function(transfer_function, base)
        visible = np.zeros([-(-(n - 1) // BLOCK_CELLS) for n in samples.shape], dtype=np.bool_)
        shown = (bands.extinction.max(axis=1) > 0, bands.level_visible)
        find_visible_blocks(samples, base, bands, shown, visible)
        return cls(
            grid=CellGrid(samples, base, visible),
            index_from_world=np.asarray(np.linalg.inv(volume.world_from_index), dtype=np.float64),
            optics=Optics(bands, PanelRules.for_tolerance(tolerance), int(panels)),
        )

    def integrate(
        self,
        origins: npt.ArrayLike,
        directions: npt.ArrayLike,
        *,
        clip_planes: Sequence[Plane] = (),
        progress: Progress | None = None,
    ) -> tuple[F64, I64]:
        """Integrate rays on all processors; arguments and errors as `integrate_rays`.

        Returns
        -------
        rgba : (N, 4) float64
        counts : (N, 5) int64
            Per ray, named by ``ray_cells.COUNT_NAMES``.
        """
        from isosample.integral.ray_cells import COUNT_NAMES, integrate_ray_block

        starts, ways = checked_rays(origins, directions)
        matrix = self.index_from_world
        last = np.array(self.grid.samples.shape[::-1]) - 1.0
        o, d = starts @ matrix[:3, :3].T + matrix[:3, 3], ways @ matrix[:3, :3].T
        reach = (np.abs(o).max(axis=1) + last.max()) / np.abs(d).max(axis=1)
        d = np.where(np.abs(d) * reach[:, None] <= GRAZING, 0.0, d)
        intervals = clipped(box_intervals(o, d, last), starts, ways, clip_planes)
        rgba, counts = np.zeros((len(o), 4)), np.zeros((len(o), len(COUNT_NAMES)), dtype=np.int64)

        def work(rows: slice) -> None:
            rays = (o[rows], d[rows], intervals[rows])
            integrate_ray_block(self.grid, self.optics, rays, rgba[rows], counts[rows])

        run_in_blocks(work, len(o), progress)
        return rgba, counts


def offset_of(low: float, high: float) -> float:
    """What to subtract from values so that rounding is relative to their range; 0 where 0 is near them."""
    return 0.5 * low + 0.5 * high if max(low, -high) > high - low else 0.0


def checked_rays(origins: npt.ArrayLike, directions: npt.ArrayLike) -> tuple[F64, F64]:
    """(N, 3) float64 origins and unit directions, or an `InputError`."""
    starts, ways = last_axis(origins, "origins", 3), last_axis(directions, "directions", 3)
    if starts.ndim != 2 or starts.shape != ways.shape:
        raise InputError(
            f"origins {starts.shape} and directions {ways.shape} must both be (N, 3). Flatten the picture."
        )
    for name, vectors in (("origins", starts), ("directions", ways)):
        wrong = np.flatnonzero(~np.isfinite(vectors).all(axis=1))
        if wrong.size:
            raise InputError(f"{name}[{wrong[0]}] is {vectors[wrong[0]].tolist()}; expected finite numbers.")
    lengths = np.linalg.norm(ways, axis=1)
    wrong = np.flatnonzero(np.abs(lengths - 1.0) > UNIT_TOLERANCE)
    if wrong.size:
        raise InputError(
            f"directions[{wrong[0]}] has length {lengths[wrong[0]]!r}; expected 1. Divide by the length."
        )
    return starts, ways


def box_intervals(origins: F64, directions: F64, last: F64) -> F64:
    """(N, 2) float64, ray parameters at which rays enter and leave the box from 0 to `last`; t >= 0.

    The numbers are those of `ray_cells.plane_distance`, bit for bit. Rays beside the box, and rays that lie
    in no plane but touch it, get an empty interval.
    """
    parallel = directions == 0.0
    slopes = np.where(parallel, 1.0, directions)
    near, far = (0.0 - origins) / slopes, (last - origins) / slopes
    beside = parallel & ((origins < -GRAZING) | (origins > last + GRAZING))
    first = np.where(parallel, -np.inf, np.minimum(near, far)).max(axis=1, initial=0.0)
    final = np.where(parallel, np.inf, np.maximum(near, far)).min(axis=1)
    return np.stack([first, np.where(beside.any(axis=1), -np.inf, final)], axis=1)


def clipped(intervals: F64, origins: F64, directions: F64, planes: Sequence[Plane]) -> F64:
    """Intervals of the ray parameter, cut to the kept side of every plane.

    Raises
    ------
    InputError
        If a plane is not four finite numbers with a normal that is not zero.
    """
    first, final = intervals[:, 0].copy(), intervals[:, 1].copy()
    for plane in planes:
        numbers = np.asarray(plane, dtype=np.float64)
        if numbers.shape != (4,) or not np.isfinite(numbers).all() or not numbers[:3].any():
            raise InputError(
                f"clip plane {plane!r} must be (nx, ny, nz, d), finite, with a normal that is not zero."
            )
        height, slope = origins @ numbers[:3] + numbers[3], directions @ numbers[:3]
        crossing = -height / np.where(slope == 0.0, 1.0, slope)
        first = np.where(slope > 0.0, np.maximum(first, crossing), first)
        final = np.where(slope < 0.0, np.minimum(final, crossing), final)
        final = np.where((slope == 0.0) & (height < 0.0), -np.inf, final)
    return np.stack([first, final], axis=1)


def run_in_blocks(work: Callable[[slice], None], count: int, progress: Progress | None) -> None:
    """Call `work` for blocks of rows from as many threads as there are processors."""
    blocks = [slice(row, min(row + RAYS_PER_BLOCK, count)) for row in range(0, count, RAYS_PER_BLOCK)]
    done = 0
    with ThreadPoolExecutor(max_workers=processors()) as pool:
        for block, _ in zip(blocks, pool.map(work, blocks), strict=True):
            done += block.stop - block.start
            if progress is not None:
                progress(done, count)


def processors() -> int:
    """Number of processors that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _floating(array: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Samples as float32 where that is exact, else as float64, read-only (one compiled kernel for each)."""
    dtype = np.float32 if np.can_cast(array.dtype, np.float32, casting="safe") else np.float64
    samples = np.ascontiguousarray(array, dtype=dtype).view()
    samples.setflags(write=False)
    return samples

"""Ground truth of the volume-rendering integral of a grid, in float64.

The field is the trilinear interpolant of the samples, exactly: along a ray it is a cubic in every cell. Each
cubic is cut at its extrema and where it takes a value at which the transfer function bends, steps or has an
isosurface. On each part opacity has a closed form; so has radiance where the colour does not change, and
elsewhere Gauss-Legendre panels err by less than the tolerance (`band_table.PanelRules` has the proof).

Or the field is a spline, along a ray a polynomial of degree 9 in every cell. Between the levels of the transfer
function it is integrated as it is; where it crosses them, by cubics that agree with it (`spline_march`).

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
from isosample.integral.band_table import SMALLEST_TOLERANCE, BandTable, Optics, PanelRules
from isosample.integral.checks import last_axis
from isosample.tally import TRACERS, tally
from isosample.volume.reconstruction import GridSpline, Reconstruction

if TYPE_CHECKING:
    from isosample.integral.cell_grid import CellGrid
    from isosample.integral.spline_grid import SplineGrid
    from isosample.integral.spline_panels import Accuracy
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
    reconstruction: Reconstruction = Reconstruction.TRILINEAR,
    clip_planes: Sequence[Plane] = (),
    tolerance: float = DEFAULT_TOLERANCE,
    panels: int = 1,
    progress: Progress | None = None,
) -> F64:
    r"""Radiance and opacity of rays through a reconstruction of a volume.

    Parameters
    ----------
    volume : Volume
        At least two samples along every axis. Of the trilinear interpolant, a cell with a corner that is not
        finite contributes nothing; a spline needs finite samples.
    transfer_function : TransferFunction
    origins, directions : (N, 3) array_like of float
        World space, directions of unit length. Only what lies in front of the origin counts.
    reconstruction : Reconstruction
    clip_planes : sequence of (nx, ny, nz, d)
        The side where nx·x + ny·y + nz·z + d >= 0 is kept [world].
    tolerance : float
        Largest absolute error of a component by quadrature, and of a spline by its cubics (see the notes),
        1e-13 to 1e-2; rounding (about 1e-14 times the number of cells on the ray) comes on top.
    panels : int
        Divides every quadrature panel, and the cubics of a spline, again; the result must not change by more
        than `tolerance`.
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
        range, the volume is thinner than two samples, or a spline is asked for and a sample is not finite.

    Notes
    -----
    .. math:: I = \int c(f)\,\tau(f)\,e^{-\int_0^t \tau(f)\,ds}\,dt

    A crossing composites the opacity of its isosurface once. A value equal to an isovalue is inside: the ray
    that reaches the isovalue and stays there crosses, one that touches it and turns back does not. Where the
    field is constant at the value of a step, the extinction from above holds, at the very last control point
    that from below. A ray ends where less than 1e-14 is transmitted.

    A spline is integrated as it is where it lies between two levels of the transfer function; where it crosses
    them, cubics take its place. They differ from it by at most half the tolerance / (largest chord · |dτ/dv| +
    |dc/dv|), with the slopes of the bands that the field meets there, and by half the tolerance times the
    values' range where these are 0: a proven bound, from Bernstein coefficients. It changes depth and colour by at
    most half the tolerance; the quadrature has the other half. At a step of extinction or colour a crossing moves
    by that difference over the field's slope, and an isosurface that is touched more closely than that may be
    crossed twice or not at all: near such rays the error can be larger.
    """
    tracer = ReferenceTracer.build(
        volume, transfer_function, reconstruction=reconstruction, tolerance=tolerance, panels=panels
    )
    return tracer.integrate(origins, directions, clip_planes=clip_planes, progress=progress)[0]


@dataclass(frozen=True, slots=True, eq=False)
class ReferenceTracer:
    """A volume and a transfer function, prepared for many calls; see `integrate_rays`.

    The samples are kept as float32 where that is exact (integers up to 16 bits, float16, float32), else as
    float64; arrays that are already so are not copied. Of a spline the coefficients are kept, and what keeps its
    tolerance.
    """

    grid: CellGrid | SplineGrid
    index_from_world: F64
    optics: Optics
    accuracy: Accuracy | None = None

    @classmethod
    def build(
        cls,
        volume: Volume,
        transfer_function: TransferFunction,
        *,
        reconstruction: Reconstruction = Reconstruction.TRILINEAR,
        tolerance: float = DEFAULT_TOLERANCE,
        panels: int = 1,
    ) -> ReferenceTracer:
        """Prepare a volume and a transfer function; arguments and errors as `integrate_rays`."""
        if min(volume.size_xyz) < 2:
            raise InputError(
                f"{volume.name} has {volume.size_xyz} samples (x, y, z); a cell needs two along every axis."
            )
        if panels < 1:
            raise InputError(f"panels {panels} must be a whole number >= 1.")
        tally(TRACERS)
        rules = PanelRules.for_tolerance(tolerance)
        base = offset_of(*volume.value_range)
        bands = BandTable.from_transfer_function(transfer_function, base)
        index_from_world = np.asarray(np.linalg.inv(volume.world_from_index), dtype=np.float64)
        if not reconstruction.smooth:
            from isosample.integral.cell_grid import CellGrid

            grid = CellGrid.build(volume, base, bands)
            return cls(grid, index_from_world, Optics(bands, rules, int(panels)))
        from isosample.integral.spline_grid import SplineGrid
        from isosample.integral.spline_panels import Accuracy

        half = max(0.5 * tolerance, SMALLEST_TOLERANCE)
        optics = Optics(bands, PanelRules.for_tolerance(half), int(panels))
        low, high = volume.value_range
        scales = (2.0 * volume.box.radius, high - low or 1.0)
        spline = SplineGrid.build(GridSpline.build(volume, reconstruction), base, bands)
        return cls(spline, index_from_world, optics, Accuracy.build(bands, scales, half, int(panels)))

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
        from isosample.integral.ray_cells import COUNT_NAMES

        starts, ways = checked_rays(origins, directions)
        last = np.array(self.shape[::-1]) - 1.0
        o, d = rays_in_index(self.index_from_world, last, starts, ways)
        intervals = clipped(box_intervals(o, d, last), starts, ways, clip_planes)
        rgba, counts = np.zeros((len(o), 4)), np.zeros((len(o), len(COUNT_NAMES)), dtype=np.int64)

        def work(rows: slice) -> None:
            self._integrate_block((o[rows], d[rows], intervals[rows]), rgba[rows], counts[rows])

        run_in_blocks(work, len(o), progress)
        return rgba, counts

    @property
    def shape(self) -> tuple[int, int, int]:
        """Number of samples along z, y, x."""
        beside = 0 if self.accuracy is None else 2
        z, y, x = self.grid[0].shape
        return z - beside, y - beside, x - beside

    def _integrate_block(self, rays: tuple[F64, F64, F64], rgba: F64, counts: I64) -> None:
        """Integrate rays in sample indices on one processor."""
        grid: Any = self.grid  # each kernel is compiled for its own kind
        if self.accuracy is None:
            from isosample.integral.ray_cells import integrate_ray_block

            integrate_ray_block(grid, self.optics, rays, rgba, counts)
        else:
            from isosample.integral.spline_march import integrate_spline_block

            integrate_spline_block(grid, self.optics, self.accuracy, rays, rgba, counts)


def rays_in_index(index_from_world: F64, last: F64, starts: F64, ways: F64) -> tuple[F64, F64]:
    """Origins and directions in sample indices; a direction that hardly drifts along an axis is parallel to it."""
    o, d = starts @ index_from_world[:3, :3].T + index_from_world[:3, 3], ways @ index_from_world[:3, :3].T
    reach = (np.abs(o).max(axis=1) + last.max()) / np.abs(d).max(axis=1)
    return o, np.where(np.abs(d) * reach[:, None] <= GRAZING, 0.0, d)


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


def box_intervals(origins: F64, directions: F64, last: F64, nearest: float = 0.0) -> F64:
    """(N, 2) float64, ray parameters at which rays enter and leave the box from 0 to `last`; t >= nearest.

    The numbers are those of `ray_cells.plane_distance`, bit for bit. Rays beside the box, and rays that lie
    in no plane but touch it, get an empty interval.
    """
    parallel = directions == 0.0
    slopes = np.where(parallel, 1.0, directions)
    near, far = (0.0 - origins) / slopes, (last - origins) / slopes
    beside = parallel & ((origins < -GRAZING) | (origins > last + GRAZING))
    first = np.where(parallel, -np.inf, np.minimum(near, far)).max(axis=1, initial=nearest)
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

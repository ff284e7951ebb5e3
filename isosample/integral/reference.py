"""Ground truth of the volume-rendering integral of a grid, in float64.

The field is the trilinear interpolant of the samples, exactly: along a ray it is a cubic in every cell. Each
cubic is cut at its extrema and where it takes a value at which the transfer function bends, steps or has an
isosurface. On each part opacity has a closed form; so has radiance where the colour does not change, and
elsewhere Gauss-Legendre panels err by less than the tolerance (`band_table.PanelRules` has the proof).

Or the field is a spline, along a ray a polynomial of degree 9 in every cell. Between the levels of the transfer
function it is integrated as it is; where it crosses them, by cubics that agree with it (`spline_march`).

With a material all colours are lit, by the gradient at every place (`cell_light`); that integral is verified at
points, not proven (`lit_panels`).

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

from isosample.errors import CapacityError, InputError
from isosample.integral.band_table import SMALLEST_TOLERANCE, BandTable, Optics, PanelRules
from isosample.integral.box_rays import Plane, box_intervals, checked_rays, clipped, rays_in_index
from isosample.integral.checks import at_least_zero, last_axis
from isosample.tally import TRACERS, tally
from isosample.volume.reconstruction import GridSpline, Reconstruction

if TYPE_CHECKING:
    from isosample.integral.cell_grid import CellGrid
    from isosample.integral.cell_light import CellLight
    from isosample.integral.spline_grid import SplineGrid
    from isosample.integral.spline_panels import Accuracy
    from isosample.transfer.transfer_function import TransferFunction
    from isosample.volume.grid import Volume

F64 = npt.NDArray[np.float64]
I64 = npt.NDArray[np.int64]
Progress = Callable[[int, int], None]

DEFAULT_TOLERANCE = 1e-10
RAYS_PER_BLOCK = 512  # a block of work for one thread: a few milliseconds to a second
LEAST_LIT_TOLERANCE = 1e-12  # rounding of the gradient where it is short


def integrate_rays(
    volume: Volume,
    transfer_function: TransferFunction,
    origins: npt.ArrayLike,
    directions: npt.ArrayLike,
    *,
    reconstruction: Reconstruction = Reconstruction.TRILINEAR,
    clip_planes: Sequence[Plane] = (),
    material: npt.ArrayLike | None = None,
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
    material : (4,) array_like of float, optional
        Ambient, diffuse and specular factor and the shininess of a light at the eye, see `shading.blinn_phong`: every
        colour is lit where it is met, in the volume and on isosurfaces. Without: colours as they are.
    tolerance : float
        Largest absolute error of a component by quadrature, and of a spline by its cubics (see the notes),
        1e-13 to 1e-2, with a material from 1e-12 on; rounding (about 1e-14 times the number of cells on the ray)
        comes on top.
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
    CapacityError
        If the light of a ray is not known to within the tolerance, because the gradient vanishes along it.

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

    With a material c(f) is replaced by :math:`c(f)\,(k_a + k_d q) + k_s q^m`, :math:`q = |n \cdot d|`, with the
    direction d of the ray and the unit gradient n that the renderers light by. Of the trilinear interpolant it is
    that of the samples' slopes: central differences, one-sided at the volume's faces and beside samples that are
    not finite, 0 between two such, interpolated trilinearly, then turned to world space. Of a spline it is
    its own gradient. Where it is 0, so is q, as the ray caster has it (what has no normal in the A-buffer keeps
    its colour). Opacity does not change. The tolerance holds by verification at points, half of it for
    quadrature, half for where the gradient vanishes, see `lit_panels`. Of a spline's isosurface the crossing, and
    with it the normal, moves by the difference between cubic and spline over the slope.
    """
    tracer = ReferenceTracer.build(
        volume,
        transfer_function,
        reconstruction=reconstruction,
        material=material,
        tolerance=tolerance,
        panels=panels,
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
    material: F64 | None = None
    tolerance: float = DEFAULT_TOLERANCE

    @classmethod
    def build(
        cls,
        volume: Volume,
        transfer_function: TransferFunction,
        *,
        reconstruction: Reconstruction = Reconstruction.TRILINEAR,
        material: npt.ArrayLike | None = None,
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
        lit = None if material is None else checked_material(material, tolerance)
        base = offset_of(*volume.value_range)
        bands = BandTable.from_transfer_function(transfer_function, base)
        index_from_world = np.asarray(np.linalg.inv(volume.world_from_index), dtype=np.float64)
        if not reconstruction.smooth:
            from isosample.integral.cell_grid import CellGrid

            grid = CellGrid.build(volume, base, bands)
            optics = Optics(bands, rules, int(panels))
            return cls(grid, index_from_world, optics, material=lit, tolerance=tolerance)
        from isosample.integral.spline_grid import SplineGrid
        from isosample.integral.spline_panels import Accuracy

        half = max(0.5 * tolerance, SMALLEST_TOLERANCE)
        optics = Optics(bands, PanelRules.for_tolerance(half), int(panels))
        low, high = volume.value_range
        scales = (2.0 * volume.box.radius, high - low or 1.0)
        spline = SplineGrid.build(GridSpline.build(volume, reconstruction), base, bands)
        brightest = 1.0 if lit is None else max(1.0, float(lit[:3].sum()))
        accuracy = Accuracy.build(bands, scales, half, int(panels), brightest)
        return cls(spline, index_from_world, optics, accuracy, lit, tolerance)

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
        grid: Any = self.grid  # each kernel is compiled for its own kind, and for light apart
        light = self._light()
        if self.accuracy is None:
            from isosample.integral.ray_cells import integrate_ray_block

            integrate_ray_block(grid, self.optics, rays, rgba, counts, light)
        else:
            from isosample.integral.spline_march import integrate_spline_block

            integrate_spline_block(grid, self.optics, self.accuracy, rays, rgba, counts, light)
        if light is not None:
            check_resolved(light, rays)

    def _light(self) -> CellLight | None:
        """Light for one thread, which writes into it."""
        if self.material is None:
            return None
        from isosample.integral.cell_light import CellLight

        kernel = getattr(self.grid, "kernel", None)
        tolerance = self.tolerance if kernel is None else 0.5 * self.tolerance  # cubics have the other half
        return CellLight.build(self.material, self.index_from_world, tolerance, kernel)


def check_resolved(light: CellLight, rays: tuple[F64, F64, F64]) -> None:
    """Raise `CapacityError` where more than half the tolerance is left unresolved on one of the rays."""
    from isosample.integral.cell_light import WORST, WORST_RAY

    worst, ray = light.numbers[WORST], int(light.numbers[WORST_RAY])
    if worst > light.allowed:
        raise CapacityError(
            f"the light along the ray from {rays[0][ray].tolist()} towards {rays[1][ray].tolist()} [sample indices] is "
            f"known to within {worst:.1e} only, as the gradient vanishes there; half of the tolerance, "
            f"{light.allowed:.1e}, may be left. Ask for a larger tolerance, or move the camera a little."
        )


def checked_material(material: npt.ArrayLike, tolerance: float) -> F64:
    """(4,) float64, finite and >= 0, or an `InputError`; also where light cannot be known so well."""
    if tolerance < LEAST_LIT_TOLERANCE:
        raise InputError(
            f"tolerance {tolerance!r} is below {LEAST_LIT_TOLERANCE:g}: rounding leaves no more of light. Give that."
        )
    numbers = at_least_zero(last_axis(material, "material", 4), "material")
    if numbers.shape != (4,):
        raise InputError(f"material has shape {numbers.shape}; expected (4,). Give one material.")
    return numbers


def offset_of(low: float, high: float) -> float:
    """What to subtract from values so that rounding is relative to their range; 0 where 0 is near them."""
    return 0.5 * low + 0.5 * high if max(low, -high) > high - low else 0.0


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

"""Where rays cross the isosurfaces of a grid, exactly: no mesh, only the reconstruction of the samples.

>>> lists = grid_crossings(volume, isovalues, origins, directions, reconstruction=Reconstruction.CUBIC)
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from isosample.errors import InputError
from isosample.integral.box_rays import box_intervals, checked_rays, rays_in_index
from isosample.integral.crossing_lists import CrossingLists
from isosample.integral.reference import offset_of, run_in_blocks
from isosample.volume.reconstruction import GridSpline, Reconstruction

if TYPE_CHECKING:
    import numpy.typing as npt

    from isosample.integral.cell_grid import CellGrid
    from isosample.integral.crossing_rows import CrossingRows, Levels
    from isosample.integral.reference import Progress
    from isosample.integral.spline_grid import SplineGrid
    from isosample.volume.grid import Volume

    F64 = npt.NDArray[np.float64]
    I64 = npt.NDArray[np.int64]

ROWS_PER_RAY = 16  # room at first; a block of rays that needs more is done again


def grid_crossings(
    volume: Volume,
    isovalues: npt.ArrayLike,
    origins: npt.ArrayLike,
    directions: npt.ArrayLike,
    *,
    reconstruction: Reconstruction = Reconstruction.TRILINEAR,
    progress: Progress | None = None,
) -> CrossingLists:
    """Crossings of rays with the isosurfaces of a volume, and where the rays enter and leave it.

    Parameters
    ----------
    volume : Volume
        At least two samples along every axis. Of the trilinear interpolant, a cell with a corner that is not
        finite is no part of the field: a ray leaves where it begins and enters where it ends. A spline needs
        finite samples.
    isovalues : (K,) array_like of float
        Ascending [data units].
    origins, directions : (N, 3) array_like of float
        World space, directions of unit length.
    reconstruction : Reconstruction
    progress : callable, optional
        Called with the number of rays done and of all rays.

    Returns
    -------
    lists : CrossingLists
        Of the whole chords, also behind the origins (distances below 0). Residuals and tolerances are 0, slopes
        are those of the field.

    Raises
    ------
    InputError
        If an array has another shape, a number is not finite, a direction is not of unit length, isovalues do
        not ascend, the volume is thinner than two samples, or it has no such reconstruction.

    Notes
    -----
    Along a ray the field of a cell is a polynomial in Bernstein form, of degree 3 or, for a spline, 9. It is
    halved until a piece reaches no isovalue or is monotone, by its coefficients; roots are then good to rounding
    over slope. A value equal to an isovalue is inside; an isovalue that is touched and not passed is no crossing.
    Where the field begins on an isovalue it begins inside. Crossings along a ray continue each other: from the
    band of the value on entry every step leads to a neighbouring band, and at last to that of the value on
    leaving.
    """
    levels = _levels(volume, isovalues)
    grid = _grid(volume, levels.base, reconstruction)
    starts, ways = checked_rays(origins, directions)
    last = np.array(volume.array.shape[::-1]) - 1.0
    matrix = np.asarray(np.linalg.inv(volume.world_from_index), dtype=np.float64)
    o, d = rays_in_index(matrix, last, starts, ways)
    intervals = box_intervals(o, d, last, nearest=-np.inf)
    blocks: dict[int, tuple[I64, CrossingRows]] = {}

    def work(rows: slice) -> None:
        blocks[rows.start] = _block(grid, levels, (o[rows], d[rows], intervals[rows]))

    run_in_blocks(work, len(o), progress)
    return _joined([blocks[start] for start in sorted(blocks)])


def _levels(volume: Volume, isovalues: npt.ArrayLike) -> Levels:
    """Isovalues to compare with, or an `InputError`."""
    from isosample.integral.crossing_rows import Levels

    values = np.array(isovalues, dtype=np.float64)
    if values.ndim != 1 or not np.isfinite(values).all() or (np.diff(values) <= 0).any():
        raise InputError(f"isovalues {isovalues!r} must be finite numbers that ascend.")
    base = offset_of(*volume.value_range)
    return Levels(values, np.concatenate([[-np.inf], values - base, [np.inf]]), base)


def _grid(volume: Volume, base: float, reconstruction: Reconstruction) -> CellGrid | SplineGrid:
    """The field as the kernels read it; every block of cells is looked at."""
    if min(volume.size_xyz) < 2:
        raise InputError(
            f"{volume.name} has {volume.size_xyz} samples (x, y, z); a cell needs two along every axis."
        )
    if reconstruction.smooth:
        from isosample.integral.spline_grid import SplineGrid

        return SplineGrid.whole(GridSpline.build(volume, reconstruction), base)
    from isosample.integral.cell_grid import CellGrid

    return CellGrid.whole(volume, base)


def _block(
    grid: CellGrid | SplineGrid, levels: Levels, rays: tuple[F64, F64, F64]
) -> tuple[I64, CrossingRows]:
    """First rows of the rays of a block, and its rows."""
    from isosample.integral.cell_grid import CellGrid
    from isosample.integral.crossing_kernels import cross_spline_rays, cross_trilinear_rays

    kernel: Any = cross_trilinear_rays if isinstance(grid, CellGrid) else cross_spline_rays
    first = np.zeros(len(rays[0]) + 1, dtype=np.int64)
    rows = _empty_rows(ROWS_PER_RAY * len(rays[0]))
    kernel(grid, levels, rays, first, rows)
    if first[-1] > len(rows.distance):
        rows = _empty_rows(int(first[-1]))
        kernel(grid, levels, rays, first, rows)
    return first, rows


def _empty_rows(count: int) -> CrossingRows:
    from isosample.integral.crossing_rows import CrossingRows

    return CrossingRows(
        used=np.zeros(1, dtype=np.int64),
        distance=np.empty(count),
        level=np.empty(count, dtype=np.int64),
        rising=np.empty(count, dtype=np.bool_),
        slope=np.empty(count),
        value=np.empty(count),
        cell=np.empty(count, dtype=np.int64),
    )


def _joined(blocks: list[tuple[I64, CrossingRows]]) -> CrossingLists:
    """The lists of all blocks, one after the other."""
    counts = [np.diff(first) for first, _ in blocks]
    first = np.concatenate([[0], *counts]).cumsum()
    exact = np.zeros(int(first[-1]))

    def column(name: str, dtype: Any) -> Any:
        parts = [getattr(rows, name)[: begin[-1]] for begin, rows in blocks]
        return np.concatenate(parts) if parts else np.empty(0, dtype=dtype)

    return CrossingLists(
        first=first.astype(np.int64),
        distance=column("distance", np.float64),
        level=column("level", np.int64),
        rising=column("rising", np.bool_),
        slope=column("slope", np.float64),
        residual=exact,
        value=column("value", np.float64),
        tolerance=exact.copy(),
    )

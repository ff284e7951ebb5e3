"""The samples of one brick, made ready for extraction: float64, differentiated, non-finite ones masked."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

if TYPE_CHECKING:
    from isosample.volume.bricks import Brick
    from isosample.volume.grid import F64, Volume
    from isosample.volume.reconstruction import GridSpline

NO_KERNEL = np.zeros((4, 4))
NO_KERNEL.setflags(write=False)
NO_GRADIENTS = np.zeros((0, 0, 0, 3))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class BrickSamples:
    """What the kernels need of one brick, for every isovalue.

    Attributes
    ----------
    values : (Z, Y, X) float64
        The field at the samples in data units, all finite (any number stands where a sample is masked).
    gradients : (Z, Y, X, 3) float64
        Derivative per sample step along x, y, z at the samples [data units / voxel]; empty with a smooth
        reconstruction, which knows its gradient everywhere.
    usable_cells : (Z - 1, Y - 1, X - 1) bool or None
        Cells whose eight corners are all samples, not masked; None = all.
    coefficients : (…) float64
        Of the trilinear field: the brick's samples with one more on each side, NaN outside the volume and
        where masked. Of a smooth one: those of the spline, of the whole volume.
    kernel : (4, 4) float64
        The kernel of the spline.
    smooth : bool
        Which of the two it is.
    origin : (3,) float64
        Added to the brick's own index coordinates it gives those of the coefficients.
    """

    values: F64
    gradients: F64
    usable_cells: npt.NDArray[np.bool_] | None
    coefficients: F64
    kernel: F64
    smooth: bool
    origin: F64


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
    gradients = np.stack([_difference(padded, 2 - axis) for axis in range(3)], axis=-1)
    padded.setflags(write=False)
    finite = np.isfinite(core)
    usable: npt.NDArray[np.bool_] | None = None
    if not finite.all():
        usable = finite[:-1] & finite[1:]
        usable = usable[:, :-1] & usable[:, 1:]
        usable = usable[:, :, :-1] & usable[:, :, 1:]
    return BrickSamples(
        values=np.ascontiguousarray(core) if usable is None else np.where(finite, core, 0.0),
        gradients=gradients,
        usable_cells=usable,
        coefficients=padded,
        kernel=NO_KERNEL,
        smooth=False,
        origin=np.zeros(3),
    )


def spline_brick(nodes: Volume, spline: GridSpline, brick: Brick) -> BrickSamples:
    """Return one brick of a smooth reconstruction, given also at the samples (`nodes`), all finite."""
    return BrickSamples(
        values=np.ascontiguousarray(nodes.array[brick.slices], dtype=np.float64),
        gradients=NO_GRADIENTS,
        usable_cells=None,
        coefficients=spline.coefficients,
        kernel=spline.kernel,
        smooth=True,
        origin=np.array(brick.start, dtype=np.float64),
    )


def gradients_at(brick: BrickSamples, positions: F64) -> F64:
    """(N, 3) float64, gradients at places in the brick's coordinates: the spline's, or interpolated differences."""
    from isosample.surfaces.field_kernels import vertex_gradients

    found = np.empty_like(positions)
    vertex_gradients(
        brick.coefficients, brick.kernel, brick.smooth, brick.origin, brick.gradients, positions, found
    )
    return found


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

"""The samples of one brick, made ready for extraction: float64, differentiated, non-finite ones masked."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

if TYPE_CHECKING:
    from isosample.volume.bricks import Brick
    from isosample.volume.grid import F64, Volume


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class BrickSamples:
    """What the kernel needs of one brick, for every isovalue.

    Attributes
    ----------
    values : (Z, Y, X) float64
        Samples in data units, all finite (any number stands where a sample is masked).
    gradients : (Z · Y · X, 3) float64
        Derivative per sample step along x, y, z at the samples [data units / voxel].
    usable_cells : (Z - 1, Y - 1, X - 1) bool or None
        Cells whose eight corners are all samples, not masked; None = all.
    """

    values: F64
    gradients: F64
    usable_cells: npt.NDArray[np.bool_] | None


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

"""The trilinear field in one cell of the grid, in float64, and the slopes of the samples that it interpolates.

Twin of ``shaders/lib/trilinear.glsl``.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    import numpy.typing as npt

    from isosample.volume.grid import F64


def trilinear(low: npt.ArrayLike, high: npt.ArrayLike, fraction: npt.ArrayLike) -> F64:
    """Interpolation of the eight samples around a place.

    Parameters
    ----------
    low, high : (..., 4) array_like of float
        Samples of one z and of the next; x runs first, then y.
    fraction : (..., 3) array_like of float
        Sample steps along x, y, z behind the first sample; beyond [0, 1] the cell's polynomial is continued.

    Returns
    -------
    value : (...) float64
    """
    u, v, w = (np.asarray(fraction, dtype=np.float64)[..., axis] for axis in range(3))
    between = (1.0 - w)[..., None] * np.asarray(low) + w[..., None] * np.asarray(high)
    front = (1.0 - u) * between[..., 0] + u * between[..., 1]
    back = (1.0 - u) * between[..., 2] + u * between[..., 3]
    value: F64 = (1.0 - v) * front + v * back
    return value


def sample_slopes(behind: npt.ArrayLike, here: npt.ArrayLike, ahead: npt.ArrayLike, limit: float) -> F64:
    """Central differences at samples, with their neighbours on either side.

    Parameters
    ----------
    behind, here, ahead : (...) array_like of float
        Three samples in a row.
    limit : float
        A neighbour above it is not there: the difference is one-sided, or 0 between two such.

    Returns
    -------
    slopes : (...) float64
        Per sample step.
    """
    before, at, after = (np.asarray(part, dtype=np.float64) for part in (behind, here, ahead))
    no_back, no_front = before > limit, after > limit
    steps = 2.0 - no_back - no_front
    slopes: F64 = (np.where(no_front, at, after) - np.where(no_back, at, before)) / np.maximum(steps, 1.0)
    return slopes

"""Smooth reconstructions on a face of the box, in float64: a bicubic of 4 × 4 coefficients.

Twin of ``shaders/lib/spline.glsl``.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    import numpy.typing as npt

    from isosample.volume.grid import F64


def tap_weights(kernel: npt.ArrayLike, u: npt.ArrayLike) -> F64:
    """Weights of the four taps at the fraction `u`.

    Parameters
    ----------
    kernel : (4, 4) array_like of float
        Weight `m` is the cubic Σ_n kernel[m, n] uⁿ.
    u : (...) array_like of float
        In [0, 1].

    Returns
    -------
    weights : (..., 4) float64
    """
    part = np.asarray(u, dtype=np.float64)
    powers = np.stack([np.ones_like(part), part, part * part, part * part * part], axis=-1)
    weights: F64 = powers @ np.asarray(kernel, dtype=np.float64).T
    return weights


def spline_face_value(taps: npt.ArrayLike, weights_u: npt.ArrayLike, weights_v: npt.ArrayLike) -> F64:
    """The bicubic.

    Parameters
    ----------
    taps : (..., 4, 4) array_like of float
        Coefficients; the last axis runs along u.
    weights_u, weights_v : (..., 4) array_like of float
        From `tap_weights`.

    Returns
    -------
    value : (...) float64
    """
    rows = (np.asarray(taps, dtype=np.float64) * np.asarray(weights_u)[..., None, :]).sum(axis=-1)
    value: F64 = (rows * np.asarray(weights_v)).sum(axis=-1)
    return value


def largest_bend(row: npt.ArrayLike) -> F64:
    """Larger one of the two second differences of four numbers, (..., 4) to (...) float64."""
    bend: F64 = np.abs(np.diff(np.asarray(row, dtype=np.float64), 2, axis=-1)).max(axis=-1)
    return bend


def spline_face_tolerance(taps: npt.ArrayLike) -> F64:
    """Largest difference between the bicubic and what the mesh's outline on the face stands for.

    Parameters
    ----------
    taps : (..., 4, 4) array_like of float
        Coefficients [normalised value].

    Returns
    -------
    tolerance : (...) float64
        [normalised value]

    Notes
    -----
    The outline is a chord of the isoline. Over a cell the bicubic leaves the straight line between two points by an
    eighth of its second difference along each axis and a quarter of the mixed difference; the rest is for the
    rasteriser and for rounding, as in `ray.face_tolerance`.
    """
    c = np.asarray(taps, dtype=np.float64)
    bend = largest_bend(c).max(axis=-1) + largest_bend(np.swapaxes(c, -1, -2)).max(axis=-1)
    mixed = np.abs(c[..., 1, 1] - c[..., 1, 2] - c[..., 2, 1] + c[..., 2, 2])
    extent = c.max(axis=(-1, -2)) - c.min(axis=(-1, -2))
    tolerance: F64 = 0.125 * bend + 0.25 * mixed + 0.02 * extent + 1e-5
    return tolerance

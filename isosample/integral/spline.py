"""Smooth reconstructions in float64: cubics of four coefficients along every axis, and their bicubic on a face.

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


def tap_slopes(kernel: npt.ArrayLike, u: npt.ArrayLike) -> F64:
    """Derivatives of the weights of `tap_weights` with respect to the fraction; (..., 4) float64."""
    part = np.asarray(u, dtype=np.float64)
    powers = np.stack([np.ones_like(part), 2.0 * part, 3.0 * part * part], axis=-1)
    slopes: F64 = powers @ np.asarray(kernel, dtype=np.float64)[:, 1:].T
    return slopes


def paired_taps(weights: npt.ArrayLike) -> F64:
    """Two taps of one sign side by side as one linear fetch.

    Parameters
    ----------
    weights : (..., 2) array_like of float
        Both >= 0 or both <= 0.

    Returns
    -------
    pair : (..., 2) float64
        Weight of the fetch, and how far it lies from the first tap to the second, in [0, 1]; 0 without weight.
    """
    first, second = np.moveaxis(np.asarray(weights, dtype=np.float64), -1, 0)
    total = first + second
    part = np.divide(second, total, out=np.zeros_like(total), where=total != 0.0)
    return np.stack([total, part], axis=-1)


def weighed_quad(quad: npt.ArrayLike, weights_x: npt.ArrayLike, weights_y: npt.ArrayLike) -> F64:
    """Weighted sum of four coefficients (..., 4), x running first, then y, with weights (..., 2); (...) float64."""
    four = np.asarray(quad, dtype=np.float64)
    square = four.reshape(*four.shape[:-1], 2, 2)
    rows = (square * np.asarray(weights_x)[..., None, :]).sum(axis=-1)
    total: F64 = (rows * np.asarray(weights_y)).sum(axis=-1)
    return total


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

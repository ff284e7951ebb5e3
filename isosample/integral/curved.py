"""From a point on a triangle to the curved isosurface through its vertices, in float64.

Twin of ``shaders/lib/curved.glsl``.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    import numpy.typing as npt

    from isosample.volume.grid import F64

LEAST_INCLINE = 0.15  # smallest cosine between ray and gradient that a shift is computed with


def curved_error(gradient: npt.ArrayLike, position: npt.ArrayLike, moment: npt.ArrayLike) -> F64:
    """How far the field at a point of a triangle is from the isovalue of its vertices.

    Parameters
    ----------
    gradient : (..., 3) array_like of float
        Gradients at the vertices, interpolated to the point [value / world].
    position : (..., 3) array_like of float
        The point [world].
    moment : (...) array_like of float
        Products gradient · position at the vertices, interpolated to the point [value].

    Returns
    -------
    error : (...) float64
        f(p) − isovalue, exact for quadratic fields and to third order for others [value].

    Notes
    -----
    About vertex i, f(p) = v + g_i · (p − p_i) + ½ (p − p_i)ᵀ H (p − p_i) + O(h³). Weighted by the barycentric
    coordinates w_i, the first sum is G · p − s. In it g_i differs from the gradient at p by −H (p − p_i), and
    Σ w_i (p − p_i) = 0, so that the first sum is −Σ w_i (p − p_i)ᵀ H (p − p_i): minus twice the second sum.
    Half of the first sum is thus f(p) − v, with the sign of G · p − s.
    """
    g, p = np.asarray(gradient, dtype=np.float64), np.asarray(position, dtype=np.float64)
    error: F64 = 0.5 * ((g * p).sum(axis=-1) - np.asarray(moment, dtype=np.float64))
    return error


def curved_shift(
    error: npt.ArrayLike,
    along: npt.ArrayLike,
    steepness: npt.ArrayLike,
    limit: npt.ArrayLike,
    rising: npt.ArrayLike,
) -> F64:
    """Way along the ray to the isosurface: one Newton step.

    Parameters
    ----------
    error : (...) array_like of float
        f(p) − isovalue [value].
    along, steepness : (...) array_like of float
        The gradient's component along the ray, and its length [value / world].
    limit : (...) array_like of float
        Largest way in either direction [world].
    rising : (...) array_like of bool
        Whether the value rises along the ray where it crosses the triangle.

    Returns
    -------
    shift : (...) float64
        [world]; a ray that grazes the surface is treated as one with a cosine of 0.15 to the gradient. 0 where the
        gradient says otherwise than the triangle whether the value rises: near an outline the step would lead to the
        ray's other crossing with the surface, and past it, so that the two would stand in the wrong order.
    """
    up = np.asarray(rising)
    incline = np.where(up, along, -np.asarray(along, dtype=np.float64))
    slope = np.maximum(np.maximum(incline, LEAST_INCLINE * np.asarray(steepness)), 1e-30)
    signed = np.where(up, -np.asarray(error, dtype=np.float64), error)
    step = np.clip(signed / slope, -np.asarray(limit), np.asarray(limit))
    return np.where(incline > 0.0, step, 0.0)

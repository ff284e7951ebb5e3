"""Rays of the picture and their interval in the volume's box, in float64.

Twin of ``shaders/lib/ray.glsl``.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from isosample.errors import InputError
from isosample.integral.checks import last_axis, within

if TYPE_CHECKING:
    import numpy.typing as npt

    from isosample.volume.grid import F64

MISS = (1.0, -1.0)  # the empty interval


def image_plane_position(pixel: npt.ArrayLike, image_size: npt.ArrayLike) -> F64:
    """Position of pixel centres on the image plane.

    Parameters
    ----------
    pixel : (..., 2) array_like of int
        Column (to the right) and row (upwards).
    image_size : (..., 2) array_like of int
        Width and height [pixels], >= 1.

    Returns
    -------
    position : (..., 2) float64
        −1 at the left and lower border of the image, 1 at the right and upper one; centres are at i + ½.

    Raises
    ------
    InputError
        If a last axis is not 2 long or an image has no pixel.
    """
    size = last_axis(image_size, "image_size", 2)
    if not (size >= 1).all():
        raise InputError(f"image_size has a side of {size.min():g} pixels; expected 1 or more.")
    centre = last_axis(pixel, "pixel", 2) + 0.5
    position: F64 = (2.0 * centre - size) / size
    return position


def slab_interval(origin: npt.ArrayLike, direction: npt.ArrayLike) -> F64:
    """Interval of the ray parameter t inside the slab 0 <= origin + t direction <= 1.

    Parameters
    ----------
    origin, direction : (...) array_like of float
        One coordinate of the ray in the box's own frame, where the box is [0, 1].

    Returns
    -------
    interval : (..., 2) float64
        First and last t; (−inf, inf) for a ray that stays inside (±1e30 in the shader), ``MISS`` for one that
        stays outside.

    Raises
    ------
    InputError
        If a number is not finite.
    """
    limit = np.finfo(np.float64).max
    start = within(origin, "origin", -limit, limit, "finite")
    slope = within(direction, "direction", -limit, limit, "finite")
    start, slope = np.broadcast_arrays(start, slope)
    parallel = np.asarray(slope == 0.0)
    divisor = np.where(parallel, 1.0, slope)
    with np.errstate(over="ignore"):  # a crossing beyond the largest number is infinitely far
        crossings = np.stack([-start / divisor, (1.0 - start) / divisor], axis=-1)
    inside = np.asarray((start >= 0.0) & (start <= 1.0))
    unlimited = np.where(inside[..., None], (-np.inf, np.inf), MISS)
    return np.where(parallel[..., None], unlimited, np.sort(crossings, axis=-1))


def box_interval(origin: npt.ArrayLike, direction: npt.ArrayLike) -> F64:
    """Interval of the ray parameter inside the unit box.

    Parameters
    ----------
    origin, direction : (..., 3) array_like of float
        The ray in the box's own frame (x, y, z), where the box is [0, 1] along each axis.

    Returns
    -------
    interval : (..., 2) float64
        First and last t; the first is not below the last where the ray misses the box or only touches it.

    Raises
    ------
    InputError
        If a last axis is not 3 long or a number is not finite.

    References
    ----------
    .. [1] T. Kay and J. Kajiya, "Ray tracing complex scenes", SIGGRAPH 1986.
    """
    slabs = slab_interval(last_axis(origin, "origin", 3), last_axis(direction, "direction", 3))
    common = np.stack([slabs[..., 0].max(axis=-1), slabs[..., 1].min(axis=-1)], axis=-1)
    missed = np.asarray((slabs[..., 0] > slabs[..., 1]).any(axis=-1))
    return np.where(missed[..., None], MISS, common)


def nearest_face(unit: npt.ArrayLike) -> npt.NDArray[np.int32]:
    """Face of the unit box nearest to a point on its surface.

    Parameters
    ----------
    unit : (..., 3) array_like of float
        Point (x, y, z) in the box's own frame.

    Returns
    -------
    face : (...) int32
        2 axis + side, where side is 0 at coordinate 0 and 1 at coordinate 1; of equally near faces the first.

    Raises
    ------
    InputError
        If the last axis is not 3 long.
    """
    point = last_axis(unit, "unit", 3)
    distances = np.stack([np.abs(point), np.abs(1.0 - point)], axis=-1)
    face: npt.NDArray[np.int32] = distances.reshape(*point.shape[:-1], 6).argmin(axis=-1).astype(np.int32)
    return face


def bilinear(corners: npt.ArrayLike, u: npt.ArrayLike, v: npt.ArrayLike) -> F64:
    """Bilinear interpolation of the four corners of a face cell.

    Parameters
    ----------
    corners : (..., 4) array_like of float
        Values at (u, v) = (0, 0), (1, 0), (0, 1), (1, 1).
    u, v : (...) array_like of float
        Place in the cell, in [0, 1].

    Returns
    -------
    value : (...) float64
        In the unit of the corners.

    Raises
    ------
    InputError
        If the last axis of `corners` is not 4 long, or a place is outside [0, 1].
    """
    values = last_axis(corners, "corners", 4)
    right, up = within(u, "u", 0.0, 1.0), within(v, "v", 0.0, 1.0)
    low = values[..., 0] * (1.0 - right) + values[..., 1] * right
    high = values[..., 2] * (1.0 - right) + values[..., 3] * right
    value: F64 = low * (1.0 - up) + high * up
    return value


def face_tolerance(corners: npt.ArrayLike) -> F64:
    """Largest difference between the bilinear field on a face cell and what the mesh's outline on it stands for.

    Parameters
    ----------
    corners : (..., 4) array_like of float
        Normalised values at (0, 0), (1, 0), (0, 1), (1, 1).

    Returns
    -------
    tolerance : (...) float64
        A quarter of the mixed difference (the outline is a chord of a bilinear isoline), 2 % of the cell's range
        (the outline is rasterised), and 1e-5 (float32).

    Notes
    -----
    Twin: ``shaders/lib/ray.glsl``.
    """
    values = last_axis(corners, "corners", 4)
    mixed = np.abs(values[..., 0] - values[..., 1] - values[..., 2] + values[..., 3])
    tolerance: F64 = 0.25 * mixed + 0.02 * np.ptp(values, axis=-1) + 1e-5
    return tolerance

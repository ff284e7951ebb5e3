"""Where the samples of a ray lie; float64 twin of ``shaders/lib/sampling.glsl``.

Source: Knoll et al. 2009, "Volume ray casting with peak finding and differential sampling", section 5.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

F64 = npt.NDArray[np.float64]


def direction_differential(direction: npt.ArrayLike, right: npt.ArrayLike) -> F64:
    """Length of the derivative of rays' unit directions by the image plane's coordinate x (eq. 10).

    Parameters
    ----------
    direction : (..., 3) array_like of float
        Directions before they were made unit vectors: those of eq. 7.
    right : (..., 3) array_like of float
        The image plane's vector along x.

    Returns
    -------
    differential : (...) float64
        Unitless, >= 0.
    """
    d, u = np.asarray(direction, dtype=np.float64), np.asarray(right, dtype=np.float64)
    squared = np.sum(d * d, axis=-1)
    numerator = squared[..., None] * u - np.sum(d * u, axis=-1)[..., None] * d
    differential: F64 = np.linalg.norm(numerator, axis=-1) / squared**1.5
    return differential


def sample_distance(first: npt.ArrayLike, growth: npt.ArrayLike, number: npt.ArrayLike) -> F64:
    """Distance of a sample along its ray: T(x) of eq. 15, with T(0) = 0.

    Parameters
    ----------
    first, growth : (...) array_like of float
        First step b and growth a of the steps [world], b > 0, a >= 0.
    number : (...) array_like of float
        The sample's number x.
    """
    b, a, x = (np.asarray(part, dtype=np.float64) for part in (first, growth, number))
    distance: F64 = 0.5 * a * x * x + b * x
    return distance


def sample_number(first: npt.ArrayLike, growth: npt.ArrayLike, distance: npt.ArrayLike) -> F64:
    """Number x of the sample at a distance >= 0: the root of eq. 18; parameters as `sample_distance`."""
    b, a, t = (np.asarray(part, dtype=np.float64) for part in (first, growth, distance))
    number: F64 = 2.0 * t / (b + np.sqrt(b * b + 2.0 * a * t))
    return number


def pixel_noise(pixel: npt.ArrayLike, seed: npt.ArrayLike) -> F64:
    """Numbers in [0, 1), one for every pixel and seed (O'Neill 2014, PCG, output function RXS-M-XS).

    Parameters
    ----------
    pixel : (..., 2) array_like of int
    seed : (...) array_like of int
        0 to 2**32 - 1.
    """
    place = np.asarray(pixel, dtype=np.uint32)
    increment, factor = np.uint32(2891336453), np.uint32(747796405)
    with np.errstate(over="ignore"):
        state = np.asarray(seed, dtype=np.uint32) + place[..., 0] * factor + place[..., 1] * increment
        for _ in range(2):
            state = state * factor + increment
            state = ((state >> ((state >> np.uint32(28)) + np.uint32(4))) ^ state) * np.uint32(277803737)
            state = (state >> np.uint32(22)) ^ state
    noise: F64 = (state >> np.uint32(8)) / 2.0**24
    return noise

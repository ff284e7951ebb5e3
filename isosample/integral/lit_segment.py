r"""The emission integral over a segment that is lit, in float64. Twin of ``shaders/lib/lit_segment.glsl``.

The value runs along a cubic (`segment`), and the gradient linearly from one end of the segment to the other. Both
are right to first order; where the value turns, at the middle of a hump, the gradient's part along the ray goes
through 0, and so does the light, which does not show at the two ends.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from isosample.integral.segment import SPENT, largest_depth, panel_count, panel_edge, segment_panel
from isosample.integral.shading import blinn_phong

if TYPE_CHECKING:
    from isosample.volume.grid import F64

LEAST_COSINE = 0.02  # of a gradient to the ray, where its length is told from the slope along the ray


def crossing_gradient(normal: F64, slope: float, direction: F64) -> F64:
    """Gradient at a crossing [value/world], from the slope along the ray, which is the gradient's part along it.

    Parameters
    ----------
    normal : (3,) float64
        Unit normal, or 0.
    slope : float
        df/dt [value/world], of either sign.
    direction : (3,) float64
        Unit direction of the ray.

    Returns
    -------
    gradient : (3,) float64
        Shorter than it is where the ray passes along the surface, with a cosine below 0.02: there the slope tells
        little of the length.
    """
    gradient: F64 = normal * (abs(slope) / max(abs(float(normal @ direction)), LEAST_COSINE))
    return gradient


def lit_moments(
    depths: tuple[float, float],
    ends: tuple[float, float],
    slopes: tuple[float, float],
    part: tuple[float, float],
    gradients: tuple[F64, F64],
    direction: F64,
    material: F64,
) -> F64:
    r"""Emission integrals over a part of a segment that is lit.

    Parameters
    ----------
    depths : (low, high)
        Extinction at the lower and upper end of the band, times the length of the whole segment, >= 0.
    ends, slopes : (front, back)
        The cubic, see `segment.cubic_moments`.
    part : (start, end)
        In [0, 1].
    gradients : two (3,) float64
        At the two ends of the segment, in any unit; 0 where there is none.
    direction : (3,) float64
        Unit direction of the ray.
    material : (4,) float64
        Ambient, diffuse and specular factor, and the shininess.

    Returns
    -------
    moments : (4,) float64
        Integrals of :math:`w\,\tau e^{-D}` for w = 1, s, s p and h: p is the position in the band, and
        :math:`s c + h` what light makes of a colour c (`shading.blinn_phong`). A colour that runs linearly from c_low
        to c_high over the band gives c_low (second − third) + c_high third + fourth.
    """
    width = part[1] - part[0]
    thickness = largest_depth(*depths, *ends, *slopes) * width
    count = panel_count(*ends, thickness)
    moments = np.zeros(4)
    through, left = 1.0, 0.0
    for number in range(count):
        right = panel_edge(number + 1, count, thickness)
        start, length = part[0] + width * left, width * (right - left)
        parts, positions, emitted, opacity = (
            np.array(found) for found in segment_panel(*depths, *ends, *slopes, start, length)
        )
        if emitted.sum() > 0.0:
            mixed = (1.0 - parts)[:, None] * gradients[0] + parts[:, None] * gradients[1]
            steepness = np.linalg.norm(mixed, axis=1, keepdims=True)
            normals = np.where(steepness > 0.0, mixed / np.where(steepness > 0.0, steepness, 1.0), 0.0)
            lit = blinn_phong([1.0, 0.0, 0.0], normals, direction, material)
            shade, highlight = lit[:, 0] - lit[:, 1], lit[:, 1]
            weights = through * opacity / emitted.sum() * emitted
            moments += [weights.sum(), weights @ shade, weights @ (shade * positions), weights @ highlight]
            through *= 1.0 - float(opacity)
        left = right
        if through < SPENT:
            break
    return moments

"""Blinn-Phong shading with a light at the eye, two-sided, in float64.

Twin of ``shaders/lib/shading.glsl``.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from isosample.integral.checks import at_least_zero, last_axis

if TYPE_CHECKING:
    import numpy.typing as npt

    from isosample.volume.grid import F64


def blinn_phong(
    straight: npt.ArrayLike, normal: npt.ArrayLike, direction: npt.ArrayLike, material: npt.ArrayLike
) -> F64:
    r"""Colour lit by a white light at the eye.

    Parameters
    ----------
    straight : (..., 3) array_like of float
        Linear RGB of the surface, not multiplied by opacity.
    normal : (..., 3) array_like of float
        Unit normal (x, y, z) of either sign.
    direction : (..., 3) array_like of float
        Unit direction of the ray (x, y, z).
    material : (..., 4) array_like of float
        Ambient, diffuse and specular factor, and the shininess exponent; each >= 0.

    Returns
    -------
    lit : (..., 3) float64
        Linear RGB; above 1 where ambient + diffuse + specular is.

    Raises
    ------
    InputError
        If a last axis has another length, or a material is negative or not finite.

    Notes
    -----
    With the light at the eye the half vector is the reversed ray, so with :math:`q = |n \cdot d|`
    :math:`C = c\,(k_a + k_d\,q) + k_s\,q^m`, after [1]_. Where q is 0 there is no highlight, even for m = 0.

    References
    ----------
    .. [1] J. Blinn, "Models of light reflection for computer synthesized pictures", SIGGRAPH 1977.
    """
    colour = last_axis(straight, "straight", 3)
    facing = last_axis(normal, "normal", 3) * last_axis(direction, "direction", 3)
    factors = at_least_zero(last_axis(material, "material", 4), "material")
    ambient, diffuse, specular, shininess = (factors[..., i : i + 1] for i in range(4))
    cosine = np.minimum(np.abs(facing.sum(axis=-1, keepdims=True)), 1.0)
    highlight = np.where(cosine > 0.0, cosine**shininess, 0.0)
    lit: F64 = colour * (ambient + diffuse * cosine) + specular * highlight
    return lit

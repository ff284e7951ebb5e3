"""Compositing of premultiplied linear RGBA in float64.

Twin of ``shaders/lib/compositing.glsl``.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from isosample.integral.checks import last_axis

if TYPE_CHECKING:
    import numpy.typing as npt

    from isosample.volume.grid import F64


def over(front: npt.ArrayLike, back: npt.ArrayLike) -> F64:
    r"""`front` composited over `back`.

    Parameters
    ----------
    front, back : (..., 4) array_like of float
        Premultiplied linear RGBA, unitless; the leading axes broadcast.

    Returns
    -------
    composited : (..., 4) float64
        Premultiplied linear RGBA.

    Raises
    ------
    InputError
        If a last axis is not 4 long.

    Notes
    -----
    :math:`C = C_f + (1 - \alpha_f)\,C_b`, the "over" operator of [1]_. Associative, not commutative.

    References
    ----------
    .. [1] T. Porter and T. Duff, "Compositing digital images", SIGGRAPH 1984.
    """
    near, far = last_axis(front, "front", 4), last_axis(back, "back", 4)
    composited: F64 = near + (1.0 - near[..., 3:]) * far
    return composited

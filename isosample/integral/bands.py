"""Values inside one band, between two neighbouring isovalues, in float64.

Twin of ``shaders/lib/bands.glsl``.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from isosample.integral.checks import at_least_zero

if TYPE_CHECKING:
    import numpy.typing as npt

    from isosample.volume.grid import F64


def band_position(value_low: npt.ArrayLike, inverse_width: npt.ArrayLike, value: npt.ArrayLike) -> F64:
    """Position of a value in its band: 0 at the lower end, 1 at the upper end.

    Parameters
    ----------
    value_low : (...) array_like of float
        Lower end of the band [normalised value].
    inverse_width : (...) array_like of float
        1 / (upper end − lower end), >= 0; 0 for an empty band, whose every value is at position 0.
    value : (...) array_like of float
        Value to be placed [normalised value].

    Returns
    -------
    position : (...) float64
        In [0, 1]; a value beside the band (of a face, where the surfaces overrule it) takes the nearer end.

    Raises
    ------
    InputError
        If an inverse width is negative or not finite.
    """
    inverse = at_least_zero(inverse_width, "inverse_width")
    offset = np.asarray(value, dtype=np.float64) - np.asarray(value_low, dtype=np.float64)
    return np.clip(offset * inverse, 0.0, 1.0)

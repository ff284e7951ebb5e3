"""Which values of a volume a transfer function shows."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

if TYPE_CHECKING:
    from isosample.transfer.transfer_function import TransferFunction

    F64 = npt.NDArray[np.float64]


def visible_intervals(transfer_function: TransferFunction, *, isosurfaces: bool) -> F64:
    """(N, 2) float64, closed intervals of data values with extinction, and isosurfaces as points if they are shown.

    Ascending by their lower ends; neighbouring slopes are one interval each. The end of a slope without extinction is
    left out: much of a volume may have just that value.
    """
    slopes = [
        (
            slope.low.value if slope.low.extinction > 0 else math.nextafter(slope.low.value, math.inf),
            slope.high.value if slope.high.extinction > 0 else math.nextafter(slope.high.value, -math.inf),
        )
        for slope in transfer_function.slopes()
        if slope.visible
    ]
    slopes = [(low, high) for low, high in slopes if low <= high]
    points = [(surface.value, surface.value) for surface in transfer_function.isosurfaces if isosurfaces]
    return np.array(sorted([*slopes, *points]), dtype=np.float64).reshape(-1, 2)

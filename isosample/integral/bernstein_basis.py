"""The Bernstein polynomials, for tables that are made once; what kernels need of them is in `bernstein`."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from isosample.volume.grid import F64


def bernstein_basis(x: F64, degree: int) -> F64:
    """(N, degree + 1) float64, the Bernstein polynomials of a degree at `x`."""
    columns = [math.comb(degree, i) * x**i * (1.0 - x) ** (degree - i) for i in range(degree + 1)]
    return np.stack(columns, axis=-1)

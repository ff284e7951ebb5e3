"""What a vertex can hold: places on multiples of 2⁻¹⁹ voxel, never at a sample, and gradients of 3 × 16 bits."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from isosample.volume.grid import F64

POSITION_STEPS = 2.0**19  # positions are multiples of 1/POSITION_STEPS [voxel]
SMALLEST_FRACTION = 2.0**-19  # a vertex keeps this distance from the samples [voxel]: no zero-area triangle
LARGEST_BRICK_CELLS = 32  # float32 holds multiples of 2**-19 exactly up to 32

MANTISSA_BITS = 15  # of a gradient's component, besides its sign
LARGEST_MANTISSA = 2**MANTISSA_BITS - 1
SMALLEST_EXPONENT = -126  # of a gradient: 2**(−126 − 15) is a float32, and −126 … 128 fit in a byte


def round_gradients(gradients: F64) -> F64:
    """Return gradients whose three components share one exponent: what a cache can keep exactly.

    Parameters
    ----------
    gradients : (N, 3) float64
        Finite, and within the range of float32.

    Returns
    -------
    rounded : (N, 3) float64
        m · 2**(e − 15) with integers abs(m) <= 32767 and, for each row, the smallest e in −126 … 128 such that no
        component exceeds 2**e. Exactly representable in float32; rounding twice changes nothing.

    Notes
    -----
    Components move by at most 2**-15 of the largest one: half a step where that is 16384 to 32767 steps, one step
    where it would be 32768. Below 2**-127 the error is 2**-142.
    """
    largest = np.abs(gradients).max(axis=1, keepdims=True, initial=0.0)
    _, exponent = np.frexp(largest)
    step = np.ldexp(1.0, np.maximum(exponent, SMALLEST_EXPONENT) - MANTISSA_BITS)
    mantissa = np.clip(np.rint(gradients / step), -LARGEST_MANTISSA, LARGEST_MANTISSA)
    rounded: F64 = mantissa * step + 0.0  # + 0.0: never −0
    return rounded

"""Sizes of pre-integration tables: their lengths, and the memory they may take."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from isosample.errors import CapacityError

F64 = npt.NDArray[np.float64]

LARGEST_TABLE_BYTES = 256 << 20
LAYERS_PER_OCTAVE, OCTAVES = 2, 6  # of a table of many lengths: from 1/64 of the base length to 64 times it
LAYERS = 2 * LAYERS_PER_OCTAVE * OCTAVES + 1


def layer_lengths(base: float) -> F64:
    """(LAYERS,) float64, lengths around `base` in equal ratios [world]."""
    octaves = np.linspace(-OCTAVES, OCTAVES, LAYERS)
    lengths: F64 = base * 2.0**octaves
    return lengths


def check_table(size: int, layers: int) -> None:
    """Raise CapacityError if a table of float32 RGBA takes more memory than `LARGEST_TABLE_BYTES`."""
    needed = 16 * size * size * layers
    if needed > LARGEST_TABLE_BYTES:
        most = math.isqrt(LARGEST_TABLE_BYTES // (16 * layers))
        raise CapacityError(
            f"a pre-integration table of {size} x {size} values and {layers} lengths takes {needed >> 20} MiB, "
            f"more than {LARGEST_TABLE_BYTES >> 20} MiB; use --table-size {most} or less."
        )

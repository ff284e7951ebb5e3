"""Pictures that commands leave behind, and a slab whose picture is known in closed form."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import numpy.typing as npt

from cli.harness import write_json

RENDER = "render blob.npy --tf tf.json --size 24x16"
EXTINCTION = 0.125
# Rounding of a constant medium: a few float32 operations on an optical depth below 2, where exp(-x) and its
# error are below 1; 16 roundings of 2**-24 are ample for the resolve pass of two crossings.
ROUNDING = 16 * 2.0**-24


def pixels(name: str = "out.npy") -> npt.NDArray[np.float32]:
    picture: npt.NDArray[np.float32] = np.load(name)
    return picture


def write_slab() -> None:
    """slab.npy: a ramp along x from 0 to 9 in a box of 9 x 8 x 7, and white.json: one extinction everywhere."""
    np.save("slab.npy", np.broadcast_to(np.arange(10, dtype=np.float32), (8, 9, 10)))
    ends = [{"value": value, "color": [1, 1, 1], "extinction": EXTINCTION} for value in (-1, 20)]
    write_json(Path("white.json"), {"points": ends})


def opacity_after(length: float) -> float:
    return -math.expm1(-EXTINCTION * length)

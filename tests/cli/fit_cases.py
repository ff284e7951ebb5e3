"""What the tests of `--fit` look at: a cube of ones in a corner of zeros."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

import isosample
from cli.harness import write_json

if TYPE_CHECKING:
    from pathlib import Path

SIZE = 60
WHITE = [1, 1, 1]
TENT: dict[str, Any] = {
    "points": [{"value": v, "color": WHITE, "extinction": e} for v, e in ((0.5, 0), (0.75, 2), (2, 2))]
}
FIRST, LAST = np.array([12, 3, 5]), np.array([17, 8, 10])  # samples (x, y, z) of a cube of ones, in a corner
RENDER = f"render cube.npy --tf tent.json --size {SIZE}x{SIZE} --fit visible"


def write_cube(folder: Path) -> isosample.Volume:
    """Write cube.npy, ones from `FIRST` to `LAST`, zeros elsewhere, and tent.json, which shows what is above 0.5."""
    samples = np.zeros((40, 25, 20), dtype=np.float32)
    samples[tuple(slice(a, b + 1) for a, b in zip(FIRST[::-1], LAST[::-1], strict=True))] = 1.0
    np.save(folder / "cube.npy", samples)
    write_json(folder / "tent.json", TENT)
    return isosample.Volume(samples)

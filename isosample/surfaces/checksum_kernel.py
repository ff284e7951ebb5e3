"""A checksum at the speed of memory: compiled."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from isosample.compiled import compiled

if TYPE_CHECKING:
    import numpy.typing as npt

    U64 = npt.NDArray[np.uint64]

LANES = 8
PRIME = np.uint64(0x9E3779B185EBCA87)
LEFT, RIGHT = np.uint64(31), np.uint64(33)


@compiled
def checksum(words: U64) -> np.uint64:
    """Return 64 bits that tell whether words have changed, of which there are a multiple of eight.

    Notes
    -----
    Each lane takes in every eighth word, by a step that is one-to-one in the word and in what the lane held: words
    that differ in one lane at one place always give another sum, and others do but for one in 2**64.
    """
    lanes = np.arange(LANES).astype(np.uint64)
    for first in range(0, len(words), LANES):
        for lane in range(LANES):
            mixed = lanes[lane] ^ words[first + lane]
            lanes[lane] = (mixed << LEFT | mixed >> RIGHT) * PRIME
    total = np.uint64(len(words))
    for lane in range(LANES):
        mixed = total ^ lanes[lane]
        total = (mixed << LEFT | mixed >> RIGHT) * PRIME
    return total

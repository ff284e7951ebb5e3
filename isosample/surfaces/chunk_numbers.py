"""Numbers that chunks are made of, for the kernels of either direction: vertices and triangles as small integers.

A vertex is named inside its chunk by a slot: class · (samples of the brick) + (linear index of its grid sample).
Classes 0, 1, 2 lie on the grid edge along that axis from the sample on, 3 and 4 in the cell that starts there; those
of class 4 carry the key that names them in the whole volume, the others have the key that follows from the slot.
"""

from __future__ import annotations

from isosample.compiled import compiled

STEPS = 2**19  # positions are multiples of 1/STEPS [voxel]
SPARE_BITS = 5  # three bytes hold a fraction and these
FRACTION_STEP = 2.0**-24
EXPLICIT = 4  # class of vertices whose key is stored
FREE = 3  # class of vertices inside cells
EDGE_NUMBERS = 13  # 12 edges of a cell and its inside
LOWEST_EXPONENT = 200  # of a gradient, with the sign turned
NEGATIVE_ZERO = -(2**15)  # the mantissa that stands for -0.0: others are less than 2^15 in size


@compiled
def shifted(mantissa: int, places: int) -> int:
    """Return mantissa · 2^places, cut at 16 places."""
    if places >= 0:
        return mantissa << min(places, 16)
    return mantissa >> min(-places, 16)


@compiled
def zigzag(value: int) -> int:
    """Small numbers of either sign as small numbers >= 0."""
    return (value << 1) ^ (value >> 63)


@compiled
def unzigzag(code: int) -> int:
    """Undo `zigzag`."""
    return (code >> 1) ^ -(code & 1)

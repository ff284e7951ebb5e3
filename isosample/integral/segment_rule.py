"""How the data runs between two neighbouring crossings of a ray."""

from __future__ import annotations

import enum


class SegmentRule(enum.Enum):
    """How the data runs between two neighbouring crossings of a ray.

    `CONSTANT` holds the front crossing's value with opacity 1 − exp(−τ h); `CONSTANT_FIRST_ORDER` is the same
    with opacity τ h, which is eq. 3 of Lindholm et al. as written; `LINEAR` interpolates between the two;
    `CUBIC` takes the slopes at the crossings into account too, see `segment`.
    """

    CONSTANT = "constant"
    CONSTANT_FIRST_ORDER = "constant-first-order"
    LINEAR = "linear"
    CUBIC = "cubic"

"""Data-centric integration over the exact crossings of a closed-form field: the segment rules without any mesh."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from isosample.integral.data_centric import BorderPoint, Crossing, integrate_ray
from isosample.integral.ray import box_interval

if TYPE_CHECKING:
    from isosample.integral.segment_rule import SegmentRule
    from isosample.transfer.isovalue_plan import IsovaluePlan
    from isosample.volume.field import Field
    from isosample.volume.grid import Box

F64 = npt.NDArray[np.float64]

SCAN_STEPS = 2000  # a pair of crossings closer than 1/2000 of the ray's way through the box is not seen
BISECTIONS = 45  # 2^-45 of a step is below the rounding of a distance


def integrate_exact_crossings(
    field: Field, plan: IsovaluePlan, box: Box, origins: F64, directions: F64, rule: SegmentRule
) -> F64:
    """Premultiplied RGBA of rays whose crossings with the isosurfaces are exact.

    Parameters
    ----------
    field : Field
    plan : IsovaluePlan
    box : Box
        The field is taken inside it.
    origins, directions : (N, 3) float64
        World space; directions are unit vectors.
    rule : SegmentRule
        How the data are taken to run between crossings.

    Returns
    -------
    rgba : (N, 4) float64

    Notes
    -----
    Crossings are found by a scan in even steps and bisection: what lies between two crossings closer than a
    step is missed, and weighs less than the step.
    """
    unit_from_world = np.linalg.inv(box.edges.T)
    inside = box_interval((origins - box.corner) @ unit_from_world.T, directions @ unit_from_world.T)
    rgba = np.zeros((len(origins), 4))
    for ray in np.flatnonzero(inside[:, 0] < inside[:, 1]):
        ends = (float(inside[ray, 0]), float(inside[ray, 1]))
        rgba[ray] = _integrate(field, plan, origins[ray], directions[ray], ends, rule)
    return rgba


def _integrate(
    field: Field,
    plan: IsovaluePlan,
    origin: F64,
    direction: F64,
    ends: tuple[float, float],
    rule: SegmentRule,
) -> F64:
    def value(t: F64) -> F64:
        return field.value(origin + t[:, None] * direction)

    t = np.linspace(*ends, SCAN_STEPS + 1)
    values = value(t)
    band = np.searchsorted(plan.isovalues, values, side="right")
    steps = np.flatnonzero(np.diff(band))
    starts, levels, rising = [], [], []
    for step in steps:
        low, high = sorted((int(band[step]), int(band[step + 1])))
        up = bool(band[step] < band[step + 1])
        for level in range(low, high) if up else range(high - 1, low - 1, -1):
            starts.append(step)
            levels.append(level)
            rising.append(up)
    crossings: list[Crossing] = []
    if starts:
        places = _bisect(value, plan.isovalues[levels], np.array(rising), t[starts], t[np.add(starts, 1)])
        crossings = [Crossing(*row) for row in zip(places.tolist(), levels, rising, strict=True)]
    entry, leave = (BorderPoint(end, float(values[i])) for end, i in zip(ends, (0, -1), strict=True))
    return integrate_ray(crossings, entry, leave, plan, rule)[0]


def _bisect(value: object, isovalues: F64, rising: npt.NDArray[np.bool_], low: F64, high: F64) -> F64:
    """Distances between `low` and `high` at which the field takes the isovalues."""
    assert callable(value)
    low, high = low.copy(), high.copy()
    for _ in range(BISECTIONS):
        middle = 0.5 * (low + high)
        beyond = (value(middle) >= isovalues) == rising
        high = np.where(beyond, middle, high)
        low = np.where(beyond, low, middle)
    return 0.5 * (low + high)

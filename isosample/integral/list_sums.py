"""Sums over the steps of many rays: the picture of their crossing lists."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from isosample.compiled import compiled
from isosample.integral.list_segments import composite, is_cut, level_light, segment_light, visible_part
from isosample.integral.list_spans import COUNTS_SIZE, REORDERED, STEPS, UNPLACED, VIOLATIONS
from isosample.integral.list_walk import FIRST_ROOM, LEVEL, STEP_SIZE, walk_ray

if TYPE_CHECKING:
    from isosample.integral.data_centric import Prepared

F64 = npt.NDArray[np.float64]
I64 = npt.NDArray[np.int64]


@compiled
def integrate_block(start: int, prepared: Prepared, rule: int, rgba: F64, totals: I64) -> None:
    """Integrate the rays from number `start` on, one per row of `rgba` (R, 4) and `totals` (R, 3)."""
    lists, levels, optics, visible = prepared
    steps, counts, light = (
        np.empty((FIRST_ROOM, STEP_SIZE)),
        np.empty(COUNTS_SIZE, dtype=np.int64),
        np.empty(4),
    )
    for row in range(len(rgba)):
        ray = start + row
        steps = walk_ray(lists, ray, levels, counts, steps)
        first, last = visible[ray, 0], visible[ray, 1]
        for i in range(counts[STEPS]):
            step = steps[i]
            segment_light(step, visible_part(step, first, last), rule, optics, light)
            composite(rgba[row], light)
            if step[LEVEL] >= 0.0 and not is_cut(step, first, last):
                level_light(step, optics, light)
                composite(rgba[row], light)
        totals[row, 0], totals[row, 1] = counts[VIOLATIONS], counts[REORDERED]
        totals[row, 2] = counts[UNPLACED]

"""The kernels behind `list_errors`: what each says is defined there."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from isosample.compiled import compiled
from isosample.integral.list_segments import (
    CUBIC,
    LINEAR,
    composite,
    is_cut,
    level_light,
    mixed,
    segment_light,
    sheet_opacity,
    visible_part,
)
from isosample.integral.list_spans import COUNTS_SIZE, REORDERED, STEPS, UNPLACED, VIOLATIONS
from isosample.integral.list_walk import (
    BACK,
    BAND,
    END,
    FIRST_ROOM,
    FRONT,
    LEVEL,
    RESIDUAL,
    SLOPE_BACK,
    SLOPE_FRONT,
    SLOPE_KNOWN,
    START,
    STEEPNESS,
    STEP_SIZE,
    walk_ray,
)

if TYPE_CHECKING:
    from isosample.integral.data_centric import Prepared
    from isosample.integral.list_segments import Optics

F64 = npt.NDArray[np.float64]


@compiled
def judge_block(start: int, prepared: Prepared, per_ray: tuple[F64, F64, F64], by_band: F64) -> None:
    """Judge the rays from number `start` on: indicator (R,), interval (R, 2, 4) and mesh (R,); sums by band."""
    lists, levels, optics, visible = prepared
    indicator, interval, mesh = per_ray
    steps, counts = np.empty((FIRST_ROOM, STEP_SIZE)), np.empty(COUNTS_SIZE, dtype=np.int64)
    brightest = _brightest(optics)
    for row in range(len(indicator)):
        ray = start + row
        steps = walk_ray(lists, ray, levels, counts, steps)
        walked, cut = steps[: counts[STEPS]], (visible[ray, 0], visible[ray, 1])
        indicator[row], mesh[row] = _compare(walked, cut, optics, by_band)
        if counts[VIOLATIONS] + counts[REORDERED] + counts[UNPLACED] > 0:
            interval[row, 0], interval[row, 1, :3], interval[row, 1, 3] = 0.0, brightest, 1.0
        else:
            _bound(walked, cut, optics, interval[row])


@compiled
def _brightest(optics: Optics) -> F64:
    """(3,) float64, the largest of every channel that anything in the plan shows."""
    found = np.zeros(3)
    for channel in range(3):
        for band in range(len(optics.color)):
            found[channel] = max(
                found[channel], optics.color[band, 0, channel], optics.color[band, 1, channel]
            )
        for level in range(len(optics.impulse)):
            found[channel] = max(found[channel], optics.impulse[level, channel], optics.sheet[level, channel])
    return found


@compiled
def _compare(steps: F64, cut: tuple[float, float], optics: Optics, by_band: F64) -> tuple[float, float]:
    """Indicator and mesh error of a ray; adds to the sums by band."""
    cubic, linear, here, other = np.zeros(4), np.zeros(4), np.empty(4), np.empty(4)
    mesh = 0.0
    for i in range(len(steps)):
        step, through = steps[i], 1.0 - cubic[3]
        part = visible_part(step, cut[0], cut[1])
        segment_light(step, part, CUBIC, optics, here)
        segment_light(step, part, LINEAR, optics, other)
        by_band[int(step[BAND])] += (through * np.abs(here - other).max()) ** 2
        composite(cubic, here)
        composite(linear, other)
        if step[LEVEL] >= 0.0 and not is_cut(step, cut[0], cut[1]):
            if step[RESIDUAL] > 0.0:
                mesh += (1.0 - cubic[3]) * _displacement_error(steps, i, optics)
            level_light(step, optics, here)
            composite(cubic, here)
            composite(linear, here)
    return np.abs(cubic - linear).max(), mesh


@compiled
def _displacement_error(steps: F64, i: int, optics: Optics) -> float:
    """Change of light or opacity by the residual of the crossing at the end of step `i`, without what is in front."""
    step = steps[i]
    longest = step[END] - step[START]
    front, behind = _mean_optics(step, optics), (0.0, 0.0, 0.0, 0.0)
    if i + 1 < len(steps):
        longest = max(longest, steps[i + 1][END] - steps[i + 1][START])
        behind = _mean_optics(steps[i + 1], optics)
    largest = 0.0
    for k in range(4):
        largest = max(largest, abs(front[k] - behind[k]))
    if step[RESIDUAL] >= longest * step[STEEPNESS]:
        return float(longest) * largest
    return float(step[RESIDUAL] / step[STEEPNESS]) * largest


@compiled
def _mean_optics(step: F64, optics: Optics) -> tuple[float, float, float, float]:
    """Light per length of a step's mean position, three channels, and the extinction there."""
    band = int(step[BAND])
    mean = 0.5 * (step[FRONT] + step[BACK]) + (step[SLOPE_FRONT] - step[SLOPE_BACK]) / 12.0
    position = min(max(mean, 0.0), 1.0)
    color, extinction = optics.color[band], optics.extinction[band]
    tau = (1.0 - position) * extinction[0] + position * extinction[1]
    return (
        tau * mixed(color, position, 0),
        tau * mixed(color, position, 1),
        tau * mixed(color, position, 2),
        tau,
    )


@compiled
def _bound(steps: F64, cut: tuple[float, float], optics: Optics, interval: F64) -> None:
    """Lower and upper bounds of RGBA over all fields with these crossings, from back to front."""
    interval[:] = 0.0
    most, least = 1.0, 1.0  # transmittance
    for i in range(len(steps) - 1, -1, -1):
        step = steps[i]
        if step[LEVEL] >= 0.0 and not is_cut(step, cut[0], cut[1]):
            clear, dense = _bound_level(step, optics, interval)
            most, least = most * clear, least * dense
        part = visible_part(step, cut[0], cut[1])
        length, band = (part[1] - part[0]) * (step[END] - step[START]), int(step[BAND])
        extinction, color = optics.extinction[band], optics.color[band]
        thin, thick = min(extinction[0], extinction[1]) * length, max(extinction[0], extinction[1]) * length
        clear, dense = math.exp(-thin), math.exp(-thick)
        for channel in range(3):
            dark, bright = (
                min(color[0, channel], color[1, channel]),
                max(color[0, channel], color[1, channel]),
            )
            _bound_channel(interval, channel, (dark, bright), (clear, dense))
        most, least = most * clear, least * dense
    interval[0, 3], interval[1, 3] = 1.0 - most, 1.0 - least


@compiled
def _bound_channel(
    interval: F64, channel: int, colors: tuple[float, float], transmitted: tuple[float, float]
) -> None:
    """Put light of a colour between two in front, through which between two parts are transmitted."""
    low, high = interval[0, channel] - colors[0], interval[1, channel] - colors[1]
    interval[0, channel] = colors[0] + min(transmitted[0] * low, transmitted[1] * low)
    interval[1, channel] = colors[1] + max(transmitted[0] * high, transmitted[1] * high)


@compiled
def _bound_level(step: F64, optics: Optics, interval: F64) -> tuple[float, float]:
    """Put a level's impulse in front, then its sheet; return the most and the least that they transmit."""
    level = int(step[LEVEL])
    impulse, sheet = optics.impulse[level], optics.sheet[level]
    opacity = sheet_opacity(sheet[3], step[STEEPNESS], optics.least_slope)
    clear, dense = 1.0 - opacity, 1.0 - opacity
    if sheet[3] > 0.0 and step[SLOPE_KNOWN] == 0.0:
        clear, dense = 1.0, 0.0
    for channel in range(3):
        same = 1.0 - impulse[3]
        _bound_channel(interval, channel, (impulse[channel], impulse[channel]), (same, same))
        _bound_channel(interval, channel, (sheet[channel], sheet[channel]), (clear, dense))
    return clear * (1.0 - impulse[3]), dense * (1.0 - impulse[3])

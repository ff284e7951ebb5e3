"""What the steps of a walk add to a ray: segments by every rule, sheets and impulses.

Twin: ``shaders/pass/walk.glsl``.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import numpy.typing as npt

from isosample.compiled import compiled
from isosample.integral.list_walk import (
    BACK,
    BAND,
    END,
    FRONT,
    LEVEL,
    SLOPE_BACK,
    SLOPE_FRONT,
    START,
    STEEPNESS,
)
from isosample.integral.quadrature import gauss_legendre
from isosample.integral.segment import cubic_moments
from isosample.integral.segment_rule import SegmentRule

if TYPE_CHECKING:
    from isosample.transfer.isovalue_plan import IsovaluePlan

F64 = npt.NDArray[np.float64]

CONSTANT, CONSTANT_FIRST_ORDER, LINEAR, CUBIC = range(4)
RULE_NUMBERS = {
    SegmentRule.CONSTANT: CONSTANT,
    SegmentRule.CONSTANT_FIRST_ORDER: CONSTANT_FIRST_ORDER,
    SegmentRule.LINEAR: LINEAR,
    SegmentRule.CUBIC: CUBIC,
}

PANEL_DEPTH = (
    0.5  # optical depth of one panel of eight nodes, whose error is below rounding: see `linear_weights`
)
MAX_PANELS = 80  # exp(−40) = 4e-18 is transmitted
NODES, WEIGHTS = gauss_legendre(8)


class Optics(NamedTuple):
    """What is seen in every band and at every level.

    Attributes
    ----------
    extinction : (K + 1, 2) float64
        At the lower and the upper end of every band [1/world].
    color : (K + 1, 2, 3) float64
        Linear RGB, straight.
    impulse, sheet : (K, 4) float64
        Linear RGB, straight; then the opacity of an impulse, and the area of a sheet [data units/world].
    least_slope : float
        |df/dt| of sheets is taken for as large at least [data units/world].
    """

    extinction: F64
    color: F64
    impulse: F64
    sheet: F64
    least_slope: float


def optics_of(plan: IsovaluePlan, least_slope: float) -> Optics:
    """Return the optics of a plan as contiguous arrays."""
    return Optics(
        np.ascontiguousarray(plan.band_extinction),
        np.ascontiguousarray(plan.band_color),
        np.column_stack([plan.impulse_color, plan.impulse_opacity]),
        np.column_stack([plan.sheet_color, plan.sheet_area]),
        float(least_slope),
    )


@compiled
def linear_weights(x0: float, x1: float) -> tuple[float, float]:
    r"""Weights of the front and the back colour of a stretch in which extinction and colour run linearly.

    Parameters
    ----------
    x0, x1 : float
        Extinction at the front and at the back, times the stretch's length, >= 0.

    Returns
    -------
    front, back : float
        As `optics.segment_weights`, which has the closed form; absolute error below 1e-14.

    Notes
    -----
    :math:`w_0 = \int_0^1 (1 - e^{-D(u)})\,du` and :math:`w_0 + w_1 = 1 - e^{-D(1)}`, on panels of optical depth
    d <= 1/2 with 8 Gauss-Legendre nodes. On a panel the integrand is 1 − const · exp(−a u − b u²), a, b' >= 0, whose
    16th derivative is largest where extinction falls to 0 at an end, exp(−d u²): 16!/8! d⁸ = 2.0e6. The error is
    (8!)⁴ / (17 (16!)³) times that, 3e-17.
    """
    opacity = -math.expm1(-0.5 * (x0 + x1))
    front, start = 0.0, 0.0
    for _ in range(MAX_PANELS):
        slope, here = x1 - x0, x0 + start * (x1 - x0)
        discriminant = here * here + 2.0 * slope * PANEL_DEPTH
        root = here + math.sqrt(discriminant) if discriminant > 0.0 else 0.0
        end = min(1.0, start + 2.0 * PANEL_DEPTH / root) if root > 0.0 else 1.0
        for k in range(len(NODES)):
            u = start + (end - start) * NODES[k]
            front += (end - start) * WEIGHTS[k] * -math.expm1(-u * (x0 + 0.5 * u * (x1 - x0)))
        start = end
        if start >= 1.0:
            break
    front += 1.0 - start  # behind the last panel nothing is transmitted
    front = min(front, opacity)
    return front, opacity - front


@compiled
def add_light(light: F64, color: F64, weight: float) -> None:
    """Add a colour times a weight to the premultiplied RGB of `light`, and the weight to its opacity."""
    for channel in range(3):
        light[channel] += weight * color[channel]
    light[3] += weight


@compiled
def mixed(color: F64, position: float, channel: int) -> float:
    """One channel of the colour at a position of a band; never outside its two ends."""
    return float((1.0 - position) * color[0, channel] + position * color[1, channel])


@compiled
def visible_part(step: F64, start: float, end: float) -> tuple[float, float]:
    """Part of a segment that is not cut away, in [0, 1]; (0, 0) where nothing is left."""
    length = step[END] - step[START]
    first, last = max(step[START], start), min(step[END], end)
    if not last > first:
        return 0.0, 0.0
    return (first - step[START]) / length, (last - step[START]) / length


@compiled
def segment_light(step: F64, part: tuple[float, float], rule: int, optics: Optics, light: F64) -> None:
    """Set `light` (4,) to the premultiplied radiance and the opacity of a part of a segment.

    The constant rules take what is at the front end of the segment, also where the part begins behind it.
    """
    light[:] = 0.0
    band, length = int(step[BAND]), step[END] - step[START]
    extinction, color = optics.extinction[band], optics.color[band]
    if not part[1] > part[0] or max(extinction[0], extinction[1]) == 0.0:
        return
    if rule == CUBIC:
        ends, slopes = (step[FRONT], step[BACK]), (step[SLOPE_FRONT], step[SLOPE_BACK])
        opacity, high, _, _ = cubic_moments(
            length * extinction[0], length * extinction[1], *ends, *slopes, part[0], part[1]
        )
        add_light(light, color[0], opacity - high)
        add_light(light, color[1], high)
        light[3] = opacity
    elif rule == LINEAR:
        _linear_light(step, part, extinction, color, light)
    else:
        position = step[FRONT]
        depth = (extinction[0] * (1.0 - position) + extinction[1] * position) * (part[1] - part[0]) * length
        opacity = -math.expm1(-depth) if rule == CONSTANT else min(depth, 1.0)
        for channel in range(3):
            light[channel] = opacity * mixed(color, position, channel)
        light[3] = opacity


@compiled
def _linear_light(step: F64, part: tuple[float, float], extinction: F64, color: F64, light: F64) -> None:
    visible = (part[1] - part[0]) * (step[END] - step[START])
    front = (1.0 - part[0]) * step[FRONT] + part[0] * step[BACK]
    back = (1.0 - part[1]) * step[FRONT] + part[1] * step[BACK]
    x0 = (extinction[0] * (1.0 - front) + extinction[1] * front) * visible
    x1 = (extinction[0] * (1.0 - back) + extinction[1] * back) * visible
    near, far = linear_weights(x0, x1)
    for channel in range(3):
        light[channel] = near * mixed(color, front, channel) + far * mixed(color, back, channel)
    light[3] = near + far


@compiled
def composite(rgba: F64, light: F64) -> None:
    """Composite light behind what a ray has seen: (4,) each, premultiplied, with opacity."""
    through = 1.0 - rgba[3]
    for channel in range(3):
        rgba[channel] += through * light[channel]
    rgba[3] = 1.0 - through * (1.0 - light[3])


@compiled
def sheet_opacity(area: float, steepness: float, least_slope: float) -> float:
    """Opacity of one crossing of a thin peak: 1 − exp(−area / |df/dt|); 1 where the ray stays on it."""
    if area == 0.0:
        return 0.0
    slope = max(steepness, least_slope)
    return -math.expm1(-area / slope) if slope > 0.0 else 1.0


@compiled
def level_light(step: F64, optics: Optics, light: F64) -> None:
    """Set `light` (4,) to what is on the level at the end of a step: the sheet, and behind it the impulse."""
    level = int(step[LEVEL])
    sheet, impulse = optics.sheet[level], optics.impulse[level]
    light[:] = 0.0
    add_light(light, sheet, sheet_opacity(sheet[3], step[STEEPNESS], optics.least_slope))
    add_light(light, impulse, (1.0 - light[3]) * impulse[3])


@compiled
def is_cut(step: F64, start: float, end: float) -> bool:
    """Whether the end of a step is cut away."""
    return not start <= step[END] <= end

"""One ray's way through the bands of the transfer function, along one cubic after the other.

The walk knows the band in which the ray is. The field's values at the ends of monotone pieces decide which
levels lie between, by comparison alone, so no level is lost or counted twice, however the roots are rounded.

With `light` colours are lit by the gradient of the cell; None, which kernels are compiled for by itself, leaves them.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from isosample.compiled import compiled
from isosample.integral.cell_cubic import cubic_extrema, cubic_part, cubic_root, cubic_value
from isosample.integral.cell_light import UNRESOLVED, light_at
from isosample.integral.lit_panels import DOUBT_SHARE, lit_panel

if TYPE_CHECKING:
    from isosample.integral.band_table import BandTable, Optics
    from isosample.integral.cell_light import CellLight

F64 = npt.NDArray[np.float64]

# The walk is an array: premultiplied RGBA in 0 to 3, and
OPACITY, TRANSMITTANCE, PANELS = 3, 4, 5
WALK_SIZE = 6

OPAQUE = 1e-14  # a ray ends where less than this is transmitted


@compiled
def start_walk(walk: F64) -> None:
    """Nothing seen so far, everything transmitted."""
    for i in range(WALK_SIZE):
        walk[i] = 0.0
    walk[TRANSMITTANCE] = 1.0


@compiled
def band_above(edges: F64, band: int, value: float) -> int:
    """Band of a value that counts a level as above it, found from a band nearby."""
    while value >= edges[band + 1]:
        band += 1
    while value < edges[band]:
        band -= 1
    return band


@compiled
def band_below(edges: F64, band: int, value: float) -> int:
    """Band of a value that counts a level as below it, found from a band nearby."""
    while value > edges[band + 1]:
        band += 1
    while value <= edges[band]:
        band -= 1
    return band


@compiled
def walk_cubic(
    walk: F64,
    band: int,
    cubic: tuple[float, float, float, float],
    length: float,
    optics: Optics,
    light: CellLight | None,
) -> int:
    """Walk along a cubic of the given length [world]; return the band at its end."""
    b0, b1, b2, b3 = cubic
    edges = optics.bands.edges
    low, high = min(min(b0, b1), min(b2, b3)), max(max(b0, b1), max(b2, b3))
    if edges[band] < low and high < edges[band + 1]:
        absorb(walk, band, cubic, (0.0, 1.0), length, optics, light)
        return band
    count, first, second = cubic_extrema(b0, b1, b2, b3)
    start, start_value = 0.0, b0
    for piece in range(count + 1):
        end = first if piece == 0 and count > 0 else (second if piece == 1 and count > 1 else 1.0)
        end_value = cubic_value(b0, b1, b2, b3, end)
        band = _walk_monotone(walk, band, cubic, (start, end, start_value, end_value), length, optics, light)
        start, start_value = end, end_value
    return band


@compiled
def _walk_monotone(
    walk: F64,
    band: int,
    cubic: tuple[float, float, float, float],
    piece: tuple[float, float, float, float],
    length: float,
    optics: Optics,
    light: CellLight | None,
) -> int:
    """Walk along a monotone piece of a cubic (start, end, value at the start, at the end), level by level."""
    start, end, start_value, end_value = piece
    bands = optics.bands
    if start_value == end_value:
        band = cross_levels(walk, band, band_above(bands.edges, band, start_value), bands, light, start)
        absorb_plateau(walk, band, start_value, (start, end), length, optics, light)
        return band
    rising = start_value < end_value
    if rising:
        band = cross_levels(walk, band, band_above(bands.edges, band, start_value), bands, light, start)
        last = band_below(bands.edges, band, end_value)
    else:
        band = cross_levels(walk, band, band_below(bands.edges, band, start_value), bands, light, start)
        last = band_above(bands.edges, band, end_value)
    b0, b1, b2, b3 = cubic
    while band != last:
        level = bands.edges[band + 1] if rising else bands.edges[band]
        root = cubic_root(b0, b1, b2, b3, level, start, end, rising)
        part = cubic_part(b0, b1, b2, b3, start, root)
        absorb(walk, band, part, (start, root), length, optics, light)
        band = cross_levels(walk, band, band + 1 if rising else band - 1, bands, light, root)
        start = root
    part = cubic_part(b0, b1, b2, b3, start, end)
    absorb(walk, band, part, (start, end), length, optics, light)
    return band


@compiled
def cross_levels(
    walk: F64, band: int, target: int, bands: BandTable, light: CellLight | None, place: float
) -> int:
    """Composite the impulses of the levels between two bands, in the direction of travel; return `target`.

    `place`: where on the part of the cell that is walked, for the light.
    """
    step = 1 if target > band else -1
    while band != target:
        level = band if step == 1 else band - 1
        opacity = bands.impulse[level, 0]
        if opacity > 0.0:
            color = bands.impulse[level, 1:]
            if light is None:
                composite(walk, opacity, 1.0 - opacity, color, color, 0.0)
            else:
                shade, highlight, doubt = light_at(light, place)
                if doubt > DOUBT_SHARE:
                    bound = max(color[0], color[1], color[2]) * light.material[1] + light.material[2]
                    light.numbers[UNRESOLVED] += walk[TRANSMITTANCE] * opacity * bound * doubt
                red, green, blue = (
                    color[0] * shade + highlight,
                    color[1] * shade + highlight,
                    color[2] * shade + highlight,
                )
                add_light(walk, (opacity * red, opacity * green, opacity * blue), opacity, 1.0 - opacity)
        band += step
    return target


@compiled
def absorb_plateau(
    walk: F64,
    band: int,
    value: float,
    part: tuple[float, float],
    length: float,
    optics: Optics,
    light: CellLight | None,
) -> None:
    """Composite a stretch of constant value: `part` of a cubic of a length [world]."""
    bands = optics.bands
    if band > 0 and value == bands.edges[band]:
        band = bands.plateau[band - 1]
    low, high = bands.edges[band], bands.edges[band + 1]
    if not (math.isfinite(low) and math.isfinite(high)):
        return  # outside every control point
    if light is not None:
        absorb(walk, band, (value, value, value, value), part, length, optics, light)
        return
    weight = (value - low) / (high - low)
    extinction = bands.extinction[band, 0] + weight * (bands.extinction[band, 1] - bands.extinction[band, 0])
    _attenuate(walk, extinction * ((part[1] - part[0]) * length), bands.color[band], weight)


@compiled
def absorb(
    walk: F64,
    band: int,
    cubic: tuple[float, float, float, float],
    place: tuple[float, float],
    whole: float,
    optics: Optics,
    light: CellLight | None,
) -> None:
    """Composite a stretch of a ray inside one band, along which the value is a cubic.

    It runs from one place to another of the part of the cell that is walked, the length of which is `whole` [world].
    """
    bands, rules, panels = optics
    length = (place[1] - place[0]) * whole
    front, back = bands.extinction[band, 0], bands.extinction[band, 1]
    if (front == 0.0 and back == 0.0) or length <= 0.0:
        return
    low = bands.edges[band]
    scale = 1.0 / (bands.edges[band + 1] - low)
    w0, w1 = (cubic[0] - low) * scale, (cubic[1] - low) * scale
    w2, w3 = (cubic[2] - low) * scale, (cubic[3] - low) * scale
    color = bands.color[band]
    if light is None:  # noqa: SIM102  # a test of its own, so that the kernel is compiled without
        if color[0, 0] == color[1, 0] and color[0, 1] == color[1, 1] and color[0, 2] == color[1, 2]:
            mean = 0.25 * (w0 + w1 + w2 + w3)
            _attenuate(walk, length * (front + mean * (back - front)), color, 0.0)
            return
    thickest = rules.depth_limits[-1]
    start, step = 0.0, 1.0 / panels
    while start < 1.0 and walk[TRANSMITTANCE] >= OPAQUE:
        end = min(1.0, start + step)
        end = 1.0 if 1.0 - end < 1e-12 else end
        part = cubic_part(w0, w1, w2, w3, start, end) if end - start < 1.0 else (w0, w1, w2, w3)
        mean = 0.25 * (part[0] + part[1] + part[2] + part[3])
        depth = (end - start) * length * (front + mean * (back - front))
        if depth > thickest and step > 1e-14:
            step *= max(0.1, min(0.7, 0.9 * thickest / depth))
            continue
        depth = max(depth, 0.0)
        if light is None:
            _absorb_panel(walk, band, part, (end - start) * length, depth, optics)
        else:
            stretch = (place[0] + start * (place[1] - place[0]), place[0] + end * (place[1] - place[0]))
            absorb_lit(walk, band, np.array(part), stretch, (end - start) * length, depth, bands, light)
        start = end
        step = min(2.0 * step, 1.0 / panels)


@compiled
def _absorb_panel(
    walk: F64,
    band: int,
    weights: tuple[float, float, float, float],
    length: float,
    depth: float,
    optics: Optics,
) -> None:
    """Composite a panel whose place in the band is a cubic: opacity in closed form, colour by quadrature."""
    bands, rules = optics.bands, optics.rules
    rule = 0
    while rule < len(rules.depth_limits) - 1 and depth > rules.depth_limits[rule]:
        rule += 1
    w0, w1, w2, w3 = weights
    front = bands.extinction[band, 0] * length
    change = bands.extinction[band, 1] * length - front
    toward_high = 0.0
    for i in range(rules.node_counts[rule]):
        basis, integral = rules.basis[rule, i], rules.integrals[rule, i]
        w = w0 * basis[0] + w1 * basis[1] + w2 * basis[2] + w3 * basis[3]
        w_sum = w0 * integral[0] + w1 * integral[1] + w2 * integral[2] + w3 * integral[3]
        so_far = front * rules.nodes[rule, i] + change * w_sum
        toward_high += rules.weights[rule, i] * w * (front + change * w) * math.exp(-so_far)
    walk[PANELS] += 1.0
    color = bands.color[band]
    composite(walk, -math.expm1(-depth), math.exp(-depth), color[0], color[1], toward_high)


@compiled
def absorb_lit(
    walk: F64,
    band: int,
    places: F64,
    stretch: tuple[float, float],
    length: float,
    depth: float,
    bands: BandTable,
    light: CellLight,
) -> None:
    """Composite a panel that is lit: opacity in closed form, light by quadrature, see `lit_panel`."""
    depths = (bands.extinction[band, 0] * length, bands.extinction[band, 1] * length)
    red, green, blue, pieces = lit_panel(
        light, places, stretch, depths, bands.color[band], walk[TRANSMITTANCE]
    )
    walk[PANELS] += float(pieces)
    add_light(walk, (red, green, blue), -math.expm1(-depth), math.exp(-depth))


@compiled
def _attenuate(walk: F64, depth: float, color: F64, weight: float) -> None:
    """Composite a stretch of one colour: that at a place in a band, 0 at its lower end and 1 at its upper."""
    opacity = -math.expm1(-max(depth, 0.0))
    composite(walk, opacity, math.exp(-max(depth, 0.0)), color[0], color[1], weight * opacity)


@compiled
def composite(walk: F64, opacity: float, transmitted: float, low: F64, high: F64, toward_high: float) -> None:
    """Composite light of colour `low` and weight `opacity`, of which `toward_high` goes to colour `high`."""
    through = walk[TRANSMITTANCE]
    for channel in range(3):
        light = low[channel] * opacity + (high[channel] - low[channel]) * toward_high
        walk[channel] += through * light
    walk[OPACITY] += through * opacity
    walk[TRANSMITTANCE] = through * transmitted


@compiled
def add_light(walk: F64, light: tuple[float, float, float], opacity: float, transmitted: float) -> None:
    """Composite light (premultiplied linear RGB) and opacity."""
    through = walk[TRANSMITTANCE]
    for channel in range(3):
        walk[channel] += through * light[channel]
    walk[OPACITY] += through * opacity
    walk[TRANSMITTANCE] = through * transmitted

"""Emission of a lit panel of a ray, by Gauss-Legendre quadrature of pieces that are halved until two levels agree.

With light the emission of a panel has no closed form, and its quadrature no proven error; it is verified at points.
A piece of opacity a is accepted where it and its two halves, of 10 nodes each, agree to within a times half the
tolerance; the halves are then used. The opacities of all pieces, each times what is transmitted to it, add up to 1 at
most, so that the errors add up to half the tolerance. Two things could hide between the nodes, and are excluded:

- a kink, where the gradient's component along the ray changes its sign: pieces are cut there (`find_turns`);
- a gradient that nearly vanishes, and turns by any angle on the way past: over a piece that is accepted it changes, by
  a bound from its Bernstein coefficients, by at most half of what it is in the middle, so that the light is analytic
  far beyond the piece; by less where a highlight of a large exponent is narrower than that.

Where the gradient vanishes on the ray, no halving fulfils that. But the light is bounded, so that a piece errs by its
opacity times the bound at most: where that is less than 2⁻¹² of half the tolerance the piece is taken as it is, and
what it may err by is added up; so is what rounding may do where the gradient is so short that this is more than a
thousandth of the light. The caller must not return a
ray for which the sum is more than half the tolerance.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from isosample.compiled import compiled
from isosample.integral.bernstein import polynomial_value
from isosample.integral.cell_light import (
    CHANGE,
    DOUBTED,
    END,
    MAX_PIECES,
    RED,
    UNRESOLVED,
    WIDTH,
    gradient_at,
    light_at,
    next_turn,
)

if TYPE_CHECKING:
    from isosample.integral.cell_light import CellLight

F64 = npt.NDArray[np.float64]

STOP_SHARE = 2.0**-12  # of what may be left unresolved, that one piece may leave: so many pieces are too many
DOUBT_SHARE = 1e-3  # of a piece's largest emission: rounding above that is told
LARGEST_TURN = 0.5  # of the gradient over half a piece, in terms of its length in the middle
HIGHLIGHT_TURN = (
    2.0  # the same over the root of the exponent: of exp(−m x² / 2), beyond two standard deviations
)


@compiled
def lit_panel(
    light: CellLight,
    places: F64,
    stretch: tuple[float, float],
    depths: tuple[float, float],
    color: F64,
    transmittance: float,
) -> tuple[float, float, float, int]:
    r"""Light that a panel inside one band emits, seen from its start.

    Parameters
    ----------
    light : CellLight
    places : (P + 1,) float64
        Position in the band along the panel, a polynomial in Bernstein form: 0 at the lower end, 1 at the upper.
    stretch : start, end
        The panel, from 0 to 1 over the part of the cell that is walked.
    depths : (low, high)
        Extinction at the lower and upper end of the band, times the panel's length. The panel's optical depth is below
        0.5, so that no emission hides in front of the first node.
    color : (2, 3) float64
        At the lower and upper end of the band (linear RGB, straight).
    transmittance : float
        From the eye to the panel.

    Returns
    -------
    red, green, blue : float
        :math:`\int l(c)\,\tau\,e^{-D}`, without what is in front of the panel.
    pieces : int
        Into which it was divided.
    """
    count = len(places)
    sums = light.sums[: count + 1]
    sums[0] = 0.0
    for i in range(count):
        sums[i + 1] = sums[i] + places[i] / count
    brightest = 0.0
    for end in range(2):
        for channel in range(3):
            brightest = max(brightest, color[end, channel])
    bound = brightest * (light.material[0] + light.material[1]) + light.material[2]
    panel = (places, sums, stretch, depths, color)
    pieces = light.pieces
    pieces[0, END], pieces[0, RED] = 1.0, math.nan
    red, green, blue, start, depth, top, taken = 0.0, 0.0, 0.0, 0.0, 0.0, 0, 0
    while top >= 0:
        whole, front, back = pieces[top], pieces[top + 2], pieces[top + 1]
        end = whole[END]
        cut = _cut_of(light, stretch, start, end)
        depth_behind = depths[0] * end + (depths[1] - depths[0]) * polynomial_value(sums, end)
        opacity = max(0.0, -math.exp(-depth) * math.expm1(depth - depth_behind))
        error = transmittance * opacity * bound
        last = error <= STOP_SHARE * light.allowed or top + 3 >= MAX_PIECES or not start < cut < end
        clear, agreed = _is_clear(light, stretch, start, end), False
        front[RED], back[RED] = math.nan, math.nan
        if last or clear:
            if math.isnan(whole[RED]):
                _measure(light, panel, start, end, brightest, whole)
            _measure(light, panel, start, cut, brightest, front)
            _measure(light, panel, cut, end, brightest, back)
            doubt = front[DOUBTED] + back[DOUBTED]
            agreed = clear and _agree(whole, front, back, light.allowed * opacity + doubt)
            if last and not agreed:
                light.numbers[UNRESOLVED] += error
            elif agreed and doubt > DOUBT_SHARE * bound * opacity:
                light.numbers[UNRESOLVED] += transmittance * doubt
        if agreed or last:
            red += front[RED] + back[RED]
            green += front[RED + 1] + back[RED + 1]
            blue += front[RED + 2] + back[RED + 2]
            start, depth = end, depth_behind
            top -= 1
            taken += 1
        else:
            back[END], front[END] = end, cut
            for column in range(pieces.shape[1]):
                pieces[top, column] = back[column]
                pieces[top + 1, column] = front[column]
            top += 1
    return red, green, blue, taken


@compiled
def _cut_of(light: CellLight, stretch: tuple[float, float], start: float, end: float) -> float:
    """Where a piece of a panel is divided: at a kink, or in the middle."""
    width = stretch[1] - stretch[0]
    turn = (next_turn(light, stretch[0] + start * width, stretch[0] + end * width) - stretch[0]) / width
    return turn if start < turn < end else 0.5 * (start + end)


@compiled
def _is_clear(light: CellLight, stretch: tuple[float, float], start: float, end: float) -> bool:
    """Whether there is no kink in a piece and the gradient turns little: then the nodes tell of the whole piece."""
    width = stretch[1] - stretch[0]
    if next_turn(light, stretch[0] + start * width, stretch[0] + end * width) >= 0.0:
        return False
    x, y, z, _ = gradient_at(light, stretch[0] + 0.5 * (start + end) * width)
    change = 0.5 * (end - start) * width * light.numbers[WIDTH] * light.numbers[CHANGE]
    largest = LARGEST_TURN
    if light.material[2] > 0.0 and light.material[3] > 1.0:
        largest = min(largest, HIGHLIGHT_TURN / math.sqrt(light.material[3]))
    return bool(change <= largest * math.sqrt(x * x + y * y + z * z))


@compiled
def _agree(whole: F64, front: F64, back: F64, allowed: float) -> bool:
    """Whether a piece and its two halves agree in every channel."""
    difference = 0.0
    for channel in range(RED, RED + 3):
        difference = max(difference, abs(front[channel] + back[channel] - whole[channel]))
    return bool(difference <= allowed)


@compiled
def _measure(
    light: CellLight,
    panel: tuple[F64, F64, tuple[float, float], tuple[float, float], F64],
    start: float,
    end: float,
    brightest: float,
    piece: F64,
) -> None:
    """Fill in a piece [start, end] of a panel: its emission, and the doubt about it."""
    places, sums, stretch, depths, color = panel
    width, change = end - start, depths[1] - depths[0]
    base, toward_high, shine, doubted = 0.0, 0.0, 0.0, 0.0
    sharpness = light.material[2] * max(light.material[3], 1.0) if light.material[3] > 0.0 else 0.0
    for i in range(len(light.nodes)):
        x = start + width * light.nodes[i]
        place = polynomial_value(places, x)
        so_far = depths[0] * x + change * polynomial_value(sums, x)
        emitted = light.weights[i] * width * (depths[0] + change * place) * math.exp(-so_far)
        shade, highlight, doubt = light_at(light, stretch[0] + x * (stretch[1] - stretch[0]))
        base += emitted * shade
        toward_high += emitted * shade * place
        shine += emitted * highlight
        peak = doubt ** min(light.material[3], 1.0) if light.material[3] < 1.0 else doubt
        doubted += abs(emitted) * (light.material[1] * brightest * doubt + sharpness * peak)
    piece[END], piece[DOUBTED] = end, doubted
    for channel in range(3):
        low, high = color[0, channel], color[1, channel]
        piece[RED + channel] = low * base + (high - low) * toward_high + shine

"""Drawings as SVG text: axes with ticks, points that tell their values, and files that stand alone."""

from __future__ import annotations

import math
from dataclasses import dataclass
from html import escape
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

WIDTH, HEIGHT = 440, 370  # units of a drawing; text of 13 of them stays legible on a phone
LEFT, RIGHT, TOP, BOTTOM = 66, 22, 52, 48  # margins around the axes; half of 10000 stands right of them

# A file of its own brings its colours along; in the report the page defines the same names.
COLORS = """
:root { --ink: #1c2430; --quiet: #5b6675; --rule: #d9dee5; --paper: #ffffff;
  --m0: #1f5fbf; --m1: #a65300; --m2: #1a7a4c; --m3: #8e3a9d; --bars: #b9c2ce; }
@media (prefers-color-scheme: dark) { :root { --ink: #e6eaf0; --quiet: #a3aebc; --rule: #333c48; --paper: #14181e;
  --m0: #7fb2ff; --m1: #f0a35a; --m2: #5fd39a; --m3: #d79be8; --bars: #4a5563; } }
svg { background: var(--paper); }
"""
STYLE = """
.plot text { font: 13px system-ui, sans-serif; fill: var(--ink); font-variant-numeric: tabular-nums; }
.plot .quiet { fill: var(--quiet); }
.plot .grid { stroke: var(--rule); stroke-width: 1; }
.plot .frame { fill: none; stroke: var(--quiet); stroke-width: 1; }
.plot .line { fill: none; stroke-width: 1.75; }
.plot .front { fill: none; stroke: var(--ink); stroke-opacity: .22; stroke-width: 9; stroke-linejoin: round;
  stroke-linecap: round; }
.plot .ring { fill: none; stroke: var(--ink); stroke-width: 1.5; }
.plot .s0 { stroke: var(--m0); } .plot .s1 { stroke: var(--m1); } .plot .s2 { stroke: var(--m2); }
.plot .s3 { stroke: var(--m3); }
.plot .f0 { fill: var(--m0); } .plot .f1 { fill: var(--m1); } .plot .f2 { fill: var(--m2); }
.plot .f3 { fill: var(--m3); }
.plot .bars { fill: var(--bars); }
.plot .curve { fill: none; stroke: var(--ink); stroke-width: 1.5; }
.plot .point:hover .ring, .plot .point:focus .ring { stroke-width: 3; }
.plot .off { stroke-opacity: 0; }
.plot .point:hover .off, .plot .point:focus .off { stroke-opacity: .6; }
.plot .point:focus { outline: none; }
"""
MARKS = {  # outlines about the origin
    0: "M-5 0a5 5 0 1 0 10 0a5 5 0 1 0-10 0z",
    1: "M-4.5-4.5h9v9h-9z",
    2: "M0-6l5.6 10h-11.2z",
    3: "M0-6.2l6.2 6.2-6.2 6.2-6.2-6.2z",
}


@dataclass(frozen=True, slots=True)
class Axis:
    """A scale along one side of a drawing.

    Attributes
    ----------
    low, high : float
        Ends, in data units; above 0 where logarithmic.
    start, stop : float
        Their places in the drawing.
    logarithmic : bool
    """

    low: float
    high: float
    start: float
    stop: float
    logarithmic: bool = True

    def place(self, value: float) -> float:
        """Where a value is; beyond an end, at the end."""
        held = min(max(value, self.low), self.high)
        if self.logarithmic:
            share = math.log(held / self.low) / math.log(self.high / self.low)
        else:
            share = (held - self.low) / (self.high - self.low)
        return self.start + share * (self.stop - self.start)

    def ticks(self) -> list[float]:
        """Values to label: powers of ten, with 2 and 5 between where there are few; round numbers if linear."""
        if not self.logarithmic:
            return _round_ticks(self.low, self.high)
        powers = range(math.floor(math.log10(self.low)) - 1, math.ceil(math.log10(self.high)) + 1)
        for factors in ((1,), (1, 3), (1, 2, 5)):
            found = [factor * 10.0**power for power in powers for factor in factors]
            found = [one for one in found if self.low * (1 - 1e-9) <= one <= self.high * (1 + 1e-9)]
            if len(found) >= 3:
                break
        return found[:: math.ceil(len(found) / 8)] if found else [self.low, self.high]


def around(values: Iterable[float], *, start: float, stop: float) -> Axis:
    """A logarithmic axis with some room about its values."""
    positive = [value for value in values if value > 0.0] or [1.0]
    low, high = min(positive), max(positive)
    room = max((high / low) ** 0.07, 1.25)
    return Axis(low / room, high * room, start, stop)


def drawing(body: str, *, title: str, description: str, height: int = HEIGHT) -> str:
    """An SVG element with a name for those who do not see it."""
    name = escape(f"{title}. {description}", quote=True)
    return (
        f'<svg class="plot" xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {height}" role="group" '
        f'aria-label="{name}">{body}</svg>'
    )


def standalone(svg: str) -> str:
    """The same as the text of a file, with its own colours."""
    start = svg.index(">") + 1
    return (
        f'<?xml version="1.0" encoding="UTF-8"?>\n{svg[:start]}<style>{COLORS}{STYLE}</style>{svg[start:]}\n'
    )


def text(
    x: float, y: float, words: str, *, anchor: str = "middle", css: str = "", turn: float | None = None
) -> str:
    """A line of text."""
    kind = f' class="{css}"' if css else ""
    turned = "" if turn is None else f' transform="rotate({turn:g} {x:.1f} {y:.1f})"'
    return f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}"{kind}{turned}>{escape(words)}</text>'


def frame(x: Axis, y: Axis, *, x_label: str, y_label: str) -> str:
    """Rules, ticks and names of two axes."""
    parts = []
    for value, words in _labelled(x):
        place = x.place(value)
        parts.append(f'<path class="grid" d="M{place:.1f} {y.start:.1f}V{y.stop:.1f}"/>')
        parts.append(text(place, y.start + 17, words, css="quiet"))
    for value, words in _labelled(y):
        place = y.place(value)
        parts.append(f'<path class="grid" d="M{x.start:.1f} {place:.1f}H{x.stop:.1f}"/>')
        parts.append(text(x.start - 6, place + 4.5, words, anchor="end", css="quiet"))
    parts.append(
        f'<path class="frame" d="M{x.start:.1f} {y.stop:.1f}V{y.start:.1f}H{x.stop:.1f}"/>'
        + text((x.start + x.stop) / 2, y.start + 38, x_label)
        + text(13, (y.start + y.stop) / 2, y_label, turn=-90)
    )
    return "".join(parts)


def _labelled(axis: Axis) -> list[tuple[float, str]]:
    """Its ticks with their texts."""
    values = axis.ticks()
    return list(zip(values, tick_texts(values), strict=True))


def line(points: Sequence[tuple[float, float]], css: str) -> str:
    """Straight lines from point to point."""
    if len(points) < 2:
        return ""
    return f'<path class="{css}" d="M{"L".join(f"{x:.1f} {y:.1f}" for x, y in points)}"/>'


def point(x: float, y: float, kind: int, told: str, *, ringed: bool) -> str:
    """A mark that tells its values to pointer, keyboard and screen reader."""
    css = "ring" if ringed else "ring off"
    words = escape(told, quote=True)
    return (
        f'<g class="point" transform="translate({x:.1f} {y:.1f})" tabindex="0" role="img" aria-label="{words}" '
        f'data-tip="{words}"><title>{words}</title><circle r="13" fill="transparent"/>'
        f'<circle class="{css}" r="9"/><path class="f{kind}" d="{MARKS[kind]}"/></g>'
    )


def legend(names: Sequence[tuple[int, str]]) -> str:
    """Marks with the names of what they stand for, two to a row."""
    parts = []
    for place, (kind, name) in enumerate(names):
        x, y = LEFT + 8 + 190 * (place % 2), 14 + 19 * (place // 2)
        parts.append(
            f'<path class="f{kind}" transform="translate({x} {y})" d="{MARKS[kind]}"/>'
            + text(x + 12, y + 4.5, name, anchor="start")
        )
    return "".join(parts)


def tick_texts(values: Sequence[float]) -> list[str]:
    """The numbers of one axis, all written in one way.

    Parameters
    ----------
    values : sequence of float

    Returns
    -------
    texts : list of str
        As they are if each is 0 or between 0.001 and 99 999 in size; else all of them as powers of ten.
    """
    plain = all(not value or 0.000_99 <= abs(value) < 1e5 for value in values)
    return [f"{value:.6g}" if plain else _power_text(value) for value in values]


def _power_text(value: float) -> str:
    """A number as a multiple of a power of ten: 10⁻³, 5·10⁻⁴; 0 stays 0."""
    if not value:
        return "0"
    mantissa, exponent = f"{value:.5e}".split("e")
    raised = str(int(exponent)).translate(str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"))
    factor = f"{float(mantissa):g}"
    return f"10{raised}" if factor == "1" else f"{factor}·10{raised}"


def _round_ticks(low: float, high: float) -> list[float]:
    """About five round numbers."""
    rough = (high - low) / 5.0
    unit = 10.0 ** math.floor(math.log10(rough))
    step = next(unit * factor for factor in (1, 2, 5, 10) if unit * factor >= rough * (1 - 1e-9))
    first = math.ceil(low / step - 1e-9)
    return [number * step for number in range(first, math.floor(high / step + 1e-9) + 1)]

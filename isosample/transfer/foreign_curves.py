"""Curves of opacity and sRGB colour over value, as VTK draws them, made into a transfer function."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from isosample.errors import InputError
from isosample.transfer.control_points import ControlPoint, Isosurface, finite_number
from isosample.transfer.transfer_function import TransferFunction

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from isosample.transfer.transfer_function import Side

F64 = npt.NDArray[np.float64]

TOLERANCE = 1 / 128  # of opacity over the unit distance, and of linear colour where something is visible
OPACITY_CEILING = 0.999  # an opacity of 1 over a distance would be an infinite extinction
FAR = 1e30  # curves go on with their end values; this stands for "to all values"
SAMPLE_COUNT = 2048  # of the whole curve, before simplification
CURVE_STEPS = 32  # straight pieces of one smooth ("sharpness") piece


@dataclass(frozen=True, slots=True)
class Node:
    """A node of a curve: value, channels in [0, 1], and the shape of the piece that follows (as in VTK)."""

    value: float
    channels: Sequence[float]
    midpoint: float = 0.5
    sharpness: float = 0.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "value", finite_number(self.value, "value"))
        channels = tuple(finite_number(channel, "channel") for channel in self.channels)
        if len(channels) not in (1, 3) or min(channels) < 0 or max(channels) > 1:
            raise InputError(f"{list(channels)} must be one opacity or three colours, all in [0, 1].")
        object.__setattr__(self, "channels", channels)
        for name in ("midpoint", "sharpness"):
            number = finite_number(getattr(self, name), name)
            if not 0 <= number <= 1:
                raise InputError(f"{name} {number:g} must lie in [0, 1].")
            object.__setattr__(self, name, number)


@dataclass(frozen=True, slots=True)
class _Run:
    """Samples of a stretch without steps: values (N,), opacities (N,), linear colours (N, 3)."""

    values: F64
    opacity: F64
    color: F64


def transfer_function_from_curves(
    opacity: Sequence[Node],
    color_srgb: Sequence[Node],
    unit_distance: float,
    *,
    source: str,
    isosurfaces: Sequence[Isosurface] = (),
) -> TransferFunction:
    """Transfer function that follows curves of opacity and colour to within `TOLERANCE`.

    Parameters
    ----------
    opacity, color_srgb : sequences of Node
        With one and three channels; colours in sRGB, as displayed.
    unit_distance : float
        The length that has the opacities [world].
    source : str
        File name for the warning.
    isosurfaces : sequence of Isosurface
        Passed on.

    Returns
    -------
    transfer_function : TransferFunction
        Extinction −ln(1 − opacity) / unit_distance.

    Raises
    ------
    InputError
        If a curve has no nodes.

    Warns
    -----
    UserWarning
        If opacities above `OPACITY_CEILING` are lowered to it.

    Notes
    -----
    Opacity linear in the value is no extinction linear in the value, and colour linear in sRGB is not linear
    in light: the curves are sampled finely, then simplified (Ramer, Douglas and Peucker) with both errors
    measured as they are seen.
    """
    shape = _polyline(opacity, "opacity")
    paint = _polyline(color_srgb, "color")
    if max(point.extinction for point in shape.points) > OPACITY_CEILING:
        warnings.warn(
            f"{source}: opacities above {OPACITY_CEILING} are lowered to it; "
            "1 over a distance is infinite extinction.",
            stacklevel=4,
        )
    points: list[ControlPoint] = []
    for run in _runs(shape, paint):
        extinction = -np.log1p(-run.opacity) / unit_distance
        for i in _simplified(run, extinction, unit_distance):
            red, green, blue = run.color[i].tolist()
            points.append(ControlPoint(float(run.values[i]), (red, green, blue), float(extinction[i])))
    return TransferFunction(_without_dark_ends(points), isosurfaces)


def linear_from_srgb(srgb: npt.ArrayLike) -> F64:
    """(...) float64, linear light in [0, 1] of sRGB values in [0, 1] (IEC 61966-2-1)."""
    srgb = np.asarray(srgb, dtype=np.float64)
    return np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)


def curve_color_srgb(value: float, opacity: Sequence[Node], color_srgb: Sequence[Node]) -> tuple[float, F64]:
    """Opacity and sRGB colour (3,) of the curves at one value."""
    _, alpha = _polyline(opacity, "opacity").evaluate(value)
    color, _ = _polyline(color_srgb, "color").evaluate(value)
    return float(alpha), color


def _without_dark_ends(points: list[ControlPoint]) -> list[ControlPoint]:
    """Leave out the outer slopes without extinction: outside the points there is none anyway."""
    lit = [i for i, point in enumerate(points) if point.extinction > 0]
    return points[max(lit[0] - 1, 0) : lit[-1] + 2] if lit else points


def _polyline(nodes: Sequence[Node], what: str) -> TransferFunction:
    """Curve as straight pieces over all values: opacity in the place of extinction, colour as it is."""
    if not nodes:
        raise InputError(f"the {what} curve has no points; expected at least one.")
    ordered = sorted(nodes, key=lambda node: node.value)
    corners = [(-FAR, ordered[0].channels)]
    for low, high in pairwise(ordered):
        corners += [(low.value, low.channels), *_shaped(low, high)]
    corners += [(ordered[-1].value, ordered[-1].channels), (FAR, ordered[-1].channels)]
    points: list[ControlPoint] = []
    for value, channels in corners:
        if len(points) > 1 and value == points[-2].value:
            points.pop()  # of three corners at one value the middle one is never reached
        if len(channels) == 1:
            points.append(ControlPoint(value, (0.0, 0.0, 0.0), channels[0]))
        else:
            points.append(ControlPoint(value, (channels[0], channels[1], channels[2]), 0.0))
    return TransferFunction(points)


def _shaped(low: Node, high: Node) -> Iterator[tuple[float, Sequence[float]]]:
    """Corners strictly inside a piece, from its midpoint and sharpness (VTK, vtkPiecewiseFunction)."""
    if low.value == high.value or low.channels == high.channels:
        return
    start, stop = np.array(low.channels), np.array(high.channels)
    width = high.value - low.value
    midpoint = min(max(low.midpoint, 1e-5), 1 - 1e-5)
    middle = low.value + midpoint * width
    if low.sharpness > 0.99:
        yield middle, low.channels
        yield middle, high.channels
    elif low.sharpness >= 0.01:
        for where in np.linspace(0, 1, CURVE_STEPS + 1)[1:-1]:
            mixed = _hermite(where, low.sharpness)
            position = where * 2 * midpoint if where < 0.5 else 1 - (1 - where) * 2 * (1 - midpoint)
            yield low.value + position * width, _between(start, stop, mixed)
    elif midpoint != 0.5:
        yield middle, _between(start, stop, 0.5)


def _between(start: F64, stop: F64, weight: float) -> tuple[float, ...]:
    """Channels at `weight` of the way, as floats."""
    mixed: list[float] = ((1 - weight) * start + weight * stop).tolist()
    return tuple(mixed)


def _hermite(where: float, sharpness: float) -> float:
    """Weight of the upper node at the relative place `where` (midpoint at ½): VTK's sharpened Hermite."""
    power = 1 + 10 * sharpness
    s = 0.5 * (2 * where) ** power if where < 0.5 else 1 - 0.5 * (2 - 2 * where) ** power
    tangent = 1 - sharpness
    weight = s * s * (3 - 2 * s) + tangent * (s**3 - 2 * s * s + s) + tangent * (s**3 - s * s)
    return float(min(max(weight, 0.0), 1.0))


def _runs(shape: TransferFunction, paint: TransferFunction) -> Iterator[_Run]:
    """Fine samples of both curves, one run from step to step."""
    knots = sorted({point.value for curve in (shape, paint) for point in curve.points})
    count = max(8, SAMPLE_COUNT // len(knots)) + 1
    parts: list[_Run] = []
    for low, high in pairwise(knots):
        part = _sampled(np.linspace(low, high, count), shape, paint)
        if parts and not (
            parts[-1].opacity[-1] == part.opacity[0] and (parts[-1].color[-1] == part.color[0]).all()
        ):
            yield _joined(parts)
            parts = []
        parts.append(part)
    yield _joined(parts)


def _sampled(values: F64, shape: TransferFunction, paint: TransferFunction) -> _Run:
    """Return samples between two neighbouring knots, with the limits from inside at both ends."""

    def inside(curve: TransferFunction, which: int) -> F64:
        sides: tuple[tuple[Side, Any], ...] = (("right", slice(None, -1)), ("left", slice(-1, None)))
        return np.concatenate([curve.evaluate(values[part], side)[which] for side, part in sides])

    opacity = np.minimum(inside(shape, 1), OPACITY_CEILING)
    return _Run(values, opacity, linear_from_srgb(inside(paint, 0)))


def _joined(parts: list[_Run]) -> _Run:
    """One run of several that meet; the doubled samples where they meet are left out."""
    keep = [slice(0 if i == 0 else 1, None) for i in range(len(parts))]
    pairs = list(zip(parts, keep, strict=True))
    return _Run(
        np.concatenate([part.values[rows] for part, rows in pairs]),
        np.concatenate([part.opacity[rows] for part, rows in pairs]),
        np.concatenate([part.color[rows] for part, rows in pairs]),
    )


def _simplified(run: _Run, extinction: F64, unit_distance: float) -> list[int]:
    """Return the samples that straight lines need to stay within `TOLERANCE` (Douglas and Peucker)."""
    kept = {0, len(run.values) - 1}
    stack = [(0, len(run.values) - 1)]
    while stack:
        start, stop = stack.pop()
        if stop - start < 2:
            continue
        rows = slice(start + 1, stop)
        weight = (run.values[rows] - run.values[start]) / (run.values[stop] - run.values[start])
        chord = (1 - weight) * extinction[start] + weight * extinction[stop]
        chord_color = (1 - weight)[:, None] * run.color[start] + weight[:, None] * run.color[stop]
        error = np.abs(-np.expm1(-chord * unit_distance) - run.opacity[rows])
        visible = np.maximum(run.opacity[rows], chord) > 0
        error = np.maximum(error, np.abs(chord_color - run.color[rows]).max(axis=1) * visible)
        worst = int(error.argmax())
        if error[worst] > TOLERANCE:
            kept.add(start + 1 + worst)
            stack += [(start, start + 1 + worst), (start + 1 + worst, stop)]
    return sorted(kept)

"""Control points and isosurfaces: the entries of a transfer function, checked when they are made."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from isosample.errors import InputError

Color = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class ControlPoint:
    """One corner of the transfer function.

    Parameters
    ----------
    value : float
        Scalar value, in data units; finite.
    color : 3 floats
        Linear RGB, straight (not multiplied by opacity), each in [0, 1].
    extinction : float
        Extinction [1/world], >= 0 and finite.

    Raises
    ------
    InputError
        If a number is not finite or out of its range (the message starts with the field's name).
    """

    value: float
    color: Color
    extinction: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "value", finite_number(self.value, "value"))
        object.__setattr__(self, "color", linear_color(self.color))
        extinction = finite_number(self.extinction, "extinction")
        if extinction < 0:
            raise InputError(f"extinction {extinction:g} is negative; extinction per world unit is >= 0.")
        object.__setattr__(self, "extinction", extinction)


@dataclass(frozen=True, slots=True)
class Isosurface:
    """An impulse of the transfer function: each crossing composites `opacity` once, whatever the angle.

    Parameters
    ----------
    value : float
        Isovalue, in data units; finite.
    color : 3 floats
        Linear RGB, straight, each in [0, 1].
    opacity : float
        Opacity of one crossing, unitless, in (0, 1].

    Raises
    ------
    InputError
        If a number is not finite or out of its range (the message starts with the field's name).
    """

    value: float
    color: Color
    opacity: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "value", finite_number(self.value, "value"))
        object.__setattr__(self, "color", linear_color(self.color))
        opacity = finite_number(self.opacity, "opacity")
        if not 0 < opacity <= 1:
            raise InputError(f"opacity {opacity:g} must be > 0 and <= 1; leave out an invisible isosurface.")
        object.__setattr__(self, "opacity", opacity)


def finite_number(number: object, what: str) -> float:
    """Return a finite float, or raise an `InputError` that starts with `what`."""
    if isinstance(number, bool) or not isinstance(number, (int, float, np.integer, np.floating)):
        raise InputError(f"{what} {number!r} must be a number.")
    try:
        result = float(number)
    except OverflowError:
        result = math.inf
    if not math.isfinite(result):
        raise InputError(f"{what} {number!r} must be finite.")
    return result


def linear_color(color: object) -> Color:
    """Return three floats in [0, 1], or raise an `InputError` that starts with ``color``."""
    if not isinstance(color, (list, tuple, np.ndarray)) or len(color) != 3:
        raise InputError(f"color {color!r} must be three numbers [r, g, b], linear, in [0, 1].")
    red, green, blue = (finite_number(channel, f"color[{i}]") for i, channel in enumerate(color))
    if min(red, green, blue) < 0 or max(red, green, blue) > 1:
        raise InputError(f"color {[red, green, blue]} must lie in [0, 1] (linear RGB).")
    return (red, green, blue)

"""The transfer function: what each scalar value looks like, as straight lines between control points."""

from __future__ import annotations

import itertools
import math
import os
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, Literal, TypeVar

import numpy as np
import numpy.typing as npt

from isosample.errors import InputError
from isosample.transfer.control_points import ControlPoint, Isosurface

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from isosample.volume.grid import Volume

__all__ = ["ControlPoint", "Isosurface", "Slope", "TransferFunction"]

F64 = npt.NDArray[np.float64]
Entry = TypeVar("Entry", ControlPoint, Isosurface)
Side = Literal["right", "left", "closed"]

SEPARATION_ULP = 4  # values closer than this many units in the last place are one value


@dataclass(frozen=True, slots=True)
class Slope:
    """A linear piece of the transfer function, of nonzero width, between two neighbouring control points."""

    low: ControlPoint
    high: ControlPoint

    @property
    def visible(self) -> bool:
        """True where any extinction on the slope is above 0."""
        return self.low.extinction > 0 or self.high.extinction > 0

    @property
    def constant(self) -> bool:
        """True where neither extinction nor colour changes along the slope."""
        return self.low.extinction == self.high.extinction and self.low.color == self.high.color


@dataclass(frozen=True)
class TransferFunction:
    """Extinction and colour of every scalar value, and isosurfaces on top of them.

    Parameters
    ----------
    points : sequence of ControlPoint
        None, or at least two; values ascend. Two points at the same value make a step.
    isosurfaces : sequence of Isosurface
        In any order (kept ascending); values distinct.

    Raises
    ------
    InputError
        If both lists are empty, values do not ascend, there is one point only, more than two points share a
        value, two isosurfaces share one, or an entry is of another type.

    Notes
    -----
    Between two points extinction and colour are each linear in the value; the emission of light is their
    product. Extinction is 0 below the first and above the last point, so an end with extinction is a step.
    """

    points: tuple[ControlPoint, ...]
    isosurfaces: tuple[Isosurface, ...] = ()

    def __init__(self, points: Sequence[ControlPoint], isosurfaces: Sequence[Isosurface] = ()) -> None:
        object.__setattr__(self, "points", _entries(points, ControlPoint, "points"))
        surfaces = _entries(isosurfaces, Isosurface, "isosurfaces")
        object.__setattr__(self, "isosurfaces", tuple(sorted(surfaces, key=lambda surface: surface.value)))
        _check_points(self.points)
        _check_isosurfaces(self.isosurfaces)
        if not self.points and not self.isosurfaces:
            raise InputError("a transfer function needs points or isosurfaces; both lists are empty.")

    def evaluate(self, values: npt.ArrayLike, side: Side = "closed") -> tuple[F64, F64]:
        """Colour and extinction at scalar values.

        Parameters
        ----------
        values : (...) float64
            Scalar values, in data units. NaN and infinities lie outside every point: extinction 0.
        side : {"closed", "right", "left"}
            Which limit to take at a step: from above ("right"), from below ("left"), or from above except
            at the very last point, where it is from below ("closed": a volume's maximum is often the last
            point).

        Returns
        -------
        color : (..., 3) float64
            Linear RGB, straight, in [0, 1]; outside the points the colour of the nearest one.
        extinction : (...) float64
            [1/world], >= 0.

        Raises
        ------
        InputError
            If `side` is none of the three.
        """
        if side not in ("right", "left", "closed"):
            raise InputError(f"side {side!r} must be 'right', 'left' or 'closed'.")
        values = np.asarray(values, dtype=np.float64)
        if not self.points:
            return np.zeros((*values.shape, 3)), np.zeros(values.shape)
        knots, color, extinction = self._arrays
        upper = np.searchsorted(knots, values, side="left" if side == "left" else "right")
        if side == "closed":
            last = np.searchsorted(knots, knots[-1], side="left")
            upper = np.where(values == knots[-1], last, upper)
        inside = (upper > 0) & (upper < len(knots))
        nearest = np.where(upper == 0, knots[0], knots[-1])
        upper = np.clip(upper, 1, len(knots) - 1)
        lower = upper - 1
        weight = _weight(np.where(inside, values, nearest), knots[lower], knots[upper])
        mixed_color: F64 = (1 - weight)[..., None] * color[lower] + weight[..., None] * color[upper]
        mixed_extinction = (1 - weight) * extinction[lower] + weight * extinction[upper]
        return mixed_color, np.where(inside, mixed_extinction, 0.0)

    def slopes(self) -> list[Slope]:
        """Return the linear pieces of nonzero width, in ascending order."""
        pairs = itertools.pairwise(self.points)
        return [Slope(low, high) for low, high in pairs if low.value < high.value]

    def peaks(self) -> list[float]:
        """Return the values of the local maxima of extinction, ascending; a plateau gives both its ends.

        A step's higher side counts, and so does an end of the function with extinction.
        """
        found: set[float] = set()
        extinction = [0.0, *(point.extinction for point in self.points), 0.0]
        start = 1
        while start <= len(self.points):
            stop = start
            while extinction[stop + 1] == extinction[start] > 0:
                stop += 1
            if extinction[start - 1] < extinction[start] > extinction[stop + 1]:
                found |= {self.points[start - 1].value, self.points[stop - 1].value}
            start = stop + 1
        return sorted(found)

    @classmethod
    def from_dict(cls, document: Mapping[str, Any], source: str = "transfer function") -> TransferFunction:
        """Transfer function from the content of a JSON file; see `json_format.parse_transfer_function`."""
        from isosample.transfer.json_format import parse_transfer_function

        return parse_transfer_function(document, source)

    def to_dict(self) -> dict[str, Any]:
        """Return the content of a JSON file; `from_dict` gives back an equal transfer function."""
        from isosample.transfer.json_format import transfer_function_to_dict

        return transfer_function_to_dict(self)

    @classmethod
    def load(cls, path: str | Path) -> TransferFunction:
        """Transfer function from a JSON file: this package's, 3D Slicer's or ParaView's.

        Raises
        ------
        InputError
            If the file cannot be read or is wrong; the message names the file, the entry and its value.
        """
        from isosample.transfer.json_format import load_transfer_function

        return load_transfer_function(path)

    def save(self, path: str | Path) -> None:
        """Write the JSON file, whole or not at all."""
        from isosample.transfer.json_format import save_transfer_function

        save_transfer_function(self, path)

    @classmethod
    def suggest(cls, volume: Volume) -> TransferFunction:
        """Transfer function that makes a first picture of a volume; see `suggest_transfer_function`."""
        from isosample.transfer.suggest import suggest_transfer_function

        return suggest_transfer_function(volume)

    @cached_property
    def _arrays(self) -> tuple[F64, F64, F64]:
        """Values (N,), colours (N, 3) and extinctions (N,) of the points."""
        return (
            np.array([point.value for point in self.points]),
            np.array([point.color for point in self.points]),
            np.array([point.extinction for point in self.points]),
        )


def check_is_transfer_function(transfer_function: object) -> None:
    """Raise `InputError` unless something is a `TransferFunction`; a path or a dict are told how to become one."""
    if isinstance(transfer_function, TransferFunction):
        return
    cure = "TransferFunction(points)"
    if isinstance(transfer_function, str | os.PathLike):
        cure = f"TransferFunction.load({os.fspath(transfer_function)!r})"
    elif isinstance(transfer_function, dict):
        cure = "TransferFunction.from_dict(...)"
    raise InputError(
        f"transfer_function is {transfer_function!r:.80}; expected a TransferFunction. Pass isosample.{cure}."
    )


def _entries(entries: Sequence[Entry], kind: type[Entry], name: str) -> tuple[Entry, ...]:
    """Return the entries as a tuple, or raise if one is of another type."""
    if not isinstance(entries, Iterable):
        raise InputError(f"{name} is {entries!r}; expected a list of {kind.__name__}.")
    found = tuple(entries)
    for i, entry in enumerate(found):
        if not isinstance(entry, kind):
            raise InputError(
                f"{name}[{i}] is {entry!r}; expected {kind.__name__}(value, (red, green, blue), "
                f"{'extinction' if name == 'points' else 'opacity'})."
            )
    return found


def _check_points(points: tuple[ControlPoint, ...]) -> None:
    """Raise unless there are none or at least two points, ascending, at most two at one value."""
    if len(points) == 1:
        raise InputError(
            f"points holds one point, at {points[0].value:g}; "
            "a slope needs two. Add a point, or use isosurfaces."
        )
    for i in range(1, len(points)):
        below, value = points[i - 1].value, points[i].value
        if value < below:
            raise InputError(
                f"points[{i}].value {value!r} is below points[{i - 1}].value {below!r}; values must ascend."
            )
        if i > 1 and value == points[i - 2].value:
            raise InputError(
                f"points[{i}].value {value!r} is the third at this value; "
                "two make a step. Remove the middle one."
            )
    if points and not math.isfinite(points[-1].value - points[0].value):
        raise InputError(
            f"points go from {points[0].value!r} to {points[-1].value!r}; their difference overflows."
        )


def _check_isosurfaces(isosurfaces: tuple[Isosurface, ...]) -> None:
    """Raise where two isosurfaces have the same value (to within `SEPARATION_ULP`)."""
    for low, high in itertools.pairwise(isosurfaces):
        if high.value - low.value <= SEPARATION_ULP * np.spacing(max(abs(low.value), abs(high.value))):
            raise InputError(
                f"isosurfaces has two entries at value {high.value!r}; their order is undefined. Keep one."
            )


def _weight(values: F64, low: F64, high: F64) -> F64:
    """Position of `values` between `low` and `high`, 0 to 1; 0 where the two are equal."""
    width = high - low
    with np.errstate(under="ignore"):  # a subnormal weight is 0 for every use
        weight: F64 = (values - low) / np.where(width > 0, width, 1.0)
    return np.clip(np.where(width > 0, weight, 0.0), 0.0, 1.0)

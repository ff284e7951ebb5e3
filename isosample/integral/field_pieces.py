"""Halves pieces of rays until their cubics agree with a closed-form field and nothing visible hides in them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from isosample.errors import InputError
from isosample.integral.ray_pieces import Pieces, halves

if TYPE_CHECKING:
    from isosample.integral.level_isolation import Isolation
    from isosample.volume.field import Field

F64 = npt.NDArray[np.float64]
I64 = npt.NDArray[np.int64]

FIRST_PIECES = 64  # per ray, before any is halved
HALVING_GAIN = 8.0  # halves err by 1/16 of the whole where the field is smooth; twice that is counted on
MAX_HALVINGS = 40  # a piece of 2^-46 of the ray, at a kink or a jump of the field, is left as it is
MAX_PIECES = 1 << 22  # of the rays of one block: 240 MB
BOUND_SLACK = 1e-9  # of the ray's way: what rounding of positions may add to a field's change
ROUNDING_ULP = 8  # a field's own rounding: agreement to so many units in the last place is agreement


def resolved_pieces(
    field: Field,
    base: float,
    line: tuple[F64, F64],
    intervals: F64,
    agreement: float,
    isolation: Isolation | None,
) -> Pieces | None:
    """Pieces whose cubics agree with the field and hide nothing, in order along every ray; None if too many."""
    todo = _first_pieces(field, base, line, intervals)
    if isolation is not None and todo.ray.size:
        _check_slopes(todo, base, isolation.bound, field)
    done: list[Pieces] = []
    count = 0
    for halving in range(MAX_HALVINGS + 1):
        middle = 0.5 * (todo.ends[:, 0] + todo.ends[:, 1])
        value, slope = _sample(field, base, line, todo.ray, middle)
        floor = ROUNDING_ULP * np.spacing(np.abs(base) + np.maximum(*np.abs(todo.values).T))
        enough = np.maximum(HALVING_GAIN * agreement, floor)
        good = np.tile(_disagreement(todo, value, slope) <= enough, 2)
        todo = halves(todo, middle, value, slope)
        if isolation is not None:
            good &= ~isolation.hides(todo, np.tile(floor, 2))
        good |= halving == MAX_HALVINGS
        done.append(todo.rows(good))
        count += len(good)
        if count > MAX_PIECES:
            return None
        todo = todo.rows(~good)
        if not todo.ray.size:
            break
    every = Pieces.joined(done)
    return every.rows(np.lexsort((every.ends[:, 0], every.ray)))


def _disagreement(pieces: Pieces, value: F64, slope: F64) -> F64:
    """Difference of cubic and field at the middle: of the values, plus 1/8 of the slopes' times the length."""
    length = pieces.ends[:, 1] - pieces.ends[:, 0]
    (front, back), (enter, leave) = pieces.values.T, pieces.slopes.T
    bend = enter - leave
    value_error = np.abs(value - 0.5 * (front + back) - 0.125 * length * bend)
    slope_error = np.abs(length * (slope + 0.25 * (enter + leave)) - 1.5 * (back - front))
    disagreement: F64 = value_error + 0.125 * slope_error
    return disagreement


def _first_pieces(field: Field, base: float, line: tuple[F64, F64], intervals: F64) -> Pieces:
    """Equal pieces of every ray that meets the box."""
    rays = np.flatnonzero(intervals[:, 0] < intervals[:, 1])
    share = np.linspace(0.0, 1.0, FIRST_PIECES + 1)
    knots = intervals[rays, :1] * (1.0 - share) + intervals[rays, 1:] * share
    value, slope = _sample(field, base, line, np.repeat(rays, FIRST_PIECES + 1), knots.ravel())

    def pairs(column: F64) -> F64:
        table = column.reshape(-1, FIRST_PIECES + 1)
        return np.stack([table[:, :-1].ravel(), table[:, 1:].ravel()], axis=1)

    return Pieces(np.repeat(rays, FIRST_PIECES), pairs(knots), pairs(value), pairs(slope))


def _check_slopes(pieces: Pieces, base: float, bound: float, field: Field) -> None:
    """Raise where the field itself contradicts the bound of its slope."""
    way = float(np.abs(pieces.ends).max())
    allowed = bound * (pieces.ends[:, 1] - pieces.ends[:, 0] + BOUND_SLACK * way)
    allowed += ROUNDING_ULP * np.spacing(abs(base) + np.abs(pieces.values).max())
    wrong = np.flatnonzero(np.abs(pieces.values[:, 1] - pieces.values[:, 0]) > allowed)
    if wrong.size:
        raise InputError(
            f"{type(field).__name__} bounds its slope by {bound:g}, yet changes by "
            f"{np.ptp(pieces.values[wrong[0]]):g} over {np.ptp(pieces.ends[wrong[0]]):g} world units. "
            "Correct lipschitz(), or let it return None."
        )


def _sample(field: Field, base: float, line: tuple[F64, F64], ray: I64, t: F64) -> tuple[F64, F64]:
    """Value less the base and slope along the ray, each (P,)."""
    points = line[0][ray] + t[:, None] * line[1][ray]
    value = field.value(points) - base
    slope: F64 = np.einsum("pi,pi->p", field.gradient(points), line[1][ray])
    wrong = np.flatnonzero(~(np.isfinite(value) & np.isfinite(slope)))
    if wrong.size:
        raise InputError(
            f"{type(field).__name__} has value {value[wrong[0]] + base} and slope {slope[wrong[0]]} at "
            f"{points[wrong[0]].tolist()}; expected finite numbers. Choose a box in which the field is finite."
        )
    return value, slope

"""Ground truth of the volume-rendering integral of a closed-form field, in float64.

Along a ray the field is replaced by cubic Hermite pieces, from its values and gradients, which are halved until they
agree with it; the pieces are then integrated as the cells of a grid are.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import numpy.typing as npt

from isosample.errors import InputError
from isosample.integral.band_table import BandTable, Optics, PanelRules
from isosample.integral.reference import (
    DEFAULT_TOLERANCE,
    box_intervals,
    checked_rays,
    clipped,
    offset_of,
    run_in_blocks,
)

if TYPE_CHECKING:
    from collections.abc import Sequence

    from isosample.integral.reference import Plane, Progress
    from isosample.transfer.transfer_function import TransferFunction
    from isosample.volume.field import Field
    from isosample.volume.grid import Box

F64 = npt.NDArray[np.float64]
I64 = npt.NDArray[np.int64]
Bool = npt.NDArray[np.bool_]

FIRST_PIECES = 64  # per ray, before any is halved
HALVING_GAIN = 8.0  # halves err by 1/16 of the whole where the field is smooth; twice that is counted on
MAX_HALVINGS = 40  # a piece of 2^-46 of the ray, at a kink or a jump of the field, is left as it is
ROUNDING_ULP = 8  # a field's own rounding: agreement to so many units in the last place is agreement


class _Pieces(NamedTuple):
    """Pieces of rays: row of the ray, ray parameter, value and slope (data units per world unit) at both ends."""

    ray: I64
    ends: F64  # (P, 2)
    values: F64  # (P, 2)
    slopes: F64  # (P, 2)

    def rows(self, chosen: Bool | I64) -> _Pieces:
        return _Pieces(self.ray[chosen], self.ends[chosen], self.values[chosen], self.slopes[chosen])

    @classmethod
    def joined(cls, parts: list[_Pieces]) -> _Pieces:
        return cls(
            np.concatenate([part.ray for part in parts]),
            np.concatenate([part.ends for part in parts]),
            np.concatenate([part.values for part in parts]),
            np.concatenate([part.slopes for part in parts]),
        )


def integrate_field_rays(
    field: Field,
    transfer_function: TransferFunction,
    box: Box,
    origins: npt.ArrayLike,
    directions: npt.ArrayLike,
    *,
    clip_planes: Sequence[Plane] = (),
    tolerance: float = DEFAULT_TOLERANCE,
    progress: Progress | None = None,
) -> F64:
    """Radiance and opacity of rays through a closed-form field inside a box.

    Parameters
    ----------
    field : Field
        Value and gradient at world positions.
    transfer_function : TransferFunction
    box : Box
        The field counts inside it only.
    origins, directions : (N, 3) array_like of float
        World space, directions of unit length. Only what lies in front of the origin counts.
    clip_planes, progress
        As for `integrate_rays`.
    tolerance : float
        1e-13 to 1e-2; see the notes for what it holds for.

    Returns
    -------
    rgba : (N, 4) float64
        Premultiplied linear RGBA, without background.

    Raises
    ------
    InputError
        As `integrate_rays`; also if the box has no extent or the field is not finite on a ray.

    Notes
    -----
    A change of the field by tolerance / (length of the ray · largest |dτ/dv| + largest |dc/dv|) changes depth
    and colour by at most the tolerance. A ray is cut into 64 equal pieces; a piece is halved until the cubic
    of its ends agrees, in value and in slope, with the field at its middle to within 8 times that; the two
    halves, whose cubics err by 1/16 as much, are then used. This is verification at points, not a proof: a
    feature of the field that is narrower than 1/128 of the ray's way through the box, and leaves no trace at
    those points, is missed. At a step of the transfer function and at an isosurface the crossing moves by
    the error of the field divided by its slope, so that the error grows where a ray nearly touches them.
    """
    starts, ways = checked_rays(origins, directions)
    matrix, last = _unit_from_world(box), np.ones(3)
    intervals = box_intervals((starts - box.corner) @ matrix.T, ways @ matrix.T, last)
    intervals = clipped(intervals, starts, ways, clip_planes)
    base, bands = _centred_bands(transfer_function)
    reach = float(np.linalg.norm(box.edges, axis=1).sum())
    optics = Optics(bands, PanelRules.for_tolerance(tolerance), 1)
    agreement = tolerance / _sensitivity(bands, reach)
    rgba = np.zeros((len(starts), 4))

    def work(rows: slice) -> None:
        from isosample.integral.ray_cells import integrate_piece_block

        line = (starts[rows], ways[rows])
        pieces = _resolved_pieces(field, base, line, intervals[rows], agreement)
        first = np.searchsorted(pieces.ray, np.arange(len(line[0]) + 1))
        lengths = np.ascontiguousarray(pieces.ends[:, 1] - pieces.ends[:, 0])
        integrate_piece_block((first, _bernstein(pieces), lengths), optics, rgba[rows])

    run_in_blocks(work, len(starts), progress)
    return rgba


def _unit_from_world(box: Box) -> F64:
    """(3, 3) float64, maps world offsets from the box's corner to [0, 1] along its edges."""
    if abs(np.linalg.det(box.edges)) == 0.0:
        raise InputError(f"the box with edges {box.edges.tolist()} has no extent; give it three edges.")
    return np.asarray(np.linalg.inv(box.edges.T), dtype=np.float64)


def _centred_bands(transfer_function: TransferFunction) -> tuple[float, BandTable]:
    """What to subtract from the field, and the bands less that."""
    values = [point.value for point in transfer_function.points]
    values += [surface.value for surface in transfer_function.isosurfaces]
    base = offset_of(min(values), max(values))
    return base, BandTable.from_transfer_function(transfer_function, base)


def _sensitivity(bands: BandTable, reach: float) -> float:
    """Largest change of a component of the picture per change of the field by one data unit, >= 1."""
    inner = slice(1, -1)
    width = np.diff(bands.edges)[inner]
    shown = bands.extinction[inner].max(axis=1, initial=0.0) > 0
    by_depth = np.abs(np.diff(bands.extinction[inner], axis=1)[:, 0]) / width
    by_color = np.abs(np.diff(bands.color[inner], axis=1)[:, 0]).max(axis=1, initial=0.0) / width
    return max(1.0, float(((reach * by_depth + by_color) * shown).max(initial=0.0)))


def _resolved_pieces(
    field: Field, base: float, line: tuple[F64, F64], intervals: F64, agreement: float
) -> _Pieces:
    """Pieces whose cubics agree with the field, in order along every ray."""
    todo = _first_pieces(field, base, line, intervals)
    done: list[_Pieces] = []
    for halving in range(MAX_HALVINGS + 1):
        middle = todo.ends.mean(axis=1)
        value, slope = _sample(field, base, line, todo.ray, middle)
        length = todo.ends[:, 1] - todo.ends[:, 0]
        rise, bend = todo.values[:, 1] - todo.values[:, 0], todo.slopes[:, 0] - todo.slopes[:, 1]
        value_error = np.abs(value - todo.values.mean(axis=1) - 0.125 * length * bend)
        slope_error = np.abs(length * (slope + 0.25 * todo.slopes.sum(axis=1)) - 1.5 * rise)
        floor = ROUNDING_ULP * np.spacing(np.abs(base) + np.abs(todo.values).max(axis=1, initial=0.0))
        enough = np.maximum(HALVING_GAIN * agreement, floor)
        good = (value_error + 0.125 * slope_error <= enough) | (halving == MAX_HALVINGS)
        halves = _halves(todo, middle, value, slope)
        done.append(halves.rows(np.tile(good, 2)))
        todo = halves.rows(np.tile(~good, 2))
        if not todo.ray.size:
            break
    every = _Pieces.joined(done)
    return every.rows(np.lexsort((every.ends[:, 0], every.ray)))


def _first_pieces(field: Field, base: float, line: tuple[F64, F64], intervals: F64) -> _Pieces:
    """Equal pieces of every ray that meets the box."""
    rays = np.flatnonzero(intervals[:, 0] < intervals[:, 1])
    share = np.linspace(0.0, 1.0, FIRST_PIECES + 1)
    knots = intervals[rays, :1] * (1.0 - share) + intervals[rays, 1:] * share
    value, slope = _sample(field, base, line, np.repeat(rays, FIRST_PIECES + 1), knots.ravel())

    def pairs(column: F64) -> F64:
        table = column.reshape(-1, FIRST_PIECES + 1)
        return np.stack([table[:, :-1].ravel(), table[:, 1:].ravel()], axis=1)

    return _Pieces(np.repeat(rays, FIRST_PIECES), pairs(knots), pairs(value), pairs(slope))


def _halves(pieces: _Pieces, middle: F64, value: F64, slope: F64) -> _Pieces:
    """First halves of all pieces, then second halves."""

    def split(column: F64, at_middle: F64) -> F64:
        front = np.stack([column[:, 0], at_middle], axis=1)
        return np.concatenate([front, np.stack([at_middle, column[:, 1]], axis=1)])

    return _Pieces(
        np.tile(pieces.ray, 2),
        split(pieces.ends, middle),
        split(pieces.values, value),
        split(pieces.slopes, slope),
    )


def _sample(field: Field, base: float, line: tuple[F64, F64], ray: I64, t: F64) -> tuple[F64, F64]:
    """Value less the base and slope along the ray, each (P,)."""
    points = line[0][ray] + t[:, None] * line[1][ray]
    value = field.value(points) - base
    slope: F64 = (field.gradient(points) * line[1][ray]).sum(axis=1)
    wrong = np.flatnonzero(~(np.isfinite(value) & np.isfinite(slope)))
    if wrong.size:
        raise InputError(
            f"{type(field).__name__} has value {value[wrong[0]] + base} and slope {slope[wrong[0]]} at "
            f"{points[wrong[0]].tolist()}; expected finite numbers. Choose a box in which the field is finite."
        )
    return value, slope


def _bernstein(pieces: _Pieces) -> F64:
    """(P, 4) float64, Bernstein coefficients of the Hermite cubics."""
    third = (pieces.ends[:, 1:] - pieces.ends[:, :1]) / 3.0 * pieces.slopes
    (front, back), (rise, fall) = pieces.values.T, third.T
    return np.ascontiguousarray(np.stack([front, front + rise, back - fall, back], axis=1))

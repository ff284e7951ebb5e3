"""Ground truth of the volume-rendering integral of a closed-form field, in float64.

Along a ray the field is replaced by cubic Hermite pieces, from its values and gradients, which are halved until they
agree with it, and, where the field's slope has a known bound, until nothing visible can hide between their
ends; the pieces are then integrated as the cells of a grid are.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import numpy.typing as npt

from isosample.errors import CapacityError, InputError
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
    from collections.abc import Callable, Sequence

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
MAX_PIECES = 1 << 22  # of the rays of one block: 240 MB
BOUND_SLACK = 1e-9  # of the ray's way: what rounding of positions may add to a field's change
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


class _Isolation(NamedTuple):
    """What must not hide in a piece: the levels of the transfer function with all that is visible there.

    Attributes
    ----------
    bound : float
        Of the field's slope [data units / world].
    levels : (K,) float64
        Ascending, less the base.
    extinction : (K + 1, 2) float64
        By band, at its lower and its upper end [1/world].
    peak : (K + 1, K + 1) float64
        ``peak[i, j]`` is the largest extinction on either side of the levels i to j − 1; 0 for none.
    surfaces, steps : (K + 1,) int64
        Number of isosurfaces and of steps of the extinction or colour among the levels below the i-th.
    tolerance, agreement : float
        What a hidden optical depth [1] and a hidden excursion [data units] may amount to.
    """

    bound: float
    levels: F64
    extinction: F64
    peak: F64
    surfaces: I64
    steps: I64
    tolerance: float
    agreement: float

    @classmethod
    def build(cls, bound: float, bands: BandTable, tolerance: float, agreement: float) -> _Isolation:
        beside = np.maximum(bands.extinction[:-1, 1], bands.extinction[1:, 0])
        count = len(beside)
        peak = np.zeros((count + 1, count + 1))
        for first in range(count):
            peak[first, first + 1 :] = np.maximum.accumulate(beside[first:])
        jumps = (bands.extinction[:-1, 1] != bands.extinction[1:, 0]) | (
            (bands.color[:-1, 1] != bands.color[1:, 0]).any(axis=1) & (beside > 0.0)
        )
        surfaces, steps = (np.append(0, np.cumsum(which)) for which in (bands.level_visible, jumps))
        levels = bands.edges[1:-1]
        return cls(bound, levels, bands.extinction, peak, surfaces, steps, tolerance, agreement)

    def mirrored(self) -> _Isolation:
        """The same for the field times −1, but for the steps, which `_above` does not ask for."""
        return self._replace(
            levels=-self.levels[::-1],
            extinction=self.extinction[::-1, ::-1],
            peak=self.peak[::-1, ::-1].T,
            surfaces=self.surfaces[-1] - self.surfaces[::-1],
        )

    def hides(self, pieces: _Pieces, floor: F64) -> Bool:
        """(P,) bool, whether a piece may reach something visible that lies beyond both of its ends.

        Also whether it may cross an isosurface or a step, between its ends, more often than it must.
        """
        low, high = np.minimum(*pieces.values.T), np.maximum(*pieces.values.T)
        length = pieces.ends[:, 1] - pieces.ends[:, 0]
        over = np.maximum(0.5 * (self.bound * length - (high - low)), 0.0)
        least = np.maximum(self.agreement, floor)
        flat = low == high
        hidden = self._above(high, over, length, flat, over > least)
        hidden |= self.mirrored()._above(-low, over, length, flat, over > least)
        first = np.searchsorted(self.levels, low, side="right")
        final = np.maximum(np.searchsorted(self.levels, high, side="left"), first)
        many = self.surfaces[final] > self.surfaces[first]
        many |= (length * self.peak[0, -1] > self.tolerance) & (self.steps[final] > self.steps[first])
        hidden |= many & (over > least)
        return hidden

    def _above(self, top: F64, over: F64, length: F64, flat: Bool, surfaces_hide: Bool) -> Bool:
        """Whether the levels from `top` to `top + over` weigh too much; a flat piece has reached its own."""
        first = np.searchsorted(self.levels, top, side="left")
        first[flat] = np.searchsorted(self.levels, top[flat], side="right")
        final = np.searchsorted(self.levels, top + over, side="right")
        hidden = final > first
        (some,) = np.nonzero(hidden)
        first, final, reach = first[some], final[some], top[some] + over[some]
        edges = np.append(self.levels, np.inf)
        at_low, at_high = self.extinction[final].T  # of the band of the highest value; final >= 1
        share = (reach - edges[final - 1]) / (edges[final] - edges[final - 1])
        extinction = np.maximum(self.peak[first, final], at_low + share * (at_high - at_low))
        surface = surfaces_hide[some] & (self.surfaces[final] > self.surfaces[first])
        hidden[some] = surface | (length[some] * extinction > self.tolerance)
        return hidden


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
        Value and gradient at world positions, and the bound of its slope if it has one.
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
        As `integrate_rays`; also if the box has no extent, the field is not finite on a ray or the bound of
        its slope is not a number >= 0 or is contradicted by its values.
    CapacityError
        If a ray needs more than 2²² pieces.

    Notes
    -----
    A change of the field by the agreement tolerance / (length of the ray · largest |dτ/dv| + largest |dc/dv|)
    changes depth and colour by at most the tolerance. A ray is cut into 64 equal pieces; a piece is halved
    until the cubic of its ends agrees, in value and in slope, with the field at its middle to within 8 times
    that; the two halves, whose cubics err by 1/16 as much, are then used. This is verification at points.

    Where ``field.lipschitz()`` gives a bound L, the field on a piece [a, b] keeps within
    (f(a) + f(b)) / 2 ± L (b − a) / 2, and a piece is halved as long as that interval reaches a control point, a
    step or an isosurface beyond both f(a) and f(b), or f(a) and f(b) lie on two sides of a step or an
    isosurface (which could be crossed more than once). It is left when the interval reaches

    - no isosurface, or is wider than [f(a), f(b)] by the agreement at most: every crossing of an isosurface
      is found, but for pairs of crossings that a change of the field by the agreement removes; and
    - no extinction τ with τ (b − a) > tolerance: what hides in one piece adds less than the tolerance to the
      optical depth, so that no visible range, however narrow the feature that reaches it, is missed.

    Not guaranteed, even so: a feature between two points whose values keep within the bands (the ranges between
    levels of the transfer function) that the ends of its piece show is verified at points only, and so is
    all of a field without a bound: there a feature narrower than 1/128 of the ray's way through the box may be
    missed. The proof is in real numbers; the rounding of positions, about 1e-16 of them times L, is not in it.
    At a step and at an isosurface the crossing moves by the error of the field divided by its slope, so that
    the error grows where a ray nearly touches them. A ray that keeps within L · s of an isosurface over a
    length l needs about l / s pieces.
    """
    starts, ways = checked_rays(origins, directions)
    matrix, last = _unit_from_world(box), np.ones(3)
    intervals = box_intervals((starts - box.corner) @ matrix.T, ways @ matrix.T, last)
    intervals = clipped(intervals, starts, ways, clip_planes)
    base, bands = _centred_bands(transfer_function)
    reach = float(np.linalg.norm(box.edges, axis=1).sum())
    optics = Optics(bands, PanelRules.for_tolerance(tolerance), 1)
    agreement = tolerance / _sensitivity(bands, reach)
    bound = _checked_bound(field)
    isolation = None if bound is None else _Isolation.build(bound, bands, tolerance, agreement)
    rgba = np.zeros((len(starts), 4))

    def work(rows: slice) -> None:
        from isosample.integral.ray_cells import integrate_piece_block

        line = (starts[rows], ways[rows])
        pieces = _resolved_pieces(field, base, line, intervals[rows], agreement, isolation)
        if pieces is None:
            _work_on_halves(work, rows, field)
            return
        first = np.searchsorted(pieces.ray, np.arange(len(line[0]) + 1))
        lengths = np.ascontiguousarray(pieces.ends[:, 1] - pieces.ends[:, 0])
        integrate_piece_block((first, _bernstein(pieces), lengths), optics, rgba[rows])

    run_in_blocks(work, len(starts), progress)
    return rgba


def _work_on_halves(work: Callable[[slice], None], rows: slice, field: Field) -> None:
    """Work on fewer rays at once; raise where it is one already."""
    if rows.stop - rows.start <= 1:
        raise CapacityError(
            f"ray {rows.start} runs so close to a visible value of {type(field).__name__} that more than "
            f"{MAX_PIECES} pieces do not prove what it meets. Shift the ray or the transfer function a little."
        )
    middle = (rows.start + rows.stop) // 2
    work(slice(rows.start, middle))
    work(slice(middle, rows.stop))


def _checked_bound(field: Field) -> float | None:
    """Bound of the field's slope, if it has one."""
    bound = field.lipschitz()
    if bound is not None and not 0.0 <= bound < np.inf:
        raise InputError(
            f"{type(field).__name__} bounds its slope by {bound!r}; expected a finite number >= 0, or None."
        )
    return bound


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
    field: Field,
    base: float,
    line: tuple[F64, F64],
    intervals: F64,
    agreement: float,
    isolation: _Isolation | None,
) -> _Pieces | None:
    """Pieces whose cubics agree with the field and hide nothing, in order along every ray; None if too many."""
    todo = _first_pieces(field, base, line, intervals)
    if isolation is not None and todo.ray.size:
        _check_slopes(todo, base, isolation.bound, field)
    done: list[_Pieces] = []
    count = 0
    for halving in range(MAX_HALVINGS + 1):
        middle = 0.5 * (todo.ends[:, 0] + todo.ends[:, 1])
        value, slope = _sample(field, base, line, todo.ray, middle)
        floor = ROUNDING_ULP * np.spacing(np.abs(base) + np.maximum(*np.abs(todo.values).T))
        enough = np.maximum(HALVING_GAIN * agreement, floor)
        good = np.tile(_disagreement(todo, value, slope) <= enough, 2)
        todo = _halves(todo, middle, value, slope)
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
    every = _Pieces.joined(done)
    return every.rows(np.lexsort((every.ends[:, 0], every.ray)))


def _disagreement(pieces: _Pieces, value: F64, slope: F64) -> F64:
    """Difference of cubic and field at the middle: of the values, plus 1/8 of the slopes' times the length."""
    length = pieces.ends[:, 1] - pieces.ends[:, 0]
    (front, back), (enter, leave) = pieces.values.T, pieces.slopes.T
    bend = enter - leave
    value_error = np.abs(value - 0.5 * (front + back) - 0.125 * length * bend)
    slope_error = np.abs(length * (slope + 0.25 * (enter + leave)) - 1.5 * (back - front))
    disagreement: F64 = value_error + 0.125 * slope_error
    return disagreement


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


def _check_slopes(pieces: _Pieces, base: float, bound: float, field: Field) -> None:
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
    slope: F64 = np.einsum("pi,pi->p", field.gradient(points), line[1][ray])
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

"""Data-centric integration over the exact crossings of a closed-form field: the segment rules without any mesh."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import numpy.typing as npt

from isosample.integral.crossing_lists import BORDER, CrossingLists
from isosample.integral.data_centric import integrate_lists
from isosample.integral.ray import box_interval

if TYPE_CHECKING:
    from collections.abc import Callable

    from isosample.integral.segment_rule import SegmentRule
    from isosample.transfer.isovalue_plan import IsovaluePlan
    from isosample.volume.field import Field
    from isosample.volume.geometry import Box

F64 = npt.NDArray[np.float64]
I64 = npt.NDArray[np.int64]

SCAN_STEPS = 256  # a field that turns twice in 1/256 of the ray's way through the box may cross unseen
ROOT_STEPS = 60  # bisection alone gets below the rounding of a distance; Newton's method needs 4 to 8
RAYS_AT_ONCE = 1024  # 6 MB per component of the scan


class _Pieces(NamedTuple):
    """Pieces of rays on which the field is monotone, in order along every ray: ray, two ends, the values there."""

    ray: I64
    ends: F64
    values: F64


def integrate_exact_crossings(
    field: Field, plan: IsovaluePlan, box: Box, origins: F64, directions: F64, rule: SegmentRule
) -> F64:
    """Premultiplied RGBA of rays whose crossings with the isosurfaces are exact.

    Parameters
    ----------
    field : Field
    plan : IsovaluePlan
    box : Box
        The field is taken inside it.
    origins, directions : (N, 3) float64
        World space; directions are unit vectors. Only what lies in front of the origin counts.
    rule : SegmentRule
        How the data are taken to run between crossings.

    Returns
    -------
    rgba : (N, 4) float64
    """
    lists = exact_crossing_lists(field, plan.isovalues, box, origins, directions)
    return integrate_lists(lists, plan, rule=rule, reach=0.0).rgba


def exact_crossing_lists(
    field: Field, isovalues: F64, box: Box, origins: F64, directions: F64
) -> CrossingLists:
    """All crossings of rays with the isosurfaces of a closed-form field, to rounding, with exact slopes.

    Parameters
    ----------
    field : Field
    isovalues : (K,) float64
        Ascending [data units].
    box : Box
        The field is taken inside it.
    origins, directions : (N, 3) float64
        World space; directions are unit vectors.

    Returns
    -------
    lists : CrossingLists
        Also of what lies behind the origins. A value equal to an isovalue is inside.

    Notes
    -----
    The field and its slope along the ray are scanned in 256 even steps. A step at whose ends the slopes differ
    in sign is cut where the slope is 0, so that two crossings of one isosurface beside a grazing point are
    found however close they are; a field that turns twice within a step is taken for monotone there.
    """
    unit_from_world = np.linalg.inv(box.edges.T)
    chords = box_interval((origins - box.corner) @ unit_from_world.T, directions @ unit_from_world.T)
    met = np.flatnonzero(chords[:, 0] < chords[:, 1])
    blocks = [met[i : i + RAYS_AT_ONCE] for i in range(0, len(met), RAYS_AT_ONCE)]
    parts = [_entries(field, isovalues, (origins[rays], directions[rays]), chords[rays]) for rays in blocks]
    ray = np.concatenate(
        [np.empty(0, dtype=np.int64), *(rays[part[0]] for rays, part in zip(blocks, parts, strict=True))]
    )
    columns = [np.concatenate([np.empty(0), *(part[1][k] for part in parts)]) for k in range(5)]
    distance, level, rising, slope, value = columns
    nothing = np.zeros(len(ray))
    return CrossingLists(
        first=np.searchsorted(ray, np.arange(len(origins) + 1)),
        distance=distance,
        level=level.astype(np.int64),
        rising=rising != 0.0,
        slope=slope,
        residual=nothing,
        value=value,
        tolerance=nothing,
    )


def _entries(
    field: Field, isovalues: F64, line: tuple[F64, F64], chords: F64
) -> tuple[I64, tuple[F64, F64, F64, F64, F64]]:
    """Ray, and distance, level, rising, slope and value, of every entry of some rays, sorted."""

    def sample(ray: I64, t: F64) -> tuple[F64, F64]:
        points = line[0][ray] + t[:, None] * line[1][ray]
        slope: F64 = np.einsum("pi,pi->p", field.gradient(points), line[1][ray])
        return field.value(points), slope

    pieces = _monotone_pieces(sample, chords)
    piece, level, rising = _levels_between(pieces, isovalues)
    ray = pieces.ray[piece]

    def above(rows: I64, t: F64) -> tuple[F64, F64]:
        value, slope = sample(ray[rows], t)
        return value - isovalues[level[rows]], slope

    distance = _roots(above, rising, pieces.ends[piece])
    distance = distance[np.lexsort((distance, ray))]  # levels of one place keep the order of travel
    slope = np.abs(sample(ray, distance)[1])
    count = np.arange(len(chords))
    borders = np.searchsorted(pieces.ray, count), np.searchsorted(pieces.ray, count, side="right") - 1
    values = [pieces.values[row, side] for side, row in enumerate(borders)]
    unknown, border = np.full(len(count), np.nan), np.full(len(count), float(BORDER))
    columns = (
        np.concatenate([chords[:, 0], distance, chords[:, 1]]),
        np.concatenate([border, level, border]),
        np.concatenate([np.ones(len(count)), rising, np.zeros(len(count))]),
        np.concatenate([unknown, slope, unknown]),
        np.concatenate([values[0], np.zeros(len(level)), values[1]]),
    )
    order = np.argsort(np.concatenate([count, ray, count]), kind="stable")
    first, second, third, fourth, fifth = (column[order] for column in columns)
    return np.concatenate([count, ray, count])[order], (first, second, third, fourth, fifth)


def _monotone_pieces(sample: Callable[[I64, F64], tuple[F64, F64]], chords: F64) -> _Pieces:
    """Pieces of the scan, cut where the field turns."""
    share = np.linspace(0.0, 1.0, SCAN_STEPS + 1)
    knots = chords[:, :1] * (1.0 - share) + chords[:, 1:] * share
    rays = np.repeat(np.arange(len(chords)), SCAN_STEPS + 1)
    value, slope = (column.reshape(knots.shape) for column in sample(rays, knots.ravel()))
    where, step = np.nonzero(slope[:, :-1] * slope[:, 1:] < 0.0)
    ends = np.stack([knots[where, step], knots[where, step + 1]], axis=1)
    turns = _roots(lambda rows, t: (sample(where[rows], t)[1], None), slope[where, step] < 0.0, ends)
    ray = np.concatenate([rays, where])
    t = np.concatenate([knots.ravel(), turns])
    values = np.concatenate([value.ravel(), sample(where, turns)[0]])
    order = np.lexsort((t, ray))
    ray, t, values = ray[order], t[order], values[order]
    same = ray[1:] == ray[:-1]
    pairs = [np.stack([column[:-1], column[1:]], axis=1)[same] for column in (t, values)]
    return _Pieces(ray[:-1][same], *pairs)


def _levels_between(pieces: _Pieces, isovalues: F64) -> tuple[I64, I64, npt.NDArray[np.bool_]]:
    """Piece, level and direction of every crossing, in the order of travel."""
    band = np.searchsorted(isovalues, pieces.values, side="right")
    rise = band[:, 1] - band[:, 0]
    piece = np.repeat(np.arange(len(rise)), np.abs(rise))
    number = np.arange(len(piece)) - np.repeat(np.cumsum(np.abs(rise)) - np.abs(rise), np.abs(rise))
    rising = rise[piece] > 0
    level = np.where(rising, band[piece, 0] + number, band[piece, 0] - 1 - number)
    return piece, level, rising


def _roots(
    function: Callable[[I64, F64], tuple[F64, F64 | None]], rising: npt.NDArray[np.bool_], ends: F64
) -> F64:
    """Places in [`ends`] where monotone functions pass 0: Newton's method inside shrinking brackets, or bisection.

    The function gives values at places of some rows and, for Newton's method, derivatives.
    """
    low, high = ends.T.copy()
    place: F64 = 0.5 * (low + high)
    rows = np.arange(len(place))  # those that still move
    for _ in range(ROOT_STEPS):
        if not len(rows):
            break
        here = place[rows]
        value, slope = function(rows, here)
        beyond = (value >= 0.0) == rising[rows]
        high[rows], low[rows] = np.where(beyond, here, high[rows]), np.where(beyond, low[rows], here)
        middle = 0.5 * (low[rows] + high[rows])
        following = middle
        if slope is not None:
            safe = np.where(slope == 0.0, 1.0, slope)
            newton = here - value / safe
            following = np.where(
                (slope != 0.0) & (newton > low[rows]) & (newton < high[rows]), newton, middle
            )
        place[rows] = following
        rows = rows[np.abs(following - here) > 2.0 * np.spacing(np.abs(following))]
    return place

"""Peaks of a transfer function that are too narrow for a mesh, each as one sheet at one isovalue."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import numpy.typing as npt

from isosample.transfer.control_points import ControlPoint
from isosample.transfer.transfer_function import SEPARATION_ULP, TransferFunction

if TYPE_CHECKING:
    from isosample.transfer.control_points import Color

F64 = npt.NDArray[np.float64]
Gradients = Callable[[Sequence[float]], Sequence[float | None]]

SHEET_WIDTH = 0.01  # [voxel]; surfaces closer than this are one to a mesh, whose vertices err by more
SHEET_COUNT = "narrow_peaks_as_sheets"  # name of their number among what a plan leaves out


class Sheet(NamedTuple):
    """A narrow peak of the extinction, as light sees it: one surface.

    A crossing composites `color` with opacity 1 − exp(−area / |df/dt|).
    """

    value: float  # centre of mass of the excess [data units], or the isosurface inside the peak
    area: float  # integral of the excess extinction over the value [data units/world]
    color: Color  # mean over the excess, linear RGB, straight
    width: float  # of the peak, divided by the typical gradient [voxel]


class _Run(NamedTuple):
    """The control points `first` to `last` of a narrow peak, and the typical gradient at it."""

    first: int
    last: int
    gradient: float  # [data units/voxel]


def split_sheets(
    transfer_function: TransferFunction, value_range: tuple[float, float], gradients: Gradients | None
) -> tuple[list[Sheet], TransferFunction]:
    """Sheets in place of the narrow peaks, and the transfer function without those peaks.

    Parameters
    ----------
    transfer_function : TransferFunction
    value_range : (low, high)
        Of the volume, in data units.
    gradients : callable or None
        Typical gradient magnitude of the field [data units/voxel] at each of a list of values, None where it
        is unknown. It is called once, and only where a peak may be narrow enough. None: no peak is a sheet.

    Returns
    -------
    sheets : list of Sheet
        Ascending.
    rest : TransferFunction
        Every peak's run of control points is moved into its sheet's value: a step from the extinction at the
        run's lower end to that at its upper end, no step where both are 0.

    Notes
    -----
    A peak is a run of control points of which all but the two ends lie above the line between these, the
    highest of them above both ends; the ends of the transfer function drop to 0. A run whose width divided by
    the typical gradient is below `SHEET_WIDTH` is a sheet; of several around one summit the widest is taken.
    Its excess over the line between its ends is the sheet, what lies below that line stays in the rest. There
    the slopes beside the peak move by less than `SHEET_WIDTH`, so that optical depths change by less than
    `SHEET_WIDTH` voxels' worth of the extinction at the run's ends. Two peaks with a valley on that line
    between them are two sheets, in the order that light meets them.

    On a ray along which the field is linear across the peak, the sheet's opacity is exact. Where the field
    bends, its relative error falls with the square of the width, because the sheet stands at the centre of
    mass; only rays that graze the surface see another picture. Light that is absorbed by another colour of
    the same peak is not told apart: colours are mixed.

    Left as they are: peaks that reach beyond the value range (a region at its maximum can fill space), peaks
    at which no gradient is known, and peaks narrower than float64 resolves. An isosurface of the transfer
    function inside a run takes the sheet to its value, so that both are one isovalue.
    """
    points = _closed_points(transfer_function)
    if gradients is None or not points:
        return [], transfer_function
    runs = _narrow_runs(points, value_range, gradients)
    surfaces = [surface.value for surface in transfer_function.isosurfaces]
    sheets: list[Sheet] = []
    kept: list[_Run] = []
    for run in runs:
        sheet = _sheet(points[run.first : run.last + 1], run.gradient, surfaces)
        if sheet is not None:
            sheets.append(sheet)
            kept.append(run)
    return sheets, _without(transfer_function, points, kept, sheets) if sheets else transfer_function


def _closed_points(transfer_function: TransferFunction) -> list[ControlPoint]:
    """Control points, of which the outermost have no extinction."""
    return _closed(_closed(list(transfer_function.points))[::-1])[::-1]


def _closed(points: list[ControlPoint]) -> list[ControlPoint]:
    """Points of which the first has no extinction: one more, or in place of the outer side of a step."""
    if not points or points[0].extinction == 0:
        return points
    first = points[0]
    seen = points[1:] if first.value == points[1].value else points
    return [ControlPoint(first.value, first.color, 0.0), *seen]


def _narrow_runs(
    points: list[ControlPoint], value_range: tuple[float, float], gradients: Gradients
) -> list[_Run]:
    """Runs narrower than `SHEET_WIDTH`, ascending, that share no more than an end."""
    value = np.array([point.value for point in points])
    extinction = np.array([point.extinction for point in points])
    low, high = value_range
    steepest = math.sqrt(3.0) * (high - low)  # a difference per voxel is at most the range, along each axis
    summits = [
        i
        for i in range(1, len(points) - 1)
        if extinction[i - 1] < extinction[i] >= extinction[i + 1]
        and value[i + 1] - value[i - 1] < SHEET_WIDTH * steepest
        and low < value[i] < high
    ]
    known = gradients(value[summits].tolist()) if summits else []
    runs: list[_Run] = []
    start = int(np.searchsorted(value, low, side="left"))
    stop = int(np.searchsorted(value, high, side="right"))
    for summit, gradient in zip(summits, known, strict=True):
        if gradient is None or summit < start:
            continue
        ends = _widest_run(value[:stop], extinction[:stop], start, summit, SHEET_WIDTH * gradient)
        if ends is not None:
            runs.append(_Run(*ends, gradient))
            start = ends[1]
    return runs


def _widest_run(value: F64, extinction: F64, start: int, summit: int, limit: float) -> tuple[int, int] | None:
    """First and last point of the widest peak around `summit` that is narrower than `limit`, from `start` on."""
    best: tuple[int, int] | None = None
    widest = SEPARATION_ULP * float(np.spacing(np.abs(value[summit])))
    for first in range(summit - 1, start - 1, -1):
        if value[summit] - value[first] >= limit:
            break
        for last in _run_ends(value, extinction, first, summit, limit):
            width = float(value[last] - value[first])
            top = extinction[first + 1 : last].max()
            if width > widest and top > max(extinction[first], extinction[last]):
                best, widest = (first, last), width
    return best


def _run_ends(value: F64, extinction: F64, first: int, summit: int, limit: float) -> list[int]:
    """Points beyond `summit` and closer to `first` than `limit`, the line to which runs below all in between."""
    stop = int(np.searchsorted(value, value[first] + limit, side="left"))
    if stop <= summit + 1:
        return []
    rise = extinction[first + 1 : stop] - extinction[first]
    width = value[first + 1 : stop] - value[first]
    with np.errstate(divide="ignore", over="ignore", invalid="ignore"):
        slope = np.where(rise == 0, 0.0, rise / width)
    below = slope[1:] < np.minimum.accumulate(slope)[:-1]
    ends: list[int] = (np.flatnonzero(below) + first + 2).tolist()
    return [end for end in ends if end > summit]


def _sheet(run: Sequence[ControlPoint], gradient: float, surfaces: list[float]) -> Sheet | None:
    """Return the sheet of a run, or None where float64 does not resolve its place inside the run."""
    value = np.array([point.value for point in run])
    color = np.array([point.color for point in run])
    extinction = np.array([point.extinction for point in run])
    width = float(value[-1] - value[0])
    place = (value - value[0]) / width  # 0 to 1 along the run
    excess = extinction - (extinction[0] + place * (extinction[-1] - extinction[0]))
    excess[[0, -1]] = 0.0
    weight = float(_products(place, excess, np.ones((len(run), 1)))[0])
    if weight * width <= 0:
        return None  # too little for float64
    mean = _products(place, excess, np.concatenate([place[:, None], color], axis=1)) / weight
    centre = float(value[0] + width * mean[0])
    apart = SEPARATION_ULP * float(np.spacing(np.abs(value[[0, -1]]).max()))
    low, high = float(value[0]) + apart, float(value[-1]) - apart
    inside = [surface for surface in surfaces if low < surface < high]
    chosen = min(inside, key=lambda surface: abs(surface - centre), default=centre)
    if not low < chosen < high:
        return None
    red, green, blue = (float(channel) for channel in np.clip(mean[1:], 0.0, 1.0))
    return Sheet(chosen, weight * width, (red, green, blue), width / gradient)


def _products(place: F64, excess: F64, other: F64) -> F64:
    """(M,) integrals over `place` of `excess` (N,) times each column of `other` (N, M), all linear in pieces."""
    length = np.diff(place)[:, None]
    front, back = excess[:-1, None], excess[1:, None]
    near, far = other[:-1], other[1:]
    with np.errstate(under="ignore"):
        mixed = 2.0 * front * near + front * far + back * near + 2.0 * back * far
        integrals: F64 = (length * mixed / 6.0).sum(axis=0)
    return integrals


def _without(
    transfer_function: TransferFunction, points: list[ControlPoint], runs: list[_Run], sheets: list[Sheet]
) -> TransferFunction:
    """Transfer function in which every run is one step at its sheet's value."""
    moved: list[ControlPoint] = []
    next_point = 0
    for run, sheet in zip(runs, sheets, strict=True):
        moved += points[next_point : run.first]
        moved += [
            ControlPoint(sheet.value, end.color, end.extinction)
            for end in (points[run.first], points[run.last])
        ]
        next_point = run.last + 1
    return TransferFunction([*moved, *points[next_point:]], transfer_function.isosurfaces)

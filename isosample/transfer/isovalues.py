"""Which isovalues a transfer function needs over a range of values."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from isosample.errors import InputError
from isosample.transfer.isovalue_plan import CONSTANT_SLOPES, IsovaluePlan, PlanRow, Reason
from isosample.transfer.sheets import SHEET_COUNT, split_sheets
from isosample.transfer.slope_values import slope_values
from isosample.transfer.transfer_function import SEPARATION_ULP, check_is_transfer_function

if TYPE_CHECKING:
    from collections.abc import Sequence

    from isosample.transfer.sample_shares import SampleShares
    from isosample.transfer.sheets import Gradients, Sheet
    from isosample.transfer.slope_values import SlopeValues
    from isosample.transfer.transfer_function import TransferFunction

__all__ = ["IsovaluePlan", "PlanRow", "Reason", "plan_isovalues"]

F64 = npt.NDArray[np.float64]

BLACK = (0.0, 0.0, 0.0)

PRIORITY: dict[Reason | None, int] = {reason: rank for rank, reason in enumerate(Reason)}

MAX_PER_SLOPE = 10_000  # a few slopes then fill the levels that a scene can have


def plan_isovalues(
    transfer_function: TransferFunction,
    value_range: tuple[float, float],
    *,
    per_slope: int = 5,
    extra: Sequence[float] = (),
    gradients: Gradients | None = None,
    lit: bool = False,
    shares: SampleShares | None = None,
) -> IsovaluePlan:
    """Isovalues that a picture needs, and the transfer function between them.

    Parameters
    ----------
    transfer_function : TransferFunction
        What is visible.
    value_range : (low, high)
        Smallest and largest sample of the volume, in data units; may be equal (then K = 0).
    per_slope : int
        Number of evenly spaced values inside each visible slope (its part inside the value range), >= 0.
    extra : sequence of float
        Further isovalues; those in bands without extinction are left out.
    gradients : callable, optional
        Typical gradient magnitude of the volume [data units/voxel] at each of a list of values, None where it
        is unknown; for instance ``functools.partial(gradient_at_values, volume)``. Peaks that are narrower
        than a hundredth of a voxel by it become sheets (see `sheets.split_sheets`). Without it none does.
    lit : bool
        Whether pictures will be lit (`RenderSettings.material`): then visible slopes that are constant in
        extinction and colour get values too.
    shares : SampleShares, optional
        Of the volume: for light the values inside these slopes are spaced half by value and half by samples, instead of
        evenly. The plan keeps it.

    Returns
    -------
    plan : IsovaluePlan
        With K = 0 and bands of extinction 0 where nothing is visible.

    Raises
    ------
    InputError
        If the range is not finite or not ascending, or `per_slope` is no whole number from 0 to 10000.

    Notes
    -----
    Every control point that bounds a visible slope or is a visible step is an isovalue, so that inside a band
    extinction and colour are linear. A slope that is constant in extinction and colour gets no values
    inside: without light, the colour and the opacity of a stretch of ray within it depend on its length alone,
    which the crossings of its two ends give exactly; nothing is gained by knowing the field in between. With
    light the normal counts, which is known at crossings alone and turns between them: with `lit` such a slope is
    divided as any other. Beyond the first and the last control point there is no extinction, so nothing to light.

    Values of slopes are kept where low < v < high: a level at the maximum is a degenerate surface.
    Isosurfaces are kept where low < v <= high: a maximum can fill a region whose border is a surface.
    Values closer than 4 units in the last place are one isovalue; the limits are those outside the cluster.
    """
    check_is_transfer_function(transfer_function)
    low, high = _checked_range(value_range)
    if not _is_whole(per_slope) or not 0 <= per_slope <= MAX_PER_SLOPE:
        raise InputError(f"per_slope {per_slope!r} must be a whole number from 0 to {MAX_PER_SLOPE}.")
    sheets, transfer_function = split_sheets(transfer_function, (low, high), gradients)
    points, skipped_points = _point_candidates(transfer_function, low, high)
    slopes = slope_values(transfer_function, (low, high), per_slope, shares)
    between, constant_count = _between_candidates(slopes, lit=lit)
    surfaces = transfer_function.isosurfaces
    impulses = [_candidate(s.value, Reason.IMPULSE) for s in surfaces if low < s.value <= high]
    further = _extra_candidates(transfer_function, low, high, extra)
    sheet_values = {sheet.value for sheet in sheets}
    points = [point for point in points if point.value not in sheet_values]
    thin = [_candidate(value, Reason.SHEET) for value in sorted(sheet_values)]
    chosen = [*points, *between, *further, *impulses, *thin]
    clusters = _clusters([*chosen, _candidate(low, None), _candidate(high, None)])
    skipped = {
        **skipped_points,
        CONSTANT_SLOPES: constant_count,
        "isosurfaces_outside_range": len(surfaces) - len(impulses),
        "extra_values_not_visible": len(extra) - len(further),
        SHEET_COUNT: len(sheets),
        "values_merged": len(chosen) - sum(cluster.level is not None for cluster in clusters),
    }
    return replace(
        _assemble(transfer_function, (low, high), clusters, sheets, skipped), lit=lit, shares=shares
    )


def _is_whole(number: object) -> bool:
    return isinstance(number, (int, np.integer))


def _assemble(
    transfer_function: TransferFunction,
    value_range: tuple[float, float],
    clusters: list[_Cluster],
    sheets: list[Sheet],
    skipped: dict[str, int],
) -> IsovaluePlan:
    """Plan with one isovalue per cluster that has a level, and the limits of the bands between them."""
    below, above = _limits(transfer_function, clusters)
    levels = [(i, cluster.level) for i, cluster in enumerate(clusters)]
    kept = [i for i, level in levels if level is not None]
    chosen = [level for _, level in levels if level is not None]
    isovalues = np.array([level.value for level in chosen])
    lower, upper = [0, *kept], [*kept, len(clusters) - 1]  # the clusters at the two ends of each band
    surfaces = {surface.value: surface for surface in transfer_function.isosurfaces}
    impulses = [surfaces[c.value] if c.reason is Reason.IMPULSE else None for c in chosen]
    at_value = {sheet.value: sheet for sheet in sheets}
    thin = [at_value.get(c.value) for c in chosen]
    return IsovaluePlan(
        isovalues=isovalues,
        reasons=tuple(level.reason for level in chosen if level.reason is not None),
        value_range=value_range,
        band_values=np.stack([[value_range[0], *isovalues], [*isovalues, value_range[1]]], axis=1),
        band_extinction=np.stack([above[1][lower], below[1][upper]], axis=1),
        band_color=np.stack([above[0][lower], below[0][upper]], axis=1),
        impulse_opacity=np.array([s.opacity if s else 0.0 for s in impulses]),
        impulse_color=np.array([s.color if s else BLACK for s in impulses]).reshape(-1, 3),
        sheet_area=np.array([sheet.area if sheet else 0.0 for sheet in thin]),
        sheet_color=np.array([sheet.color if sheet else BLACK for sheet in thin]).reshape(-1, 3),
        sheet_width=np.array([sheet.width if sheet else 0.0 for sheet in thin]),
        skipped=skipped,
    )


def _limits(
    transfer_function: TransferFunction, clusters: list[_Cluster]
) -> tuple[tuple[F64, F64], tuple[F64, F64]]:
    """Colours and extinctions just below and just above every cluster; at a range end from inside alone."""
    first = np.array([cluster.members[0].value for cluster in clusters])
    last = np.array([cluster.members[-1].value for cluster in clusters])
    below, above = transfer_function.evaluate(first, "left"), transfer_function.evaluate(last, "right")
    if len(clusters) == 1:
        closed = transfer_function.evaluate(last, "closed")
        return closed, closed
    for side_below, side_above in zip(below, above, strict=True):
        side_below[0], side_above[-1] = side_above[0], side_below[-1]
    return below, above


def _point_candidates(
    transfer_function: TransferFunction, low: float, high: float
) -> tuple[list[_Candidate], dict[str, int]]:
    """Candidates for the control points inside the range, and counts of those left out."""
    reasons = _point_reasons(transfer_function)
    inside = {v: reason for v, reason in reasons.items() if low < v < high}
    values = [point.value for point in transfer_function.points]
    skipped = {
        "points_outside_range": sum(not low <= v <= high for v in values),
        "points_without_visible_slope": sum(v in inside and inside[v] is None for v in values),
    }
    return [_candidate(v, reason) for v, reason in inside.items() if reason is not None], skipped


def _point_reasons(transfer_function: TransferFunction) -> dict[float, Reason | None]:
    """Reason of every control point's value; None where nothing is visible on either side."""
    slope_ends = {end.value for s in transfer_function.slopes() if s.visible for end in (s.low, s.high)}
    peaks = set(transfer_function.peaks())
    values = sorted({point.value for point in transfer_function.points})
    steps = _visible_steps(transfer_function, values)
    reasons: dict[float, Reason | None] = {}
    for value, step in zip(values, steps, strict=True):
        if not step and value not in slope_ends:
            reasons[value] = None
        elif value in peaks:
            reasons[value] = Reason.PEAK
        else:
            reasons[value] = Reason.STEP if step else Reason.SLOPE_END
    return reasons


def _visible_steps(transfer_function: TransferFunction, values: list[float]) -> list[bool]:
    """Tell at which values extinction jumps, or colour does where there is extinction on both sides."""
    color_below, below = transfer_function.evaluate(values, "left")
    color_above, above = transfer_function.evaluate(values, "right")
    recolored = (color_below != color_above).any(axis=-1) & (below > 0) & (above > 0)
    steps: list[bool] = ((below != above) | recolored).tolist()
    return steps


def _between_candidates(slopes: list[SlopeValues], *, lit: bool) -> tuple[list[_Candidate], int]:
    """Return the values inside the visible slopes, and the number of constant slopes that get none."""
    found: list[_Candidate] = []
    for slope in slopes:
        if lit or not slope.constant:
            tolerance = _tolerance(
                max(abs(slope.start), abs(slope.stop))
            )  # of the spacing's rounding, also near 0
            found += [_Candidate(value, tolerance, Reason.BETWEEN) for value in slope.values]
    return found, 0 if lit else sum(slope.constant for slope in slopes)


def _extra_candidates(
    transfer_function: TransferFunction, low: float, high: float, extra: Sequence[float]
) -> list[_Candidate]:
    """Return the caller's own values, those inside the range and with extinction on either side."""
    _, below = transfer_function.evaluate(extra, "left")
    _, above = transfer_function.evaluate(extra, "right")
    return [
        _candidate(float(value), Reason.BETWEEN)
        for value, visible in zip(extra, (below > 0) | (above > 0), strict=True)
        if visible and low < value < high
    ]


def _clusters(candidates: list[_Candidate]) -> list[_Cluster]:
    """Group candidates that are one value; the first group holds the range's low end, the last its high."""
    clusters: list[_Cluster] = []
    for candidate in sorted(candidates, key=lambda c: (c.value, c.reason is None)):
        if clusters and clusters[-1].joins(candidate):
            clusters[-1].members.append(candidate)
        else:
            clusters.append(_Cluster([candidate]))
    return clusters


def _candidate(value: float, reason: Reason | None) -> _Candidate:
    """Candidate with the tolerance of its own magnitude."""
    return _Candidate(value, _tolerance(value), reason)


def _tolerance(magnitude: float) -> float:
    """Return the distance below which two values of this magnitude are one."""
    return SEPARATION_ULP * float(np.spacing(abs(magnitude)))


def _checked_range(value_range: tuple[float, float]) -> tuple[float, float]:
    """Return the range as floats, or raise where it is not finite and ascending."""
    low, high = (float(end) for end in value_range)
    if not (math.isfinite(low) and math.isfinite(high) and low <= high):
        raise InputError(f"value range {value_range} must be finite and ascending (smallest, largest).")
    return low, high


@dataclass(frozen=True, slots=True)
class _Candidate:
    """A value that may become an isovalue; closer than `tolerance` to another, the two are one."""

    value: float
    tolerance: float
    reason: Reason | None  # None: an end of the value range


@dataclass(frozen=True, slots=True)
class _Cluster:
    """Candidates that are one value, ascending."""

    members: list[_Candidate]

    def joins(self, candidate: _Candidate) -> bool:
        """Tell whether `candidate` (not below the members) is one value with them."""
        first = self.members[0]
        if (
            candidate.reason is Reason.IMPULSE
            and self.level is not None
            and self.level.reason is Reason.IMPULSE
        ):
            return False  # two isosurfaces of the transfer function stay two
        return candidate.value - first.value < max(first.tolerance, candidate.tolerance)

    @property
    def level(self) -> _Candidate | None:
        """The member that stands for all, first in the order of `Reason`; None where an end absorbs them."""
        named = [member for member in self.members if member.reason is not None]
        at_end = len(named) < len(self.members)
        best = min(named, key=lambda member: PRIORITY[member.reason], default=None)
        return best if best is None or not at_end or best.reason is Reason.IMPULSE else None

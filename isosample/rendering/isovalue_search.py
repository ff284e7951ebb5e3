"""Isovalues for a tolerance: the bands that err most are divided until exact crossings give the picture."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from isosample.defaults import DEFAULT_PER_SLOPE
from isosample.rendering.picture_lists import least_sheet_slope
from isosample.rendering.quality import shares_for_light
from isosample.rendering.shown_error import shown_error
from isosample.transfer.isovalue_plan import CONSTANT_SLOPES
from isosample.transfer.isovalues import plan_isovalues
from isosample.transfer.slope_values import plateau_values
from isosample.volume.reconstruction import GridSpline
from isosample.volume.statistics import gradient_at_values

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from isosample.integral.crossing_lists import CrossingLists
    from isosample.rendering.planning_views import PlanningViews
    from isosample.transfer.isovalue_plan import IsovaluePlan
    from isosample.transfer.sample_shares import SampleShares
    from isosample.transfer.sheets import Gradients
    from isosample.transfer.transfer_function import TransferFunction
    from isosample.volume.grid import Volume
    from isosample.volume.reconstruction import Reconstruction

    Crossings = Callable[[npt.NDArray[np.float64]], CrossingLists]

F64 = npt.NDArray[np.float64]

START_PER_SLOPE = 1
LEAST_SHARE, LARGEST_SHARE = 0.12, 0.5  # of the visible bands are divided in one round
JUDGED = 0.5  # rays count from this share of the target on, so that other views do not fail at once
NARROWEST = 1e-9  # of the value range: narrower bands are not divided


@dataclass(frozen=True, slots=True)
class IsovalueSearch:
    """A plan, the error that it leaves with exact crossings, and how it was found.

    Attributes
    ----------
    plan : IsovaluePlan
    error : float
        What a thousandth of the rays exceed.
    rounds : list of dict
        ``isovalues`` and ``error`` of every round, JSON-ready.
    """

    plan: IsovaluePlan
    error: float
    rounds: list[dict[str, Any]]

    def marked(self, *, lit: bool, shares: SampleShares | None) -> IsovalueSearch:
        """The same, with a plan that says whether it is for light."""
        if not lit:
            return self
        skipped = self.plan.skipped | {CONSTANT_SLOPES: 0}
        return replace(self, plan=replace(self.plan, lit=True, shares=shares, skipped=skipped))


def search_isovalues(
    views: PlanningViews,
    transfer_function: TransferFunction,
    value_range: tuple[float, float],
    crossings: Crossings,
    *,
    target: float,
    max_isovalues: int,
    gradients: Gradients | None,
    least_slope: float,
    lit: bool = False,
    shares: SampleShares | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> IsovalueSearch:
    """Divide bands until cubic segments between exact crossings show the truth.

    Parameters
    ----------
    views : PlanningViews
    transfer_function : TransferFunction
    value_range : (low, high)
        Of the field, in data units.
    crossings : callable
        Exact crossings of the views' rays with isovalues (K,).
    target : float
        Largest error for all but a thousandth of the rays.
    max_isovalues : int
        The search ends before it exceeds this number; the control points are in the plan in any case.
    gradients : callable or None
        As for `plan_isovalues`.
    least_slope : float
        As for `integrate_lists`.
    lit : bool
        Whether pictures will be lit: slopes of constant extinction and colour are then given the default number of
        values per slope, as the search, whose pictures have no light, sees no need for any.
    shares : SampleShares, optional
        As for `plan_isovalues`, for these values.
    progress : callable, optional
        Called with the number of isovalues and `max_isovalues`.

    Notes
    -----
    A round divides, in the middle, the bands in which cubic and linear segments differ most on the rays that
    err: the square of the difference, as it reaches the eye, summed over these rays (`judge_lists`). It also
    divides the band of largest optical weight, because what stays inside a band and never crosses an isovalue
    leaves no trace in that sum. Far from the target more bands are divided at once: the error falls with about
    the square of their number.
    """
    from isosample.integral.data_centric import integrate_lists

    extra = plateau_values(transfer_function, value_range, DEFAULT_PER_SLOPE, shares) if lit else []
    rounds: list[dict[str, Any]] = []
    best: IsovalueSearch | None = None
    before = -1
    while True:
        plan = plan_isovalues(
            transfer_function, value_range, per_slope=START_PER_SLOPE, extra=extra, gradients=gradients
        )
        count = len(plan.isovalues)
        if best is not None and (count > max_isovalues or count == before):
            return best.marked(lit=lit, shares=shares)
        before = count
        lists = crossings(plan.isovalues)
        integrals = integrate_lists(lists, plan, reach=0.0, least_slope=least_slope)
        errors = views.errors(integrals.rgba)
        error = shown_error(errors)
        rounds.append({"isovalues": count, "error": error})
        if best is None or error < best.error:
            best = IsovalueSearch(plan, error, rounds)
        if progress is not None:
            progress(min(count, max_isovalues), max_isovalues)
        if error <= target:
            return best.marked(lit=lit, shares=shares)
        share = min(max(0.5 * (math.sqrt(error / target) - 1.0), LEAST_SHARE), LARGEST_SHARE)
        weights = _band_weights(lists, plan, errors > JUDGED * target, least_slope)
        extra += _middles(plan, weights, share, max_isovalues - count)


def search_field(
    volume: Volume,
    transfer_function: TransferFunction,
    views: PlanningViews,
    reconstruction: Reconstruction,
    *,
    target: float,
    max_isovalues: int,
    lit: bool,
    progress: Callable[[int, int], None] | None = None,
) -> IsovalueSearch:
    """Search isovalues for exact crossings of the field that a volume's reconstruction gives.

    Parameters
    ----------
    views, target, max_isovalues, lit, progress
        As for `search_isovalues`.
    volume : Volume
    transfer_function : TransferFunction
    reconstruction : Reconstruction
    """
    from isosample.integral.grid_crossings import grid_crossings

    smooth = reconstruction.smooth
    low, high = GridSpline.build(volume, reconstruction).value_range if smooth else volume.value_range
    origins, directions = views.rays
    return search_isovalues(
        views,
        transfer_function,
        (low, high),
        lambda values: grid_crossings(volume, values, origins, directions, reconstruction=reconstruction),
        target=target,
        max_isovalues=max_isovalues,
        gradients=_remembered(partial(gradient_at_values, volume)),
        least_slope=least_sheet_slope((low, high), volume.box),
        lit=lit,
        shares=shares_for_light(volume, transfer_function) if lit else None,
        progress=progress,
    )


def _remembered(gradients: Gradients) -> Gradients:
    """Gradients that are measured once for every list of values."""
    known: dict[tuple[float, ...], Sequence[float | None]] = {}

    def look_up(values: Sequence[float]) -> Sequence[float | None]:
        key = tuple(values)
        if key not in known:
            known[key] = gradients(values)
        return known[key]

    return look_up


def _band_weights(
    lists: CrossingLists, plan: IsovaluePlan, judged: npt.NDArray[np.bool_], least_slope: float
) -> F64:
    """(K + 1,) what every band adds to the difference between cubic and linear segments on the judged rays."""
    from isosample.integral.list_errors import judge_lists

    visible = np.where(judged[:, None], [0.0, np.inf], [0.0, 0.0])
    return judge_lists(lists, plan, reach=0.0, visible=visible, least_slope=least_slope).by_band


def _middles(plan: IsovaluePlan, weights: F64, share: float, room: int) -> list[float]:
    """Middles of the bands to divide, those of largest weight first, and of one that weighs most by its optics."""
    low, high = plan.band_values.T
    width = high - low
    constant = (plan.band_extinction[:, 0] == plan.band_extinction[:, 1]) & (
        plan.band_color[:, 0] == plan.band_color[:, 1]
    ).all(axis=1)
    dividable = (
        plan.band_visible & ~constant & (width > NARROWEST * (plan.value_range[1] - plan.value_range[0]))
    )
    count = max(math.ceil(share * np.count_nonzero(plan.band_visible)), 1)
    heaviest = np.argsort(-np.where(dividable, weights, 0.0), kind="stable")[:count]
    chosen = [int(band) for band in heaviest if dividable[band] and weights[band] > 0]
    optical = np.where(dividable, width * plan.band_extinction.max(axis=1), 0.0)
    optical[chosen] = 0.0
    if optical.any():
        chosen.insert(0, int(np.argmax(optical)))
    middles: list[float] = (0.5 * low + 0.5 * high)[chosen[: max(room, 0)]].tolist()
    return middles

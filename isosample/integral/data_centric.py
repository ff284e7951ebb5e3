"""The data-centric integral of rays in float64: the resolve pass on crossing lists.

Twin: ``shaders/pass/resolve.glsl``. Source: Lindholm et al., "Towards data centric sampling for volume
rendering", Algorithm 1 and eqs. 2 and 3; with slopes at the crossings, see `segment`.

>>> integrals = integrate_lists(lists, plan, reach=float(np.linalg.norm(volume.spacing)))
>>> integrals.rgba
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import numpy.typing as npt

from isosample.errors import InputError
from isosample.integral.crossing_lists import checked_lists
from isosample.integral.segment_rule import SegmentRule

if TYPE_CHECKING:
    from isosample.integral.crossing_lists import CrossingLists
    from isosample.integral.list_segments import Optics
    from isosample.integral.list_spans import Levels
    from isosample.integral.reference import Progress
    from isosample.transfer.isovalue_plan import IsovaluePlan

F64 = npt.NDArray[np.float64]
I64 = npt.NDArray[np.int64]


class ListIntegrals(NamedTuple):
    """Pictures of N rays, and what their walks met.

    Attributes
    ----------
    rgba : (N, 4) float64
        Premultiplied linear RGBA, without background.
    violations : (N,) int64
        Crossings that do not continue the walk of a ray that lost some, and borders that do not fit.
    reordered : (N,) int64
        Crossings out of the order of the levels on a ray that lost none: meshes of neighbouring levels cut
        each other there.
    unplaced : (N,) int64
        Lost crossings that were put in at places which nothing tells. A ray with one cannot be repaired with
        certainty.
    """

    rgba: F64
    violations: I64
    reordered: I64
    unplaced: I64


class Prepared(NamedTuple):
    """Checked arguments of a walk, as kernels take them."""

    lists: CrossingLists
    levels: Levels
    optics: Optics
    visible: F64


def integrate_lists(
    lists: CrossingLists,
    plan: IsovaluePlan,
    *,
    reach: float,
    rule: SegmentRule = SegmentRule.CUBIC,
    visible: npt.ArrayLike | None = None,
    least_slope: float = 0.0,
    progress: Progress | None = None,
) -> ListIntegrals:
    """Radiance and opacity of rays, from their crossings with the isosurfaces.

    Parameters
    ----------
    lists : CrossingLists
    plan : IsovaluePlan
        The transfer function in every band, the sheets and the impulses.
    reach : float
        Diagonal of a cell [world], >= 0: within it meshes of several levels may cut each other. 0 for exact
        crossings.
    rule : SegmentRule
        How the data runs between crossings.
    visible : (N, 2) array_like of float, optional
        Start and end of the part of each ray that is not cut away [world]. Default: what is in front of the
        origin.
    least_slope : float
        |df/dt| of a sheet's crossing is taken for as large at least [data units/world], >= 0.
    progress : callable, optional
        Called with the number of rays done and of all rays.

    Returns
    -------
    integrals : ListIntegrals

    Raises
    ------
    InputError
        If the lists are not as documented, an array has the wrong shape, or a number is out of range.

    Notes
    -----
    A span runs from a border point at which the ray enters to the next border point, or to the end of the
    list; what lies outside is not integrated. If its crossings lead from the band of the entry's value to that
    of the exit's, it is balanced, and every crossing moves the walk by one band, in whatever order they
    stand; unless the order tells that crossings which cancel were lost. Where the value on the border and the
    surfaces disagree about the band within the value's tolerance, the surfaces decide. Anything else is a
    loss: levels are then put in where they are missing, and counted.

    A lost crossing is put in, in this order: where the slope of the next crossing meets it, if nothing is
    visible before it; where the slope of the previous one does, if nothing is visible behind it; where the
    Hermite cubic of the gap goes through its level in its direction, if both slopes are known; where the
    straight line meets it; else in the middle. Counted as unplaced are those of the first two that miss the
    gap by more than `reach`, those of the cubic between two crossings of their own level, those on an end of
    the straight line, and the last.
    """
    from isosample.integral.list_segments import RULE_NUMBERS
    from isosample.integral.list_sums import integrate_block
    from isosample.integral.reference import run_in_blocks

    prepared = prepare(lists, plan, reach=reach, visible=visible, least_slope=least_slope)
    count = len(prepared.visible)
    rgba, counts = np.zeros((count, 4)), np.zeros((count, 3), dtype=np.int64)
    number = RULE_NUMBERS[rule]

    def work(rows: slice) -> None:
        integrate_block(rows.start, prepared, number, rgba[rows], counts[rows])

    run_in_blocks(work, count, progress)
    return ListIntegrals(rgba, *counts.T)


def prepare(
    lists: CrossingLists,
    plan: IsovaluePlan,
    *,
    reach: float,
    visible: npt.ArrayLike | None,
    least_slope: float,
) -> Prepared:
    """Check the arguments of `integrate_lists`; see there."""
    from isosample.integral.list_segments import optics_of
    from isosample.integral.list_spans import Levels

    for name, number in (("reach", reach), ("least_slope", least_slope)):
        if not 0.0 <= number < np.inf:
            raise InputError(f"{name} {number!r} must be a finite number >= 0.")
    checked = checked_lists(lists, len(plan.isovalues))
    count = len(checked.first) - 1
    cut = np.array([[0.0, np.inf]]) if visible is None else np.asarray(visible, dtype=np.float64)
    if visible is None:
        cut = np.repeat(cut, count, axis=0)
    if cut.shape != (count, 2) or np.isnan(cut).any():
        raise InputError(
            f"visible has shape {cut.shape}; expected ({count}, 2) numbers, a start and an end per ray."
        )
    levels = Levels(
        np.ascontiguousarray(plan.isovalues),
        np.ascontiguousarray(plan.band_values),
        plan.band_visible,
        float(reach),
    )
    return Prepared(checked, levels, optics_of(plan, least_slope), np.ascontiguousarray(cut))

"""How far pictures from crossing lists may be off: an indicator, a guaranteed interval, the mesh's share.

>>> errors = judge_lists(lists, plan, reach=float(np.linalg.norm(volume.spacing)))
>>> errors.indicator.max(), errors.by_band.argmax()
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import numpy.typing as npt

from isosample.integral.data_centric import prepare

if TYPE_CHECKING:
    from isosample.integral.crossing_lists import CrossingLists
    from isosample.integral.reference import Progress
    from isosample.transfer.isovalue_plan import IsovaluePlan

F64 = npt.NDArray[np.float64]


class ListErrors(NamedTuple):
    r"""How far the pictures of N rays may be off.

    Attributes
    ----------
    indicator : (N,) float64
        Largest difference of the cubic and the linear rule over RGBA. It orders rays and bands by their error,
        and exceeds the cubic's error on most rays, often by far; it promises nothing. It does not see what
        both rules miss (a field that turns twice between two crossings), nor the error of the crossings.
    interval : (N, 2, 4) float64
        Lower and upper bounds of premultiplied RGBA. Guaranteed for any field that crosses the isovalues where
        the lists say and nowhere else, whatever it does between, and for the transfer function of the plan;
        to rounding. First order in the width of the bands: far wider than the cubic's error. Not covered:
        crossings that are off, and pairs of crossings that are missing. A ray on which crossings were missed
        or out of order gets the interval that holds for every ray: 0 to the brightest colour, opacity 0 to 1.
    mesh : (N,) float64
        Estimate of what the residuals of the crossings change, to first order: each moves its crossing by
        residual / \|df/dt\|, by the longer of the adjoining segments at most. Neither crossings that the
        mesh misses or invents (silhouettes) nor the displacement of sheets and impulses against each other.
    by_band : (K + 1,) float64
        For every band, the sum over the rays' segments in it of the squares of the indicator of the segment
        alone, as it is seen through what lies in front.
    """

    indicator: F64
    interval: F64
    mesh: F64
    by_band: F64


def judge_lists(
    lists: CrossingLists,
    plan: IsovaluePlan,
    *,
    reach: float,
    visible: npt.ArrayLike | None = None,
    least_slope: float = 0.0,
    progress: Progress | None = None,
) -> ListErrors:
    r"""Judge the pictures that `integrate_lists` makes with cubic segments; arguments and errors as there.

    Returns
    -------
    errors : ListErrors

    Notes
    -----
    Interval: on a segment of length h in a band with extinction in [τ₀, τ₁] and colour in [c₀, c₁], what is
    seen is a mean of colours in [c₀, c₁] of weight 1 − q and of what lies behind of weight q, with q in
    [exp(−h τ₁), exp(−h τ₀)]. From back to front,

    .. math:: I_{lo} \leftarrow \min_q c_0 + q\,(I_{lo} - c_0), \qquad
              I_{hi} \leftarrow \max_q c_1 + q\,(I_{hi} - c_1),

    both at an end of q's range. A sheet at a crossing of unknown slope may have any opacity.

    Mesh: a crossing displaced by e lengthens one of its two segments at the cost of the other, which changes
    the optical depth by e (τ_f − τ_b) and the light by e (τ_f c_f − τ_b c_b), with the means of extinction and
    colour over the segments in front and behind, seen through the transmittance T in front. The larger
    change, times T, summed over the crossings.
    """
    from isosample.integral.list_judgement import judge_block
    from isosample.integral.reference import run_in_blocks

    prepared = prepare(lists, plan, reach=reach, visible=visible, least_slope=least_slope)
    count = len(prepared.visible)
    errors = ListErrors(
        np.zeros(count), np.zeros((count, 2, 4)), np.zeros(count), np.zeros(len(plan.band_values))
    )
    sums: dict[int, F64] = {}

    def work(rows: slice) -> None:
        sums[rows.start] = np.zeros_like(errors.by_band)
        per_ray = (errors.indicator[rows], errors.interval[rows], errors.mesh[rows])
        judge_block(rows.start, prepared, per_ray, sums[rows.start])

    run_in_blocks(work, count, progress)
    for start in sorted(sums):  # the same sum whatever the order in which threads finish
        errors.by_band[:] += sums[start]
    return errors

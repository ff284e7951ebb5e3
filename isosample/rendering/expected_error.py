"""How far a view of which nothing is measured is expected to err, by what was measured for a plan."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Mapping


def expected_error(estimates: Mapping[str, float], report: Mapping[str, Any]) -> float:
    """Error that a thousandth of a view's pixels are expected to exceed.

    Parameters
    ----------
    estimates : mapping
        `ErrorMap.percentiles` of the view.
    report : mapping
        Of the plan.

    Returns
    -------
    error : float
        What was reached on the views of the plan, times the larger of the ratios by which the indicator and the
        estimate of the mesh's error are larger here than there (1 at least); one that was 0 there is left out.
        Neither promises anything, and neither sees silhouettes.
    """
    known = report["estimates"]
    ratios = [estimates[name] / known[name] for name in ("indicator", "mesh") if known[name] > 0.0]
    return float(report["reached"] * max([1.0, *ratios]))

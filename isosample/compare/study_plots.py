"""Plots of convergence studies: the errors, the order seen, and the order or bound expected."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from isosample.errors import MissingDependencyError
from isosample.files import replacing

if TYPE_CHECKING:
    from pathlib import Path

    from isosample.compare.study import Study

SEEN, EXPECTED = "#1f6fb2", "#b0b0b0"


def plot_study(study: Study, path: Path) -> None:
    """Write a log-log plot of one study as PNG.

    Parameters
    ----------
    study : Study
    path : Path
        The file appears whole or not at all.

    Raises
    ------
    MissingDependencyError
        If matplotlib is not installed.
    InputError
        If the file cannot be written.
    """
    try:
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure
    except ImportError as error:
        raise MissingDependencyError(
            'plots need matplotlib. Install it with: pip install "isosample[plot]"'
        ) from error
    figure = Figure(figsize=(6.4, 4.4), dpi=120, layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.add_subplot()
    _expectation(axes, study)
    label = (
        "errors seen" if study.order is None or study.bounds is not None else f"seen: order {study.order:.2f}"
    )
    axes.loglog(study.refinement, study.errors, "o-", color=SEEN, label=label, zorder=3)
    axes.set_xticks(study.refinement, [f"{x:g}" for x in study.refinement])
    axes.tick_params(axis="x", which="minor", bottom=False, labelbottom=False)
    axes.set_xlabel(study.parameter)
    axes.set_ylabel(study.measure)
    axes.set_title(f"{study.question}\n{'passed' if study.passed else 'FAILED'}", fontsize=9, wrap=True)
    axes.grid(visible=True, which="both", alpha=0.25)
    axes.legend()
    with replacing(path) as file:
        figure.savefig(file, format="png")


def _expectation(axes: Any, study: Study) -> None:
    """Shade the orders expected from the first error on, or draw the bounds."""
    x = study.refinement
    if study.bounds is not None:
        axes.loglog(x, study.bounds, "--", color=EXPECTED, label="bound")
        return
    assert study.expected is not None
    lines = [study.errors[0] * (x / x[0]) ** -order for order in study.expected]
    axes.fill_between(
        x, *lines, color=EXPECTED, alpha=0.4, lw=0, label=f"expected: order {study.expectation}"
    )

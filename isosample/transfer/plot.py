"""The histogram of a volume with a transfer function over it, as a picture."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from isosample.errors import MissingDependencyError
from isosample.files import replacing
from isosample.volume.statistics import histogram

if TYPE_CHECKING:
    from isosample.transfer.isovalue_plan import IsovaluePlan
    from isosample.transfer.transfer_function import TransferFunction
    from isosample.volume.grid import F64, Volume

BARS, CURVE, TICKS = "#c3cad3", "#303030", "#d06a2c"
SHADES = 600  # steps in which the colours under the curve are drawn
DISPLAY_GAMMA = 1.0 / 2.2  # near enough to sRGB's curve for a plot's fill


def plot_histogram(
    volume: Volume, tf: TransferFunction | None = None, *, path: str | Path, plan: IsovaluePlan | None = None
) -> Path:
    """Write the histogram (log counts) as PNG, with the extinction in its own colours and the isovalues over it.

    Parameters
    ----------
    volume : Volume
    tf : TransferFunction, optional
        Drawn on an axis of its own, on the right.
    path : path
        The file appears whole or not at all.
    plan : IsovaluePlan, optional
        Its isovalues become ticks under the curve.

    Returns
    -------
    path : Path

    Raises
    ------
    MissingDependencyError
        If matplotlib is not installed.
    InputError
        If no sample is finite, or the file cannot be written.
    """
    figure_type, canvas_type = _matplotlib()
    counts, edges = histogram(volume)
    figure = figure_type(figsize=(8.0, 4.2), dpi=120, layout="constrained")
    canvas_type(figure)
    axes = figure.add_subplot()
    axes.stairs(counts, edges, fill=True, color=BARS)
    axes.set_yscale("log")
    axes.set_ylim(bottom=0.7, top=max(10.0, 3.0 * float(counts.max())))
    axes.set_xlim(*_limits(edges))
    axes.set_xlabel("value")
    axes.set_ylabel("samples")
    axes.set_title(volume.name, loc="left")
    top_axes = axes if tf is None else _draw_transfer_function(axes, tf)
    if plan is not None and len(plan.isovalues):
        _draw_isovalues(top_axes, plan)
    path = Path(path)
    with replacing(path) as file:
        figure.savefig(file, format="png")
    return path


def _limits(edges: F64) -> tuple[float, float]:
    """The histogram's range with a little room; a single value gets a unit of it."""
    low, high = float(edges[0]), float(edges[-1])
    room = 0.02 * (high - low) or 0.5
    return low - room, high + room


def _draw_isovalues(axes: Any, plan: IsovaluePlan) -> None:
    """Draw a tick at every isovalue along the lower edge."""
    count = len(plan.isovalues)
    edge = axes.get_xaxis_transform()  # data units along x, shares of the height along y
    axes.plot(
        plan.isovalues, np.full(count, 0.02), "|", color=TICKS, transform=edge, label=f"{count} isovalues"
    )
    # Beside the title: wherever it is inside, there may be a bar or the curve.
    axes.legend(
        loc="lower right", bbox_to_anchor=(1.0, 1.0), borderaxespad=0.2, handlelength=1.0, frameon=False
    )


def _draw_transfer_function(axes: Any, tf: TransferFunction) -> Any:
    """Draw extinction over value on a second axis, filled with the colours of the values; return the axis."""
    right = axes.twinx()
    low, high = axes.get_xlim()
    # Steps need both limits: each control point is drawn from the left and from the right.
    at_points = np.array([point.value for point in tf.points])
    values = np.sort(np.concatenate([np.linspace(low, high, SHADES), at_points, at_points]))
    values = values[(values >= low) & (values <= high)]
    sides = np.where(np.append(np.diff(values) == 0, False), "left", "right")
    colors, extinctions = tf.evaluate(values, side="right")
    left_colors, left_extinctions = tf.evaluate(values, side="left")
    from_left = sides == "left"
    extinctions = np.where(from_left, left_extinctions, extinctions)
    colors = np.where(from_left[:, None], left_colors, colors)
    shown = np.clip(colors, 0.0, 1.0) ** DISPLAY_GAMMA
    right.plot(values, extinctions, color=CURVE, lw=1.2)
    impulses = [(surface.value, surface.opacity, surface.color) for surface in tf.isosurfaces]
    top = max(1.1 * float(extinctions.max(initial=0.0)), 1e-12)
    under = right.fill_between(values, extinctions, facecolor="none")
    colored = right.pcolormesh(values, [0.0, top], shown[None, :-1], alpha=0.75)
    colored.set_clip_path(under.get_paths()[0], transform=right.transData)
    for value, opacity, color in impulses:
        right.plot([value, value], [0, opacity * top], color=np.array(color) ** DISPLAY_GAMMA, lw=2.5)
    right.set_ylim(0.0, top)
    right.set_ylabel("extinction [1/world unit]" + (" · impulses by opacity" if impulses else ""))
    return right


def check_matplotlib() -> None:
    """Raise `MissingDependencyError` if no plot can be made here."""
    _matplotlib()


def _matplotlib() -> tuple[Any, Any]:
    """Figure and canvas."""
    try:
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure
    except ImportError as error:
        raise MissingDependencyError(
            'a plot needs matplotlib. Install it with: pip install "isosample[plot]".'
        ) from error
    return Figure, FigureCanvasAgg

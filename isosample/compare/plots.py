"""Plots of a comparison: error against time and samples, time against frames, the histogram with its TF."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from isosample.compare import svg
from isosample.compare.verdict_sentences import least_rmse, listed
from isosample.defaults import COMPARED_METHODS
from isosample.rendering.image import srgb_from_linear
from isosample.transfer.transfer_function import TransferFunction
from isosample.wording import counted

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    Entry = dict[str, Any]

LEAST_ERROR = 1e-9  # a picture without any error is drawn here: a logarithm has no 0
MOST_FRAMES = 10_000
SHADES = 64  # colours under the transfer function
HISTOGRAM_HEIGHT = 330
BINS = 256  # drawn, at most


def error_against_time(entries: Sequence[Entry]) -> str:
    """SVG of RMSE over the seconds of a frame."""
    return _scatter(
        entries,
        lambda entry: 1e3 * float(entry["summary"]["frame_seconds"]),
        title="Error against time",
        x_label="time of a frame [ms]",
    )


def error_against_samples(entries: Sequence[Entry]) -> str:
    """SVG of RMSE over evaluations of the field (ray casters) or crossings (data-centric) per ray."""
    return _scatter(
        entries,
        lambda entry: float(entry["summary"]["evaluations_per_ray"]),
        title="Error against samples",
        x_label="samples or fragments per ray",
    )


def pareto(points: Sequence[tuple[float, float]]) -> list[int]:
    """Indices of the points that no other one beats in both coordinates, by the first coordinate.

    Parameters
    ----------
    points : sequence of (cost, error)
        Smaller is better. Of equal points the first stays.
    """
    order = sorted(range(len(points)), key=lambda index: (*points[index], index))
    front: list[int] = []
    least = math.inf
    for index in order:
        if points[index][1] < least:
            front.append(index)
            least = points[index][1]
    return front


def race_of_frames(document: dict[str, Any]) -> dict[str, Any] | None:
    """The race that `time_against_frames` shows: with most methods, at the smallest such error; None without one.

    Parameters
    ----------
    document : dict
        Content of results.json.
    """
    races = [race for race in document["verdict"]["races"] if race["fastest"]]
    return max(races, key=lambda one: (len(one["fastest"]), -one["target"]), default=None)


def frames_caption(document: dict[str, Any]) -> str:
    """At which error `time_against_frames` holds methods against each other, and which it leaves out and why.

    Parameters
    ----------
    document : dict
        Content of results.json.
    """
    race = race_of_frames(document)
    if race is None:
        largest = max(one["target"] for one in document["verdict"]["races"])
        return f"The time of many frames is not drawn: no method gets to an RMSE of {largest:g}."
    entries, target = document["entries"], f"{race['target']:g}"
    absent = [
        f"{method} ({least_rmse(entries, method):.2g} at best)"
        for method in dict.fromkeys(entry["method"] for entry in entries)
        if method not in race["fastest"]
    ]
    told = f"Each method at its fastest setting with an RMSE of at most {target}."
    if not absent:
        return told
    verb, pronoun = ("gets", "it is") if len(absent) == 1 else ("get", "they are")
    return f"{told} Here {listed(absent)} never {verb} to {target}, so {pronoun} not drawn."


def time_against_frames(document: dict[str, Any]) -> str:
    """SVG of the seconds that many frames take with everything before the first; empty where there is no race.

    Parameters
    ----------
    document : dict
        Content of results.json.
    """
    race = race_of_frames(document)
    if race is None:
        return ""
    by_name = {entry["name"]: entry for entry in document["entries"]}
    chosen = [by_name[race["fastest"][method]] for method in COMPARED_METHODS if method in race["fastest"]]
    counts = np.geomspace(1, MOST_FRAMES, 41).tolist()
    curves = {
        entry["method"]: [entry["setup_seconds"] + n * entry["summary"]["frame_seconds"] for n in counts]
        for entry in chosen
    }
    x = svg.Axis(1.0, MOST_FRAMES, svg.LEFT, svg.WIDTH - svg.RIGHT)
    y = svg.around([s for c in curves.values() for s in c], start=svg.HEIGHT - svg.BOTTOM, stop=svg.TOP)
    body = svg.frame(x, y, x_label="frames of one scene", y_label="seconds in all, setup included")
    for entry in chosen:
        kind, course = COMPARED_METHODS.index(entry["method"]), curves[entry["method"]]
        places = [(x.place(n), y.place(s)) for n, s in zip(counts, course, strict=True)]
        body += svg.line(places, f"line s{kind}")
        for n in (1, 10, 100, 1000, MOST_FRAMES):
            total = entry["setup_seconds"] + n * entry["summary"]["frame_seconds"]
            told = f"{entry['method']}, {entry['label']}: {n} frames in {total:.3g} s"
            body += svg.point(x.place(n), y.place(total), kind, told, ringed=False)
    body += svg.legend([(COMPARED_METHODS.index(entry["method"]), entry["method"]) for entry in chosen])
    # Times grow with the frames: the lower right corner is free.
    body += svg.text(x.stop - 8, y.start - 9, f"RMSE ≤ {race['target']:g}", anchor="end", css="quiet")
    return svg.drawing(
        body,
        title=f"Time against frames at RMSE {race['target']:g}",
        description=frames_caption(document),
    )


def histogram_plot(scene: dict[str, Any]) -> str:
    """SVG of the counts of the values (logarithmic), with the extinction in its own colours over them.

    Parameters
    ----------
    scene : dict
        Of results.json.
    """
    edges = np.array(scene["histogram"]["edges"])
    counts = np.array(scene["histogram"]["counts"], dtype=float)
    together = -(-counts.size // BINS)
    starts = np.arange(0, counts.size, together)
    counts, edges = np.add.reduceat(counts, starts), np.append(edges[starts], edges[-1])
    bottom, top = HISTOGRAM_HEIGHT - svg.BOTTOM, 26
    x = svg.Axis(float(edges[0]), float(edges[-1]), svg.LEFT, svg.WIDTH - svg.RIGHT, logarithmic=False)
    y = svg.Axis(0.7, max(10.0, 2.0 * float(counts.max())), bottom, top)
    body = svg.frame(x, y, x_label="value", y_label="samples of the volume")
    path = f"M{x.place(edges[0]):.1f} {bottom}"
    for count, right in zip(counts.tolist(), edges[1:].tolist(), strict=True):
        path += f"V{y.place(count):.1f}" if count else f"V{bottom}"
        path += f"H{x.place(right):.1f}"
    body += f'<path class="bars" d="{path}V{bottom}z"/>'
    function = TransferFunction.from_dict(scene["transfer_function"])
    body += _transfer_curve(function, x, bottom, top)
    return svg.drawing(
        body,
        title="Histogram of the volume with the transfer function",
        description=f"{counted(len(function.points), 'point')} and {counted(len(function.isosurfaces), 'isosurface')}; "
        "the extinction is the curve, filled with its colours.",
        height=HISTOGRAM_HEIGHT,
    )


def _scatter(entries: Sequence[Entry], cost: Callable[[Entry], float], *, title: str, x_label: str) -> str:
    points = [(cost(entry), max(float(entry["summary"]["rmse"]), LEAST_ERROR)) for entry in entries]
    x = svg.around([one for one, _ in points], start=svg.LEFT, stop=svg.WIDTH - svg.RIGHT)
    y = svg.around([one for _, one in points], start=svg.HEIGHT - svg.BOTTOM, stop=svg.TOP)
    places = [(x.place(one), y.place(other)) for one, other in points]
    front = pareto(points)
    methods = [method for method in COMPARED_METHODS if any(entry["method"] == method for entry in entries)]
    body = svg.frame(x, y, x_label=x_label, y_label="RMSE against the reference")
    body += svg.line([places[index] for index in front], "front")
    for method, parameter in dict.fromkeys((entry["method"], entry["parameter"]) for entry in entries):
        own = [
            place
            for place, entry in zip(places, entries, strict=True)
            if (entry["method"], entry["parameter"]) == (method, parameter)
        ]
        body += svg.line(own, f"line s{COMPARED_METHODS.index(method)}")
    for index, entry in enumerate(entries):
        on_front = index in front
        body += svg.point(
            *places[index],
            COMPARED_METHODS.index(entry["method"]),
            _told(entry, on_front=on_front),
            ringed=on_front,
        )
    body += svg.legend([(COMPARED_METHODS.index(method), method) for method in methods])
    count = len(front)
    told = (
        f"{len(entries)} settings of {len(methods)} methods; {count} of them are on the Pareto front, ringed."
    )
    return svg.drawing(body, title=title, description=told)


def _told(entry: Entry, *, on_front: bool) -> str:
    summary = entry["summary"]
    front = ", on the Pareto front" if on_front else ""
    return (
        f"{entry['method']}, {entry['label']}: RMSE {summary['rmse']:.2e}, {1e3 * summary['frame_seconds']:.3g} ms, "
        f"{summary['evaluations_per_ray']:.3g} per ray{front}"
    )


def _transfer_curve(function: TransferFunction, x: svg.Axis, bottom: float, top: float) -> str:
    """The extinction as a filled curve, isosurfaces as bars as high as their opacity."""
    corners = [point for point in function.points if x.low <= point.value <= x.high]
    values = np.unique([x.low, x.high, *np.linspace(x.low, x.high, 4 * SHADES), *(p.value for p in corners)])
    sides = [function.evaluate(values, side=side)[1] for side in ("left", "right")]
    doubled = np.repeat(values, 2)
    extinctions = np.stack(sides, axis=1).ravel()
    highest = float(extinctions.max(initial=0.0))
    height = 0.92 * (bottom - top)
    places = [
        (x.place(value), bottom - height * extinction / (highest or 1.0))
        for value, extinction in zip(doubled.tolist(), extinctions.tolist(), strict=True)
    ]
    shades = np.linspace(x.low, x.high, SHADES)
    colors = function.evaluate(shades)[0]
    stops = "".join(
        f'<stop offset="{place / (SHADES - 1):.4f}" stop-color="{_hex(color)}"/>'
        for place, color in enumerate(colors.tolist())
    )
    outline = "L".join(f"{px:.1f} {py:.1f}" for px, py in places)
    drawn = (
        f'<defs><linearGradient id="transfer" gradientUnits="userSpaceOnUse" x1="{x.start}" x2="{x.stop}" y1="0" '
        f'y2="0">{stops}</linearGradient></defs>'
        f'<path d="M{x.start:.1f} {bottom}L{outline}L{x.stop:.1f} {bottom}z" fill="url(#transfer)" fill-opacity=".55"/>'
        + svg.line(places, "curve")
    )
    for surface in function.isosurfaces:
        if x.low <= surface.value <= x.high:
            place = x.place(surface.value)
            drawn += (
                f'<path d="M{place:.1f} {bottom}V{bottom - height * surface.opacity:.1f}" fill="none" '
                f'stroke="{_hex(surface.color)}" stroke-width="3"/>'
            )
    if highest == 0.0:
        return drawn
    words = f"extinction, up to {highest:.3g} per world unit"
    return drawn + svg.text(x.stop, top - 9, words, anchor="end", css="quiet")


def _hex(color: Sequence[float]) -> str:
    """A linear colour as CSS writes it in sRGB."""
    parts = np.rint(255.0 * srgb_from_linear(np.clip(np.asarray(color, dtype=float), 0.0, 1.0))).astype(int)
    return "#" + "".join(f"{part:02x}" for part in parts.tolist())

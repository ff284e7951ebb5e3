"""The report of a comparison: one HTML file that needs nothing else, with its figures as files beside it."""

from __future__ import annotations

import base64
import io
import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from isosample.compare import plots, svg
from isosample.compare.false_color import (
    DIFFERENCE_COLORS,
    ERROR_COLORS,
    Scale,
    difference_png,
    error_png,
    gradient_css,
    shown,
)
from isosample.compare.report_tables import facts, tables
from isosample.compare.results import write_results, write_table
from isosample.defaults import COMPARED_METHODS, REFERENCE
from isosample.errors import MissingDependencyError
from isosample.files import replacing

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence
    from pathlib import Path

    from isosample.compare.experiment import Outcome

    Entry = dict[str, Any]  # of results.json

PLOTS = ("error_against_time", "error_against_samples", "time_against_frames", "histogram")
MOST_PICTURES = 4  # of a method in the report, with one camera; all of them are files
WEBP_EFFORT = 4  # of 0 to 6


@dataclass(frozen=True, slots=True)
class Picture:
    """A picture of the report with its two maps, as data addresses."""

    name: str
    method: str
    label: str
    camera: int
    rmse: float | None
    picture: str
    error: str
    difference: str


def write_report(
    outcome: Outcome,
    folder: Path,
    *,
    source: str | None = None,
    transfer_function: str | None = None,
    command: Callable[[Entry, int], str] | None = None,
) -> dict[str, Any]:
    """Write the pictures, the plots, results.csv, results.json and report.html, in this order.

    Pictures and plots of an earlier comparison that this one has not are removed in the end.

    Parameters
    ----------
    outcome : Outcome
    folder : Path
        Must exist; a folder ``pictures`` is made in it.
    source, transfer_function : str, optional
        Where volume and transfer function come from.
    command : callable, optional
        The command line that draws the picture of an entry of results.json and a camera, counted from 0.

    Returns
    -------
    document : dict
        The content of results.json.

    Raises
    ------
    InputError
        If a file cannot be written.
    MissingDependencyError
        If Jinja2 is not installed.
    """
    document = outcome.results.to_dict()
    document["scene"] |= {"source": source, "transfer_function_source": transfer_function}
    if command is not None:
        for entry in document["entries"]:
            for camera, view in enumerate(entry["views"]):
                view["command"] = command(entry, camera)
    document["settings"]["error_scale"] = _scale_of(document).ticks
    figures = figures_of(document)
    pictures, files = _write_pictures(outcome, document, folder / "pictures")
    page = render_report(document, figures, pictures)
    for name, drawn in figures.items():
        with replacing(folder / f"{name}.svg") as file:
            file.write(svg.standalone(drawn).encode())
    write_table(document, folder / "results.csv")
    write_results(document, folder / "results.json")
    with replacing(folder / "report.html") as file:
        file.write(page.encode())
    _remove_others(folder, figures, files)
    return document


def _remove_others(folder: Path, figures: Iterable[str], pictures: Iterable[str]) -> None:
    """Remove plots and pictures of another comparison, which the new page would seem to be about."""
    named = re.compile(rf"camera-\d+_({REFERENCE}|({'|'.join(COMPARED_METHODS)})-.+)\.png")
    found = {path for path in (folder / "pictures").iterdir() if named.fullmatch(path.name)}
    found |= {path for name in PLOTS if (path := folder / f"{name}.svg").exists()}
    kept = {folder / f"{name}.svg" for name in figures} | {folder / "pictures" / name for name in pictures}
    for path in found - kept:
        path.unlink(missing_ok=True)


def figures_of(document: dict[str, Any]) -> dict[str, str]:
    """The plots as SVG, by name; the one of frames is left out where no method reaches a target."""
    entries = document["entries"]
    drawn = (
        plots.error_against_time(entries),
        plots.error_against_samples(entries),
        plots.time_against_frames(document),
        plots.histogram_plot(document["scene"]),
    )
    return {name: figure for name, figure in zip(PLOTS, drawn, strict=True) if figure}


def render_report(document: dict[str, Any], figures: dict[str, str], pictures: Sequence[Picture]) -> str:
    """The text of report.html.

    Parameters
    ----------
    document : dict
        Content of results.json.
    figures : dict of str to str
        SVG elements, as `figures_of`.
    pictures : sequence of Picture
        By camera; the references first.

    Raises
    ------
    MissingDependencyError
        If Jinja2 is not installed.
    """
    try:
        import jinja2
    except ImportError as error:
        raise MissingDependencyError(
            'a report needs Jinja2, which is not installed: pip install "isosample[compare]".'
        ) from error
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("isosample.compare"),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    scale, title = _scale_of(document), document["scene"]["volume"]["name"]
    ticks = svg.tick_texts(scale.ticks)
    return environment.get_template("report.html.j2").render(
        document=document,
        title=title,
        title_parts=re.split(r"(?=\.)|(?<=[_-])", title),
        figures=figures,
        frames_caption=plots.frames_caption(document),
        pictures=pictures,
        cameras=range(len(document["settings"]["cameras"])),
        left=_first_shown(pictures, document),
        colors=svg.COLORS,
        plot_style=svg.STYLE,
        error_gradient=gradient_css(ERROR_COLORS),
        difference_gradient=gradient_css(DIFFERENCE_COLORS),
        error_ticks=ticks,
        difference_ticks=[f"−{ticks[-1]}", f"−{ticks[-3]}", "0", ticks[-3], ticks[-1]],
        tables=tables(document),
        facts=facts(document),
    )


def chosen_entries(entries: Sequence[Entry], most: int) -> list[Entry]:
    """At most so many of every method, evenly from its coarsest to its finest."""
    found: list[Entry] = []
    for method in COMPARED_METHODS:
        own = [entry for entry in entries if entry["method"] == method]
        places = np.unique(np.rint(np.linspace(0, len(own) - 1, min(most, len(own)))).astype(int))
        found += [own[place] for place in places.tolist()]
    return found


def _first_shown(pictures: Sequence[Picture], document: dict[str, Any]) -> str:
    """Name of the picture on the left at first: of the strictest race's winner, else the first after the reference."""
    names = [picture.name for picture in pictures if picture.rmse is not None]
    strictest_first = reversed(document["verdict"]["races"])
    wanted = [name for race in strictest_first for name in list(race["fastest"].values())[:1]]
    return next((name for name in wanted if name in names), names[0])


def _scale_of(document: dict[str, Any]) -> Scale:
    """The one scale of all error maps and differences."""
    return Scale.up_to(entry["summary"]["percentile_error"] for entry in document["entries"])


def _write_pictures(
    outcome: Outcome, document: dict[str, Any], folder: Path
) -> tuple[list[Picture], list[str]]:
    """Write every picture and its maps as PNG; return those of the report, and the names of all files."""
    scale, backdrop = _scale_of(document), document["settings"]["backdrop"]
    cameras = range(len(outcome.references))
    embedded = chosen_entries(document["entries"], max(2, MOST_PICTURES // len(outcome.references)))
    kept = {entry["name"] for entry in embedded}
    found, names = [], []
    for camera in cameras:
        truth = outcome.references[camera]
        rows = [(REFERENCE, REFERENCE, "float64", None, truth)] + [
            (
                entry["name"],
                entry["method"],
                entry["label"],
                entry["views"][camera]["errors"]["rmse"],
                outcome.pictures[entry["name"]][camera],
            )
            for entry in document["entries"]
        ]
        for name, method, label, rmse, rgba in rows:
            flat = shown(rgba, backdrop)
            maps = {"error": error_png(rgba, truth, scale), "difference": difference_png(rgba, truth, scale)}
            stem = f"camera-{camera + 1}_{name}"
            files = {"": _encoded(flat, "PNG"), **({} if rmse is None else maps)}
            for kind, content in files.items():
                names.append(f"{stem}{kind and '_' + kind}.png")
                with replacing(folder / names[-1], make_folder=True) as file:
                    file.write(content)
            if rmse is None or name in kept:
                addresses = {kind: _address(content, "png") for kind, content in maps.items()}
                webp = _address(_encoded(flat, "WEBP"), "webp")
                found.append(Picture(name, method, label, camera, rmse, webp, **addresses))
    return found, names


def _encoded(flat: Any, kind: str) -> bytes:
    """A picture without loss."""
    import PIL.Image

    options: dict[str, Any] = {"lossless": True, "method": WEBP_EFFORT} if kind == "WEBP" else {}
    file = io.BytesIO()
    PIL.Image.fromarray(flat).save(file, format=kind, **options)
    return file.getvalue()


def _address(content: bytes, kind: str) -> str:
    return f"data:image/{kind};base64,{base64.b64encode(content).decode('ascii')}"

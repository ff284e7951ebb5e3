"""The command line of `isosample render` that draws a picture of a comparison."""

from __future__ import annotations

import shlex
from typing import TYPE_CHECKING, Any

from isosample.cli import values
from isosample.cli.cameras import PLACING_OPTIONS, azimuths
from isosample.cli.methods import option
from isosample.cli.sources import VOLUME_OPTIONS
from isosample.defaults import DATA_CENTRIC, EXACT_PEAKS, PEAK_FINDING
from isosample.wording import fraction_text

if TYPE_CHECKING:
    import argparse

SWEPT = {
    "step": "--step",
    "s_k": "--pixel-scale",
    "isovalues per slope": "--per-slope",
    "tolerance": "--tolerance",
}
SHARED = ("tf", *VOLUME_OPTIONS, "nan", "reconstruction", "shading", "clip", "background", "stage")


def render_command(
    args: argparse.Namespace, size: tuple[int, int], entry: dict[str, Any], camera: int
) -> str:
    """Return the command that draws a picture again, for the shell, in the folder where the comparison was started.

    Parameters
    ----------
    args : Namespace
        Of `isosample compare`.
    size : (width, height)
        Of the pictures [pixel].
    entry : dict
        Of results.json: the method and its setting.
    camera : int
        Which of the views, from 0.
    """
    words = ["isosample", "render", str(args.source), "--method", entry["method"]]
    words += [SWEPT[entry["parameter"]], _fraction(entry["value"])]
    words += _of_method(args, entry, camera)
    for name in SHARED:
        words += _given(args, name)
    words += ["--size", "{}x{}".format(*size), *_view(args, camera)]
    return shlex.join([*words, "-o", f"camera-{camera + 1}_{entry['name']}.png"])


def _of_method(args: argparse.Namespace, entry: dict[str, Any], camera: int) -> list[str]:
    """Options of one kind of method, and what the comparison takes where `render` takes another default."""
    if entry["method"] == DATA_CENTRIC:
        words = _given(args, "details")
        if words and entry["parameter"] == "tolerance":  # chosen for the views of the comparison together
            words += ["--screen-error", _fraction(entry["views"][camera]["cost"]["screen_error"])]
        return words
    words = _given(args, "sampling") + _given(args, "adaptive")
    if entry["method"] == PEAK_FINDING:
        for name, value in EXACT_PEAKS.items():
            words += [option(name), getattr(args, name) or value]
    return words


def _view(args: argparse.Namespace, camera: int) -> list[str]:
    """Where the picture is taken from."""
    if args.camera is not None:
        return ["--camera", str(args.camera)]
    words = ["--azimuth", _number(azimuths(args)[camera])]
    for name in PLACING_OPTIONS:
        if name != "azimuth":
            words += _given(args, name)
    return words


def _given(args: argparse.Namespace, name: str) -> list[str]:
    """An option as it was given; nothing where it is what it is by default."""
    value = getattr(args, name, None)
    if value is None or value == args.parser.get_default(name):
        return []
    if value is True:
        return [option(name)]
    if isinstance(value, list):  # an option that may be given several times
        return [word for one in value for word in (option(name), _written(one))]
    return [option(name), _written(value)]


def _written(value: object) -> str:
    if isinstance(value, tuple):
        return ",".join(map(_written, value))
    return _number(value) if isinstance(value, float) else str(value)


def _number(value: float) -> str:
    """The shortest text that is this number."""
    short = f"{value:g}"
    return short if float(short) == value else repr(value)


def _fraction(value: float) -> str:
    """The same, as 1/n where that is this number."""
    short = fraction_text(value)
    return short if values.screen_error(short) == value else repr(value)

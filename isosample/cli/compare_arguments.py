"""Options of `isosample compare`: what is compared, and of which pictures."""

from __future__ import annotations

from typing import TYPE_CHECKING

from isosample.cli import arguments, values
from isosample.defaults import (
    COMPARED_METHODS,
    DEFAULT_PER_SLOPES,
    DEFAULT_PIXEL_SCALES,
    DEFAULT_REPEAT,
    DEFAULT_STEPS,
    DEFAULT_TOLERANCES,
)
from isosample.wording import fraction_text

if TYPE_CHECKING:
    import argparse
    from collections.abc import Sequence

SIZE, QUICK_SIZE = (512, 512), (256, 256)


def add_sweep_options(parser: argparse.ArgumentParser) -> None:
    """Add the lists of settings, and what goes for all of them; None where nothing is given."""
    group = parser.add_argument_group("what is compared", "lists have commas between, from coarse to fine")
    group.add_argument(
        "--methods",
        type=values.words(COMPARED_METHODS),
        default=COMPARED_METHODS,
        metavar="M,M,…",
        help=f"of {', '.join(COMPARED_METHODS)} (default: all)",
    )
    group.add_argument(
        "--repeat",
        type=values.positive_count,
        metavar="N",
        help=f"timed frames per setting and camera (default {DEFAULT_REPEAT})",
    )
    group.add_argument(
        "--per-slopes",
        type=values.list_of(values.count),
        metavar="K,K,…",
        help=f"data-centric: isovalues inside each visible slope (default {_list(DEFAULT_PER_SLOPES)})",
    )
    group.add_argument(
        "--tolerances",
        type=values.list_of(values.tolerance),
        metavar="E,E,…",
        help="data-centric: errors that isovalues and refinement are searched for "
        f"(default {_list(DEFAULT_TOLERANCES)})",
    )
    group.add_argument(
        "--steps",
        type=values.list_of(values.step),
        metavar="S,S,…",
        help=f"ray casters: distances between samples [voxel] (default {_list(DEFAULT_STEPS)})",
    )
    group.add_argument(
        "--sampling",
        choices=("uniform", "differential"),
        help="ray casters: even steps (default uniform), or steps that grow with the pixel's footprint",
    )
    group.add_argument(
        "--pixel-scales",
        type=values.list_of(values.step),
        metavar="S,S,…",
        help="ray casters, with --sampling differential: steps over a pixel's footprint, s_k of Knoll et al. "
        f"(default {_list(DEFAULT_PIXEL_SCALES)})",
    )
    group.add_argument(
        "--adaptive",
        action="store_true",
        default=None,
        help="ray casters: longer steps where the data vary little",
    )
    group.add_argument(
        "--peak-weight",
        choices=("integral", "paper"),
        help="peak finding: a peak's share of the integral (default), or the paper's weight, which the step does not "
        "bring closer to the reference",
    )
    group.add_argument(
        "--crossings",
        choices=("exact", "secant"),
        help="peak finding: from the cubic of every cell (default exact), or by secant steps, as in the paper",
    )


def _list(numbers: Sequence[float]) -> str:
    return ",".join(fraction_text(number) for number in numbers)


def add_picture_options(parser: argparse.ArgumentParser) -> None:
    """Add size, views and look."""
    group = parser.add_argument_group("picture", "the same for all methods")
    group.add_argument(
        "--size",
        type=values.picture_size,
        metavar="WxH",
        help="width and height [pixel], 11 or more (default {}x{})".format(*SIZE),
    )
    group.add_argument(
        "--cameras",
        type=values.positive_count,
        metavar="N",
        help="so many views around the volume, from --azimuth on (default 1)",
    )
    arguments.add_shading_option(
        group,
        does="light the volume from the eye, in every method and in the reference (default: colours as they are); "
        "isovalues for --tolerances are searched for without light all the same",
    )
    arguments.add_look_options(group, displayed="; displayed over black")

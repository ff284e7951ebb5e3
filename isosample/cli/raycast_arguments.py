"""Options of the ray caster: how it samples and classifies."""

from __future__ import annotations

from typing import TYPE_CHECKING

from isosample.cli import values
from isosample.defaults import (
    DEFAULT_PEAK_BINS,
    DEFAULT_PEAKS,
    DEFAULT_PIXEL_SCALE,
    DEFAULT_ROOT_ITERATIONS,
    DEFAULT_STEP,
    DEFAULT_TABLE_SIZE,
    MACROCELLS,
    MOST_PEAKS,
    PEAK_BIN_RANGE,
    RAYCAST_METHODS,
    TABLE_SIZE_RANGE,
)

if TYPE_CHECKING:
    import argparse


def add_raycast_options(parser: argparse.ArgumentParser) -> None:
    """Add how the ray caster samples and classifies; None where nothing is given."""
    group = parser.add_argument_group(
        "ray caster", "with --method {}, {} or {} only".format(*RAYCAST_METHODS)
    )
    _add_sampling_options(group)
    _add_classification_options(group)
    _add_peak_options(group)


def _add_sampling_options(group: argparse._ArgumentGroup) -> None:
    group.add_argument(
        "--step",
        type=values.step,
        metavar="VOXELS",
        help="distance between samples, in voxels of the smallest spacing, as a number or a fraction such as 1/4 "
        f"(default {DEFAULT_STEP:g}, or what --tolerance finds)",
    )
    group.add_argument(
        "--sampling",
        choices=("uniform", "differential"),
        help="uniform: even steps (default); differential: steps that grow with the distance from the eye",
    )
    group.add_argument(
        "--pixel-scale",
        type=values.step,
        metavar="S",
        help="differential sampling: the first step, in pixels of an image plane one voxel in front of the eye; s_k of "
        f"Knoll et al. (default {DEFAULT_PIXEL_SCALE:g})",
    )
    group.add_argument(
        "--adaptive",
        action="store_true",
        default=None,
        help="longer steps in macrocells whose data vary little (default: the same step everywhere)",
    )
    group.add_argument(
        "--jitter",
        type=values.count,
        metavar="SEED",
        help="shift the samples of every ray by a random part of a step (default: no shift)",
    )
    group.add_argument(
        "--filtering",
        choices=("shader", "hardware"),
        help="who interpolates: the shader in float32 (default), or the texture unit, which may round to 8 bits",
    )
    group.add_argument(
        "--no-skipping",
        dest="skipping",
        action="store_false",
        default=None,
        help="sample empty macrocells too (default: rays leap over them)",
    )
    group.add_argument(
        "--macrocells",
        type=values.count,
        metavar="N",
        help=f"macrocells along the longest axis, at most (default {MACROCELLS})",
    )


def _add_classification_options(group: argparse._ArgumentGroup) -> None:
    group.add_argument(
        "--transfer",
        dest="transfer_lookup",
        choices=("exact", "texture"),
        help="transfer function: straight lines between its points (default exact), or a texture of 8192 entries",
    )
    group.add_argument(
        "--quadrature",
        choices=("riemann", "trapezoid"),
        help="post-classified, and between peaks: a step has the colour and extinction of its front (order 1), or "
        "runs in a straight line from its front's to its back's (order 2; default trapezoid)",
    )
    group.add_argument(
        "--integration",
        choices=("exact", "1d", "2d", "3d"),
        help="pre-integrated: piece by piece of the transfer function (default exact); from its integrals over the "
        "value (1d: fastest, the mean colour of a step, no isosurfaces); or from a table by the values at both ends, "
        "for one length of the step (2d) or many (3d)",
    )
    group.add_argument(
        "--table-size",
        type=values.count,
        metavar="N",
        help="values along an edge of the table of 2d and 3d, {} to {} (default {})".format(
            *TABLE_SIZE_RANGE, DEFAULT_TABLE_SIZE
        ),
    )
    group.add_argument(
        "--table-dtype",
        choices=("float32", "float16"),
        help="numbers of the table of 2d and 3d (default float32); float16 takes half the memory and rounds entries by "
        "2^-11 of themselves",
    )


def _add_peak_options(group: argparse._ArgumentGroup) -> None:
    group.add_argument(
        "--peak-mode",
        choices=("both", "xor", "peak-only", "dvr-only"),
        help="peak finding: samples and peaks (default both), samples where there is no peak, or one of the two alone",
    )
    group.add_argument(
        "--peak-weight",
        choices=("paper", "integral"),
        help="opacity of a peak: of its extinction over a length of 1 (default paper), or its exact share of the "
        "integral",
    )
    group.add_argument(
        "--crossings",
        choices=("secant", "exact"),
        help="peaks of a step: by the signs at its ends and secant steps (default secant), or all of them, from the "
        "cubic of every cell",
    )
    group.add_argument(
        "--peak-bins",
        type=values.count,
        metavar="N",
        help="secant: values along an edge of the peak table, {} to {} (default {})".format(
            *PEAK_BIN_RANGE, DEFAULT_PEAK_BINS
        ),
    )
    group.add_argument(
        "--peaks",
        type=values.count,
        metavar="N",
        help=f"secant: most peaks in one step, 1 to {MOST_PEAKS} (default {DEFAULT_PEAKS})",
    )
    group.add_argument(
        "--root-iterations",
        type=values.count,
        metavar="N",
        help=f"secant: steps to a root (default {DEFAULT_ROOT_ITERATIONS})",
    )

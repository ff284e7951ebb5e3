"""`isosample filter`: a volume smoothed by diffusion, Gaussian or median, as a new file."""

from __future__ import annotations

import time
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from isosample.cli import arguments, values
from isosample.cli.console import note, progress_bars, say_fields, say_json, seconds
from isosample.cli.outputs import check_writable
from isosample.cli.parser import add_command
from isosample.defaults import DEFAULT_CONDUCTANCE, DEFAULT_ITERATIONS, DEFAULT_TIME_SHARE, VOLUME_SUFFIXES
from isosample.errors import InputError
from isosample.wording import byte_size, fraction_text

if TYPE_CHECKING:
    import argparse

    from isosample.cli.console import Progress
    from isosample.cli.parser import Commands
    from isosample.volume.grid import Volume

EXAMPLE = """\
isosample filter embryo.nrrd --anisotropic-diffusion --iterations 10 -o smooth.nrrd
isosample filter head.nii.gz --gaussian 0.8 -o soft.nii.gz
isosample filter scan.mha --median 1 -o clean.mha"""
DIFFUSION_OPTIONS = ("conductance", "iterations", "time_step")


def add_parser(commands: Commands) -> None:
    """Add the command and its options."""
    parser = add_command(
        commands,
        "filter",
        run,
        summary="Smooth a volume before it is rendered, and write it as a new file.",
        example=EXAMPLE,
    )
    parser.add_argument("volume", type=Path, metavar="VOLUME", help="volume file or DICOM folder")
    kind = parser.add_mutually_exclusive_group(required=True)
    kind.add_argument(
        "--anisotropic-diffusion",
        action="store_true",
        help="smooth noise along edges and keep these, after Perona and Malik",
    )
    kind.add_argument(
        "--gaussian", type=values.positive, metavar="SIGMA", help="standard deviation of a Gaussian [world]"
    )
    kind.add_argument(
        "--median",
        type=values.positive,
        metavar="RADIUS",
        help="half the edge of the box whose median is taken [world], rounded to whole samples along every axis",
    )
    _add_diffusion_options(parser.add_argument_group("anisotropic diffusion"))
    parser.add_argument(
        "-o",
        "--output",
        type=Path,
        required=True,
        metavar="FILE",
        help=f"volume file: {', '.join(VOLUME_SUFFIXES)} (.npy: samples alone, without spacing and placement)",
    )
    parser.add_argument("--json", action="store_true", help="write JSON (default: a table)")
    arguments.add_volume_options(parser)


def run(args: argparse.Namespace) -> int:
    """Check what is asked for, filter, write, tell."""
    from isosample.cli.sources import open_source_volume
    from isosample.volume.writers import check_can_write, save_volume, volume_suffix

    _refuse_other_options(args)
    check_can_write(args.output)
    check_writable({"--output": args.output}, [args.volume])
    volume = open_source_volume(args, args.volume)
    started = time.perf_counter()
    with progress_bars() as progress:
        filtered = _filtered(volume, args, progress)
    duration = time.perf_counter() - started
    save_volume(filtered, args.output)
    if volume_suffix(args.output) == ".npy" and filtered.spacing != (1.0, 1.0, 1.0):
        spacing = ",".join(f"{length:.9g}" for length in filtered.spacing)
        note(f"{args.output} holds no spacing; read it with --spacing {spacing}")
    _tell(args, volume, filtered, duration)
    return 0


def _add_diffusion_options(group: argparse._ArgumentGroup) -> None:
    group.add_argument(
        "--conductance",
        type=values.positive,
        metavar="K",
        help=f"slopes far above K times the typical one are edges, and stay (default {DEFAULT_CONDUCTANCE:g})",
    )
    group.add_argument(
        "--iterations",
        type=values.count,
        metavar="N",
        help=f"steps of the diffusion (default {DEFAULT_ITERATIONS})",
    )
    group.add_argument(
        "--time-step",
        type=values.positive,
        metavar="T",
        help=f"length of a step [world squared]; must be stable (default {DEFAULT_TIME_SHARE:g} of the longest stable "
        f"step: {fraction_text(DEFAULT_TIME_SHARE / 6)} at a spacing of 1)",
    )


def _refuse_other_options(args: argparse.Namespace) -> None:
    """Raise `InputError` where options of the diffusion are given for another filter."""
    given = [name for name in DIFFUSION_OPTIONS if getattr(args, name) is not None]
    if given and not args.anisotropic_diffusion:
        option = given[0].replace("_", "-")
        raise InputError(
            f"--{option} belongs to --anisotropic-diffusion; leave it out, or choose that filter."
        )


def _filtered(volume: Volume, args: argparse.Namespace, progress: Progress) -> Volume:
    """Return the filtered volume."""
    from isosample.volume import filters

    if args.gaussian is not None:
        return filters.gaussian(volume, args.gaussian, progress=partial(progress, "Gaussian"))
    if args.median is not None:
        return filters.median(volume, args.median, progress=partial(progress, "median"))
    given = {name: getattr(args, name) for name in DIFFUSION_OPTIONS if getattr(args, name) is not None}
    return filters.anisotropic_diffusion(volume, progress=partial(progress, "diffusion"), **given)


def _tell(args: argparse.Namespace, before: Volume, after: Volume, duration: float) -> None:
    """Write what was made."""
    report: dict[str, Any] = {
        "volume": str(args.output),
        "bytes": args.output.stat().st_size,
        "filter": _name(args),
        "samples": list(after.size_xyz),
        "type": str(after.array.dtype),
        "range_before": list(before.value_range),
        "range": list(after.value_range),
        "seconds": round(duration, 3),
    }
    if args.json:
        say_json(report)
        return
    ranges = [" to ".join(f"{value:.6g}" for value in part.value_range) for part in (before, after)]
    say_fields(
        {
            "volume": f"{report['volume']} ({byte_size(report['bytes'])})",
            "filter": report["filter"],
            "samples": f"{' x '.join(map(str, after.size_xyz))} {report['type']}",
            "range": f"{ranges[1]} (before: {ranges[0]})",
            "time": seconds(duration),
        }
    )


def _name(args: argparse.Namespace) -> str:
    """Return the filter, with the number that it was chosen with."""
    if args.gaussian is not None:
        return f"gaussian {args.gaussian:g}"
    return f"median {args.median:g}" if args.median is not None else "anisotropic-diffusion"

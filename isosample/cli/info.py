"""`isosample info`: what a volume is."""

from __future__ import annotations

import math
import sys
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from isosample.cli import arguments
from isosample.cli.console import say, say_fields, say_json, say_table
from isosample.cli.outputs import check_suffix, check_writable
from isosample.cli.parser import add_command
from isosample.cli.summary import note_if_empty
from isosample.errors import InputError
from isosample.wording import byte_size, thousands

if TYPE_CHECKING:
    import argparse

    from isosample.cli.parser import Commands
    from isosample.transfer.isovalues import IsovaluePlan
    from isosample.transfer.transfer_function import TransferFunction
    from isosample.volume.grid import Volume

HISTOGRAM_BINS = 256  # of the JSON, at most
HISTOGRAM_ROWS = 16  # of the table, at most
HISTOGRAM_WIDTH = 40  # [character]
EXAMPLE = """\
isosample info head.nrrd
isosample info head.nrrd --tf bone.json --plan --histogram head_histogram.png
isosample info head.nrrd --suggest bone.json --histogram head_histogram.png
isosample info head.raw --shape 256,256,128 --dtype uint16 --json"""


def add_parser(commands: Commands) -> None:
    """Add the command and its options."""
    parser = add_command(
        commands,
        "info",
        run,
        summary="Tell a volume's size, sample type, placement and values.",
        example=EXAMPLE,
    )
    parser.add_argument("volume", type=Path, metavar="VOLUME", help="volume file or DICOM folder")
    parser.add_argument("--json", action="store_true", help="write JSON (default: a table)")
    parser.add_argument("--plan", action="store_true", help="print the isovalues and why each is there")
    parser.add_argument(
        "--histogram",
        type=Path,
        metavar="FILE",
        help="PNG file for a plot of the histogram and the transfer function",
    )
    parser.add_argument(
        "--suggest",
        type=Path,
        metavar="FILE",
        help="JSON file for the transfer function that is suggested from the histogram: something to begin with",
    )
    arguments.add_shading_option(
        parser, does="with --plan: the isovalues for pictures with light (default: without)"
    )
    arguments.add_plan_options(
        parser, without="none, or where one is needed, one suggested from the histogram"
    )
    arguments.add_volume_options(parser)


def run(args: argparse.Namespace) -> int:
    """Open the volume, describe it, and plot it where asked for."""
    from isosample.cli.sources import load_transfer_function, open_source_volume

    _check_plan_options(args)
    _check_outputs(args)
    given = load_transfer_function(args.tf)
    volume = open_source_volume(args, args.volume)
    if args.suggest is not None:
        from isosample.transfer.transfer_function import TransferFunction

        given = TransferFunction.suggest(volume)
        given.save(args.suggest)
    description = describe(volume)
    transfer_function, plan = _plan(args, volume, given)
    if args.histogram is not None:
        from isosample.transfer.plot import plot_histogram

        plot_histogram(volume, transfer_function, path=args.histogram, plan=plan)
    if args.json:
        say_json(description | ({"plan": plan.to_dict()} if plan is not None and args.plan else {}))
    else:
        _say(volume, description, _written(args))
        if plan is not None and args.plan:
            from isosample.cli.plan_table import say_plan

            say_plan(plan)
    return 0


def _shows_plan(args: argparse.Namespace) -> bool:
    """Whether the isovalues are printed, or drawn into the plot of a transfer function."""
    drawn = args.histogram is not None and (args.tf is not None or args.suggest is not None)
    return bool(args.plan) or drawn


def _check_plan_options(args: argparse.Namespace) -> None:
    """Raise for an option about a plan that is not shown."""
    if _shows_plan(args):
        return
    given = ["--shading"] if args.shading else []
    if args.per_slope is not None:
        given.append(f"--per-slope {args.per_slope}")
    if given:
        raise InputError(
            f"{given[0]} changes the plan, which is not shown; add --plan, or --histogram with --tf or --suggest, or "
            "leave it out."
        )


def _check_outputs(args: argparse.Namespace) -> None:
    """Raise unless both files can be written, and made."""
    if args.suggest is not None:
        check_suffix(args.suggest, (".json",), "a transfer function")
        if args.tf is not None:
            raise InputError(
                f"--suggest {args.suggest} writes a transfer function and --tf {args.tf} reads one; leave out one of "
                "them."
            )
    if args.histogram is not None:
        from isosample.transfer.plot import check_matplotlib

        check_suffix(args.histogram, (".png",), "a plot")
        check_matplotlib()
    inputs = [path for path in (args.volume, args.tf) if path is not None]
    check_writable({"--histogram": args.histogram, "--suggest": args.suggest}, inputs)


def describe(volume: Volume) -> dict[str, Any]:
    """Return what a volume is, JSON-ready; range and histogram are None where no sample is finite."""
    nan_count, infinity_count = volume.nonfinite_counts
    some_finite = nan_count + infinity_count < volume.array.size
    return {
        "name": volume.name,
        "size_xyz": list(volume.size_xyz),
        "dtype": str(volume.array.dtype),
        "bytes": int(volume.array.nbytes),
        "spacing": list(volume.spacing),
        "origin": list(volume.origin),
        "direction": volume.direction.tolist(),
        "box_corners": volume.box.corners().tolist(),
        "value_range": list(volume.value_range) if some_finite else None,
        "nan_count": nan_count,
        "infinity_count": infinity_count,
        "histogram": histogram_of(volume) if some_finite else None,
    }


def _plan(
    args: argparse.Namespace, volume: Volume, given: TransferFunction | None
) -> tuple[TransferFunction | None, IsovaluePlan | None]:
    """Return the transfer function and its plan, where it is shown; suggested only where a plan is asked for."""
    from isosample.cli.sources import plan_for, transfer_function_of
    from isosample.rendering.quality import shares_for_light
    from isosample.volume.statistics import gradient_at_values

    if not _shows_plan(args):
        return given, None
    tf, _ = transfer_function_of(volume, given, args.tf, nan_masked=True)
    gradients = partial(gradient_at_values, volume)
    shares = shares_for_light(volume, tf) if args.shading else None
    plan = plan_for(tf, volume.value_range, args.per_slope, gradients, lit=args.shading, shares=shares)
    note_if_empty(plan, tf)
    return tf, plan


def _written(args: argparse.Namespace) -> dict[str, str]:
    """Rows about the files that are written."""
    made = {"suggested transfer function": args.suggest, "plot of the histogram": args.histogram}
    return {name: str(path) for name, path in made.items() if path is not None}


def _say(volume: Volume, description: dict[str, Any], written: dict[str, str]) -> None:
    corners = volume.box.corners()
    value_range = description["value_range"]
    fields = {
        "name": volume.name,
        "size (x, y, z)": " x ".join(str(count) for count in volume.size_xyz),
        "samples": f"{volume.array.dtype}, {thousands(volume.array.size)}, {byte_size(volume.array.nbytes)}",
        "spacing": _vector(volume.spacing),
        "origin": _vector(volume.origin),
        "direction": "; ".join(_vector(row) for row in volume.direction.tolist()),
        "box": f"{_vector(corners.min(axis=0))} to {_vector(corners.max(axis=0))}",
        "values": f"{value_range[0]:.9g} to {value_range[1]:.9g}" if value_range else "none is finite",
        "NaN, infinite": f"{thousands(description['nan_count'])}, {thousands(description['infinity_count'])}",
    }
    say_fields(fields | written)
    if description["histogram"]:
        _say_histogram(**description["histogram"])


def _vector(numbers: Any) -> str:
    return ", ".join(f"{number:.7g}" for number in numbers)


def histogram_of(volume: Volume) -> dict[str, list[Any]]:
    """Return the counts of the finite samples and the edges of their bins, HISTOGRAM_BINS at most, JSON-ready."""
    import numpy as np

    from isosample.volume.statistics import histogram

    counts, edges = histogram(volume, HISTOGRAM_BINS)
    starts = np.arange(0, len(counts), math.ceil(len(counts) / HISTOGRAM_BINS))
    return {
        "counts": np.add.reduceat(counts, starts).tolist(),
        "edges": [*edges[starts].tolist(), float(edges[-1])],
    }


def _say_histogram(counts: list[int], edges: list[float]) -> None:
    """Write the counts of HISTOGRAM_ROWS ranges at most; on a terminal with their logarithms as bars."""
    say()
    step = math.ceil(len(counts) / HISTOGRAM_ROWS)
    starts = range(0, len(counts), step)
    totals = [sum(counts[start : start + step]) for start in starts]
    columns = ["values from", "to", "samples"]
    rows = [
        [f"{edges[start]:.6g}", f"{edges[min(start + step, len(counts))]:.6g}", thousands(total)]
        for start, total in zip(starts, totals, strict=True)
    ]
    if sys.stdout.isatty():
        longest = math.log1p(max(totals))
        columns.append("logarithmic")
        for row, total in zip(rows, totals, strict=True):
            row.append("█" * round(HISTOGRAM_WIDTH * math.log1p(total) / longest))
    say_table(columns, rows, numeric=(0, 1, 2))

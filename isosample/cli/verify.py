"""`isosample verify`: convergence studies on closed-form scenes, and whether the orders are the theory's."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from isosample.cli.console import note, say, say_json, say_table
from isosample.cli.outputs import make_folder, write_json
from isosample.cli.parser import add_command

if TYPE_CHECKING:
    import argparse

    from isosample.cli.parser import Commands
    from isosample.compare.study import Study

EXIT_FAILED = 1
EXAMPLE = """\
isosample verify
isosample verify --quick
isosample verify -o verification"""


def add_parser(commands: Commands) -> None:
    """Add the command and its options."""
    parser = add_command(
        commands,
        "verify",
        run,
        summary="Refine isovalues, grid, pixels and layers on closed-form scenes, and compare the observed orders of "
        "convergence with the theory's (exit status 1 if one is off).",
        example=EXAMPLE,
    )
    parser.add_argument(
        "-o",
        "--output",
        type=Path,
        metavar="DIR",
        help="folder for a plot of each study and all figures as JSON",
    )
    parser.add_argument(
        "--quick", action="store_true", help="fewer refinements: half a minute in place of two"
    )
    parser.add_argument(
        "--json", action="store_true", help="write JSON on standard output (default: a table)"
    )


def run(args: argparse.Namespace) -> int:
    """Run the studies, tell the verdicts, and fail if one does."""
    from isosample.compare.studies import run_studies
    from isosample.gl.context import shared_context

    folder = None if args.output is None else _folder_for_plots(args.output)
    renderer = shared_context().info["GL_RENDERER"]
    progress = None if args.json else (lambda name: note(f"{name} …"))
    studies = list(run_studies(quick=args.quick, progress=progress))
    document = {"renderer": renderer, "quick": args.quick, "studies": [study.to_dict() for study in studies]}
    if folder is not None:
        from isosample.compare.study_plots import plot_study

        write_json(folder / "studies.json", document)
        for study in studies:
            plot_study(study, folder / f"{study.name}.png")
    if args.json:
        say_json(document)
    else:
        _say(studies, renderer, folder)
    return 0 if all(study.passed for study in studies) else EXIT_FAILED


def _folder_for_plots(folder: Path) -> Path:
    """Make the folder, and raise before the long work if nothing can be written or drawn."""
    from isosample.transfer.plot import check_matplotlib

    check_matplotlib()
    return make_folder(folder)


def _say(studies: list[Study], renderer: str, folder: Path | None) -> None:
    rows = [
        [
            study.name,
            study.measure,
            f"{study.errors[0]:.1e} → {study.errors[-1]:.1e}",
            "" if study.bounds is not None or study.order is None else f"{study.order:.2f}",
            study.expectation,
            "passed" if study.passed else "FAILED",
        ]
        for study in studies
    ]
    say_table(("study", "error", "first → last", "order", "expected", "verdict"), rows)
    say()
    failed = sum(not study.passed for study in studies)
    say(f"{len(studies) - failed} of {len(studies)} studies passed on {renderer}.")
    if folder is not None:
        say(f"Plots and figures are in {folder}.")

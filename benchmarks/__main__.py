"""Runs every benchmark of speed and writes benchmarks/RESULTS.md; `accuracy` runs that of errors instead."""

from __future__ import annotations

import argparse
import sys
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from benchmarks import (
    bench_abuffer,
    bench_cache,
    bench_details,
    bench_equal_error,
    bench_extract,
    bench_method_choice,
    bench_peeling,
    bench_raycast,
    bench_reference,
    bench_scale,
    bench_scaling,
    bench_startup,
)
from benchmarks.machine import describe_machine
from benchmarks.results_page import sections, with_head, with_section

if TYPE_CHECKING:
    from collections.abc import Callable

RESULTS = Path(__file__).parent / "RESULTS.md"
HEAD = """\
# Results

Medians (and median absolute deviations) of repeated, interleaved runs. Made by `make bench`; the parts by the programs
of this folder.
"""
PARTS = {
    "startup": bench_startup.report,
    "extract": bench_extract.report,
    "cache": bench_cache.report,
    "abuffer": bench_abuffer.report,
    "details": bench_details.report,
    "peeling": bench_peeling.report,
    "equal_error": bench_equal_error.report,
    "scaling": bench_scaling.report,
    "raycast": bench_raycast.report,
    "method_choice": bench_method_choice.report,
    "reference": bench_reference.report,
    "scale": bench_scale.report,
}


def main() -> None:
    """Run all, or some, print them, and keep them on the page."""
    if sys.argv[1:2] == ["accuracy"]:
        from benchmarks import bench_accuracy

        bench_accuracy.main(sys.argv[2:])
        return
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description=__doc__)
    parser.add_argument("--quick", action="store_true", help="fewer repetitions; prints only, keeps no page")
    parser.add_argument(
        "--full",
        action="store_true",
        help="also a volume of 1024³ samples (minutes, and 3 GiB of disk), and scans at 1024² pixels (an hour)",
    )
    parser.add_argument(
        "parts",
        nargs="*",
        help=f"some of {', '.join(PARTS)}: only their sections of the page are written anew; all by default",
    )
    arguments = parser.parse_args()
    unknown = sorted(set(arguments.parts) - set(PARTS))
    if unknown:
        parser.error(f"no part {', '.join(unknown)}; there are {', '.join(PARTS)}")
    for name in arguments.parts or PARTS:
        program: Callable[..., str] = PARTS[name]
        if name in ("scale", "equal_error"):
            program = partial(program, full=arguments.full)
        print(f"-- {name}", file=sys.stderr, flush=True)
        report = program(quick=arguments.quick)
        print(report, flush=True)
        if not arguments.quick:
            _renew(report)
    if not arguments.quick:
        if not arguments.parts:
            page = with_head(RESULTS.read_text(encoding="utf-8"), f"{HEAD}\n{describe_machine()}")
            RESULTS.write_text(page, encoding="utf-8")
        print(f"written to {RESULTS}")


def _renew(report: str) -> None:
    """Put the sections of a report in the place of those on the page."""
    page = RESULTS.read_text(encoding="utf-8")
    for section in sections(report, describe_machine()):
        page = with_section(page, section)
    RESULTS.write_text(page, encoding="utf-8")


if __name__ == "__main__":
    main()

"""Runs every benchmark of speed and writes benchmarks/RESULTS.md; `accuracy` runs that of errors instead."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from benchmarks import (
    bench_abuffer,
    bench_cache,
    bench_extract,
    bench_raycast,
    bench_reference,
    bench_scale,
    bench_startup,
)
from benchmarks.machine import describe_machine

RESULTS = Path(__file__).parent / "RESULTS.md"


def main() -> None:
    """Run all, print the page, and keep it."""
    if sys.argv[1:2] == ["accuracy"]:
        from benchmarks import bench_accuracy

        bench_accuracy.main(sys.argv[2:])
        return
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description=__doc__)
    parser.add_argument("--quick", action="store_true", help="fewer repetitions; prints only, keeps no page")
    parser.add_argument(
        "--full", action="store_true", help="also a volume of 1024³ samples: minutes, and 3 GiB of disk"
    )
    arguments = parser.parse_args()
    quick = arguments.quick
    parts = [
        "# Results\n",
        "Medians (and median absolute deviations) of repeated, interleaved runs. Made by `make bench`.\n",
        describe_machine(),
    ]
    for program in (bench_startup, bench_extract, bench_cache, bench_abuffer, bench_raycast, bench_reference):
        parts.append(program.report(quick=quick))
        print(parts[-1], flush=True)
    parts.append(bench_scale.report(quick=quick, full=arguments.full))
    print(parts[-1], flush=True)
    if not quick:
        RESULTS.write_text("\n".join(parts), encoding="utf-8")
        print(f"written to {RESULTS}")


if __name__ == "__main__":
    main()

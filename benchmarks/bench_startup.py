"""Start-up: `import isosample` and `isosample --help` in fresh processes."""

from __future__ import annotations

import subprocess
import sys
import time

from benchmarks.machine import median, table

CASES = {
    "python -c pass": [sys.executable, "-c", "pass"],
    "import isosample": [sys.executable, "-c", "import isosample"],
    "isosample --help": [sys.executable, "-m", "isosample", "--help"],
    "isosample render --help": [sys.executable, "-m", "isosample", "render", "--help"],
}


def report(*, quick: bool) -> str:
    """Wall time of each command, interleaved."""
    samples: dict[str, list[float]] = {name: [] for name in CASES}
    for _ in range(3 if quick else 15):
        for name, command in CASES.items():
            start = time.perf_counter()
            subprocess.run(command, check=True, capture_output=True)
            samples[name].append(time.perf_counter() - start)
    rows = [(f"`{name}`", median(times)) for name, times in samples.items()]
    return "## Start-up\n\n" + table(("command", "wall time"), rows)

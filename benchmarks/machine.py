"""What the figures were measured on, and how figures are summed up."""

from __future__ import annotations

import os
import platform
import subprocess
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

import isosample
from isosample.compare.machine import processor
from isosample.gl.context import shared_context

if TYPE_CHECKING:
    from collections.abc import Sequence


def describe_machine() -> str:
    """One paragraph: date, commit, processor, driver."""
    info = shared_context().info
    return (
        f"{datetime.now(tz=UTC):%Y-%m-%d}, commit {commit()}, isosample {isosample.__version__}, "
        f"{processor()} with {os.cpu_count()} cores, Python {platform.python_version()}, "
        f"{info['GL_RENDERER']}, OpenGL {info['GL_VERSION']}.\n"
    )


def commit() -> str:
    """Short hash of the checkout, with + if it has changes."""
    folder = Path(__file__).parent
    run = ["git", "-C", str(folder)]
    found = subprocess.run(
        [*run, "rev-parse", "--short", "HEAD"], capture_output=True, text=True, check=False
    )
    changed = subprocess.run([*run, "status", "--porcelain"], capture_output=True, text=True, check=False)
    return (found.stdout.strip() or "unknown") + ("+" if changed.stdout.strip() else "")


def median(samples: Sequence[float]) -> str:
    """Median and median absolute deviation, in milliseconds."""
    middle = float(np.median(samples))
    spread = float(np.median(np.abs(np.asarray(samples) - middle)))
    return f"{1e3 * middle:.0f} ± {1e3 * spread:.0f} ms"


def table(heads: Sequence[str], rows: Sequence[Sequence[object]]) -> str:
    """Markdown table."""
    lines = [heads, ["---"] * len(heads), *rows]
    return "\n".join("| " + " | ".join(str(cell) for cell in line) + " |" for line in lines) + "\n"

"""Running commands inside the test's process or beside it, and the small files that they read."""

from __future__ import annotations

import json
import os
import shlex
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    import numpy.typing as npt

ROOT = Path(__file__).resolve().parents[2]
TF: dict[str, Any] = {
    "points": [
        {"value": 20, "color": [1, 0, 0], "extinction": 0},
        {"value": 50, "color": [0, 1, 0], "extinction": 0.5},
        {"value": 80, "color": [0, 0, 1], "extinction": 0.25},
    ]
}


@dataclass(frozen=True, slots=True)
class Outcome:
    """What a command left behind: its exit status, standard output and standard error."""

    status: int
    out: str
    err: str

    def fields(self) -> dict[str, str]:
        """Return the lines `name   value` of the standard output."""
        pairs = [line.split("  ", 1) for line in self.out.splitlines() if "  " in line]
        return {name: value.strip() for name, value in pairs}


Run = Callable[..., Outcome]


def words_of(arguments: tuple[str | Path, ...]) -> list[str]:
    """Split a command line that is given as one text; keep one that is given word by word."""
    if len(arguments) == 1 and isinstance(arguments[0], str):
        return shlex.split(arguments[0])
    return [str(argument) for argument in arguments]


def run_beside(*arguments: str | Path, **environment: str) -> Outcome:
    """Run `python -m isosample` as a process of its own in the current folder."""
    done = subprocess.run(
        [sys.executable, "-m", "isosample", *words_of(arguments)],
        env={**os.environ, "PYTHONPATH": str(ROOT), **environment},
        capture_output=True,
        text=True,
        check=False,
        timeout=120,
    )
    return Outcome(done.returncode, done.stdout, done.stderr)


def blob() -> npt.NDArray[np.float32]:
    """(8, 9, 10) samples between 0 and 100, highest in the middle; a count of its own along each axis."""
    z, y, x = np.mgrid[-1:1:8j, -1:1:9j, -1:1:10j]
    samples: npt.NDArray[np.float32] = (100 * np.exp(-2 * (x * x + y * y + z * z))).astype(np.float32)
    return samples


def write_scene(folder: Path) -> None:
    """Write blob.npy and tf.json, which most commands of the tests read."""
    np.save(folder / "blob.npy", blob())
    write_json(folder / "tf.json", TF)


def write_json(path: Path, document: object) -> None:
    """Write any document as JSON."""
    path.write_text(json.dumps(document), encoding="utf-8")


def content(folder: Path) -> dict[str, bytes | None]:
    """Return every file below a folder with its bytes, and every folder with None."""
    return {
        str(path.relative_to(folder)): path.read_bytes() if path.is_file() else None
        for path in sorted(folder.rglob("*"))
    }


def chunks(folder: Path) -> list[Path]:
    """Return the files of all chunks of a cache folder, sorted."""
    return sorted(folder.glob("chunks/*/*.chunk"))

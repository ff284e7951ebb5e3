"""Kernels run whether or not their machine code can be kept."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
KERNEL = """
import warnings
warnings.simplefilter("always")
from isosample.compiled import compiled

@compiled
def doubled(number):
    return 2.0 * number

@compiled
def doubled_twice(number):
    return doubled(doubled(number))

print(doubled_twice(1.5))
"""
CACHES = ("HOME", "XDG_CACHE_HOME", "NUMBA_CACHE_DIR")


def run_kernel(folder: Path, **environment: str) -> subprocess.CompletedProcess[str]:
    """Run two kernels of a file in `folder`, by a process of its own with these folders and no others."""
    script = folder / "kernel.py"
    script.write_text(KERNEL, encoding="utf-8")
    kept = {name: value for name, value in os.environ.items() if name not in CACHES}
    return subprocess.run(
        [sys.executable, str(script)],
        env={**kept, "PYTHONPATH": str(ROOT), **environment},
        capture_output=True,
        text=True,
        check=False,
        timeout=120,
    )


@pytest.mark.parametrize(
    ("environment", "named"),
    [
        ({"HOME": "/dev/null"}, "in /dev/null/.cache/isosample/kernels/"),
        ({"HOME": "/dev/null", "XDG_CACHE_HOME": "/dev/null/cache"}, "in /dev/null/cache/isosample/kernels/"),
        ({"HOME": "/dev/null", "NUMBA_CACHE_DIR": "/dev/null/numba"}, "in /dev/null/numba (Not a directory)"),
        ({"HOME": "~"}, "cannot be kept (the user has no home folder)"),  # what expands to itself is no home
    ],
)
def test_without_a_folder_for_machine_code_kernels_run_and_one_warning_names_it(
    tmp_path: Path, environment: dict[str, str], named: str
) -> None:
    done = run_kernel(tmp_path, **environment)
    assert (done.returncode, done.stdout) == (0, "6.0\n"), done.stderr
    assert done.stderr.count("UserWarning") == 1
    assert f"compiled code cannot be kept {named.removeprefix('cannot be kept ')}" in done.stderr
    assert "set XDG_CACHE_HOME or NUMBA_CACHE_DIR" in done.stderr
    assert sorted(path.name for path in tmp_path.rglob("*")) == ["kernel.py"]


def test_machine_code_is_kept_in_the_user_s_cache(tmp_path: Path) -> None:
    cache = tmp_path / "cache"
    done = run_kernel(tmp_path, XDG_CACHE_HOME=str(cache))
    assert (done.returncode, done.stdout, done.stderr) == (0, "6.0\n", "")
    assert len(list((cache / "isosample" / "kernels").rglob("*.nbc"))) == 2

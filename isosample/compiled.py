"""Compilation of float64 kernels to machine code: no fast mathematics, no global interpreter lock, cached."""

from __future__ import annotations

import hashlib
import os
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar, cast

from numba import config, njit

if TYPE_CHECKING:
    from collections.abc import Callable
    from typing import Any

F = TypeVar("F", bound="Callable[..., Any]")


def compiled(function: F) -> F:
    """Return `function` compiled by numba on its first call; the machine code is kept in the user's cache.

    Importing this module imports numba, so modules with kernels are imported where they are called.
    """
    chosen = config.CACHE_DIR  # type: ignore[attr-defined]  # set when numba starts
    if not chosen:  # read while the decorator runs, and put back for everybody else
        config.CACHE_DIR = str(kernel_cache())  # type: ignore[attr-defined]
    try:
        return cast("F", njit(nogil=True, cache=True, fastmath=False, error_model="numpy")(function))
    finally:
        config.CACHE_DIR = chosen  # type: ignore[attr-defined]


@cache
def kernel_cache() -> Path:
    """Folder of the machine code, one per state of the sources.

    Numba checks a cached function against its own file alone, and an index that names a class which another file
    no longer has cannot even be read. A folder per state of all files with kernels has neither fault.
    """
    digest = hashlib.sha256()
    package = Path(__file__).parent
    for source in sorted(package.rglob("*.py")):
        text = source.read_bytes()
        if source.parent.name == "integral" or b"compiled" in text:
            digest.update(text)
    base = Path(os.environ.get("XDG_CACHE_HOME") or "~/.cache").expanduser()
    return base / "isosample" / "kernels" / digest.hexdigest()[:16]

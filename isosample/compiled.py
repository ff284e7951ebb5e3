"""Compilation of float64 kernels to machine code: no fast mathematics, no global interpreter lock, cached."""

from __future__ import annotations

import errno
import hashlib
import logging
import os
import tempfile
import time
import warnings
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar, cast

from numba import config, njit
from numba.core import event

if TYPE_CHECKING:
    from collections.abc import Callable
    from typing import Any

F = TypeVar("F", bound="Callable[..., Any]")

LOG = logging.getLogger(__name__)
PATIENCE = 10.0  # s of compilation after which it is told of


class _Compilations(event.Listener):
    """Tells once, in the log, why the first run takes long: what is compiled has no machine code in the cache.

    Compilations may be nested, and none begins while another thread's is going on.
    """

    def __init__(self) -> None:
        self._depth, self._began, self._spent, self._told = 0, 0.0, 0.0, False

    def on_start(self, event: event.Event) -> None:  # noqa: ARG002  # named by numba
        """Tell where the compilations so far have taken long."""
        now = time.monotonic()
        if self._depth == 0:
            self._began = now
        self._depth += 1
        if not self._told and self._spent + now - self._began > PATIENCE:
            self._told = True
            LOG.info(
                "kernels are being compiled to machine code, which the next run finds where it can be kept"
            )

    def on_end(self, event: event.Event) -> None:  # noqa: ARG002
        """Add what the outermost compilation took."""
        self._depth -= 1
        if self._depth == 0:
            self._spent += time.monotonic() - self._began


event.register("numba:compile", _Compilations())  # type: ignore[no-untyped-call]


def compiled(function: F) -> F:
    """Return `function` compiled by numba on its first call; the machine code is kept in the user's cache.

    Importing this module imports numba, so modules with kernels are imported where they are called. Where the cache
    cannot be written, a warning says so once, and every process compiles for itself.
    """
    chosen = config.CACHE_DIR  # type: ignore[attr-defined]  # set when numba starts, by NUMBA_CACHE_DIR
    folder = Path(chosen) if chosen else kernel_cache()
    kept = _can_be_written(folder)
    if kept:  # read while the decorator runs, and put back for everybody else
        config.CACHE_DIR = str(folder)  # type: ignore[attr-defined]
    try:
        return cast("F", njit(nogil=True, cache=kept, fastmath=False, error_model="numpy")(function))
    finally:
        config.CACHE_DIR = chosen  # type: ignore[attr-defined]


@cache
def kernel_cache() -> Path | None:
    """Folder of the machine code, one per state of the sources; None where there is no home folder to hold it.

    Numba checks a cached function against its own file alone, and an index that names a class which another file
    no longer has cannot even be read. A folder per state of all files with kernels has neither fault.
    """
    digest = hashlib.sha256()
    package = Path(__file__).parent
    for source in sorted(package.rglob("*.py")):
        text = source.read_bytes()
        if source.parent.name == "integral" or b"compiled" in text:
            digest.update(text)
    try:
        base = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    except RuntimeError:
        return None
    return Path(base) / "isosample" / "kernels" / digest.hexdigest()[:16]


@cache
def _can_be_written(folder: Path | None) -> bool:
    """Whether a folder is there, or can be made, and takes files; a warning says why not."""
    try:
        if folder is None:
            raise FileNotFoundError(errno.ENOENT, "the user has no home folder")
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return True
    except OSError as error:
        where = "" if folder is None else f" in {folder}"
        warnings.warn(
            f"compiled code cannot be kept{where} ({error.strerror}), so every process compiles it anew; set "
            "XDG_CACHE_HOME or NUMBA_CACHE_DIR to a folder that can be written.",
            stacklevel=3,
        )
        return False

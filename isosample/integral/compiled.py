"""Compilation of float64 kernels to machine code: no fast mathematics, no global interpreter lock, cached."""

from __future__ import annotations

from typing import TYPE_CHECKING, TypeVar, cast

from numba import njit

if TYPE_CHECKING:
    from collections.abc import Callable
    from typing import Any

F = TypeVar("F", bound="Callable[..., Any]")


def compiled(function: F) -> F:
    """Return `function` compiled by numba on its first call; the machine code is kept beside the source.

    Importing this module imports numba, so modules with kernels are imported where they are called.
    """
    compile_lazily = njit(nogil=True, cache=True, fastmath=False, error_model="numpy")
    return cast("F", compile_lazily(function))

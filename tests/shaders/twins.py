"""Rounding bounds of float32, and shaders with a wrong constant: to hold shader functions against float64."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from isosample.gl.shader_source import shader_root

if TYPE_CHECKING:
    from pathlib import Path

    import numpy.typing as npt
    from hypothesis.strategies import SearchStrategy

    from isosample.volume.grid import F64

    F32 = npt.NDArray[np.float32]

UNIT = 2.0**-24  # half the spacing of float32 at 1: the largest relative rounding
TINY = 2.0**-126  # smaller results may be flushed to zero (OpenGL Shading Language 4.5, section 4.7.1)
DIVISION = 5  # roundings: 2.5 ulp <= 5 units (section 4.7.1, table)
SQUARE_ROOT = 9  # roundings: 1 / inversesqrt(), 2 ulp and a division


def gamma(count: int) -> float:
    """Relative error of `count` roundings (Higham 2002, lemma 3.1)."""
    return count * UNIT / (1.0 - count * UNIT)


def ulp(values: npt.ArrayLike) -> F64:
    """Spacing of the float32 numbers at `values`."""
    spacing: F64 = np.spacing(np.maximum(np.abs(values), TINY).astype(np.float32)).astype(np.float64)
    return spacing


def columns(count: int, low: float, high: float, rows: int = 16) -> SearchStrategy[F32]:
    """Arrays (rows, count) of float32 in [low, high] without subnormal numbers; (rows,) if `count` is 0."""
    elements = st.floats(low, high, width=32, allow_subnormal=False)
    return arrays(np.float32, (rows, count) if count else rows, elements=elements, fill=st.nothing())


def wrong_shader(folder: Path, path: str, right: str, wrong: str) -> Path:
    """Shader root in `folder` whose file `path` has `wrong` in place of `right`, which must be there once."""
    text = (shader_root() / path).read_text(encoding="utf-8")
    assert text.count(right) == 1, f"{right!r} occurs {text.count(right)} times in {path}"
    target = folder / path
    target.parent.mkdir(parents=True, exist_ok=True)
    target.write_text(text.replace(right, wrong), encoding="utf-8")
    return folder


def assert_within(found: npt.NDArray[Any], expected: F64, bound: npt.ArrayLike) -> None:
    """Raise AssertionError with the worst place unless every error is within its bound."""
    excess = np.abs(found.astype(np.float64) - expected) - np.broadcast_to(bound, expected.shape)
    if (excess <= 0.0).all():
        return
    worst = np.unravel_index(int(excess.argmax()), excess.shape)
    raise AssertionError(
        f"{excess[worst]:g} beyond its bound at {worst}: found {found[worst]!r}, expected {expected[worst]!r}"
    )

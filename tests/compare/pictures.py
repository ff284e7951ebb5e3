"""Pictures for the tests of the measures."""

from __future__ import annotations

from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

import hypothesis.strategies as st
import numpy as np
import pytest

if TYPE_CHECKING:
    from collections.abc import Iterable

    from isosample.volume.grid import F64

BLACK = (0.0, 0.0, 0.0)
seeds = st.integers(0, 2**32 - 1)
needs_flip = pytest.mark.skipif(find_spec("flip_evaluator") is None, reason="flip-evaluator is not installed")


def names_of(measures: Iterable[str]) -> list[Any]:
    """Parameters of a test of each measure; FLIP is skipped where its package is absent."""
    return [pytest.param(name, marks=needs_flip) if name == "flip" else name for name in measures]


def uniform(rgba: tuple[float, float, float, float], *, height: int = 16, width: int = 16) -> F64:
    return np.full((height, width, 4), rgba)


def grey(level: float) -> F64:
    """Opaque grey of a linear level."""
    return uniform((level, level, level, 1.0))


def random_picture(seed: int, *, height: int = 13, width: int = 17) -> F64:
    """Premultiplied, half of it empty."""
    rng = np.random.default_rng(seed)
    alpha = rng.random((height, width, 1)) * (rng.random((height, width, 1)) < 0.5)
    alpha[height // 2, width // 2] = 1.0  # at least one pixel is visible, away from the border
    return np.concatenate([rng.random((height, width, 3)) * alpha, alpha], axis=-1)

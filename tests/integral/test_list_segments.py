"""Weights of linear segments and opacities of sheets in kernels, against their closed forms."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from isosample.integral import list_segments
from isosample.integral.list_segments import linear_weights, sheet_opacity
from isosample.integral.optics import segment_weights

depths = st.one_of(st.just(0.0), st.floats(1e-12, 1e4))


@given(depths, depths)
def test_linear_weights_are_those_of_the_closed_form(x0: float, x1: float) -> None:
    # The quadrature errs by 3e-17 per panel of at most 80, its sums and exponents by 8 · 80 roundings of terms that
    # sum to 1: 640 · 1.1e-16 at the very worst.
    np.testing.assert_allclose(linear_weights(x0, x1), segment_weights(x0, x1), rtol=0, atol=7e-14)


@given(st.floats(1e-9, 1e-3), st.floats(1e-9, 1e-3))
def test_thin_segments_keep_their_colour(x0: float, x1: float) -> None:
    front, _ = linear_weights(x0, x1)
    assert front == pytest.approx(segment_weights(x0, x1)[0], rel=1e-13)


@pytest.mark.parametrize("depth", [1e3, 1e6, 1e12, 1e200])
def test_segments_of_any_depth_end(depth: float) -> None:
    front, back = linear_weights(depth, depth)
    assert front + back == 1.0
    assert back == pytest.approx(min(1.0 / depth, 1.0), rel=1e-3, abs=1e-15)


def test_one_panel_would_not_do(monkeypatch: pytest.MonkeyPatch) -> None:
    python: Any = linear_weights
    monkeypatch.setattr(list_segments, "PANEL_DEPTH", 1e3)
    assert abs(python.py_func(30.0, 1.0)[0] - segment_weights(30.0, 1.0)[0]) > 1e-5


def test_sheets_from_grazed_to_crossed_at_once() -> None:
    for area, slope, least, expected in (
        (0.0, 0.0, 0.0, 0.0),
        (0.1, 0.0, 0.0, 1.0),
        (0.1, 0.0, 0.2, -np.expm1(-0.5)),
        (0.1, 0.4, 0.2, -np.expm1(-0.25)),
        (0.1, 1e300, 0.0, 1e-301),
    ):
        assert sheet_opacity(area, slope, least) == pytest.approx(expected, rel=1e-14)

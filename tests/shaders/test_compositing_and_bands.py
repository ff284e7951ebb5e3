"""Shader compositing and band positions agree with float64 within their roundings."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
from hypothesis import given, settings

from isosample.integral.bands import band_position
from isosample.integral.compositing import over
from shaders.harness import call
from shaders.twins import TINY, assert_within, columns, gamma, wrong_shader

if TYPE_CHECKING:
    from pathlib import Path

    import moderngl

    from shaders.twins import F32

COMPOSITING, BANDS = "lib/compositing.glsl", "lib/bands.glsl"


def _assert_over(gl: moderngl.Context, front: F32, back: F32, root: Path | None = None) -> None:
    found = call(gl, COMPOSITING, "vec4 over(vec4 front, vec4 back)", front, back, root=root)
    front, back = front.astype(np.float64), back.astype(np.float64)
    # 1 − a, the product and the sum: three roundings, as the file states.
    assert_within(found, over(front, back), gamma(3) * (np.abs(front) + np.abs(back)) + TINY)


def _assert_position(
    gl: moderngl.Context, low: F32, inverse: F32, value: F32, root: Path | None = None
) -> None:
    signature = "float band_position(float value_low, float inverse_width, float value)"
    found = call(gl, BANDS, signature, low, inverse, value, root=root)
    expected = band_position(*(part.astype(np.float64) for part in (low, inverse, value)))
    # The difference and the product: two roundings; clamping to [0, 1] shrinks errors.
    assert_within(found, expected, gamma(2) * expected + TINY * (1.0 + inverse))
    assert ((found >= 0.0) & (found <= 1.0)).all()


def _random_bands() -> tuple[F32, F32, F32]:
    random = np.random.default_rng(1).random((3, 2000), dtype=np.float32)
    return random[0], np.float32(1.0) / random[1], random[2]


def test_over_agrees_with_its_twin(gl: moderngl.Context) -> None:
    random = np.random.default_rng(0).random((2, 5000, 4), dtype=np.float32)
    _assert_over(gl, random[0], random[1])


def test_opaque_front_and_clear_back_are_exact(gl: moderngl.Context) -> None:
    colour = np.random.default_rng(2).random((50, 4), dtype=np.float32)
    opaque, clear = colour.copy(), np.zeros_like(colour)
    opaque[:, 3] = 1.0
    front, back = np.concatenate([opaque, clear, colour]), np.concatenate([colour, colour, clear])
    found = call(gl, COMPOSITING, "vec4 over(vec4 front, vec4 back)", front, back)
    assert found.tolist() == np.concatenate([opaque, colour, colour]).tolist()


@settings(max_examples=20)
@given(front=columns(4, 0.0, 1.0), back=columns(4, 0.0, 1.0))
def test_over_agrees_for_any_colours(gl: moderngl.Context, front: F32, back: F32) -> None:
    _assert_over(gl, front, back)


def test_band_position_agrees_with_its_twin(gl: moderngl.Context) -> None:
    _assert_position(gl, *_random_bands())


def test_band_ends_and_empty_bands_are_exact(gl: moderngl.Context) -> None:
    low = np.full(6, 0.25, np.float32)
    inverse = np.array([4, 4, 4, 4, 0, 0], np.float32)
    value = np.array([0.25, 0.5, -1, 1, 0, 1], np.float32)
    signature = "float band_position(float value_low, float inverse_width, float value)"
    assert call(gl, BANDS, signature, low, inverse, value).tolist() == [0, 1, 0, 1, 0, 0]


@settings(max_examples=20)
@given(low=columns(0, 0.0, 1.0), inverse=columns(0, 0.0, 2.0**40), value=columns(0, -1.0, 2.0))
def test_band_position_agrees_for_any_band(gl: moderngl.Context, low: F32, inverse: F32, value: F32) -> None:
    _assert_position(gl, low, inverse, value)


def test_wrong_constant_is_told(gl: moderngl.Context, tmp_path: Path) -> None:
    root = wrong_shader(tmp_path, COMPOSITING, "(1.0 - front.a)", "(1.00001 - front.a)")
    front, back = np.random.default_rng(0).random((2, 100, 4), dtype=np.float32)
    with pytest.raises(AssertionError, match="beyond its bound"):
        _assert_over(gl, front, back, root)
    root = wrong_shader(tmp_path, BANDS, "0.0, 1.0)", "0.0, 0.99999)")
    with pytest.raises(AssertionError, match="beyond its bound"):
        _assert_position(gl, *_random_bands(), root)

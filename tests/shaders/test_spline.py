"""Shader splines on the faces of the box agree with float64 within their roundings."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from isosample.integral.spline import largest_bend, spline_face_tolerance, spline_face_value, tap_weights
from shaders.harness import call
from shaders.twins import assert_within, gamma, wrong_shader

if TYPE_CHECKING:
    from pathlib import Path

    import moderngl


SPLINE = "lib/spline.glsl"
COUNT = 1000


def assert_weights(gl: moderngl.Context, root: Path | None = None) -> None:
    rng = np.random.default_rng(1)
    kernel = rng.uniform(-1.0, 1.0, (4, 4)).astype(np.float32)
    u = rng.random(COUNT).astype(np.float32)
    found = call(gl, SPLINE, "vec4 tap_weights(vec4 kernel[4], float u)", kernel, u, root=root)
    # Two products of the third power, one with the kernel, three sums: 6 roundings of terms of at most 1.
    assert_within(found, tap_weights(kernel, u), gamma(6) * 4.0)


def assert_value(gl: moderngl.Context, root: Path | None = None) -> None:
    rng = np.random.default_rng(2)
    taps = rng.uniform(-1.0, 1.0, (COUNT, 4, 4)).astype(np.float32)
    across, up = (rng.uniform(-1.0, 1.0, (COUNT, 4)).astype(np.float32) for _ in range(2))
    signature = "float spline_face_value(vec4 taps[4], vec4 weights_u, vec4 weights_v)"
    found = call(gl, SPLINE, signature, taps, across, up, root=root)
    # Two dot products of four: 4 roundings each, of 16 terms of at most 1.
    assert_within(found, spline_face_value(taps, across, up), gamma(8) * 16.0)


def assert_bend(gl: moderngl.Context, root: Path | None = None) -> None:
    row = np.random.default_rng(3).uniform(-1.0, 1.0, (COUNT, 4)).astype(np.float32)
    found = call(gl, SPLINE, "float largest_bend(vec4 row)", row, root=root)
    assert_within(found, largest_bend(row), gamma(2) * 4.0)  # two roundings of terms that sum to 4


def assert_tolerance(gl: moderngl.Context, root: Path | None = None) -> None:
    taps = np.random.default_rng(4).uniform(-1.0, 1.0, (COUNT, 4, 4)).astype(np.float32)
    found = call(gl, SPLINE, "float spline_face_tolerance(vec4 taps[4])", taps, root=root)
    expected = spline_face_tolerance(taps)
    # Bends 4 each times 1/8, mixed 4 times 1/4, range 2 times 0.02: terms of at most 2.1, 8 roundings.
    assert_within(found, expected, gamma(8) * 2.1)


CHECKS = {
    "tap_weights": assert_weights,
    "spline_face_value": assert_value,
    "largest_bend": assert_bend,
    "spline_face_tolerance": assert_tolerance,
}


@pytest.mark.parametrize("check", CHECKS)
def test_the_shader_does_what_its_twin_does(gl: moderngl.Context, check: str) -> None:
    CHECKS[check](gl)


@pytest.mark.parametrize(
    ("check", "right", "wrong"),
    [
        ("tap_weights", "u * u * u", "u * u"),
        ("spline_face_value", "dot(taps[3], weights_u)", "dot(taps[2], weights_u)"),
        ("largest_bend", "row.y - 2.0 * row.z + row.w", "row.y - 2.0 * row.z"),
        ("spline_face_tolerance", "0.125 * (bend", "0.12 * (bend"),
    ],
)
def test_a_wrong_shader_is_found(
    gl: moderngl.Context, tmp_path: Path, check: str, right: str, wrong: str
) -> None:
    with pytest.raises(AssertionError):
        CHECKS[check](gl, wrong_shader(tmp_path, SPLINE, right, wrong))

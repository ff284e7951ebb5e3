"""Shader splines agree with float64 within their roundings."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from isosample.integral.spline import (
    largest_bend,
    paired_taps,
    spline_face_tolerance,
    spline_face_value,
    tap_slopes,
    tap_weights,
    weighed_quad,
)
from shaders.harness import call
from shaders.twins import DIVISION, assert_within, gamma, wrong_shader

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


def assert_slopes(gl: moderngl.Context, root: Path | None = None) -> None:
    rng = np.random.default_rng(5)
    kernel = rng.uniform(-1.0, 1.0, (4, 4)).astype(np.float32)
    u = rng.random(COUNT).astype(np.float32)
    found = call(gl, SPLINE, "vec4 tap_slopes(vec4 kernel[4], float u)", kernel, u, root=root)
    # Two products of 3 u², one with the kernel, two sums: 5 roundings of terms of at most 1, 2 and 3.
    assert_within(found, tap_slopes(kernel, u), gamma(5) * 6.0)


def assert_pairs(gl: moderngl.Context, root: Path | None = None) -> None:
    weights = np.random.default_rng(6).random((COUNT, 2)).astype(np.float32)
    weights[::2] *= -1.0
    weights[:3] = [[0.0, 0.0], [0.0, 0.5], [-0.5, 0.0]]
    found = call(gl, SPLINE, "vec2 paired_taps(vec2 weights)", weights, root=root)
    # A sum of at most 2, and a part of at most 1 that is divided by it.
    assert_within(found, paired_taps(weights), [gamma(1) * 2.0, gamma(1 + DIVISION)])


def assert_quad(gl: moderngl.Context, root: Path | None = None) -> None:
    rng = np.random.default_rng(7)
    quad = rng.uniform(-1.0, 1.0, (COUNT, 4)).astype(np.float32)
    across, up = (rng.uniform(-1.0, 1.0, (COUNT, 2)).astype(np.float32) for _ in range(2))
    signature = "float weighed_quad(vec4 quad, vec2 weights_x, vec2 weights_y)"
    found = call(gl, SPLINE, signature, quad, across, up, root=root)
    # Two dot products of two: 2 roundings each, of 4 terms of at most 1.
    assert_within(found, weighed_quad(quad, across, up), gamma(4) * 4.0)


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
    "tap_slopes": assert_slopes,
    "paired_taps": assert_pairs,
    "weighed_quad": assert_quad,
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
        ("tap_slopes", "3.0 * (u * u)", "2.0 * (u * u)"),
        ("paired_taps", "weights.y / sum", "weights.x / sum"),
        ("weighed_quad", "dot(quad.zw, weights_x)", "dot(quad.wz, weights_x)"),
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


def test_slopes_of_weights_are_their_derivatives() -> None:
    """A central difference of a cubic is its derivative plus h² times the third power's weight."""
    kernel, u, h = np.random.default_rng(8).uniform(-1.0, 1.0, (4, 4)), np.linspace(0.1, 0.9, 9), 0.0625
    difference = (tap_weights(kernel, u + h) - tap_weights(kernel, u - h)) / (2.0 * h)
    assert np.abs(tap_slopes(kernel, u) + h * h * kernel[:, 3] - difference).max() < 1e-14


def test_a_pair_of_taps_is_one_linear_fetch() -> None:
    weights = np.array([[0.25, 0.75], [-0.5, -0.125], [0.0, 0.0], [2.0, 0.0]])
    first, second = 3.0, -7.0
    total, part = paired_taps(weights).T
    assert np.array_equal(total * (first + part * (second - first)), weights @ [first, second])


def test_a_quad_is_a_corner_of_the_face() -> None:
    """Four by four taps are four quads."""
    rng = np.random.default_rng(9)
    taps, across, up = rng.normal(size=(4, 4)), rng.normal(size=4), rng.normal(size=4)
    quads = sum(
        float(weighed_quad(taps[j : j + 2, i : i + 2].ravel(), across[i : i + 2], up[j : j + 2]))
        for j in (0, 2)
        for i in (0, 2)
    )
    assert quads == pytest.approx(float(spline_face_value(taps, across, up)), abs=1e-14)

"""The shader's cubic in a cell agrees with float64: coefficients, values, slopes, extrema and roots."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from isosample.integral.cell_cubic import (
    cubic_between,
    cubic_extrema,
    cubic_root,
    cubic_slope,
    cubic_through,
    cubic_value,
)
from shaders.harness import call
from shaders.twins import UNIT, assert_within, gamma, wrong_shader

if TYPE_CHECKING:
    from pathlib import Path

    import moderngl

    from isosample.volume.grid import F64
    from shaders.twins import F32

CUBIC = "lib/cell_cubic.glsl"
COUNT = 2000


def coefficients(seed: int) -> F32:
    """(COUNT, 4) float32 in [0, 1]."""
    return np.random.default_rng(seed).random((COUNT, 4)).astype(np.float32)


def rows(function: object, *columns: F32 | F64) -> F64:
    """A float64 kernel, row by row; vectors are passed number by number."""
    found = []
    for row in zip(*columns, strict=True):
        numbers = [float(number) for part in row for number in np.atleast_1d(part)]
        found.append(function(*numbers))  # type: ignore[operator]  # a compiled kernel
    return np.array(found, dtype=np.float64)


def assert_between(gl: moderngl.Context, root: Path | None = None) -> None:
    rng = np.random.default_rng(1)
    low, high = coefficients(2), coefficients(3)
    start, end = (rng.random((COUNT, 3)).astype(np.float32) for _ in range(2))
    signature = "vec4 cubic_between(vec4 low, vec4 high, vec3 start, vec3 end)"
    found = call(gl, CUBIC, signature, low, high, start, end, root=root)
    corners = np.stack([low, high], axis=1).reshape(-1, 2, 2, 2).astype(np.float64)
    places = zip(corners, start.astype(np.float64), end.astype(np.float64), strict=True)
    expected = np.array([cubic_between(*place) for place in places])
    # Three interpolations of numbers in [0, 1], each with a difference, a product and a sum (3 units); their mean: two
    # sums of up to 3 (2 units more) and a division (2.5 ulp). Together 9 + 2 + 5.
    assert_within(found, expected, gamma(16))


def assert_through(gl: moderngl.Context, root: Path | None = None) -> None:
    samples = coefficients(4)
    found = call(gl, CUBIC, "vec4 cubic_through(vec4 samples)", samples, root=root)
    # Terms of at most 5 + 18 + 9 + 2 = 34, a product and three sums, over 6: 4 units, and 5 of the division.
    assert_within(found, rows(cubic_through, samples), gamma(9) * 34.0 / 6.0)


def assert_value(gl: moderngl.Context, root: Path | None = None) -> None:
    b, s = coefficients(5), np.random.default_rng(6).random(COUNT).astype(np.float32)
    found = call(gl, CUBIC, "float cubic_value(vec4 b, float s)", b, s, root=root)
    # First differences <= 1, second <= 2, third <= 4: terms of at most 1 + 3 + 6 + 4, 3 + 7 roundings each.
    assert_within(found, rows(cubic_value, b, s), gamma(10) * 14.0)


def assert_slope(gl: moderngl.Context, root: Path | None = None) -> None:
    b, s = coefficients(7), np.random.default_rng(8).random(COUNT).astype(np.float32)
    found = call(gl, CUBIC, "float cubic_slope(vec4 b, float s)", b, s, root=root)
    # 3 (1 + 4 + 4) in terms, 3 + 6 roundings.
    assert_within(found, rows(cubic_slope, b, s), gamma(9) * 27.0)


def assert_extrema(gl: moderngl.Context, root: Path | None = None) -> None:
    b = coefficients(9)
    found = call(gl, CUBIC, "vec2 cubic_extrema(vec4 b)", b, root=root).astype(np.float64)
    expected = rows(cubic_extrema, b)[:, 1:]
    # A place is found to where the slope, whose own error is that of `cubic_slope`, is 0: it may be missed where the
    # slope only just reaches 0, so what counts is the value there.
    places = np.concatenate([found, expected], axis=1)
    values = np.stack([rows(cubic_value, b, places[:, i]) for i in range(4)], axis=1)
    both = (found < 1.0) == (expected < 1.0)
    assert both.mean() > 0.99
    assert_within(values[:, :2][both], values[:, 2:][both], gamma(9) * 27.0)


def assert_root(gl: moderngl.Context, root: Path | None = None) -> None:
    b = np.sort(coefficients(10), axis=1)  # rising
    level = (b[:, 0] + (b[:, 3] - b[:, 0]) * np.random.default_rng(11).random(COUNT)).astype(np.float32)
    inside = (level > b[:, 0]) & (level < b[:, 3])
    b, level = b[inside], level[inside]
    ends = np.zeros(len(b), np.float32), np.ones(len(b), np.float32)
    signature = "float cubic_root(vec4 b, float level, float low, float high, bool rising)"
    found = call(gl, CUBIC, signature, b, level, *ends, np.array(True), root=root).astype(np.float64)
    # The value there is the level: error of the value, and what the last step of Newton's method leaves, f'' / 2 <= 6
    # times its square.
    values = rows(cubic_value, b, found)
    assert_within(values, level.astype(np.float64), gamma(10) * 14.0 + 6.0 * 1e-4**2 + 4.0 * UNIT)
    count = len(b)
    exact = rows(cubic_root, b, level, np.zeros(count), np.ones(count), np.ones(count))
    slopes = rows(cubic_slope, b, exact)
    steep = slopes > 0.5
    assert_within(found[steep], exact[steep], 2.0 * (gamma(10) * 14.0 / slopes[steep] + 2e-7))


CHECKS = {
    "cubic_between": assert_between,
    "cubic_through": assert_through,
    "cubic_value": assert_value,
    "cubic_slope": assert_slope,
    "cubic_extrema": assert_extrema,
    "cubic_root": assert_root,
}


@pytest.mark.parametrize("check", CHECKS)
def test_the_shader_does_what_its_twin_does(gl: moderngl.Context, check: str) -> None:
    CHECKS[check](gl)


@pytest.mark.parametrize(
    ("check", "right", "wrong"),
    [
        ("cubic_between", "(end_at_start.x + at_start.y", "(end_at_start.y + at_start.y"),
        ("cubic_through", "18.0 * samples.y", "17.9 * samples.y"),
        ("cubic_value", "s * (3.0 * e.x + s * (e.y - e.x)));", "s * (2.9 * e.x + s * (e.y - e.x)));"),
        ("cubic_slope", "2.0 * e.x", "1.9 * e.x"),
        ("cubic_extrema", "d.z - d.y - half_linear", "d.z - d.y"),
        ("cubic_root", "change <= CUBIC_ROOT_TOLERANCE", "change <= 0.2"),
    ],
)
def test_a_wrong_shader_is_found(
    gl: moderngl.Context, tmp_path: Path, check: str, right: str, wrong: str
) -> None:
    root = wrong_shader(tmp_path, CUBIC, right, wrong)
    with pytest.raises(AssertionError):
        CHECKS[check](gl, root)


def test_a_falling_piece_has_the_root_of_its_mirror_image(gl: moderngl.Context) -> None:
    b = np.sort(coefficients(12), axis=1)[:200]
    level = (0.5 * (b[:, 0] + b[:, 3])).astype(np.float32)
    zero, one = np.float32(0.0), np.float32(1.0)
    signature = "float cubic_root(vec4 b, float level, float low, float high, bool rising)"
    rising = call(gl, CUBIC, signature, b, level, zero, one, np.array(True)).astype(np.float64)
    falling = call(gl, CUBIC, signature, b[:, ::-1].copy(), level, zero, one, np.array(False))
    steep = rows(cubic_slope, b, rising) > 0.5
    # Both are roots to the tolerance of `assert_root`.
    assert_within(falling[steep], 1.0 - rising[steep], 4.0 * (gamma(10) * 14.0 / 0.5 + 2e-7))


def test_four_values_of_a_cubic_give_its_coefficients_back() -> None:
    b = np.random.default_rng(13).random(4)
    places = np.array([0.0, 1.0 / 3.0, 2.0 / 3.0, 1.0])
    values = rows(cubic_value, np.tile(b, (4, 1)), places)
    # Condition: weights of up to 34 / 6 on values with an error of 14 units of float64.
    assert np.abs(rows(cubic_through, values[None]) - b).max() < 6.0 * 14.0 * 2.0**-52

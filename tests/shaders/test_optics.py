"""Shader opacities, panels and segment weights keep the errors that `optics.glsl` states."""

from __future__ import annotations

import itertools
import math
from typing import TYPE_CHECKING

import numpy as np
import pytest
from hypothesis import given, settings

from isosample.integral.optics import (
    PANEL_DEPTH,
    mean_opacity,
    opacity_from_depth,
    panel_end,
    partial_depth,
    segment_weights,
)
from shaders.harness import call
from shaders.twins import (
    DIVISION,
    SQUARE_ROOT,
    TINY,
    UNIT,
    assert_within,
    columns,
    gamma,
    ulp,
    wrong_shader,
)

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    import moderngl

    from isosample.volume.grid import F64
    from shaders.twins import F32

OPTICS = "lib/optics.glsl"
# The polynomial's 9.1e-8 times a depth of 1/2, the ray behind the last panel, and roundings in units. Each
# stands for all panels, as their widths are 1 in all; s = x1 − x0, and x_u is the extinction at a panel's start u:
#   what is left before the n-th panel: its product 1.5 n exp(−n / 2) <= 1.1; the panels before it have depths that
#   are off by (2 (SQUARE_ROOT + 1 + DIVISION) + 6) / 2 = 18 of the root and the quotient, 1 of the place and, where x
#   rises, 3 of x_u (see _assert_panel_end), and n exp(−n / 2) <= 0.74: 16.3; where x falls, 6 x0 u of x_u, of which
#   x0 u exp(−x0 u / 2) <= 0.74 is left: 18.5;
#   x_u times the width w <= 1: 2 |s| u + 2 x_u, where x rises at most 4; where it falls, 2 x0 times the sum of
#   w² exp(−D) <= e^½ times the integral of exp(−x0 u / 2): 6.6; s w² / 2 <= ½, three roundings: 1.5;
#   the polynomial: 2 k + 2 of what is of order k, at most 1/4, 1/24, ... where x rises: 1.5; where it falls 4;
#   1 − what is left and their product 0.8, the sum 1, the width 1;
#   up to 36 sums of at most sqrt(k / 36): 24, where x falls 1 − sqrt(1 − k / 36): 13; the rest of the ray 2.
# The back weight adds the opacity's 5.4 + 2. Together 61 where x rises, 57 where it falls.
STATED_WEIGHT_ERROR = 0.5 * 9.1e-8 + math.exp(-18.0) + gamma(61)


def _opacity_bound(depth: F64) -> F64:
    """Error that the file states: gamma(4) below depth 1/2, exp of the specification and a sum above."""
    opacity = opacity_from_depth(depth)
    series = (gamma(4) + 6e-10) * opacity
    exponential = (3.0 + 2.0 * depth) * ulp(np.exp(-depth)) + UNIT * opacity
    return np.where(depth < 0.5, series, exponential) + TINY


def _assert_opacity(gl: moderngl.Context, depth: F32, root: Path | None = None) -> None:
    found = call(gl, OPTICS, "float opacity_from_depth(float x)", depth, root=root)
    exact = depth.astype(np.float64)
    assert_within(found, opacity_from_depth(exact), _opacity_bound(exact))


def _assert_mean_opacity(gl: moderngl.Context, a: F32, b: F32, root: Path | None = None) -> None:
    found = call(gl, OPTICS, "float mean_opacity(float a, float b)", a, b, root=root)
    along, bend = a.astype(np.float64), b.astype(np.float64)
    # What is of order k: 2 k + 2 roundings at most of the same sum without signs, that of depths |a| v + |b| v².
    terms = sum(
        math.comb(k, j)
        * along ** (k - j)
        * np.abs(bend) ** j
        / (k + j + 1)
        * gamma(2 * k + 2)
        / math.factorial(k)
        for k in range(1, 6)
        for j in range(k + 1)
    )
    expected = mean_opacity(along, bend)
    assert_within(found, expected, terms + 9.1e-8 * expected + TINY)


def _assert_partial_depth(gl: moderngl.Context, x0: F32, x1: F32, u: F32, root: Path | None = None) -> None:
    found = call(gl, OPTICS, "float partial_depth(float x0, float x1, float u)", x0, x1, u, root=root)
    front, back, part = (value.astype(np.float64) for value in (x0, x1, u))
    # x1 − x0, two products (the half is exact), the sum, the product with u: 5 roundings of these terms.
    bound = gamma(5) * part * (front + 0.5 * part * np.abs(back - front)) + TINY
    assert_within(found, partial_depth(front, back, part), bound)


def _assert_panel_end(gl: moderngl.Context, x0: F32, x1: F32, u: F32, root: Path | None = None) -> None:
    found = call(gl, OPTICS, "float panel_end(float x0, float x1, float u)", x0, x1, u, root=root)
    front, back, start, end = (value.astype(np.float64) for value in (x0, x1, u, found))
    assert ((end >= start) & (end <= 1.0)).all()
    slope, width, middle = np.abs(back - front), end - start, 0.5 * (start + end)
    at_start, at_end = (front * (1.0 - part) + back * part for part in (start, end))
    depth = width * (front * (1.0 - middle) + back * middle)
    # Error in depth, not in place (the place is ill-conditioned where the extinction ends at 0). With P the
    # panel's depth: a relative error r of the step costs r width at_end <= 2 r P; r is that of the root, a
    # sum and a division. The discriminant's 3 roundings of x_u² + 2 P s cost width² / (4 P) times that, which
    # is 3 + 3 units of P. An error of x_u (3 roundings) costs that times the width; u + step is rounded once.
    depth_error = gamma(2 * (SQUARE_ROOT + 1 + DIVISION) + 6) * PANEL_DEPTH
    extinction_error = gamma(3) * (slope * start + at_start) * width
    bound = depth_error + extinction_error + gamma(1) * end * np.maximum(at_start, at_end)
    held = np.where(end < 1.0, depth, np.maximum(depth, PANEL_DEPTH))  # the last panel may hold less
    assert_within(held, np.full(held.shape, PANEL_DEPTH), bound)
    # Where the extinction does not fall, nothing cancels, and the place itself is held against the twin:
    # 3 roundings of x_u and of the discriminant, then as above.
    rising = back >= front
    expected = panel_end(front, back, start)
    step_error = gamma(6 + SQUARE_ROOT + 1 + DIVISION) * (expected - start)
    assert_within(found[rising], expected[rising], (step_error + gamma(1) * expected)[rising])


def _assert_weights(gl: moderngl.Context, x0: F32, x1: F32, root: Path | None = None) -> None:
    found = call(gl, OPTICS, "vec2 segment_weights(float x0, float x1)", x0, x1, root=root)
    front, back = x0.astype(np.float64), x1.astype(np.float64)
    expected, depth = segment_weights(front, back), 0.5 * (front + back)
    assert (found >= 0.0).all()
    assert_within(found, expected, STATED_WEIGHT_ERROR)
    # The sum of both and the difference that makes one of them: 2 roundings, and one of the depth itself.
    sums = found.astype(np.float64).sum(axis=-1)
    assert_within(sums, opacity_from_depth(depth), _opacity_bound(depth) + gamma(3))
    # Thin: one panel of width 1, behind which all is left. What is of order k has 2 k + 2 roundings and one of s: 5 of
    # (x0 + |s|) / 2 / (front weight) <= 2.5 and less of the rest (1/3, 1/10, ... of that): 13 + 4 + 1.5.
    thin = np.maximum(front, back) <= 0.5
    front_bound = (gamma(28) + 9.1e-8) * expected[thin, 0] + TINY
    assert_within(found[thin, 0], expected[thin, 0], front_bound)
    opacity_bound = (gamma(6) + 6e-10) * opacity_from_depth(depth[thin])
    assert_within(found[thin, 1], expected[thin, 1], front_bound + opacity_bound + TINY)


def _stretches() -> tuple[F32, F32]:
    ends = np.concatenate([[0.0], np.geomspace(1e-12, 1e6, 90), np.linspace(0.1, 40.0, 60)])
    pairs = np.array(list(itertools.product(ends, ends)), np.float32)
    return pairs[:, 0].copy(), pairs[:, 1].copy()


def _panel_depths() -> tuple[F32, F32]:
    """Depths a v + b v² that do not fall, and end at 1/2 at most."""
    end = np.concatenate([np.geomspace(1e-20, PANEL_DEPTH, 60), np.linspace(0.0, PANEL_DEPTH, 60)])
    shape = np.linspace(0.0, 2.0, 61)  # part of the depth that runs linearly; above 1 the extinction falls
    linear, bend = end[:, None] * shape, end[:, None] * (1.0 - shape)
    return linear.ravel().astype(np.float32), bend.ravel().astype(np.float32)


def _panels() -> tuple[F32, F32, F32]:
    x0, x1 = (np.tile(part, 2) for part in _stretches())
    return x0, x1, np.random.default_rng(5).random(x0.size, dtype=np.float32)


def test_opacity_keeps_its_stated_error(gl: moderngl.Context) -> None:
    depths = np.concatenate([[0.0], np.geomspace(1e-30, 1e6, 20_000), np.linspace(0.0, 40.0, 40_000)])
    _assert_opacity(gl, depths.astype(np.float32))


def test_stated_bounds_of_opacity_hold_the_specified_exp() -> None:
    # The comment's 3.2e-7 and 7e-7 follow from the specified error of exp, for every depth of 1/2 and more.
    depths = np.linspace(0.5, 40.0, 100_001)
    bound = _opacity_bound(depths)
    assert bound.max() <= 3.2e-7
    assert (bound / opacity_from_depth(depths)).max() <= 7e-7


def test_opacity_is_exact_at_zero_and_for_opaque_paths(gl: moderngl.Context) -> None:
    depths = np.array([0.0, 1e-20, 100.0, 1e30], np.float32)
    found = call(gl, OPTICS, "float opacity_from_depth(float x)", depths)
    assert found.tolist() == [0.0, float(depths[1]), 1.0, 1.0]


@settings(max_examples=20)
@given(depth=columns(0, 0.0, 64.0))
def test_opacity_agrees_for_any_depth(gl: moderngl.Context, depth: F32) -> None:
    _assert_opacity(gl, depth)


def test_mean_opacity_keeps_its_stated_error(gl: moderngl.Context) -> None:
    _assert_mean_opacity(gl, *_panel_depths())


def test_partial_depth_agrees_with_its_twin(gl: moderngl.Context) -> None:
    _assert_partial_depth(gl, *_panels())


def test_panels_hold_their_depth(gl: moderngl.Context) -> None:
    _assert_panel_end(gl, *_panels())


@settings(max_examples=20)
@given(x0=columns(0, 0.0, 1e6), x1=columns(0, 0.0, 1e6), u=columns(0, 0.0, 1.0))
def test_panels_and_depths_agree_for_any_stretch(gl: moderngl.Context, x0: F32, x1: F32, u: F32) -> None:
    _assert_partial_depth(gl, x0, x1, u)
    _assert_panel_end(gl, x0, x1, u)


def test_segment_weights_keep_their_stated_error_from_clear_to_opaque(gl: moderngl.Context) -> None:
    _assert_weights(gl, *_stretches())


def test_segment_weights_have_their_limits(gl: moderngl.Context) -> None:
    x0 = np.array([0.0, 1e30, 1e30, 3e38], np.float32)
    x1 = np.array([0.0, 0.0, 1e30, 3e38], np.float32)
    found = call(gl, OPTICS, "vec2 segment_weights(float x0, float x1)", x0, x1)
    assert found.tolist() == [[0.0, 0.0], [1.0, 0.0], [1.0, 0.0], [1.0, 0.0]]


@settings(max_examples=20)
@given(x0=columns(0, 0.0, 1e6), x1=columns(0, 0.0, 1e6))
def test_segment_weights_agree_for_any_stretch(gl: moderngl.Context, x0: F32, x1: F32) -> None:
    _assert_weights(gl, x0, x1)


@pytest.mark.parametrize(
    ("right", "wrong", "check", "arguments"),
    [
        ("(1.0 / 4.0)", "(1.0 / 4.01)", _assert_opacity, lambda: (np.linspace(0, 1, 500, dtype=np.float32),)),
        ("(x0 + 0.5 * u *", "(x0 + 0.50001 * u *", _assert_partial_depth, _panels),
        ("step_u = 2.0 *", "step_u = 2.0001 *", _assert_panel_end, _panels),
        ("10.0 * c4 / 9.0", "10.0 * c4 / 8.0", _assert_mean_opacity, _panel_depths),
        ("c2 = 0.1665636", "c2 = 0.1666636", _assert_mean_opacity, _panel_depths),
        ("PANEL_TRANSMITTANCE = 0.6065", "PANEL_TRANSMITTANCE = 0.6066", _assert_weights, _stretches),
        ("LEAST_LEFT = 1.9e-8", "LEAST_LEFT = 1.9e-4", _assert_weights, _stretches),
    ],
)
def test_wrong_constant_is_told(
    gl: moderngl.Context,
    tmp_path: Path,
    right: str,
    wrong: str,
    check: Callable[..., None],
    arguments: Callable[[], tuple[F32, ...]],
) -> None:
    root = wrong_shader(tmp_path, OPTICS, right, wrong)
    with pytest.raises(AssertionError, match="beyond its bound"):
        check(gl, *arguments(), root)

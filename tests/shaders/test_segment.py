"""Shader cubics, limiters and emission integrals agree with their float64 twins within their roundings."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from isosample.gl.shader_source import shader_root
from isosample.integral import segment
from shaders.harness import call
from shaders.twins import DIVISION, SQUARE_ROOT, TINY, assert_within, gamma, wrong_shader

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    import moderngl

    from isosample.volume.grid import F64
    from shaders.twins import F32

SEGMENT = "lib/segment.glsl"
COUNT = 4000
OPTICS = '#include "lib/optics.glsl"\n'


def exact(function: Callable[..., Any], *columns: F32) -> F64:
    """Rows of a scalar float64 function."""
    rows = zip(*(column.astype(np.float64).tolist() for column in columns), strict=True)
    return np.array([function(*row) for row in rows], dtype=np.float64)


def uniform(rng: np.random.Generator, low: float, high: float) -> F32:
    return rng.uniform(low, high, COUNT).astype(np.float32)


def ends(rng: np.random.Generator) -> tuple[F32, F32]:
    return tuple(rng.integers(0, 2, COUNT).astype(np.float32) for _ in range(2))  # type: ignore[return-value]


def pairs(a: F32, b: F32) -> F32:
    return np.stack([a, b], axis=1)


def curve_bound(front: F32, back: F32, a: F32, b: F32, u: F32) -> F64:
    """9 roundings on the longest path (rise, cube, and three products and sums of Horner's scheme) of all terms."""
    f, k, a, b, u = (np.abs(column.astype(np.float64)) for column in (front, back, a, b, u))
    rise = f + k
    terms = f + u * (a + u * (3.0 * rise + 2.0 * a + b + u * (a + b + 2.0 * rise)))
    return gamma(9) * terms + TINY


def assert_curve(gl: moderngl.Context, root: Path | None = None) -> None:
    rng = np.random.default_rng(1)
    front, back, u = (uniform(rng, 0.0, 1.0) for _ in range(3))
    a, b = (uniform(rng, -8.0, 8.0) for _ in range(2))
    columns = (front, back, pairs(a, b), u)
    bound = curve_bound(front, back, a, b, u)
    for name in ("segment_curve", "segment_position"):
        signature = f"float {name}(float front, float back, vec2 slopes, float u)"
        found = call(gl, SEGMENT, signature, *columns, root=root, prelude=OPTICS)
        assert_within(found, exact(getattr(segment, name), front, back, a, b, u), bound)


def assert_bump(gl: moderngl.Context, root: Path | None = None) -> None:
    rng = np.random.default_rng(2)
    a, b = (np.exp(rng.uniform(-8.0, 8.0, COUNT)).astype(np.float32) for _ in range(2))
    a[:50], b[25:75] = 0.0, 0.0
    found = call(gl, SEGMENT, "float bump_height(float a, float b)", a, b, root=root, prelude=OPTICS)
    # At a maximum an error of its place counts squared; a division and 6 roundings of the product itself.
    height = exact(segment.bump_height, a, b)
    assert_within(found, height, gamma(7 + DIVISION) * height + TINY)


def overshoot_bound(a: F32, b: F32) -> F64:
    """As `curve_bound` with u <= 1, and a subtraction; at an extremum an error of its place counts squared."""
    slope = a.astype(np.float64) + b.astype(np.float64)
    return gamma(10) * (3.0 * slope + 6.0)


def assert_overshoot(gl: moderngl.Context, root: Path | None = None) -> None:
    rng = np.random.default_rng(3)
    a, b = (uniform(rng, 0.0, 12.0) for _ in range(2))
    found = call(gl, SEGMENT, "float overshoot(float a, float b)", a, b, root=root, prelude=OPTICS)
    expected = exact(segment.overshoot, a, b)
    assert (expected > 0.02).sum() > COUNT / 10
    assert_within(found, expected, overshoot_bound(a, b))


def assert_limited(gl: moderngl.Context, root: Path | None = None) -> None:
    rng = np.random.default_rng(4)
    front, back = ends(rng)
    a, b = (uniform(rng, 0.0, 12.0) for _ in range(2))
    first = np.where(front == 0.0, a, -a).astype(np.float32)
    last = np.where(back == 1.0, b, -b).astype(np.float32)
    signature = "vec2 limit_slopes(float front, float back, vec2 slopes)"
    found = call(gl, SEGMENT, signature, front, back, pairs(first, last), root=root, prelude=OPTICS)
    expected = exact(segment.limit_slopes, front, back, first, last)
    # A bump's factor has its height's 12 roundings and a division; between isovalues an error of the overshoot sets
    # the limiter in by 1 / LEAVES_FAR times as much, and the length has a root and three roundings.
    factor = gamma(8 + 3 * DIVISION + SQUARE_ROOT) + overshoot_bound(a, b) / segment.LEAVES_FAR
    assert_within(found, expected, factor[:, None] * np.abs(pairs(first, last)) + TINY)


def assert_depth(gl: moderngl.Context, root: Path | None = None) -> None:
    rng = np.random.default_rng(6)
    front, back, low, high = (uniform(rng, 0.0, 1.0) for _ in range(4))
    a, b = (uniform(rng, -3.0, 3.0) for _ in range(2))
    signature = "float largest_depth(vec2 depths, float front, float back, vec2 slopes)"
    found = call(
        gl, SEGMENT, signature, pairs(low, high), front, back, pairs(a, b), root=root, prelude=OPTICS
    )
    # A division and a sum place a coefficient of at most 2 before it is clamped; mixing depths of at most 1 has 3 more.
    assert_within(
        found, exact(segment.largest_depth, low, high, front, back, a, b), gamma(DIVISION + 4) * 3.0
    )


def moment_cases() -> tuple[F32, ...]:
    """Clear to opaque segments, whole and cut, whose number of panels does not hang on a rounding."""
    rng = np.random.default_rng(5)
    front, back = ends(rng)
    low, high = (np.exp(rng.uniform(-6.0, 5.0, COUNT)).astype(np.float32) for _ in range(2))
    low[::5] = 0.0
    start = np.where(rng.random(COUNT) < 0.5, 0.0, rng.uniform(0.0, 0.9, COUNT)).astype(np.float32)
    end = np.where(rng.random(COUNT) < 0.5, 1.0, rng.uniform(start, 1.0)).astype(np.float32)
    slopes = [rng.uniform(0.0, 3.0, COUNT).astype(np.float32) for _ in range(2)]
    a = np.where(front == 0.0, slopes[0], -slopes[0]).astype(np.float32)
    b = np.where(back == 1.0, slopes[1], -slopes[1]).astype(np.float32)
    reached = exact(segment.largest_depth, low, high, front, back, a, b)
    panels = reached * (end - start) / segment.PANEL_DEPTH
    kept = np.abs(panels - np.rint(panels)) > 1e-5 * (1.0 + panels)
    return tuple(column[kept] for column in (low, high, front, back, a, b, start, end))


def assert_moments(gl: moderngl.Context, root: Path | None = None) -> None:
    """Of whole integrals, and with them of `segment_panel`, whose nodes nothing else shows."""
    cases = moment_cases()
    low, high, front, back, a, b, start, end = cases
    signature = "vec4 cubic_moments(vec2 depths, float front, float back, vec2 slopes, vec2 part)"
    columns = (pairs(low, high), front, back, pairs(a, b), pairs(start, end))
    found = call(gl, SEGMENT, signature, *columns, root=root, prelude=OPTICS)
    expected = exact(segment.cubic_moments, *cases)
    thickness = np.maximum(low, high).astype(np.float64) * (end.astype(np.float64) - start)
    # An error d of the depth anywhere changes a moment by 2 d exp(-D) at most, and the normalisation of three nodes
    # by as much again. d is the thickness times that of the position (slopes <= 3, curve_bound) and 8 roundings. The
    # exponential and the opacity (7e-7, optics.glsl) come in each panel with the transmittance before it, so once; the
    # sums of 24 panels have 24 roundings; and 2^-24 is left out at the end.
    position = float(curve_bound(*(np.full(1, v, dtype=np.float32) for v in (1.0, 0.0, 3.0, 3.0, 1.0)))[0])
    bound = 4.0 * thickness * (position + gamma(8)) + 7e-7 + gamma(32) + 2.0**-24
    assert_within(found, expected, np.minimum(bound, 2e-4)[:, None])


CHECKS = {
    "curve": assert_curve,
    "bump": assert_bump,
    "overshoot": assert_overshoot,
    "limiter": assert_limited,
    "depth": assert_depth,
    "moments": assert_moments,
}


@pytest.mark.parametrize("check", CHECKS)
def test_the_shader_does_what_its_twin_does(gl: moderngl.Context, check: str) -> None:
    CHECKS[check](gl)


def test_panels_end_where_the_twin_s_end(gl: moderngl.Context) -> None:
    thickness = np.array([0.0, 0.5, 2.5, 30.0, 47.0, 49.0, 1e4], dtype=np.float32)
    front = np.zeros(len(thickness), dtype=np.float32)
    for back in (front, front + 1):
        signature = "int panel_count(float front, float back, float thickness)"
        found = call(gl, SEGMENT, signature, front, back.astype(np.float32), thickness, prelude=OPTICS)
        assert found.tolist() == exact(segment.panel_count, front, back, thickness).tolist()
    numbers = np.arange(25, dtype=np.int32)
    for thick in (1.0, 100.0):
        signature = "float panel_edge(int number, int count, float thickness)"
        found = call(gl, SEGMENT, signature, numbers, 24, thick, prelude=OPTICS)
        expected = np.array([segment.panel_edge(int(n), 24, thick) for n in numbers])
        assert_within(found, expected, gamma(2 * DIVISION + 1) * expected + TINY)
        assert found[-1] == 1.0


@pytest.mark.parametrize(
    ("check", "right", "wrong"),
    [
        ("curve", "2.0 * slopes.x - slopes.y", "2.0 * slopes.x + slopes.y"),
        ("bump", "2.0 - share + sqrt", "2.0 + share + sqrt"),
        ("overshoot", "3.0 * (a + b - 2.0)", "2.0 * (a + b - 2.0)"),
        ("limiter", "3.0 / max(length(size), 3.0)", "2.9 / max(length(size), 3.0)"),
        ("depth", "back - slopes.y / 3.0", "back + slopes.y / 3.0"),
        ("moments", "-0.035976667524938911", "0.035976667524938911"),
        ("moments", "panel.parts * panel.positions", "panel.parts * panel.parts"),
        ("moments", "through *= 1.0 - panel.opacity", "through *= 1.0 - 0.999 * panel.opacity"),
    ],
)
def test_a_wrong_shader_is_found(
    gl: moderngl.Context, tmp_path: Path, check: str, right: str, wrong: str
) -> None:
    root = wrong_shader(tmp_path, SEGMENT, right, wrong)
    (root / "lib" / "optics.glsl").write_bytes((shader_root() / "lib" / "optics.glsl").read_bytes())
    with pytest.raises(AssertionError):
        CHECKS[check](gl, root)


def test_huge_slopes_stay_finite(gl: moderngl.Context) -> None:
    slopes = np.array([[1e30, -1e30], [3e38, -1.0], [1e-30, -1e-30]], dtype=np.float32)
    ends = np.zeros(3, dtype=np.float32)
    signature = "vec2 limit_slopes(float front, float back, vec2 slopes)"
    for back in (ends, ends + 1):
        found = call(gl, SEGMENT, signature, ends, back, slopes, prelude=OPTICS)
        assert np.isfinite(found).all()
    assert math.isclose(float(found[2, 0]), 1e-30, rel_tol=1e-5)

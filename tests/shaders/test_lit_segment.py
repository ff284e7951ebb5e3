"""Shader integrals over lit segments agree with their float64 twin within their roundings."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from isosample.gl.shader_source import shader_root
from isosample.integral.lit_segment import LEAST_COSINE, crossing_gradient, lit_moments
from shaders.harness import call
from shaders.test_segment import moment_cases, pairs
from shaders.twins import DIVISION, SQUARE_ROOT, TINY, UNIT, assert_within, gamma, wrong_shader

if TYPE_CHECKING:
    from pathlib import Path

    import moderngl

    from shaders.twins import F32

LIT = "lib/lit_segment.glsl"
PRELUDE = '#include "lib/optics.glsl"\n#include "lib/segment.glsl"\n#include "lib/shading.glsl"\n'
COUNT = 1500
MATERIAL = np.array([0.25, 0.75, 0.25, 16.0], dtype=np.float32)


def unit_vectors(rng: np.random.Generator, count: int) -> F32:
    vectors = rng.normal(size=(count, 3))
    found: F32 = (vectors / np.linalg.norm(vectors, axis=1, keepdims=True)).astype(np.float32)
    return found


def assert_moments(gl: moderngl.Context, root: Path | None = None) -> None:
    cases = [column[:COUNT] for column in moment_cases()]
    low, high, front, back, a, b, start, end = cases
    rng = np.random.default_rng(11)
    count = len(low)
    gradients = [
        unit_vectors(rng, count) * rng.uniform(0.5, 2.0, (count, 1)).astype(np.float32) for _ in range(2)
    ]
    direction = unit_vectors(rng, count)
    signature = (
        "vec4 lit_moments(vec2 depths, float front, float back, vec2 slopes, vec2 part, vec3 front_gradient, "
        "vec3 back_gradient, vec3 direction, vec4 material)"
    )
    columns = (pairs(low, high), front, back, pairs(a, b), pairs(start, end), *gradients, direction, MATERIAL)
    found = call(gl, LIT, signature, *columns, root=root, prelude=PRELUDE)
    exact = [column.astype(np.float64) for column in columns[:-1]]
    ends = np.stack(exact[1:3], axis=1)
    rows: Any = zip(exact[0], ends, *exact[3:5], zip(*exact[5:7], strict=True), exact[7], strict=True)
    material = MATERIAL.astype(np.float64)
    expected = np.array([lit_moments(d, e, s, p, g, v, material) for d, e, s, p, g, v in rows])
    parts = np.linspace(0.0, 1.0, 33)[:, None, None]
    mixed = (1.0 - parts) * exact[5] + parts * exact[6]
    kept = np.linalg.norm(mixed, axis=2).min(axis=0) > 0.2
    # The moments without light err by 2e-4 at most (test_segment.py), and so do they when their terms are multiplied by
    # a light of at most 1. The light adds its own error. Mixing gradients of at most 2 down to 0.2 rounds a normal by
    # gamma(4) 2 / 0.2, and a node that is off by gamma(12) moves the mixture by 4 of that; its length has three
    # products, a root and a division, the cosine three products. A highlight is a power of 16: so often the
    # cosine's error, and that of pow, 16 ln 2 2^-21 for cosines from 1/2, below which it is less than 2^-16.
    cosine = gamma(16) * 4.0 / 0.2 + gamma(8 + SQUARE_ROOT + DIVISION)
    light = 0.75 * cosine + 0.25 * (16.0 * cosine + 16.0 * 2.0**-21 + 8.0 * UNIT)
    assert kept.mean() > 0.8
    assert_within(found[kept], expected[kept], 2e-4 + 2.0 * light)


def assert_gradient(gl: moderngl.Context, root: Path | None = None) -> None:
    rng = np.random.default_rng(12)
    normal, direction = unit_vectors(rng, COUNT), unit_vectors(rng, COUNT)
    slope = rng.uniform(-4.0, 4.0, COUNT).astype(np.float32)
    signature = "vec3 crossing_gradient(vec3 normal, float slope, vec3 direction)"
    found = call(gl, LIT, signature, normal, slope, direction, root=root, prelude=PRELUDE)
    exact = [column.astype(np.float64) for column in (normal, slope, direction)]
    expected = np.array([crossing_gradient(n, float(s), d) for n, s, d in zip(*exact, strict=True)])
    # A cosine of at least LEAST_COSINE has three products of terms that sum to 1.8 at most; a division, a product.
    assert_within(
        found, expected, (gamma(3) * 1.8 / LEAST_COSINE + gamma(DIVISION + 1)) * np.abs(expected) + TINY
    )


CHECKS = {"moments": assert_moments, "gradient": assert_gradient}


@pytest.mark.parametrize("check", CHECKS)
def test_the_shader_does_what_its_twin_does(gl: moderngl.Context, check: str) -> None:
    CHECKS[check](gl)


@pytest.mark.parametrize(
    ("check", "right", "wrong"),
    [
        ("moments", "mix(front_gradient, back_gradient", "mix(back_gradient, front_gradient"),
        ("moments", "dot(panel.emitted, highlight)", "dot(panel.emitted, shade)"),
        ("moments", "through *= 1.0 - panel.opacity", "through *= 1.0 - 0.99 * panel.opacity"),
        ("gradient", "LEAST_COSINE = 0.02", "LEAST_COSINE = 0.2"),
    ],
)
def test_a_wrong_shader_is_found(
    gl: moderngl.Context, tmp_path: Path, check: str, right: str, wrong: str
) -> None:
    root = wrong_shader(tmp_path, LIT, right, wrong)
    for name in ("optics", "segment", "shading"):
        (root / "lib" / f"{name}.glsl").write_bytes((shader_root() / "lib" / f"{name}.glsl").read_bytes())
    with pytest.raises(AssertionError):
        CHECKS[check](gl, root)

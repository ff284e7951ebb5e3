"""Shader trilinear interpolation and slopes of samples agree with float64 within their roundings."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from isosample.integral.trilinear import sample_slopes, trilinear
from shaders.harness import call
from shaders.twins import DIVISION, assert_within, gamma, wrong_shader

if TYPE_CHECKING:
    from pathlib import Path

    import moderngl


TRILINEAR = "lib/trilinear.glsl"
COUNT = 1000
LIMIT = 1e20


def assert_value(gl: moderngl.Context, root: Path | None = None) -> None:
    rng = np.random.default_rng(1)
    low, high = (rng.uniform(-1.0, 1.0, (COUNT, 4)).astype(np.float32) for _ in range(2))
    fraction = rng.uniform(-1.0, 2.0, (COUNT, 3)).astype(np.float32)  # beyond the cell too
    fraction[::2] = np.abs(fraction[::2]) / 2.0
    found = call(
        gl, TRILINEAR, "float trilinear(vec4 low, vec4 high, vec3 fraction)", low, high, fraction, root=root
    )
    # Every axis: 1 − f, a product, a sum; samples of at most 1, weights of |1 − f| + |f|.
    wide = fraction.astype(np.float64)
    weights = np.prod(np.abs(1.0 - wide) + np.abs(wide), axis=-1)
    assert_within(found, trilinear(low, high, fraction), gamma(9) * weights)


def assert_slopes(gl: moderngl.Context, root: Path | None = None) -> None:
    behind, here, ahead = np.random.default_rng(2).uniform(-1.0, 1.0, (3, COUNT, 4)).astype(np.float32)
    behind[::3], ahead[::5] = 1e38, 1e38
    signature = "vec4 sample_slopes(vec4 behind, vec4 here, vec4 ahead, float limit)"
    found = call(gl, TRILINEAR, signature, behind, here, ahead, np.float32(LIMIT), root=root)
    # A difference of at most 2, divided by 1 or 2.
    assert_within(found, sample_slopes(behind, here, ahead, LIMIT), gamma(1 + DIVISION) * 2.0)


CHECKS = {"trilinear": assert_value, "sample_slopes": assert_slopes}


@pytest.mark.parametrize("check", CHECKS)
def test_the_shader_does_what_its_twin_does(gl: moderngl.Context, check: str) -> None:
    CHECKS[check](gl)


@pytest.mark.parametrize(
    ("check", "right", "wrong"),
    [
        ("trilinear", "between.xy, between.zw", "between.xz, between.yw"),
        ("sample_slopes", "vec4(2.0) - vec4(no_back)", "vec4(2.0)"),
    ],
)
def test_a_wrong_shader_is_found(
    gl: moderngl.Context, tmp_path: Path, check: str, right: str, wrong: str
) -> None:
    with pytest.raises(AssertionError):
        CHECKS[check](gl, wrong_shader(tmp_path, TRILINEAR, right, wrong))


def test_interpolation_meets_the_samples() -> None:
    """Samples x + 10 y + 100 z: the corner named by the fraction, and the linear field between and beyond."""
    low, high = np.array([0.0, 1.0, 10.0, 11.0]), np.array([100.0, 101.0, 110.0, 111.0])
    places = np.array(
        [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 1], [0.5, 0.25, 0.75], [-1, 2, 0.5]]
    )
    assert np.array_equal(trilinear(low, high, places), places @ [1.0, 10.0, 100.0])


def test_slopes_are_one_sided_beside_what_is_not_there() -> None:
    """Of a parabola 1, 4, 9: 4 in the middle, 3 behind, 5 ahead, and 0 without neighbours."""
    none = 2.0 * LIMIT
    found = sample_slopes([1.0, 1.0, none, none], [4.0] * 4, [9.0, none, 9.0, none], LIMIT)
    assert np.array_equal(found, [4.0, 3.0, 5.0, 0.0])

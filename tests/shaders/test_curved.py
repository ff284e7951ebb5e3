"""Shader shifts from triangles to curved surfaces agree with float64 within their roundings."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from isosample.integral.curved import curved_error, curved_shift
from shaders.harness import call
from shaders.twins import DIVISION, TINY, assert_within, gamma, wrong_shader

if TYPE_CHECKING:
    from pathlib import Path

    import moderngl

CURVED = "lib/curved.glsl"
COUNT = 2000


def assert_error(gl: moderngl.Context, root: Path | None = None) -> None:
    rng = np.random.default_rng(1)
    gradient, position = (rng.normal(size=(COUNT, 3)).astype(np.float32) for _ in range(2))
    moment = rng.normal(size=COUNT).astype(np.float32)
    signature = "float curved_error(vec3 gradient, vec3 position, float moment)"
    found = call(gl, CURVED, signature, gradient, position, moment, root=root)
    # A product, two sums and the difference: 4 roundings of all terms; the half is exact.
    terms = np.abs(gradient.astype(np.float64) * position).sum(axis=1) + np.abs(moment)
    assert_within(found, curved_error(gradient, position, moment), 0.5 * gamma(4) * terms + TINY)


def assert_shift(gl: moderngl.Context, root: Path | None = None) -> None:
    rng = np.random.default_rng(2)
    error, along = (rng.normal(size=COUNT).astype(np.float32) for _ in range(2))
    steepness = (np.abs(along) * rng.uniform(1.0, 20.0, COUNT)).astype(np.float32)
    limit = rng.uniform(0.01, 2.0, COUNT).astype(np.float32)
    rising = rng.integers(0, 2, COUNT).astype(bool)
    signature = "float curved_shift(float error, float along, float steepness, float limit, bool rising)"
    found = call(gl, CURVED, signature, error, along, steepness, limit, rising, root=root)
    shift = curved_shift(error, along, steepness, limit, rising)
    # The constant 0.15 and its product, and a division.
    assert_within(found, shift, gamma(2 + DIVISION) * np.abs(shift) + TINY)


CHECKS = {"curved_error": assert_error, "curved_shift": assert_shift}


@pytest.mark.parametrize("check", CHECKS)
def test_the_shader_does_what_its_twin_does(gl: moderngl.Context, check: str) -> None:
    CHECKS[check](gl)


@pytest.mark.parametrize(
    ("check", "right", "wrong"),
    [
        ("curved_error", "0.5 * (dot", "0.501 * (dot"),
        ("curved_shift", "incline > 0.0", "incline < 9.0"),
        ("curved_shift", "LEAST_INCLINE * steepness", "0.1 * steepness"),
    ],
)
def test_a_wrong_shader_is_found(
    gl: moderngl.Context, tmp_path: Path, check: str, right: str, wrong: str
) -> None:
    with pytest.raises(AssertionError):
        CHECKS[check](gl, wrong_shader(tmp_path, CURVED, right, wrong))

"""Shader shading agrees with float64 within the specified errors of pow and its own roundings."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
import pytest
from hypothesis import given, settings

from isosample.integral.shading import blinn_phong
from shaders.harness import call
from shaders.twins import TINY, UNIT, assert_within, columns, gamma, wrong_shader

if TYPE_CHECKING:
    from pathlib import Path

    import moderngl

    from isosample.volume.grid import F64
    from shaders.twins import F32

SHADING = "lib/shading.glsl"
SIGNATURE = "vec3 blinn_phong(vec3 straight, vec3 normal, vec3 direction, vec4 material)"


def _highlight_bound(cosine: F64, cosine_error: F64, shininess: F64) -> F64:
    """Error of pow(cosine, shininess): exp2(y log2(x)) of the specification, section 4.7.1, for inexact x."""
    low, high = np.maximum(cosine - cosine_error, 0.0), np.minimum(cosine + cosine_error, 1.0)
    powers = [np.where(end > 0.0, end**shininess, 0.0) for end in (low, cosine, high)]
    logarithm = np.abs(np.log2(np.maximum(cosine, TINY)))
    # log2 errs by 2^-21 for x in [1/2, 2], else by 3 ulp <= 6 units; y log2(x) is rounded; exp2 errs by
    # 3 + 2 |x| ulp.
    log_error = np.where(cosine >= 0.5, 2.0**-21, 6.0 * UNIT * logarithm)
    exponent = shininess * logarithm
    relative = math.log(2.0) * (shininess * log_error + UNIT * exponent) + 2.0 * UNIT * (3.0 + 2.0 * exponent)
    input_error = np.maximum(powers[2] - powers[1], powers[1] - powers[0])
    bound: F64 = input_error + np.expm1(np.minimum(relative, 1.0)) * powers[2] + TINY
    return bound


def _assert_lit(
    gl: moderngl.Context, straight: F32, normal: F32, direction: F32, material: F32, root: Path | None = None
) -> None:
    found = call(gl, SHADING, SIGNATURE, straight, normal, direction, material, root=root)
    given = [part.astype(np.float64) for part in (straight, normal, direction, material)]
    colour, facing, factors = given[0], given[1] * given[2], given[3]
    diffuse, specular, shininess = (factors[:, i : i + 1] for i in range(1, 4))
    cosine = np.minimum(np.abs(facing.sum(axis=-1, keepdims=True)), 1.0)
    cosine_error = gamma(3) * np.abs(facing).sum(axis=-1, keepdims=True) + TINY
    highlight = _highlight_bound(cosine, cosine_error, shininess)
    expected = blinn_phong(*given)
    # diffuse · cosine, + ambient, · colour, specular · highlight, and the last sum: 5 roundings.
    bound = gamma(5) * expected + colour * diffuse * cosine_error + specular * highlight + TINY
    assert_within(found, expected, bound)


def _scene(count: int) -> tuple[F32, F32, F32, F32]:
    random = np.random.default_rng(9)
    colour = random.random((count, 3), dtype=np.float32)
    normal, direction = random.normal(size=(2, count, 3))
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    direction /= np.linalg.norm(direction, axis=-1, keepdims=True)
    material = random.random((count, 4))
    material[:, 3] = 10.0 ** random.uniform(-1, 3, count)
    return colour, normal.astype(np.float32), direction.astype(np.float32), material.astype(np.float32)


def test_shading_agrees_with_its_twin(gl: moderngl.Context) -> None:
    _assert_lit(gl, *_scene(20_000))


def test_edge_on_surface_has_no_highlight_and_facing_one_has_all(gl: moderngl.Context) -> None:
    colour = np.full((3, 3), 0.5, np.float32)
    normal = np.array([[1, 0, 0], [0, 0, 1], [0, 0, -1]], np.float32)
    direction, material = np.array([0, 0, 1], np.float32), np.array([0.25, 0.5, 0.25, 0], np.float32)
    found = call(gl, SHADING, SIGNATURE, colour, normal, direction, material)
    assert found[:, 0].tolist() == [0.125, 0.625, 0.625]


@settings(max_examples=20)
@given(
    straight=columns(3, 0.0, 1.0),
    normal=columns(3, -1.0, 1.0),
    direction=columns(3, -1.0, 1.0),
    material=columns(4, 0.0, 1.0),
    shininess=columns(0, 0.0, 512.0),
)
def test_shading_agrees_for_any_material(
    gl: moderngl.Context, straight: F32, normal: F32, direction: F32, material: F32, shininess: F32
) -> None:
    material[:, 3] = shininess
    _assert_lit(gl, straight, normal, direction, material)


@pytest.mark.parametrize(
    ("right", "wrong"),
    [
        ("material.y * cosine", "0.9999 * material.y * cosine"),
        ("pow(cosine, material.w)", "pow(cosine, 1.001 * material.w)"),
    ],
)
def test_wrong_constant_is_told(gl: moderngl.Context, tmp_path: Path, right: str, wrong: str) -> None:
    root = wrong_shader(tmp_path, SHADING, right, wrong)
    with pytest.raises(AssertionError, match="beyond its bound"):
        _assert_lit(gl, *_scene(200), root)

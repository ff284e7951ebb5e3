"""Sample distances, their inverse, ray differentials and pixel noise of the shaders agree with float64."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
from hypothesis import given, settings

from isosample.integral.sampling import direction_differential, pixel_noise, sample_distance, sample_number
from shaders.harness import call
from shaders.twins import DIVISION, SQUARE_ROOT, TINY, assert_within, columns, gamma, wrong_shader

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    import moderngl

    from shaders.twins import F32

SAMPLING = "lib/sampling.glsl"
INVERSE_ROOT = 4  # roundings of inversesqrt(): 2 ulp

positive = columns(3, 2.0**-20, 2.0**20)


def _assert_distance(gl: moderngl.Context, rows: F32, root: Path | None = None) -> None:
    signature = "float sample_distance(float first, float growth, float number)"
    found = call(gl, SAMPLING, signature, *rows.T, root=root)
    expected = sample_distance(*rows.T.astype(np.float64))
    # 0.5 growth is exact; its product with the number, the sum, the product: of positive numbers.
    assert_within(found, expected, gamma(3) * expected)


def _assert_number(gl: moderngl.Context, rows: F32, root: Path | None = None) -> None:
    signature = "float sample_number(float first, float growth, float distance)"
    found = call(gl, SAMPLING, signature, *rows.T, root=root)
    expected = sample_number(*rows.T.astype(np.float64))
    # Two products and a sum of positive numbers (the root halves their error), the root, a sum, the quotient.
    assert_within(found, expected, gamma(1 + SQUARE_ROOT + 1 + DIVISION) * expected)


def _assert_differential(gl: moderngl.Context, rows: F32, root: Path | None = None) -> None:
    direction, right = rows[:, :3] + np.array([0.0, 0.0, 3.0], np.float32), rows[:, 3:]
    signature = "float direction_differential(vec3 direction, vec3 right)"
    found = call(gl, SAMPLING, signature, direction, right, root=root)
    d, u = direction.astype(np.float64), right.astype(np.float64)
    expected = direction_differential(d, u)
    # u - (u.d / d.d) d: two dot products (3 each), quotient, product, difference, of vectors no longer than |u|;
    # then a length (dot 3, root), 1/|d| (half of a dot's 3, inverse root) and a product.
    across = 2.0 * gamma(3 + 3 + DIVISION + 2) * np.linalg.norm(u, axis=1) / np.linalg.norm(d, axis=1)
    along = gamma(3 + SQUARE_ROOT + 3 + INVERSE_ROOT + 1) * expected
    assert_within(found, expected, across + along + TINY)


def _assert_noise(gl: moderngl.Context, rows: F32, root: Path | None = None) -> None:
    whole = rows.astype(np.uint32)
    found = call(
        gl, SAMPLING, "float pixel_noise(uvec2 pixel, uint seed)", whole[:, :2], whole[:, 2], root=root
    )
    assert_within(found, pixel_noise(whole[:, :2], whole[:, 2]), 0.0)  # whole numbers below 2^24, times 2^-24


@settings(deadline=None)
@given(rows=positive)
def test_distances_and_numbers_of_samples_agree_with_float64(gl: moderngl.Context, rows: F32) -> None:
    _assert_distance(gl, rows)
    _assert_number(gl, rows)


@settings(deadline=None)
@given(rows=columns(6, -1.0, 1.0))
def test_ray_differentials_agree_with_float64(gl: moderngl.Context, rows: F32) -> None:
    _assert_differential(gl, rows)


@settings(deadline=None)
@given(rows=columns(3, 0.0, 2.0**24))
def test_noise_is_the_same_number(gl: moderngl.Context, rows: F32) -> None:
    _assert_noise(gl, rows)


def test_a_number_leads_back_to_its_distance() -> None:
    number = np.arange(1.0, 2000.0)
    for growth in (0.0, 1e-6, 0.3):
        distance = sample_distance(0.01, growth, number)
        assert np.allclose(sample_number(0.01, growth, distance), number, rtol=1e-12, atol=0.0)


def test_the_differential_is_the_derivative_of_the_unit_direction() -> None:
    generator = np.random.default_rng(3)
    direction, right = generator.normal(size=(2, 50, 3))
    step = 1e-6

    def unit(x: float) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
        moved = direction + x * right
        return np.asarray(moved / np.linalg.norm(moved, axis=1, keepdims=True))

    # Central difference: truncation of order step^2 |D'''|, rounding 2^-53 / step.
    numeric = np.linalg.norm(unit(step) - unit(-step), axis=1) / (2.0 * step)
    scale = (np.linalg.norm(right, axis=1) / np.linalg.norm(direction, axis=1)) ** 3
    assert (np.abs(direction_differential(direction, right) - numeric) <= 1e-9 + 30.0 * step**2 * scale).all()


def test_noise_is_even_over_pixels_and_seeds() -> None:
    pixels = np.stack(np.meshgrid(np.arange(64), np.arange(64)), axis=-1).reshape(-1, 2)
    first, second = pixel_noise(pixels, 1), pixel_noise(pixels, 2)
    # Mean of 4096 even numbers: standard deviation 1 / sqrt(12 * 4096) = 0.0045; 5 of them.
    assert abs(first.mean() - 0.5) < 0.0225
    assert abs(np.corrcoef(first, second)[0, 1]) < 5.0 / 64.0
    assert abs(np.corrcoef(first[:-1], first[1:])[0, 1]) < 5.0 / 64.0


WRONG: list[tuple[Callable[..., None], int, str, str]] = [
    (_assert_distance, 3, "0.5 * growth * number", "growth * number"),
    (_assert_number, 3, "2.0 * growth", "growth"),
    (_assert_differential, 6, "dot(right, direction) / squared", "dot(right, direction)"),
    (_assert_noise, 3, "(state >> 28) + 4u", "(state >> 28) + 5u"),
]


@pytest.mark.parametrize(("check", "count", "right", "wrong"), WRONG)
def test_a_wrong_shader_is_noticed(
    gl: moderngl.Context,
    tmp_path: Path,
    check: Callable[..., None],
    count: int,
    right: str,
    wrong: str,
) -> None:
    rows = np.random.default_rng(1).uniform(0.1, 1.0, (16, count)).astype(np.float32)
    rows = rows * 1000.0 if count == 3 else rows
    with pytest.raises(AssertionError):
        check(gl, rows.astype(np.float32), wrong_shader(tmp_path, SAMPLING, right, wrong))

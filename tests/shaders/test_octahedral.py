"""Shader normals survive 32 bits within the stated angle, and code and decode as their float64 twins do."""

from __future__ import annotations

import itertools
import math
from typing import TYPE_CHECKING

import numpy as np
import pytest
from hypothesis import given, settings

from isosample.integral.octahedral import STEPS, octahedral_fold, pack_normal, unpack_normal
from isosample.rendering.frame import shared_constants
from shaders.harness import call
from shaders.twins import UNIT, assert_within, columns, gamma, wrong_shader

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    import moderngl
    import numpy.typing as npt

    from shaders.twins import F32

OCTAHEDRAL = "lib/octahedral.glsl"
# Rounding to 16 bits as derived in the file, and roundings on the way: the components of p carry 8 each
# (norm 2, division 5, scaling 1), together 8 units of |p_x| + |p_y| <= 1, folding 2 more; the octahedron's
# point moves √2 as far, seen from a distance of 1/√3 or more: (8 + 2) √6 = 25 units.
STATED_ANGLE = 3.0 * math.sqrt(2.0) * 0.5 / STEPS + gamma(25)


def _directions(count: int) -> F32:
    """(count, 3) float32 vectors of about unit length, a third of them near a fold or an axis of the map."""
    random = np.random.default_rng(4)
    vectors = random.normal(size=(count, 3))
    flat = random.integers(0, 3, count // 3)
    vectors[np.arange(count // 3), flat] *= 10.0 ** random.uniform(-9, 0, count // 3)
    unit: F32 = (vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)).astype(np.float32)
    return unit


def _assert_fold(gl: moderngl.Context, p: F32, root: Path | None = None) -> None:
    found = call(gl, OCTAHEDRAL, "vec2 octahedral_fold(vec2 p)", p, root=root)
    expected = octahedral_fold(p)
    assert_within(found, expected, gamma(1) * np.abs(expected))  # the difference, times 1 or −1


def _steps(bits: npt.NDArray[np.uint32]) -> npt.NDArray[np.int64]:
    """(N, 2) signed 16-bit numbers of packed normals."""
    halves = np.stack([bits & 0xFFFF, bits >> 16], axis=-1).astype(np.uint16)
    return halves.view(np.int16).astype(np.int64)


def _assert_pack(gl: moderngl.Context, normals: F32, root: Path | None = None) -> None:
    bits = call(gl, OCTAHEDRAL, "uint pack_normal(vec3 n)", normals, root=root)
    exact = normals.astype(np.float64)
    # The place is off by 10 units, 0.02 steps, so rounding may fall on the neighbouring step, no further.
    steps = np.abs(_steps(bits) - _steps(pack_normal(exact)))
    assert_within(steps, np.zeros(steps.shape), 1.0)
    unit = exact / np.linalg.norm(exact, axis=-1, keepdims=True)
    angle = 2.0 * np.arcsin(0.5 * np.linalg.norm(unpack_normal(bits) - unit, axis=-1))
    assert_within(angle, np.zeros(angle.shape), STATED_ANGLE)


def _assert_unpack(gl: moderngl.Context, bits: npt.NDArray[np.uint32], root: Path | None = None) -> None:
    found = call(gl, OCTAHEDRAL, "vec3 unpack_normal(uint bits)", bits, root=root)
    # A component c / 32767 carries 5 roundings, 1 − |x| − |y| with |x| + |y| <= 2 then 12, folding 1 more:
    # the vector moves by √(6² + 6² + 12²) = 15 units; it is at least 1/√3 long: 26. Normalising: 3 + 4 + 1.
    assert_within(found, unpack_normal(bits), gamma(34))


def test_stated_angle_is_the_one_of_the_file() -> None:
    assert STATED_ANGLE <= 6.48e-5 + 2e-6


def test_fold_agrees_with_its_twin(gl: moderngl.Context) -> None:
    random = np.random.default_rng(6).uniform(-1.0, 1.0, (2000, 2)).astype(np.float32)
    _assert_fold(gl, np.concatenate([random, np.zeros((1, 2), np.float32)]))


def test_packed_normals_keep_the_stated_angle(gl: moderngl.Context) -> None:
    _assert_pack(gl, _directions(200_000))


@settings(max_examples=20)
@given(normals=columns(3, -1.0, 1.0))
def test_packing_agrees_for_any_direction(gl: moderngl.Context, normals: F32) -> None:
    long_enough = np.abs(normals).max(axis=-1, keepdims=True) > 2.0**-40
    _assert_pack(gl, np.where(long_enough, normals, np.float32(1.0)))


def test_unpacked_normals_agree_with_their_twin(gl: moderngl.Context) -> None:
    edges = np.array([0, 1, 0x7FFE, 0x7FFF, 0x8000, 0x8001, 0x8002, 0xFFFF], np.uint32)
    corners = (edges[:, None] | (edges[None, :] << np.uint32(16))).ravel()
    words = np.random.default_rng(8).integers(0, 2**32, 100_000, dtype=np.uint32)
    _assert_unpack(gl, np.concatenate([corners, words]))


def test_axes_and_the_zero_vector_have_their_codes(gl: moderngl.Context) -> None:
    axes = np.array(
        [[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1], [0, 0, 0]], np.float32
    )
    bits = call(gl, OCTAHEDRAL, "uint pack_normal(vec3 n)", axes)
    expected = [0x7FFF, 0x8001, 0x7FFF0000, 0x80010000, 0, 0x7FFF7FFF, 0]
    assert bits.tolist() == expected
    assert pack_normal(axes).tolist() == expected
    back = call(gl, OCTAHEDRAL, "vec3 unpack_normal(uint bits)", bits[:6])
    assert np.abs(back - axes[:6]).max() <= 4 * UNIT  # normalising a vector of length 1


def test_no_direction_has_the_code_of_none(gl: moderngl.Context) -> None:
    corners = np.array(list(itertools.product([-2.0, -1.0, 0.0, 1.0, 2.0], repeat=3)), np.float32)
    bits = call(gl, OCTAHEDRAL, "uint pack_normal(vec3 n)", np.concatenate([corners, _directions(10_000)]))
    assert not (bits == shared_constants()["NO_NORMAL"]).any()
    assert (_steps(bits) > -32768).all()  # neither half of it is ever made


@pytest.mark.parametrize(
    ("right", "wrong", "check", "argument"),
    [
        ("(1.0 - abs(p.yx))", "(0.99999 - abs(p.yx))", _assert_fold, np.full((1, 2), 0.3, np.float32)),
        ("n.xy / max", "0.9999 * n.xy / max", _assert_pack, _directions(100)),
        ("p, 1.0 - abs(p.x)", "p, 1.0001 - abs(p.x)", _assert_unpack, np.arange(99, dtype=np.uint32) << 9),
    ],
)
def test_wrong_constant_is_told(
    gl: moderngl.Context,
    tmp_path: Path,
    right: str,
    wrong: str,
    check: Callable[..., None],
    argument: npt.NDArray[np.generic],
) -> None:
    root = wrong_shader(tmp_path, OCTAHEDRAL, right, wrong)
    with pytest.raises(AssertionError, match="beyond its bound"):
        check(gl, argument, root)

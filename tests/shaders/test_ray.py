"""Shader rays, box intervals, faces and cells agree with float64 within their roundings."""

from __future__ import annotations

import itertools
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from hypothesis import given, settings

from isosample.integral.ray import (
    MISS,
    bilinear,
    box_interval,
    face_tolerance,
    image_plane_position,
    nearest_face,
    slab_interval,
)
from shaders.harness import call
from shaders.twins import DIVISION, TINY, UNIT, assert_within, columns, gamma, wrong_shader

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    import moderngl
    import numpy.typing as npt

    from isosample.volume.grid import F64
    from shaders.twins import F32

    Pixels = npt.NDArray[np.int32]

RAY = "lib/ray.glsl"
UNLIMITED = 1e30  # what the shader says for an infinite end
CROSSING = gamma(1 + DIVISION)  # 1 − origin is rounded, then divided


def _assert_plane(gl: moderngl.Context, pixel: Pixels, size: Pixels, root: Path | None = None) -> None:
    signature = "vec2 image_plane_position(ivec2 pixel, ivec2 image_size)"
    found = call(gl, RAY, signature, pixel, size, root=root)
    expected = image_plane_position(pixel, size)
    # Pixel + 1/2 and twice that are exact below 2^23; the quotient is 1 + expected; one more rounding.
    assert_within(found, expected, gamma(DIVISION) * (1.0 + expected) + gamma(1) * np.abs(expected))


def _assert_interval(found: F32, expected: F64) -> None:
    finite = np.clip(expected, -UNLIMITED, UNLIMITED)
    # Orderings, minima and maxima pass relative errors on as they are.
    assert_within(found, finite, CROSSING * np.abs(finite) + TINY)


def _assert_slab(gl: moderngl.Context, origin: F32, direction: F32, root: Path | None = None) -> None:
    found = call(gl, RAY, "vec2 slab_interval(float origin, float direction)", origin, direction, root=root)
    _assert_interval(found, slab_interval(origin, direction))


def _assert_box(gl: moderngl.Context, origin: F32, direction: F32, root: Path | None = None) -> None:
    found = call(gl, RAY, "vec2 box_interval(vec3 origin, vec3 direction)", origin, direction, root=root)
    _assert_interval(found, box_interval(origin, direction))


def _assert_face(gl: moderngl.Context, unit: F32, root: Path | None = None) -> None:
    found = call(gl, RAY, "int nearest_face(vec3 unit)", unit, root=root)
    point = unit.astype(np.float64)
    distances = np.abs(point[np.arange(len(point)), found // 2] - found % 2)
    expected = np.abs(np.stack([point, 1.0 - point], axis=-1)).min(axis=(1, 2))
    # 1 − unit is rounded: of two faces nearly as near either may be found.
    assert_within(distances, expected, 2 * gamma(1) * expected)
    clear = np.sort(np.minimum(np.abs(point), np.abs(1.0 - point)), axis=-1)
    unique = clear[:, 1] > clear[:, 0] + 4 * UNIT * clear[:, 1]
    assert_within(found[unique], nearest_face(point)[unique].astype(np.float64), 0.0)


def _assert_bilinear(gl: moderngl.Context, corners: F32, u: F32, v: F32, root: Path | None = None) -> None:
    found = call(gl, RAY, "float bilinear(vec4 corners, float u, float v)", corners, u, v, root=root)
    expected = bilinear(corners.astype(np.float64), u, v)
    # mix as x (1 − a) + y a or as x + a (y − x), |y − x| <= 2 max: 5 roundings of the largest corner at most.
    assert_within(found, expected, gamma(10) * np.abs(corners).max(axis=-1) + TINY)


def _pixels() -> tuple[Pixels, Pixels]:
    random = np.random.default_rng(10)
    size = random.integers(1, 8192, (2000, 2)).astype(np.int32)
    return (random.random((2000, 2)) * size).astype(np.int32), size


def _rays() -> tuple[F32, F32]:
    """Rays through the box or past it; a quarter of the directions is parallel to some face."""
    random = np.random.default_rng(11)
    origin, direction = random.uniform(-2.0, 3.0, (20_000, 3)), random.normal(size=(20_000, 3))
    direction[np.arange(5000), random.integers(0, 3, 5000)] = 0.0
    return origin.astype(np.float32), direction.astype(np.float32)


def _slabs() -> tuple[F32, F32]:
    return tuple(part.ravel() for part in _rays())  # type: ignore[return-value]


def _points() -> tuple[F32]:
    return (np.random.default_rng(12).random((20_000, 3), dtype=np.float32),)


def _cells() -> tuple[F32, F32, F32]:
    random = np.random.default_rng(13).random((6, 5000), dtype=np.float32)
    return np.ascontiguousarray(random[:4].T), random[4], random[5]


PAIRS: list[tuple[Callable[..., None], Callable[[], tuple[Any, ...]]]] = [
    (_assert_plane, _pixels),
    (_assert_slab, _slabs),
    (_assert_box, _rays),
    (_assert_face, _points),
    (_assert_bilinear, _cells),
]


@pytest.mark.parametrize(("check", "arguments"), PAIRS)
def test_function_agrees_with_its_twin(
    gl: moderngl.Context, check: Callable[..., None], arguments: Callable[[], tuple[Any, ...]]
) -> None:
    check(gl, *arguments())


def test_ray_along_a_face_is_unlimited_inside_and_misses_outside(gl: moderngl.Context) -> None:
    origin = np.array([0.0, 0.5, 1.0, -0.125, 1.125], np.float32)
    direction = np.array([0.0, -0.0, 0.0, 0.0, -0.0], np.float32)
    found = call(gl, RAY, "vec2 slab_interval(float origin, float direction)", origin, direction)
    unlimited = [-float(np.float32(UNLIMITED)), float(np.float32(UNLIMITED))]
    assert found.tolist() == [unlimited] * 3 + [list(MISS)] * 2


def test_ties_between_faces_go_to_the_first(gl: moderngl.Context) -> None:
    # Eighths: every distance is exact, so the faces are those of the twin.
    eighths = np.linspace(0.0, 1.0, 9, dtype=np.float32)
    points = np.array(list(itertools.product(eighths, repeat=3)), np.float32)
    assert call(gl, RAY, "int nearest_face(vec3 unit)", points).tolist() == nearest_face(points).tolist()


def test_corners_of_a_cell_are_exact(gl: moderngl.Context) -> None:
    corners = np.tile(np.array([3.5, -1.25, 0.75, 8.0], np.float32), (4, 1))
    u, v = np.array([0, 1, 0, 1], np.float32), np.array([0, 0, 1, 1], np.float32)
    found = call(gl, RAY, "float bilinear(vec4 corners, float u, float v)", corners, u, v)
    assert found.tolist() == corners[0].tolist()


@settings(max_examples=20)
@given(origin=columns(3, -8.0, 8.0), speed=columns(3, 2.0**-40, 8.0), sign=columns(3, -1.0, 1.0))
def test_box_interval_agrees_for_any_ray(gl: moderngl.Context, origin: F32, speed: F32, sign: F32) -> None:
    direction = speed * np.sign(sign)  # now and then 0, never so small that the quotient overflows
    _assert_box(gl, origin, direction)
    _assert_slab(gl, origin.ravel(), direction.ravel())


@settings(max_examples=20)
@given(
    corners=columns(4, -1e3, 1e3), u=columns(0, 0.0, 1.0), v=columns(0, 0.0, 1.0), points=columns(3, 0.0, 1.0)
)
def test_cells_and_faces_agree_for_any_values(
    gl: moderngl.Context, corners: F32, u: F32, v: F32, points: F32
) -> None:
    _assert_bilinear(gl, corners, u, v)
    _assert_face(gl, points)


@pytest.mark.parametrize(
    ("right", "wrong", "pair"),
    [
        ("vec2(pixel) + 0.5", "vec2(pixel) + 0.501", PAIRS[0]),
        ("(1.0 - origin) / direction", "(1.00001 - origin) / direction", PAIRS[1]),
        ("max(max(x.x, y.x), z.x)", "max(x.x, y.x)", PAIRS[2]),
        ("{ face = 3;", "{ face = 2;", PAIRS[3]),
        ("mix(corners.z, corners.w, u)", "mix(corners.z, 1.0001 * corners.w, u)", PAIRS[4]),
    ],
)
def test_wrong_constant_is_told(
    gl: moderngl.Context,
    tmp_path: Path,
    right: str,
    wrong: str,
    pair: tuple[Callable[..., None], Callable[[], tuple[Any, ...]]],
) -> None:
    check, arguments = pair
    root = wrong_shader(tmp_path, RAY, right, wrong)
    with pytest.raises(AssertionError, match="beyond its bound"):
        check(gl, *arguments(), root)


def test_the_tolerance_of_a_face_is_its_twin_and_bounds_the_chord(gl: moderngl.Context) -> None:
    rng = np.random.default_rng(4)
    corners = rng.random((500, 4)).astype(np.float32)
    found = call(gl, RAY, "float face_tolerance(vec4 corners)", corners)
    expected = face_tolerance(corners.astype(np.float64))
    # 6 additions and products of numbers up to 2.
    assert np.abs(found - expected).max() <= 8 * 2.0**-24 * 2
    # Along the chord between two points of an isoline on the cell's edges the field stays within the tolerance.
    for cell, tolerance in zip(corners.astype(np.float64), expected, strict=True):
        f00, f10, f01, f11 = cell
        level = 0.5 * (f00 + f10)
        if (f01 - level) * (f11 - level) >= 0:
            continue
        top = (level - f01) / (f11 - f01)
        t = np.linspace(0.0, 1.0, 21)
        along = bilinear(np.broadcast_to(cell, (21, 4)), 0.5 + t * (top - 0.5), t)
        assert np.abs(along - level).max() <= tolerance

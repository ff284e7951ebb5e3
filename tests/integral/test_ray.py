"""Rays meet the unit box where geometry says; pixels are centred; bilinear cells are exact at corners."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from isosample.errors import InputError
from isosample.integral.ray import (
    MISS,
    bilinear,
    box_interval,
    image_plane_position,
    nearest_face,
    slab_interval,
)

UNIT = 2.0**-53
inside = arrays(np.float64, 3, elements=st.floats(0.0, 1.0, allow_subnormal=False))
vectors = arrays(np.float64, 3, elements=st.floats(-10.0, 10.0, allow_subnormal=False))
fractions = st.floats(0.0, 1.0, allow_subnormal=False)


def test_pixel_centres_are_symmetric_about_the_middle() -> None:
    pixels = np.array(list(itertools.product(range(4), range(2))))
    positions = image_plane_position(pixels, (4, 2))
    assert positions[0].tolist() == [-0.75, -0.5]
    assert positions[-1].tolist() == [0.75, 0.5]
    assert positions.tolist() == (-positions[::-1]).tolist()
    assert image_plane_position((1, 1), (3, 3)).tolist() == [0.0, 0.0]


def test_slab_is_entered_and_left_at_its_faces() -> None:
    # From −1 at speed 2 the coordinate is 0 at t = 1/2 and 1 at t = 1; backwards from 3, at −1 and −1.5.
    assert slab_interval([-1.0, 0.5, 3.0], [2.0, -1.0, 2.0]).tolist() == [[0.5, 1], [-0.5, 0.5], [-1.5, -1]]


def test_ray_along_a_slab_stays_inside_or_outside() -> None:
    assert slab_interval([0.0, 0.5, 1.0], 0.0).tolist() == [[-math.inf, math.inf]] * 3
    assert slab_interval([-1e-300, 1.0 + 2 * UNIT], -0.0).tolist() == [list(MISS)] * 2


def test_diagonal_of_the_box_has_its_length() -> None:
    diagonal = np.ones(3) / math.sqrt(3.0)
    first, last = box_interval(np.full(3, 0.5) - 2.0 * diagonal, diagonal)
    assert float(last - first) == pytest.approx(math.sqrt(3.0), rel=16 * UNIT)


def test_ray_nearly_along_a_slab_meets_it_infinitely_far() -> None:
    assert slab_interval([0.5, 5.0], 1e-310).tolist() == [[-math.inf, math.inf], [-math.inf, -math.inf]]
    assert box_interval((0.5, 0.5, -1.0), (1e-310, 0.0, 1.0)).tolist() == [1.0, 2.0]


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_axis_ray_meets_two_opposite_faces_or_misses(axis: int) -> None:
    direction = np.eye(3)[axis]
    origin = 0.25 - 3.0 * direction
    assert box_interval(origin, direction).tolist() == [2.75, 3.75]
    assert box_interval(origin + 1.5 * np.eye(3)[axis - 1], direction).tolist() == list(MISS)


@given(point=inside, direction=vectors.filter(lambda v: np.abs(v).max() > 1e-3), back=st.floats(0.0, 10.0))
def test_ray_through_a_point_of_the_box_holds_that_point(
    point: np.ndarray, direction: np.ndarray, back: float
) -> None:
    first, last = box_interval(point - back * direction, direction)
    # The origin is rounded by 2 units of at most 101 along each axis, and the box test divides by the speed
    # there; along an axis with speed 0 the origin is the point itself.
    speeds = np.abs(direction[direction != 0.0])
    slack = 4 * 101 * UNIT / speeds.min() if back else 4 * UNIT
    assert first <= back + slack
    assert last >= back - slack


@given(middle=inside, direction=vectors.filter(lambda v: np.abs(v).max() > 1e-3))
def test_ends_of_the_interval_lie_on_the_box(middle: np.ndarray, direction: np.ndarray) -> None:
    origin = 0.125 + 0.75 * middle - direction  # the ray is well inside the box at distance 1
    first, last = box_interval(origin, direction)
    assert first < 1.0 < last
    for distance in (first, last):
        point = origin + distance * direction
        # Quotient, product and sum: three roundings of numbers up to |o| + |t d|, and one in the quotient's
        # numerator.
        slack = 4 * UNIT * (11.0 + float(np.abs(distance * direction).max()))
        assert (np.abs(point - 0.5) <= 0.5 + slack).all()
        assert (np.abs(np.abs(point - 0.5) - 0.5) <= slack).any()


@given(origin=vectors, direction=vectors)
def test_reversed_ray_has_the_reversed_interval(origin: np.ndarray, direction: np.ndarray) -> None:
    forth, back = box_interval(origin, direction), box_interval(origin, -direction)
    if forth.tolist() == list(MISS):
        assert back.tolist() == list(MISS)
    else:
        assert back.tolist() == (-forth[::-1]).tolist()


def test_points_of_a_face_are_nearest_to_it() -> None:
    for face in range(6):
        point = np.full(3, 0.375)
        point[face // 2] = face % 2
        assert int(nearest_face(point)) == face


def test_corner_belongs_to_its_first_face() -> None:
    assert nearest_face([[0.0, 0.0, 0.0], [1.0, 1.0, 1.0], [0.5, 1.0, 0.0]]).tolist() == [0, 1, 3]
    assert nearest_face(np.zeros((2, 5, 3))).shape == (2, 5)


@given(
    corners=arrays(np.float64, 4, elements=st.floats(-1e3, 1e3, allow_subnormal=False)),
    u=fractions,
    v=fractions,
)
def test_bilinear_reproduces_corners_and_swaps_with_its_axes(corners: np.ndarray, u: float, v: float) -> None:
    places = [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (1.0, 1.0)]
    assert [float(bilinear(corners, *place)) for place in places] == corners.tolist()
    swapped = float(bilinear(corners[[0, 2, 1, 3]], v, u))
    # 6 roundings on either side, each of at most the largest corner.
    assert float(bilinear(corners, u, v)) == pytest.approx(swapped, abs=12 * UNIT * np.abs(corners).max())


def test_bilinear_of_products_is_the_product() -> None:
    # (1 + 2u)(3 − v) at the corners; quarters are exact.
    assert bilinear([3.0, 9.0, 2.0, 6.0], [0.25, 0.5], [0.5, 0.75]).tolist() == [1.5 * 2.5, 2.0 * 2.25]


def test_ray_that_is_no_ray_is_refused() -> None:
    with pytest.raises(InputError, match="origin is nan at index 1; expected finite"):
        box_interval([0.0, math.nan, 0.0], [0.0, 0.0, 1.0])
    with pytest.raises(InputError, match="image_size has a side of 0 pixels"):
        image_plane_position((0, 0), (4, 0))
    with pytest.raises(InputError, match=r"v is 1\.25; expected 0 to 1"):
        bilinear(np.zeros(4), 0.5, 1.25)

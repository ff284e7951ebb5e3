"""Packed normals come back within the derived angle, and the codes of the axes are the known ones."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from isosample.errors import InputError
from isosample.integral.octahedral import STEPS, octahedral_fold, pack_normal, unpack_normal

PROMISED_ANGLE = 3.0 * math.sqrt(2.0) * 0.5 / STEPS  # rad; derived in pack_normal
components = st.floats(-1e3, 1e3, allow_subnormal=False)


def angle_between(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Angles [rad] between unit vectors, accurate for small ones."""
    angles: np.ndarray = 2.0 * np.arcsin(0.5 * np.linalg.norm(a - b, axis=-1))
    return angles


@pytest.mark.parametrize(
    ("axis", "bits"),
    [
        ((1, 0, 0), 0x00007FFF),
        ((-1, 0, 0), 0x00008001),  # −32767 in two's complement
        ((0, 1, 0), 0x7FFF0000),
        ((0, -1, 0), 0x80010000),
        ((0, 0, 1), 0x00000000),
        ((0, 0, -1), 0x7FFF7FFF),  # the centre of the map folded onto its corner (1, 1)
    ],
)
def test_axes_have_known_codes_and_come_back_exactly(axis: tuple[int, int, int], bits: int) -> None:
    packed = pack_normal(np.array(axis, np.float64))
    assert int(packed) == bits
    assert unpack_normal(packed).tolist() == list(axis)


def test_packed_normals_come_back_within_the_promised_angle() -> None:
    normals = np.random.default_rng(3).normal(size=(200_000, 3))
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    angles = angle_between(unpack_normal(pack_normal(normals)), normals)
    assert angles.max() <= PROMISED_ANGLE
    assert angles.max() > 0.95 * PROMISED_ANGLE  # the bound is no looser than it must be


@given(n=arrays(np.float64, 3, elements=components).filter(lambda n: np.abs(n).max() > 1e-3))
def test_length_does_not_matter_and_powers_of_two_change_no_bit(n: np.ndarray) -> None:
    assert int(pack_normal(4.0 * n)) == int(pack_normal(n))
    unit = n / np.linalg.norm(n)
    assert float(angle_between(unpack_normal(pack_normal(n)), unit)) <= PROMISED_ANGLE + 1e-15


@given(words=arrays(np.uint32, 8))
def test_every_word_is_a_unit_vector(words: np.ndarray) -> None:
    np.testing.assert_allclose(np.linalg.norm(unpack_normal(words), axis=-1), 1.0, rtol=1e-15)


def test_lowest_number_stands_for_minus_one_like_its_neighbour() -> None:
    # −32768 / 32767 is clamped (OpenGL Shading Language 4.5, unpackSnorm2x16).
    lowest, clamped = unpack_normal(np.array([0x8000, 0x8001], np.uint32))
    assert lowest.tolist() == clamped.tolist()


def test_fold_exchanges_the_square_and_its_corners() -> None:
    places = np.array([[0.25, 0.5], [-0.25, 0.5], [0.25, -0.5], [-0.25, -0.5]])
    folded = octahedral_fold(places)
    assert folded.tolist() == [[0.5, 0.75], [-0.5, 0.75], [0.5, -0.75], [-0.5, -0.75]]
    assert octahedral_fold(folded).tolist() == places.tolist()


def test_zero_vector_is_packed_as_plus_z() -> None:
    assert unpack_normal(pack_normal(np.zeros(3))).tolist() == [0.0, 0.0, 1.0]


def test_what_is_no_normal_is_refused() -> None:
    with pytest.raises(InputError, match="component that is not finite"):
        pack_normal([1.0, math.nan, 0.0])
    with pytest.raises(InputError, match=r"n has shape \(2,\); expected \(\.\.\., 3\)"):
        pack_normal([1.0, 0.0])
    with pytest.raises(InputError, match="packed normals are int64; expected uint32"):
        unpack_normal(np.zeros(2, np.int64))

"""Blinn-Phong with the light at the eye: the cosine law, both sides alike, no highlight edge-on."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from isosample.errors import InputError
from isosample.integral.shading import blinn_phong

UNIT = 2.0**-53
COLOUR = np.array([0.5, 0.25, 1.0])
FORWARD = np.array([0.0, 0.0, -1.0])
angles = st.floats(-math.pi, math.pi, allow_subnormal=False)


def _tilted(angle: float) -> np.ndarray:
    return np.array([math.sin(angle), 0.0, math.cos(angle)])


def test_ambient_alone_leaves_the_colour() -> None:
    assert blinn_phong(COLOUR, _tilted(1.0), FORWARD, (1, 0, 0, 8)).tolist() == COLOUR.tolist()


@given(angle=angles)
def test_diffuse_part_follows_the_cosine(angle: float) -> None:
    lit = blinn_phong(COLOUR, _tilted(angle), FORWARD, (0.25, 0.5, 0.0, 8.0))
    np.testing.assert_allclose(lit, COLOUR * (0.25 + 0.5 * abs(math.cos(angle))), rtol=6 * UNIT)


@given(angle=angles)
def test_highlight_is_white_and_a_power_of_the_cosine(angle: float) -> None:
    # cos^4 = (1 + cos 2a)²/4, an independent form; its own sum cancels to 2 units of 1.
    lit = blinn_phong(np.zeros(3), _tilted(angle), FORWARD, (0.0, 0.0, 0.75, 4.0))
    np.testing.assert_allclose(lit, 0.75 * (0.5 * (1.0 + math.cos(2.0 * angle))) ** 2, rtol=0, atol=16 * UNIT)


@given(angle=angles)
def test_both_sides_of_a_surface_are_lit_alike(angle: float) -> None:
    material = (0.1, 0.7, 0.2, 20.0)
    front, back = (blinn_phong(COLOUR, sign * _tilted(angle), FORWARD, material) for sign in (1.0, -1.0))
    assert front.tolist() == back.tolist()


@pytest.mark.parametrize("shininess", [0.0, 1.0, 100.0])
def test_edge_on_surface_has_no_highlight(shininess: float) -> None:
    edge_on = blinn_phong(COLOUR, [1.0, 0.0, 0.0], FORWARD, (0.1, 0.7, 0.2, shininess))
    np.testing.assert_allclose(edge_on, 0.1 * COLOUR, rtol=2 * UNIT)


def test_normal_rounded_beyond_unit_length_is_not_brighter() -> None:
    longer = blinn_phong(COLOUR, [0.0, 0.0, 1.0 + 1e-7], FORWARD, (0.1, 0.7, 0.2, 1e6))
    assert longer.tolist() == blinn_phong(COLOUR, [0.0, 0.0, 1.0], FORWARD, (0.1, 0.7, 0.2, 1e6)).tolist()


def test_negative_material_is_refused() -> None:
    with pytest.raises(InputError, match="material is -1 at index 3; expected finite and >= 0"):
        blinn_phong(COLOUR, FORWARD, FORWARD, (0.1, 0.7, 0.2, -1.0))

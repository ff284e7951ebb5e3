"""Lit segments: without light they are plain ones, and light follows the gradient, against closed forms."""

from __future__ import annotations

import math

import numpy as np
import pytest

from isosample.integral.lit_segment import LEAST_COSINE, crossing_gradient, lit_moments
from isosample.integral.segment import cubic_moments

Z = np.array([0.0, 0.0, 1.0])
DIFFUSE = np.array([0.0, 1.0, 0.0, 1.0])
CUBIC = ((0.3, 2.0), (0.0, 1.0), (0.5, 1.5), (0.1, 0.9))


def test_a_material_of_ambient_light_alone_leaves_a_segment_as_it_is() -> None:
    (depths, ends, slopes, part), gradients = CUBIC, (np.array([1.0, 2.0, 0.5]), np.array([-1.0, 0.0, 3.0]))
    seen, high, _, _ = cubic_moments(*depths, *ends, *slopes, *part)
    found = lit_moments(*CUBIC, gradients, Z, np.array([1.0, 0.0, 0.0, 1.0]))
    np.testing.assert_allclose(found, [seen, seen, high, 0.0], rtol=1e-14, atol=1e-16)
    assert lit_moments(*CUBIC, (np.zeros(3), np.zeros(3)), Z, DIFFUSE)[1] == 0.0  # nothing to light


def test_equal_gradients_light_all_of_a_segment_alike() -> None:
    (depths, ends, slopes, part), gradient = CUBIC, np.array([3.0, 0.0, 4.0])
    seen, high, _, _ = cubic_moments(*depths, *ends, *slopes, *part)
    found = lit_moments(*CUBIC, (gradient, gradient), Z, np.array([0.1, 0.5, 0.25, 2.0]))
    np.testing.assert_allclose(found, [seen, 0.5 * seen, 0.5 * high, 0.25 * 0.64 * seen], rtol=1e-13)


def test_a_ray_through_a_sphere_is_dark_where_it_passes_along_its_shells() -> None:
    # Thin, of one extinction, between the two crossings of the shell of radius 5, 4 from the centre at the nearest: the
    # gradient there is the place over the radius, so mixed it is that of every place on the way, and the light is
    # |s| / sqrt(s^2 + 16) from s = -3 to 3, in the mean (5 - 4) / 3. Two panels of three nodes each: the integrand is
    # smooth up to s = 0, and its 6th derivative below 6! / 4^6, so they err by 3^7 (3!)^4 / (7 (6!)^3) of that, 2e-4.
    ends = tuple(np.array([4.0, 0.0, s]) / 5.0 for s in (-3.0, 3.0))
    depth = 1e-6
    found = lit_moments((depth, depth), (0.0, 0.0), (0.0, 0.0), (0.0, 1.0), (ends[0], ends[1]), Z, DIFFUSE)
    assert found[1] / depth == pytest.approx(1.0 / 3.0, abs=2e-4)
    assert found[1] / depth < 0.6 * 0.6  # what light at the two ends, 3 / 5, would make


def test_a_gradient_follows_from_its_part_along_the_ray() -> None:
    gradient = np.array([2.0, -1.0, 2.0])
    normal = gradient / 3.0
    np.testing.assert_allclose(crossing_gradient(normal, 2.0, Z), gradient, rtol=1e-15)
    np.testing.assert_allclose(crossing_gradient(normal, -2.0, Z), gradient, rtol=1e-15)
    grazing = np.array([math.sqrt(1.0 - 1e-6), 0.0, 1e-3])
    np.testing.assert_allclose(crossing_gradient(grazing, 1e-3, Z), grazing * 1e-3 / LEAST_COSINE, rtol=1e-12)

"""The field's error on a triangle from the gradients at its vertices: exact for quadratic fields."""

from __future__ import annotations

import math

import numpy as np

from isosample.integral.curved import LEAST_INCLINE, curved_error, curved_shift


def test_the_error_is_exact_for_a_quadratic_field() -> None:
    rng = np.random.default_rng(3)
    hessian = rng.normal(size=(3, 3))
    hessian += hessian.T
    slope = np.array([3.0, -2.0, 5.0])

    def field(p: np.ndarray) -> np.ndarray:
        return np.asarray(p @ slope + 0.5 * np.einsum("...i,ij,...j->...", p, hessian, p))

    corners = rng.normal(scale=0.3, size=(3, 3))
    for _ in range(30):  # onto the isosurface f = 0.2
        gradient = slope + corners @ hessian
        corners -= ((field(corners) - 0.2) / (gradient**2).sum(axis=1))[:, None] * gradient
    gradients = slope + corners @ hessian
    weights = rng.dirichlet(np.ones(3), size=50)
    points = weights @ corners
    moments = weights @ (gradients * corners).sum(axis=1)
    found = curved_error(weights @ gradients, points, moments)
    assert np.abs(field(points) - 0.2).max() > 0.01
    assert np.abs(found - (field(points) - 0.2)).max() < 1e-13  # roundings of terms of about 2


def test_one_shift_along_the_ray_lands_on_a_sphere_to_third_order() -> None:
    errors = []
    for size in (0.2, 0.1, 0.05):
        angles = np.array([0.1, 0.1 + 2.1, 0.1 + 4.2])
        corners = np.stack([size * np.cos(angles), size * np.sin(angles), np.zeros(3)], axis=1)
        corners[:, 2] = np.sqrt(1.0 - size**2)
        gradients, middle = corners, corners.mean(axis=0)  # of the distance from the centre
        moment = float((gradients * corners).sum(axis=1).mean())
        way = np.array([0.3, 0.1, -1.0]) / math.sqrt(1.1)
        gradient = gradients.mean(axis=0)
        error = curved_error(gradient, middle, moment)
        shift = curved_shift(error, gradient @ way, np.linalg.norm(gradient), 1.0, gradient @ way > 0.0)
        errors.append(abs(np.linalg.norm(middle + shift * way) - 1.0))
    assert errors[1] <= errors[0] / 7.0  # order 3 or better
    assert errors[2] <= errors[1] / 7.0


def test_a_shift_is_limited_and_grazing_rays_have_a_least_slope() -> None:
    assert curved_shift(1.0, 0.5, 0.5, 0.25, True) == -0.25
    assert curved_shift(1.0, -0.5, 0.5, 0.25, False) == 0.25
    assert math.isclose(float(curved_shift(0.01, 1e-9, 1.0, 1.0, True)), -0.01 / LEAST_INCLINE)
    assert curved_shift(0.0, 0.0, 0.0, 1.0, True) == 0.0


def test_a_crossing_does_not_move_towards_the_other_one_of_its_ray() -> None:
    """Beside an outline the gradient may rise along a ray that leaves through the triangle, or fall where it enters."""
    along = np.array([0.1, 0.0, -0.1])
    assert curved_shift(0.3, along, 1.0, 9.0, False).tolist() == [0.0, 0.0, 0.3 / LEAST_INCLINE]
    assert curved_shift(0.3, along, 1.0, 9.0, True).tolist() == [-0.3 / LEAST_INCLINE, 0.0, 0.0]

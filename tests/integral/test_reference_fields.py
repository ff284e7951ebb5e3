"""The reference integral of closed-form fields: against closed forms, and as the limit of finer grids."""

from __future__ import annotations

import numpy as np
import pytest

from isosample.errors import InputError
from isosample.integral.field_reference import integrate_field_rays
from isosample.integral.reference import integrate_rays
from isosample.transfer.control_points import ControlPoint, Isosurface
from isosample.transfer.transfer_function import TransferFunction
from isosample.volume.analytic import (
    Constant,
    Field,
    GaussianMixture,
    LinearRamp,
    PlaneWaves,
    SphereDistance,
    sample_field,
)
from isosample.volume.grid import F64, Box

WHITE = (1.0, 1.0, 1.0)
BOX = Box(corner=np.array([-2.0, -3.0, -2.5]), edges=np.diag([4.0, 6.0, 5.0]))


def rays(count: int, spread: float = 1.0) -> tuple[F64, F64]:
    rng = np.random.default_rng(1)
    ways = rng.normal(size=(count, 3))
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    return rng.normal(size=(count, 3)) * spread - 20.0 * ways, ways


def test_a_ramp_and_a_constant_are_those_of_a_grid() -> None:
    """A linear field is its own trilinear interpolant."""
    tf = TransferFunction(
        [ControlPoint(-5.0, (1.0, 0.0, 0.2), 0.1), ControlPoint(4.0, (0.0, 1.0, 0.5), 0.7)],
        [Isosurface(0.3, WHITE, 0.2)],
    )
    origins, ways = rays(40)
    plane = (0.3, -0.2, 1.0, 0.1)
    for field in (LinearRamp((1.0, -0.5, 0.75), 0.25), Constant(1.5)):
        volume = sample_field(field, (3, 5, 4), lower=(-2, -3, -2.5), upper=(2, 3, 2.5), dtype=np.float64)
        for planes in ([], [plane]):
            expected = integrate_rays(volume, tf, origins, ways, clip_planes=planes)
            rgba = integrate_field_rays(field, tf, BOX, origins, ways, clip_planes=planes)
            assert np.abs(rgba - expected).max() <= 3e-10
            assert expected[:, 3].max() > 0.5


def test_shells_of_a_distance_field_are_chords() -> None:
    """Constant extinction between two radii: closed form, with a step of the transfer function at both."""
    inner, outer, extinction = 0.6, 1.7, 0.8
    tf = TransferFunction(
        [ControlPoint(inner, WHITE, extinction), ControlPoint(outer, WHITE, extinction)],
        [Isosurface(1.0, (1.0, 0.0, 0.0), 0.3)],
    )
    origins, ways = rays(200, spread=0.8)
    origins[0] = -9.0 * ways[0]  # through the centre, where the field has a kink
    closest = np.linalg.norm(np.cross(origins, ways), axis=1)
    chords = [2 * np.sqrt(np.maximum(r**2 - closest**2, 0.0)) for r in (inner, outer)]
    alpha = 1.0 - np.exp(-extinction * (chords[1] - chords[0])) * np.where(closest < 1.0, 0.49, 1.0)
    rgba = integrate_field_rays(SphereDistance((0.0, 0.0, 0.0), 0.0), tf, BOX, origins, ways)
    # The field is met to about tolerance / 2; a crossing moves by that divided by the slope cos of the angle.
    slope = np.ones(len(closest))
    for radius in (inner, 1.0, outer):
        cosine = np.sqrt(np.maximum(1 - (closest / radius) ** 2, 0.0))
        slope = np.where(closest < radius, np.minimum(slope, cosine), slope)
    good = slope > 0.05
    assert good.mean() > 0.9
    assert np.abs(rgba[good, 3] - alpha[good]).max() <= 1e-10 + 2 * extinction * 1e-10 / 0.05
    assert (closest < inner).any()
    assert (closest > outer).any()


def test_finer_grids_approach_it_in_second_order() -> None:
    field = GaussianMixture(((0.3, 0.1, 0.0), (-0.8, 0.4, 0.5)), (1.1, 0.8), (1.0, 0.6))
    tf = TransferFunction(
        [
            ControlPoint(0.1, (1.0, 0.0, 0.0), 0.0),
            ControlPoint(0.4, (1.0, 1.0, 0.0), 0.6),
            ControlPoint(0.9, (0.0, 0.0, 1.0), 0.0),
        ]
    )
    origins, ways = rays(60)
    exact = integrate_field_rays(field, tf, BOX, origins, ways, tolerance=1e-8)
    errors = []
    for n in (17, 33, 65):
        volume = sample_field(field, (n, n, n), lower=(-2, -3, -2.5), upper=(2, 3, 2.5), dtype=np.float64)
        errors.append(np.sqrt(np.mean((integrate_rays(volume, tf, origins, ways) - exact) ** 2)))
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert np.all(np.abs(orders - 2.0) < 0.2), orders
    # A field that is 1 % too high is seen.
    wrong = GaussianMixture(field.centres, field.widths, (1.01, 0.606))
    other = integrate_field_rays(wrong, tf, BOX, origins, ways, tolerance=1e-8)
    with pytest.raises(AssertionError):
        assert np.abs(other - exact).max() < 1e-4


@pytest.mark.parametrize("tolerance", [1e-4, 1e-7])
def test_the_tolerance_is_met(tolerance: float) -> None:
    field = PlaneWaves(((2.0, 1.0, 0.5), (-1.0, 2.0, 3.0)), (1.0, 0.7), (0.3, 1.0))
    tf = TransferFunction(
        [
            ControlPoint(-1.0, (1.0, 0.0, 0.0), 0.0),
            ControlPoint(0.2, (0.0, 1.0, 0.0), 2.0),
            ControlPoint(1.0, (0.0, 0.0, 1.0), 0.1),
            ControlPoint(1.8, (0.0, 0.0, 1.0), 0.0),
        ]
    )
    origins, ways = rays(30)
    rgba = integrate_field_rays(field, tf, BOX, origins, ways, tolerance=tolerance)
    finer = integrate_field_rays(field, tf, BOX, origins, ways, tolerance=tolerance / 100)
    assert 0 < np.abs(rgba - finer).max() <= tolerance


class Pole(Field):
    """1 / x, which is infinite in the middle of the box."""

    def value(self, points: F64) -> F64:
        with np.errstate(divide="ignore"):
            return np.asarray(1.0 / points[..., 0])

    def gradient(self, points: F64) -> F64:
        return np.zeros(points.shape)


def test_wrong_input_is_named() -> None:
    tf = TransferFunction([], [Isosurface(0.5, WHITE, 0.5)])
    with pytest.raises(InputError, match=r"Pole has value inf .* expected finite numbers"):
        integrate_field_rays(Pole(), tf, BOX, [[0.0, 0.0, -9.0]], [[0.0, 0.0, 1.0]])
    flat = Box(corner=np.zeros(3), edges=np.diag([1.0, 1.0, 0.0]))
    with pytest.raises(InputError, match="has no extent"):
        integrate_field_rays(Constant(0.0), tf, flat, [[0.0, 0.0, -9.0]], [[0.0, 0.0, 1.0]])
    with pytest.raises(InputError, match="tolerance"):
        integrate_field_rays(Constant(0.0), tf, BOX, [[0.0, 0.0, -9.0]], [[0.0, 0.0, 1.0]], tolerance=0.0)
    assert not integrate_field_rays(Constant(0.0), tf, BOX, [[9.0, 0.0, -9.0]], [[0.0, 0.0, 1.0]]).any()

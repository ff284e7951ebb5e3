"""Closed-form fields have the gradients, values and symmetries that their formulas promise."""

from __future__ import annotations

import math

import numpy as np
import pytest

from isosample.errors import InputError
from isosample.volume.analytic import (
    Constant,
    Field,
    GaussianMixture,
    GaussianShell,
    Gyroid,
    HydrogenOrbital,
    LinearRamp,
    MarschnerLobb,
    PlaneWaves,
    SphereDistance,
    nucleon_like,
    sample_field,
)

EPSILON = float(np.finfo(np.float64).eps)
ORBITALS = [(n, l, m) for n in range(1, 5) for l in range(n) for m in range(-l, l + 1)]  # noqa: E741
SHELL = GaussianShell(centre=(0.2, -0.1, 0.3), radius=0.5, width=0.2, amplitude=3.0)
WAVES = PlaneWaves(((3, 1, 0), (0, -2, 4)), (1.0, 0.5), (0.3, -1.1))

# field, centre of the test points, half width of the region they are drawn from
SCENES: list[tuple[Field, float, float]] = [
    (Constant(3.0), 0, 1),
    (LinearRamp((1.0, -2.0, 0.5), 4.0), 0, 1),
    (SphereDistance((5.0, 5.0, 5.0), 0.5), 0, 1),
    (GaussianMixture(((0, 0, 0), (0.5, 0, 0)), (0.3, 0.6), (1.0, -0.4)), 0, 1),
    (nucleon_like(), 20, 18),
    (SHELL, 0, 1),
    (MarschnerLobb(), 0, 1),
    (Gyroid(0.7), 0, 1),
    (WAVES, 0, 1),
    *[(HydrogenOrbital(n, l, m, bohr_radius=0.5), 0, 4.0) for n, l, m in ORBITALS],  # noqa: E741
]


def central_difference(field: Field, points: np.ndarray, step: float) -> np.ndarray:
    shifts = step * np.eye(3)
    return np.stack(
        [(field.value(points + shift) - field.value(points - shift)) / (2 * step) for shift in shifts],
        axis=-1,
    )


def check_gradient(field: Field, points: np.ndarray, step: float) -> None:
    """Compare with differences D(h), D(h/2).

    D(h) = g + c h² + O(h⁴), so |D(h/2) − g| is a third of |D(h) − D(h/2)|, plus a fourth-order rest of a
    fifteenth of it where c = 0: the whole difference bounds both. Each value carries at most about 64
    roundings of terms as large as `scale`, which D(h/2) divides by h.
    """
    coarse, fine = central_difference(field, points, step), central_difference(field, points, step / 2)
    scale = np.abs(field.value(points)).max() + np.abs(points).max() * np.abs(fine).max()
    tolerance = np.abs(coarse - fine).max(axis=-1, keepdims=True) + 64 * EPSILON * scale / step
    assert (np.abs(field.gradient(points) - fine) <= tolerance).all()


@pytest.mark.parametrize(("field", "centre", "half_width"), SCENES, ids=lambda scene: str(scene)[:40])
def test_the_gradient_is_the_limit_of_central_differences(
    field: Field, centre: float, half_width: float
) -> None:
    points = centre + np.random.default_rng(7).uniform(-half_width, half_width, (200, 3))
    check_gradient(field, points, step=half_width * 1e-3)


def test_the_gradient_check_notices_a_wrong_constant() -> None:
    class Wrong(Gyroid):
        def gradient(self, points: np.ndarray) -> np.ndarray:
            return 1.001 * super().gradient(points)

    points = np.random.default_rng(7).uniform(-1, 1, (200, 3))
    with pytest.raises(AssertionError):
        check_gradient(Wrong(0.7), points, step=1e-3)


@pytest.mark.parametrize("scene", SCENES, ids=lambda scene: str(scene[0])[:40])
def test_values_and_gradients_follow_the_shape_of_the_points(scene: tuple[Field, float, float]) -> None:
    field, centre, half_width = scene
    points = centre + np.random.default_rng(1).uniform(-half_width, half_width, (2, 3, 4, 3))
    values, gradients = field.value(points), field.gradient(points)
    assert (values.shape, gradients.shape) == ((2, 3, 4), (2, 3, 4, 3))
    assert values.dtype == gradients.dtype == np.float64
    # one point alone: sums may be taken in another order, a few roundings of the field's largest terms
    np.testing.assert_allclose(field.value(points[1, 2, 3]), values[1, 2, 3], rtol=1e-12, atol=1e-15)


# a scene with a bound of its slope, and the share of the bound that its steepest point reaches at least
BOUNDED: list[tuple[Field, float, float, float]] = [
    (Constant(3.0), 0, 1, 1.0),
    (LinearRamp((1.0, -2.0, 0.5), 4.0), 0, 1, 1 - 4 * EPSILON),
    (SphereDistance((5.0, 5.0, 5.0), 0.5), 0, 1, 1 - 8 * EPSILON),
    # attained on spheres: 20000 points come closer than 0.01 to s = 1, where s exp(−s²/2) loses 1e-4
    (GaussianMixture(((0, 0, 0),), (0.3,), (-2.0,)), 0, 1, 0.999),
    (SHELL, 0, 1, 0.999),
    # attained at lattice points and on planes; cos(0.1) or so beside them
    (Gyroid(0.7), 0, 1, 0.98),
    (PlaneWaves(((3, 1, 0),), (-1.5,), (0.3,)), 0, 1, 0.999),
    # the sines of the two factors do not peak together, the waves and Gaussians not at one place
    (MarschnerLobb(), 0, 1, 0.95),
    (WAVES, 0, 1, 0.7),
    (GaussianMixture(((0, 0, 0), (0.5, 0, 0)), (0.3, 0.6), (1.0, -0.4)), 0, 1, 0.5),
    (nucleon_like(), 20, 18, 0.1),
]


def check_bound(field: Field, points: np.ndarray, share: float) -> None:
    """The steepest of `points` is between `share` of the bound and the bound, but for a few roundings."""
    bound, steepest = field.lipschitz(), np.linalg.norm(field.gradient(points), axis=-1).max()
    assert bound is not None
    assert share * bound <= steepest <= bound * (1 + 8 * EPSILON)


@pytest.mark.parametrize(
    ("field", "centre", "half_width", "share"), BOUNDED, ids=lambda scene: str(scene)[:40]
)
def test_no_slope_exceeds_its_bound_and_the_bound_is_not_far(
    field: Field, centre: float, half_width: float, share: float
) -> None:
    points = centre + np.random.default_rng(9).uniform(-half_width, half_width, (20000, 3))
    check_bound(field, points, share)


def test_the_bound_check_notices_a_bound_that_is_too_small() -> None:
    class Wrong(Gyroid):
        def lipschitz(self) -> float:
            return 0.99 * super().lipschitz()

    points = np.zeros((1, 3))  # where the bound is attained
    check_bound(Gyroid(0.7), points, 1 - 8 * EPSILON)
    with pytest.raises(AssertionError):
        check_bound(Wrong(0.7), points, 0.5)


def test_the_slope_of_an_orbital_has_no_known_bound() -> None:
    assert HydrogenOrbital(2, 1, 0).lipschitz() is None


def test_the_marschner_lobb_signal_has_its_published_values() -> None:
    field = MarschnerLobb(frequency=6.0, alpha=0.25)
    # on the axis r = 0: ρ_r = cos(12π) = 1, so f = (1 − sin(πz/2) + 0.5) / 2.5
    points = np.array([[0, 0, 0], [0, 0, 1], [0, 0, -1], [1, 0, 0]], dtype=np.float64)
    # at r = 1: cos(π/2) = 0, ρ_r = 1 as well
    np.testing.assert_allclose(field.value(points), [0.6, 0.2, 1.0, 0.6], rtol=1e-13)


def test_the_marschner_lobb_gradient_is_smooth_on_its_axis() -> None:
    gradient = MarschnerLobb().gradient(np.zeros((1, 3)))
    np.testing.assert_allclose(gradient, [[0, 0, -math.pi / 2 / 2.5]], rtol=1e-15)


def test_the_gyroid_has_its_translation_and_rotation_symmetry() -> None:
    points = np.random.default_rng(2).uniform(-1, 1, (50, 3))
    field = Gyroid(2.0)
    # 6 roundings of sines of phases below 10: each phase is off by 10 ε at most
    np.testing.assert_allclose(
        field.value(points + np.array([2, 0, -4])), field.value(points), atol=100 * EPSILON
    )
    np.testing.assert_allclose(
        field.value(np.roll(points, 1, axis=-1)), field.value(points), atol=10 * EPSILON
    )
    assert field.value(np.array([0.25, 0.5, 0.0])) == pytest.approx(1.0, abs=4 * EPSILON)


def test_plane_waves_and_shell_and_mixture_have_their_known_values() -> None:
    assert WAVES.value(np.zeros(3)) == pytest.approx(math.cos(0.3) + 0.5 * math.cos(-1.1), rel=1e-15)
    assert SHELL.value(np.array([0.7, -0.1, 0.3])) == pytest.approx(3.0, rel=1e-15)
    assert SHELL.value(np.array([0.9, -0.1, 0.3])) == pytest.approx(3 * math.exp(-0.5), rel=1e-14)
    bell = GaussianMixture(((1, 2, 3),), (2.0,), (5.0,))
    assert bell.value(np.array([1.0, 2.0, 5.0])) == pytest.approx(5 * math.exp(-0.5), rel=1e-15)


def test_sphere_distance_is_signed_and_its_gradient_at_the_centre_is_zero() -> None:
    field = SphereDistance((1, 1, 1), 2.0)
    np.testing.assert_array_equal(field.value(np.array([[1, 1, 1], [4, 1, 1], [1, 1, 3]])), [-2, 1, 0])
    np.testing.assert_array_equal(field.gradient(np.array([[1, 1, 1], [4, 1, 1]])), [[0, 0, 0], [1, 0, 0]])


def test_nucleon_like_has_two_bodies_a_ring_and_sixfold_symmetry() -> None:
    field = nucleon_like()
    points = np.random.default_rng(5).uniform(-19, 19, (100, 3))
    turn = np.array([[0.5, -math.sqrt(0.75), 0], [math.sqrt(0.75), 0.5, 0], [0, 0, 1]])
    np.testing.assert_allclose(field.value(20 + points @ turn.T), field.value(20 + points), atol=1e-13)
    centre, body, ring = field.value(np.array([[20, 20, 20], [20, 20, 9], [29.5, 20, 20]]))
    assert centre < 0.5 * ring < 0.5 * body
    volume = sample_field(field, (41, 41, 41), lower=(0, 0, 0), upper=(40, 40, 40))
    low, high = volume.value_range
    assert 0 <= low < 0.01
    assert 0.9 < high < 1.1


@pytest.mark.parametrize(("n", "l", "m"), ORBITALS)
def test_an_orbitals_largest_density_is_one(n: int, l: int, m: int) -> None:  # noqa: E741
    axis = np.linspace(-1, 1, 61) * 2 * n * n  # the outermost maximum lies within 2 n² Bohr radii
    grid = np.stack(np.meshgrid(axis, axis, axis), axis=-1)
    highest = HydrogenOrbital(n, l, m).value(grid).max()
    assert highest <= 1 + 1e-12  # about 50 roundings in the roots of the stationary points, squared
    if l:  # smooth at its maximum: half a grid step h away, the density has lost less than a tenth of it
        assert highest > 0.9 if n < 4 else highest > 0.5


def test_known_orbitals_have_their_closed_forms() -> None:
    points = np.random.default_rng(3).uniform(-3, 3, (100, 3))
    x, y, z = points.T
    r = np.linalg.norm(points, axis=1)
    np.testing.assert_allclose(HydrogenOrbital(1, 0, 0).value(points), np.exp(-2 * r), rtol=1e-13)
    d = (3 * z**2 - r**2) ** 2 * np.exp(-2 * r / 3)  # highest on the z axis at r = 6: (2·36)² e⁻⁴
    np.testing.assert_allclose(
        HydrogenOrbital(3, 2, 0).value(points), d / (72**2 * math.exp(-4)), rtol=1e-10, atol=1e-16
    )
    f = (x * y * z) ** 2 * np.exp(-r / 2)  # highest at |x| = |y| = |z|, r = 12: 12⁶/27 e⁻⁶
    np.testing.assert_allclose(
        HydrogenOrbital(4, 3, -2).value(points), f / (12**6 / 27 * math.exp(-6)), rtol=1e-10, atol=1e-16
    )


def test_a_2s_orbital_vanishes_on_its_nodal_sphere() -> None:
    assert HydrogenOrbital(2, 0, 0).value(np.array([0.0, 2.0, 0.0])) == pytest.approx(0, abs=1e-30)


@pytest.mark.parametrize(("n", "l", "m"), [(0, 0, 0), (2, 2, 0), (3, 1, -2)])
def test_impossible_quantum_numbers_are_refused(n: int, l: int, m: int) -> None:  # noqa: E741
    with pytest.raises(InputError, match="no orbital has n, l, m"):
        HydrogenOrbital(n, l, m)


def test_a_sampled_ramp_holds_the_fields_values_at_the_samples_world_positions() -> None:
    field = LinearRamp((1.0, 16.0, 256.0), 0.5)
    volume = sample_field(field, (3, 4, 5), lower=(0, 1, 2), upper=(2, 4, 6), dtype=np.float64)
    assert (volume.spacing, volume.origin, volume.size_xyz) == ((1, 1, 1), (0, 1, 2), (3, 4, 5))
    assert volume.array[4, 3, 2] == field.value(np.array([2.0, 4.0, 6.0]))
    assert volume.array[1, 2, 0] == field.value(np.array([0.0, 3.0, 3.0]))
    assert volume.name == "LinearRamp"


def test_sampling_as_integers_rounds_and_refuses_what_does_not_fit() -> None:
    ramp = LinearRamp((1.0, 0.0, 0.0), 0.6)
    volume = sample_field(ramp, (3, 2, 2), lower=(0, 0, 0), upper=(2, 1, 1), dtype=np.uint8)
    np.testing.assert_array_equal(volume.array[0, 0], [1, 2, 3])
    with pytest.raises(InputError, match=r"LinearRamp has values from -0.6 to 1.4; uint8 holds 0 to 255"):
        sample_field(ramp, (3, 2, 2), lower=(-1.2, 0, 0), upper=(0.8, 1, 1), dtype=np.uint8)


@pytest.mark.parametrize(("size", "upper"), [((1, 2, 2), (1, 1, 1)), ((2, 2, 2), (1, 0, 1))])
def test_a_degenerate_box_is_refused(size: tuple[int, int, int], upper: tuple[float, float, float]) -> None:
    with pytest.raises(InputError, match="at least 2 per axis"):
        sample_field(Constant(1.0), size, lower=(0, 0, 0), upper=upper)


def test_mixtures_and_waves_of_unequal_lists_are_refused() -> None:
    with pytest.raises(InputError, match="equally many"):
        GaussianMixture(((0, 0, 0),), (1.0, 2.0), (1.0,))
    with pytest.raises(InputError, match="equally many"):
        PlaneWaves(((0, 0, 1),), (1.0,), ())
    with pytest.raises(InputError, match="must be > 0"):
        GaussianShell((0, 0, 0), 1.0, 0.0)

"""The reference integral with light: closed forms, an independent adaptive rule, places where the gradient is 0."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from isosample.errors import CapacityError, InputError
from isosample.integral import band_walk, bernstein, cell_gradient, cell_light, lit_panels, ray_cells
from isosample.integral.cell_gradient import find_turns, slope_at
from isosample.integral.cell_light import DOUBT, TURNS, WORST, CellLight
from isosample.integral.reference import check_resolved, integrate_rays
from isosample.integral.shading import blinn_phong
from isosample.surfaces.field_kernels import sample_slope
from isosample.transfer.control_points import ControlPoint, Isosurface
from isosample.transfer.transfer_function import TransferFunction
from isosample.volume.grid import Volume
from isosample.volume.reconstruction import GridSpline, Reconstruction

if TYPE_CHECKING:
    from collections.abc import Callable

    from isosample.volume.grid import F64

U = 2.0**-53
RED, GREEN, BLUE, WHITE = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0), (1.0, 1.0, 1.0)
MATERIAL = (0.2, 0.7, 0.3, 20.0)
SMOOTH = [one for one in Reconstruction if one.smooth]
TURN = np.array([[0.8, -0.6, 0.0], [0.48, 0.64, -0.6], [0.36, 0.48, 0.8]])
PLACED: dict[str, Any] = {"spacing": (1.0, 0.5, 2.0), "origin": (1.0, -3.0, 2.0), "direction": TURN}


def noise(n: int = 5) -> Volume:
    return Volume(np.random.default_rng(3).random((n, n + 1, n + 2)), **PLACED)


def random_rays(volume: Volume, count: int, seed: int = 1) -> tuple[F64, F64]:
    rng = np.random.default_rng(seed)
    ways = rng.normal(size=(count, 3))
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    box = volume.box
    return box.corner + (0.1 + 0.8 * rng.random((count, 3))) @ box.edges - 30.0 * ways, ways


def slab(low: float, high: float, extinction: float, first: Any = RED, last: Any = BLUE) -> TransferFunction:
    return TransferFunction([ControlPoint(low, first, extinction), ControlPoint(high, last, extinction)])


# -- closed forms ---------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "reconstruction", [Reconstruction.TRILINEAR, Reconstruction.BSPLINE, Reconstruction.CUBIC]
)
@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_a_linear_field_is_lit_by_one_constant(reconstruction: Reconstruction, dtype: type) -> None:
    """c becomes c · shade + highlight everywhere, and so does the picture, with the highlight times the opacity."""
    z, y, x = np.mgrid[0:5, 0:7, 0:9]
    slopes = np.array([0.0625, 0.03125, -0.046875])  # exact in float32
    volume = Volume((np.stack([x, y, z], axis=-1) @ slopes + 0.25).astype(dtype), **PLACED)
    tf = TransferFunction(
        [ControlPoint(0.2, RED, 0.1), ControlPoint(0.5, GREEN, 0.8), ControlPoint(0.8, BLUE, 0.2)],
        [Isosurface(0.4, WHITE, 0.25)],
    )
    origins, ways = random_rays(volume, 60)
    plain = integrate_rays(volume, tf, origins, ways, reconstruction=reconstruction)
    lit = integrate_rays(volume, tf, origins, ways, reconstruction=reconstruction, material=MATERIAL)
    gradient = np.linalg.inv(volume.world_from_index)[:3, :3].T @ slopes
    normal = gradient / np.linalg.norm(gradient)
    ones, nought = (blinn_phong([c] * 3, normal, ways, MATERIAL) for c in (1.0, 0.0))
    expected = plain[:, :3] * (ones - nought) + plain[:, 3:] * nought
    # The tolerance of either picture; the light's cosine is rounded as coefficients of up to 200 times the range are.
    assert np.abs(lit[:, :3] - expected).max() <= 2e-10 + 7.0 * 400 * U
    assert np.abs(lit[:, 3] - plain[:, 3]).max() <= 400 * U
    assert np.count_nonzero(plain[:, 3] > 0.3) > 20


def squares(n: int = 9) -> Volume:
    """|x|² from the centre of a turned grid of uneven steps: central differences of it are exact, and linear."""
    volume = Volume(np.zeros((n, n, n)), **PLACED)
    k, j, i = np.mgrid[0:n, 0:n, 0:n]
    places = np.stack([i, j, k], axis=-1) - 0.5 * (n - 1)
    world = places @ volume.world_from_index[:3, :3].T
    return Volume((world**2).sum(axis=-1), **PLACED)


@pytest.mark.parametrize("miss", [0.7, 1e-3, 1e-7, 1e-12, 0.0])
@pytest.mark.parametrize(
    "material", [MATERIAL, (0.0, 1.0, 0.0, 1.0), (0.1, 0.2, 1.5, 0.5), (0.0, 0.0, 1.0, 300.0)]
)
def test_a_slab_around_a_centre_is_lit_by_the_angle_to_it(miss: float, material: tuple[float, ...]) -> None:
    """The gradient is 2 x without error, two samples from the faces: past the centre at a distance b the cosine is
    |t| / (t² + b²)^½, however the value between the samples runs, which constant optics do not show.
    """
    from scipy.integrate import quad

    volume = squares()
    centre, reach, extinction = volume.box.centre, 0.9, 0.8
    rng = np.random.default_rng(5)
    way = rng.normal(size=3)
    way /= np.linalg.norm(way)
    beside = np.cross(way, rng.normal(size=3))
    beside *= miss / np.linalg.norm(beside)
    tf = slab(-1.0, 100.0, extinction, (0.4, 0.5, 0.6), (0.4, 0.5, 0.6))
    ends = [(*way.tolist(), float(-way @ centre + reach)), (*(-way).tolist(), float(way @ centre + reach))]
    found = integrate_rays(
        volume, tf, [centre + beside - 5.0 * way], [way], clip_planes=ends, material=material
    )

    ambient, diffuse, specular, shininess = material

    def emitted(t: float, colour: float) -> float:
        cosine = 1.0 if miss == 0.0 else abs(t) / math.hypot(t, miss)
        light = colour * (ambient + diffuse * cosine) + specular * cosine**shininess
        return float(light * extinction * math.exp(-extinction * (t + reach)))

    near = [miss * 10.0**power for power in (-2, -1, 0, 1, 2, 3) if 0.0 < miss * 10.0**power < reach]
    cuts = [-reach, *[-t for t in near[::-1]], 0.0, *near, reach]
    for channel, colour in enumerate((0.4, 0.5, 0.6)):
        parts = [
            quad(emitted, a, b, colour, epsabs=1e-14, epsrel=1e-13, limit=400)[0] for a, b in pairwise(cuts)
        ]
        # 1e-10 asked for; positions up to 10 rounded, over the distance of the miss, act on that distance alone.
        assert found[0, channel] == pytest.approx(sum(parts), abs=1e-10 + 40 * U * 10)


def test_an_isosurface_is_lit_where_the_ray_crosses_it() -> None:
    """Opaque, it shows blinn_phong of its colour with the direction of the centre from the crossing."""
    from scipy.optimize import brentq

    volume = squares()
    centre = volume.box.centre
    tf = TransferFunction([], [Isosurface(0.5, (0.3, 0.6, 0.9), 1.0)])
    rng = np.random.default_rng(6)
    ways = rng.normal(size=(40, 3))
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    origins = centre + 0.2 * rng.normal(size=(40, 3)) - 4.0 * ways
    found = integrate_rays(volume, tf, origins, ways, material=MATERIAL)
    seen = 0
    for origin, way, rgba in zip(origins, ways, found, strict=True):
        middle = float((centre - origin) @ way)
        line = values_along(volume, origin, way)
        if line(middle) >= 0.5:
            continue
        crossing = origin + brentq(lambda t, line=line: line(t) - 0.5, middle - 1.2, middle, xtol=1e-15) * way
        normal = (crossing - centre) / np.linalg.norm(crossing - centre)
        # The crossing is found to 1e-14, on a sphere of radius 0.7, and a highlight of the power 20.
        assert np.abs(rgba[:3] - blinn_phong((0.3, 0.6, 0.9), normal, way, MATERIAL)).max() <= 1e-12
        seen += 1
    assert seen > 20


def test_a_gradient_counts_however_short_it_is() -> None:
    """Beside an edge whose samples have none, a weight of 1e-18 leaves that of one corner alone, along x."""
    samples = np.zeros((5, 5, 5))
    samples[2, 2, 2] = 1.0
    tf = slab(-1.0, 2.0, 0.8, WHITE, WHITE)
    ends = [(1.0, 0.0, 0.0, -0.125), (-1.0, 0.0, 0.0, 0.875)]
    found = integrate_rays(
        Volume(samples),
        tf,
        [(-3.0, 1.0 + 1e-9, 1.0 + 1e-9)],
        [(1.0, 0.0, 0.0)],
        clip_planes=ends,
        material=MATERIAL,
    )
    alpha = -math.expm1(-0.75 * 0.8)
    assert found[0] == pytest.approx([alpha * sum(MATERIAL[:3])] * 3 + [alpha], abs=1e-10)


def test_without_a_gradient_the_ambient_part_is_left() -> None:
    volume = Volume(np.full((4, 5, 6), 0.5), **PLACED)
    tf = TransferFunction(slab(0.0, 1.0, 0.4).points)
    rays = random_rays(volume, 20)
    plain = integrate_rays(volume, tf, *rays)
    lit = integrate_rays(volume, tf, *rays, material=MATERIAL)
    assert np.abs(lit[:, :3] - MATERIAL[0] * plain[:, :3]).max() <= 20 * U
    assert plain[:, 3].max() > 0.3


# -- against an independent rule ------------------------------------------------------------------


def values_along(volume: Volume, origin: F64, way: F64) -> Callable[[float], float]:
    """The trilinear field at a distance along a ray."""
    index_from_world = np.linalg.inv(volume.world_from_index)

    def value(t: float) -> float:
        place = index_from_world[:3, :3] @ (origin + t * way) + index_from_world[:3, 3]
        return float(interpolated(np.asarray(volume.array, dtype=np.float64)[..., None], place[None])[0, 0])

    return value


def interpolated(samples: F64, places: F64) -> F64:
    """(N, C) components of samples (Z, Y, X, C) at places (N, 3), by the eight weights."""
    cell = np.clip(np.floor(places).astype(int), 0, np.array(samples.shape[2::-1]) - 2)
    fraction, total = places - cell, 0.0
    for corner in np.ndindex(2, 2, 2):
        weight = np.prod(np.where(np.array(corner) == 1, fraction, 1.0 - fraction), axis=1)
        i, j, k = (cell + corner).T
        total = total + weight[:, None] * samples[k, j, i]
    return np.asarray(total)


def value_and_gradient(volume: Volume, reconstruction: Reconstruction) -> Callable[[F64], tuple[F64, F64]]:
    """Field and world gradient at places in sample indices, without any of the code under test."""
    matrix = np.linalg.inv(volume.world_from_index)[:3, :3]
    samples = np.asarray(volume.array, dtype=np.float64)
    if reconstruction.smooth:
        spline = GridSpline.build(volume, reconstruction)

        def smooth(places: F64) -> tuple[F64, F64]:
            values, gradients = spline.evaluate(places)
            return values, gradients @ matrix

        return smooth
    differences = np.gradient(samples)  # central, one-sided at the faces
    table = np.stack([samples, *differences[::-1]], axis=-1)

    def trilinear(places: F64) -> tuple[F64, F64]:
        four = interpolated(table, places)
        return four[:, 0], four[:, 1:] @ matrix

    return trilinear


def integral_by_quad(
    volume: Volume, tf: TransferFunction, ray: tuple[F64, F64], reconstruction: Reconstruction
) -> F64:
    """Lit RGB of one ray through a volume whose values all lie in one band, by scipy's adaptive rule, cell by cell."""
    from scipy.integrate import quad

    origin, way = ray
    inverse = np.linalg.inv(volume.world_from_index)
    o, d = inverse[:3, :3] @ origin + inverse[:3, 3], inverse[:3, :3] @ way
    last = np.array(volume.size_xyz) - 1.0
    near, far = np.minimum(-o / d, (last - o) / d).max(), np.maximum(-o / d, (last - o) / d).min()
    planes = np.concatenate([(np.arange(n) - o[i]) / d[i] for i, n in enumerate(volume.size_xyz)])
    cuts = np.unique([near, far, *planes[(planes > near) & (planes < far)]])
    field = value_and_gradient(volume, reconstruction)
    nodes, weights = np.polynomial.legendre.leggauss(6)

    def at(t: F64) -> tuple[F64, F64]:
        return field(np.clip(o + np.atleast_1d(t)[:, None] * d, 0.0, last))

    def depth(low: float, high: float) -> float:
        places = low + 0.5 * (nodes + 1.0) * (high - low)
        return float(0.5 * (high - low) * (weights @ tf.evaluate(at(places)[0])[1]))

    def along(t: float) -> float:
        return float(at(np.array([t]))[1][0] @ way)

    rgb, total = np.zeros(3), 0.0
    for low, high in pairwise(cuts):

        def emitted(t: float, channel: int, low: float = low) -> float:
            values, gradients = at(np.array([t]))
            color, extinction = tf.evaluate(values)
            lit = blinn_phong(color, gradients / np.linalg.norm(gradients), way, MATERIAL)
            return float(lit[0, channel] * extinction[0] * math.exp(-depth(low, t)))

        kinks = sign_changes(along, low, high)
        for a, b in pairwise([low, *kinks, high]):
            part = [
                quad(emitted, a, b, channel, epsabs=1e-12, epsrel=1e-12, limit=200)[0] for channel in range(3)
            ]
            rgb += math.exp(-total) * np.array(part)
        total += depth(low, high)
    return rgb


def sign_changes(function: Callable[[float], float], low: float, high: float) -> list[float]:
    """Zeros between 50 places."""
    from scipy.optimize import brentq

    places = np.linspace(low, high, 51)
    values = [function(t) for t in places]
    return [
        brentq(function, a, b, xtol=1e-15)
        for (a, b), (f, g) in zip(pairwise(places), pairwise(values), strict=True)
        if f * g < 0.0
    ]


@pytest.mark.parametrize("reconstruction", Reconstruction)
def test_adaptive_quadrature_of_noise_agrees(reconstruction: Reconstruction) -> None:
    """Values, colours, extinction and gradients all vary; 6 nodes are exact for the depth of 9 degrees."""
    volume = noise(3)
    tf = TransferFunction([ControlPoint(-2.0, RED, 0.0), ControlPoint(3.0, GREEN, 1.5)])
    origins, ways = random_rays(volume, 4, seed=8)
    found = integrate_rays(volume, tf, origins, ways, reconstruction=reconstruction, material=MATERIAL)
    expected = [integral_by_quad(volume, tf, ray, reconstruction) for ray in zip(origins, ways, strict=True)]
    # 1e-10 asked for; positions up to 40 and gradients of 10 per unit are rounded, times a light of 7 per radian.
    assert np.abs(found[:, :3] - expected).max() <= 1e-10 + 100 * 40 * 10 * 7 * U
    assert np.abs(found[:, :3]).max() > 0.1


# -- tolerance ------------------------------------------------------------------------------------

EVERYTHING = TransferFunction(
    [
        ControlPoint(0.1, RED, 0.2),
        ControlPoint(0.3, GREEN, 0.2),
        ControlPoint(0.5, BLUE, 4.0),
        ControlPoint(0.9, BLUE, 1.0),
    ],
    [Isosurface(0.35, WHITE, 0.3)],
)


@pytest.mark.parametrize("reconstruction", [Reconstruction.TRILINEAR, Reconstruction.CUBIC])
@pytest.mark.parametrize("tolerance", [1e-3, 1e-6, 1e-10])
@pytest.mark.parametrize("thickness", [0.1, 1.0, 1e4])
def test_the_tolerance_is_kept(tolerance: float, thickness: float, reconstruction: Reconstruction) -> None:
    points = [ControlPoint(p.value, p.color, thickness * p.extinction) for p in EVERYTHING.points]
    surfaces = EVERYTHING.isosurfaces if reconstruction is Reconstruction.TRILINEAR else []
    tf, volume = TransferFunction(points, surfaces), noise()
    rays = random_rays(volume, 100)
    given: dict[str, Any] = {"material": MATERIAL, "reconstruction": reconstruction}
    found = integrate_rays(volume, tf, *rays, tolerance=tolerance, **given)
    exact = integrate_rays(volume, tf, *rays, tolerance=1e-11, panels=3, **given)
    rounding = 2e-13  # some 200 pieces per ray; the light changes by up to 7 per change of the normal
    assert np.abs(found - exact).max() < tolerance + 1e-11 + rounding
    assert np.abs(exact[:, :3]).max() > 0.05


def test_opacity_does_not_change_with_light() -> None:
    volume = noise()
    rays = random_rays(volume, 60)
    plain, lit = (integrate_rays(volume, EVERYTHING, *rays, material=m) for m in (None, MATERIAL))
    assert np.abs(plain[:, 3] - lit[:, 3]).max() <= 400 * U  # other panels, other roundings
    assert np.abs(plain[:, :3] - lit[:, :3]).max() > 0.05


def test_light_that_is_ambient_alone_leaves_the_picture() -> None:
    volume = noise()
    rays = random_rays(volume, 60)
    plain, lit = (integrate_rays(volume, EVERYTHING, *rays, material=m) for m in (None, (1.0, 0.0, 0.0, 1.0)))
    assert np.abs(plain - lit).max() <= 2e-10


def test_what_stays_unresolved_is_never_returned() -> None:
    light = CellLight.build(np.array(MATERIAL), np.eye(4), 1e-10)
    rays = (np.zeros((1, 3)), np.ones((1, 3)), np.zeros((1, 2)))
    check_resolved(light, rays)
    light.numbers[WORST] = 0.6e-10
    with pytest.raises(
        CapacityError, match=r"to within 6.0e-11 only.*5.0e-11, may be left.*larger tolerance"
    ):
        check_resolved(light, rays)


def test_a_ray_that_stops_short_adds_up_what_it_leaves(monkeypatch: pytest.MonkeyPatch) -> None:
    """With a rule of which nothing agrees, every piece is left as it is; the sum of what they may err by is told."""
    plain_python(monkeypatch)
    monkeypatch.setattr(lit_panels, "_agree", lambda *_: False)
    monkeypatch.setattr(lit_panels, "STOP_SHARE", 1.0)
    tf = slab(-1.0, 100.0, 0.8)
    volume = squares(3)
    with pytest.raises(CapacityError, match="as the gradient vanishes there"):
        integrate_rays(
            volume,
            tf,
            [volume.box.centre - [5.0, 0.1, 0.2]],
            [(1.0, 0.0, 0.0)],
            material=MATERIAL,
            tolerance=1e-2,
        )


TURNS_OF = {
    "none": ([], []),
    "one": ([0.3], [0.3]),
    "in the middle, where it is halved": ([0.5], [0.5]),
    "where it is halved again, with others": ([0.25, 0.5, 0.875], [0.25, 0.5, 0.875]),
    "close together": ([0.4, 0.4 + 1e-5, 0.9], [0.4, 0.4 + 1e-5, 0.9]),
    "a double zero is none": ([0.5, 0.5], []),
    "outside": ([-0.2, 1.3, 0.6], [0.6]),
}


@pytest.mark.parametrize("degree", [3, 9])
@pytest.mark.parametrize("case", TURNS_OF)
def test_turns_are_the_zeros_at_which_the_sign_changes(case: str, degree: int) -> None:
    """A root of a polynomial with coefficients below 1 is found to rounding over its slope."""
    zeros, expected = TURNS_OF[case]
    light = CellLight.build(np.array(MATERIAL), np.eye(4), 1e-10, None if degree == 3 else np.zeros((4, 4)))
    powers = np.zeros(degree + 1)
    factors = np.polynomial.polynomial.polyfromroots(zeros) if zeros else np.ones(1)
    powers[: len(factors)] = factors
    for i in range(degree + 1):  # from powers to Bernstein's basis
        parts = [math.comb(i, j) / math.comb(degree, j) * powers[j] for j in range(i + 1)]
        light.gradient[3, i] = math.fsum(parts)
    light.numbers[DOUBT] = 16 * U
    find_turns(light)
    found = light.turns[: int(light.numbers[TURNS])]
    assert found.tolist() == pytest.approx(expected, abs=1e-9 if case == "close together" else 1e-13)


# -- samples that are not there -------------------------------------------------------------------


def test_slopes_at_samples_are_those_of_the_meshes() -> None:
    """At faces and beside NaN; the meshes' samples have a border of NaN. `sample_slope` is held by tests of its own."""
    rng = np.random.default_rng(9)
    samples = rng.random((4, 5, 6))
    samples[rng.random(samples.shape) < 0.3] = np.nan
    padded = np.pad(samples, 1, constant_values=np.nan)
    for k, j, i in np.ndindex(samples.shape):
        if np.isnan(samples[k, j, i]):
            continue
        for axis in range(3):
            assert slope_at(samples, (i, j, k), axis) == sample_slope(padded, k, j, i, axis)


def test_beside_masked_cells_a_linear_field_keeps_its_light() -> None:
    """One-sided differences of it are exact too."""
    z, y, x = np.mgrid[0:6, 0:7, 0:8]
    samples = 0.1 * x + 0.02 * y - 0.03 * z + 0.3
    samples[2, 3, 4] = np.nan
    volume, tf = Volume(samples, **PLACED), slab(0.0, 1.5, 0.6)
    rays = random_rays(volume, 60)
    plain, lit = (integrate_rays(volume, tf, *rays, material=m) for m in (None, MATERIAL))
    gradient = np.linalg.inv(volume.world_from_index)[:3, :3].T @ [0.1, 0.02, -0.03]
    normal = gradient / np.linalg.norm(gradient)
    ones, nought = (blinn_phong([c] * 3, normal, rays[1], MATERIAL) for c in (1.0, 0.0))
    assert np.abs(lit[:, :3] - plain[:, :3] * (ones - nought) - plain[:, 3:] * nought).max() <= 2e-10
    whole = integrate_rays(Volume(np.nan_to_num(samples, nan=0.69), **PLACED), tf, *rays)
    assert np.abs(whole - plain).max() > 1e-3  # some rays meet the hole


# -- the rest -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("material", "tolerance", "message"),
    [
        ((0.1, 0.2, 0.3), 1e-10, r"material has shape \(3,\); expected \(..., 4\)"),
        (np.ones((2, 4)), 1e-10, r"material has shape \(2, 4\); expected \(4,\)"),
        ((0.1, -0.2, 0.3, 1.0), 1e-10, "material is -0.2 at index 1; expected finite and >= 0"),
        ((0.1, 0.2, 0.3, 1.0), 1e-13, "tolerance 1e-13 is below 1e-12"),
    ],
)
def test_a_wrong_material_is_refused(material: Any, tolerance: float, message: str) -> None:
    with pytest.raises(InputError, match=message):
        integrate_rays(
            noise(), EVERYTHING, [(0.0, 0.0, -5.0)], [(0.0, 0.0, 1.0)], material=material, tolerance=tolerance
        )


def plain_python(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Let the kernels run as Python."""
    names = []
    for module in (band_walk, bernstein, cell_gradient, cell_light, lit_panels, ray_cells):
        for name, entry in list(vars(module).items()):
            if hasattr(entry, "py_func"):
                monkeypatch.setattr(module, name, entry.py_func)
                names.append(name)
    return names


def test_the_kernels_do_in_python_what_they_do_compiled(monkeypatch: pytest.MonkeyPatch) -> None:
    volume = noise(3)
    rays = random_rays(volume, 3)
    compiled = integrate_rays(volume, EVERYTHING, *rays, material=MATERIAL, tolerance=1e-6)
    assert "lit_panel" in plain_python(monkeypatch)
    plain = integrate_rays(volume, EVERYTHING, *rays, material=MATERIAL, tolerance=1e-6)
    # The same operations in the same order; exp, expm1 and pow may come from another library, 1 ulp off.
    assert np.abs(plain - compiled).max() <= 1000 * 2.0**-52

"""The reference integral against other ways to compute it, and against itself with more panels."""

from __future__ import annotations

import math
import subprocess
import sys
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
import pytest

from isosample.integral import band_walk, cell_cubic, cell_grid, ray_cells
from isosample.integral.band_table import PanelRules
from isosample.integral.reference import integrate_rays
from isosample.transfer.control_points import ControlPoint, Isosurface
from isosample.transfer.transfer_function import TransferFunction
from isosample.volume.grid import Volume

if TYPE_CHECKING:
    from isosample.volume.grid import F64

RED, GREEN, BLUE, WHITE = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0), (1.0, 1.0, 1.0)
EVERYTHING = TransferFunction(
    [
        ControlPoint(0.2, RED, 0.0),
        ControlPoint(0.5, GREEN, 3.0),
        ControlPoint(0.6, BLUE, 0.5),
        ControlPoint(0.6, WHITE, 2.0),
        ControlPoint(0.9, (0.0, 1.0, 1.0), 0.1),
    ],
    [Isosurface(0.45, (1.0, 0.5, 0.0), 0.3)],
)


def noise(n: int = 6) -> Volume:
    return Volume(np.random.default_rng(0).random((n, n, n)))


def rays_through(volume: Volume, count: int) -> tuple[F64, F64]:
    rng = np.random.default_rng(1)
    target = rng.random((count, 3)) * (np.array(volume.size_xyz) - 1)
    directions = rng.normal(size=(count, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    return target - 20.0 * directions, directions


def trilinear(samples: F64, points: F64) -> F64:
    """Trilinear interpolation at (x, y, z) in sample indices, written out."""
    cell = np.clip(np.floor(points).astype(int), 0, np.array(samples.shape[::-1]) - 2)
    u = points - cell
    total = np.zeros(len(points))
    for corner in range(8):
        bits = np.array([corner & 1, corner >> 1 & 1, corner >> 2])
        x, y, z = (cell + bits).T
        total += samples[z, y, x] * np.prod(np.where(bits, u, 1.0 - u), axis=1)
    return total


def riemann_sum(volume: Volume, tf: TransferFunction, origin: F64, way: F64, step: float) -> tuple[F64, int]:
    """Brute force: one sample in the middle of every step; also the number of steps with a jump in them."""
    with np.errstate(divide="ignore"):
        faces = np.stack([-origin / way, (np.array(volume.size_xyz) - 1 - origin) / way])
    start, end = faces.min(axis=0).max(), faces.max(axis=0).min()
    count = math.ceil((end - start) / step)
    length = (end - start) / count
    t = start + (np.arange(count) + 0.5) * length
    values = trilinear(volume.array.astype(np.float64), origin + t[:, None] * way)
    color, extinction = tf.evaluate(values)
    layers = np.zeros((2 * count, 4))
    layers[::2] = -np.expm1(-extinction * length)[:, None] * np.concatenate(
        [color, np.ones((count, 1))], axis=1
    )
    jumps = 0
    for surface in tf.isosurfaces:
        crossed = np.flatnonzero((values[1:] >= surface.value) != (values[:-1] >= surface.value))
        layers[2 * crossed + 1] = surface.opacity * np.array([*surface.color, 1.0])
        jumps += len(crossed)
    for value in (0.2, 0.6, 0.9):
        jumps += int(np.count_nonzero((values[1:] >= value) != (values[:-1] >= value)))
    through = np.concatenate([[1.0], np.cumprod(1.0 - layers[:, 3])[:-1]])
    return through @ layers, jumps


def test_a_riemann_sum_of_tiny_steps_approaches_it() -> None:
    volume = noise()
    origins, directions = rays_through(volume, 30)
    rgba = integrate_rays(volume, EVERYTHING, origins, directions)
    largest = {}
    for step in (0.02, 0.002):
        errors = []
        for origin, way, exact in zip(origins, directions, rgba, strict=True):
            brute, jumps = riemann_sum(volume, EVERYTHING, origin, way, step)
            # Each jump of extinction or colour, and each impulse, lies up to one step off its place: depth
            # (at most 3 per voxel) and light change by 3 steps. In between the midpoint rule errs by
            # length · step² / 24 · max |(cτ)''| with |f'| < 3, |f''| < 6: below 10 · step² · 100.
            assert np.abs(brute - exact).max() <= 3.0 * step * (jumps + 1) + 1e3 * step**2
            errors.append(np.abs(brute - exact).max())
        largest[step] = max(errors)
    assert largest[0.002] < 0.25 * largest[0.02]
    assert largest[0.002] < 2e-3


def integral_by_quad(tf: TransferFunction, field: np.polynomial.Polynomial, length: float) -> F64:
    """RGBA of a cubic over [0, 1] by scipy's adaptive rule, between the places of jumps and bends."""
    from scipy.integrate import quad

    nodes, weights = np.polynomial.legendre.leggauss(6)
    roots = np.concatenate([(field - point.value).roots() for point in tf.points])
    inside = roots.real[(np.abs(roots.imag) < 1e-9) & (roots.real > 0) & (roots.real < 1)]
    cuts = [0.0, *sorted(inside.tolist()), 1.0]

    def optics(s: F64) -> tuple[F64, F64]:
        return tf.evaluate(field(s))

    def depth(low: float, high: float) -> float:
        places = low + 0.5 * (nodes + 1.0) * (high - low)
        return float(0.5 * (high - low) * length * (weights @ optics(places)[1]))

    def light(s: float, low: float, channel: int) -> float:
        color, extinction = optics(np.array([s]))
        return float(color[0, channel] * extinction[0] * math.exp(-depth(low, s)))

    rgb, total = np.zeros(3), 0.0
    for low, high in pairwise(cuts):
        part = [quad(light, low, high, (low, channel), epsabs=1e-12)[0] for channel in range(3)]
        rgb += math.exp(-total) * length * np.array(part)
        total += depth(low, high)
    return np.array([*rgb, -math.expm1(-total)])


def test_adaptive_quadrature_of_one_cell_agrees() -> None:
    rng = np.random.default_rng(7)
    tf = TransferFunction(EVERYTHING.points)
    thirds = np.linspace(0.0, 1.0, 4)
    for _ in range(8):
        samples = rng.random((2, 2, 2))
        p, q = rng.random(3), rng.random(3)
        axis = rng.integers(3)
        p[axis], q[axis] = 0.0, 1.0
        length = float(np.linalg.norm(q - p))
        way = (q - p) / length
        field = np.polynomial.Polynomial.fit(thirds, trilinear(samples, p + thirds[:, None] * (q - p)), 3)
        expected = integral_by_quad(tf, field, length)
        planes = [(*way.tolist(), float(-way @ p)), (*(-way).tolist(), float(way @ q))]
        rgba = integrate_rays(Volume(samples), tf, [p - way], [way], clip_planes=planes)[0]
        # Roots of the companion matrix are good to about 1e-11 here; a jump of 1.5 per voxel acts on that.
        assert np.abs(rgba - expected).max() <= 2e-10


@pytest.mark.parametrize("tolerance", [1e-3, 1e-6, 1e-10, 1e-13])
@pytest.mark.parametrize("thickness", [0.1, 1.0, 30.0, 1e5])
def test_halving_the_panels_changes_less_than_the_tolerance(tolerance: float, thickness: float) -> None:
    points = [ControlPoint(p.value, p.color, thickness * p.extinction) for p in EVERYTHING.points]
    tf = TransferFunction(points, EVERYTHING.isosurfaces)
    volume = noise()
    rays = rays_through(volume, 100)
    rgba = integrate_rays(volume, tf, *rays, tolerance=tolerance)
    halved = integrate_rays(volume, tf, *rays, tolerance=tolerance, panels=2)
    many = integrate_rays(volume, tf, *rays, tolerance=1e-13, panels=8)
    rounding = 2e-14  # some 200 panels and roots per ray, each rounded to 2^-53 of the light that is left
    assert np.abs(rgba - halved).max() < tolerance + rounding
    assert np.abs(rgba - many).max() < tolerance + rounding
    assert rgba[:, 3].min() < 1.0
    assert rgba[:, 3].max() > 0.05


def test_a_dropped_half_of_the_depth_is_seen_by_halving(monkeypatch: pytest.MonkeyPatch) -> None:
    """A fault in the rules (integrals of the Bernstein polynomials off by a factor) does not converge."""
    right = PanelRules.for_tolerance(1e-10)
    wrong = right._replace(integrals=0.5 * right.integrals)
    monkeypatch.setattr(PanelRules, "for_tolerance", lambda tolerance: wrong if tolerance else right)
    rays = rays_through(noise(), 20)
    rgba, halved = (integrate_rays(noise(), EVERYTHING, *rays, panels=panels) for panels in (1, 2))
    with pytest.raises(AssertionError):
        assert np.abs(rgba - halved).max() < 1e-10


@pytest.mark.parametrize("dtype", ["u1", ">i2", "f2", "f4", "i4"])
def test_every_sample_type_gives_the_picture_of_its_float64_copy(dtype: str) -> None:
    samples = np.random.default_rng(3).integers(0, 100, (10, 4, 5)).astype(dtype)
    tf = TransferFunction(
        [ControlPoint(20.0, RED, 0.0), ControlPoint(70.0, BLUE, 2.0)], [Isosurface(55.0, GREEN, 0.3)]
    )
    volume = Volume(samples)
    rays = rays_through(volume, 20)
    exact = integrate_rays(Volume(samples.astype(np.float64)), tf, *rays)
    assert np.array_equal(integrate_rays(volume, tf, *rays), exact)
    assert exact[:, 3].max() > 0.1


def test_the_kernels_do_in_python_what_they_do_compiled(monkeypatch: pytest.MonkeyPatch) -> None:
    volume = noise(10)
    rays = rays_through(volume, 4)
    compiled = integrate_rays(volume, EVERYTHING, *rays)
    calls = []
    for module in (band_walk, cell_cubic, cell_grid, ray_cells):
        for name, entry in list(vars(module).items()):
            if hasattr(entry, "py_func"):
                monkeypatch.setattr(module, name, entry.py_func)
                calls.append(name)
    assert "integrate_ray_block" in calls
    plain = integrate_rays(volume, EVERYTHING, *rays)
    # The same operations in the same order; exp and expm1 may come from another library, 1 ulp off.
    assert np.abs(plain - compiled).max() <= 200 * 2.0**-52


@pytest.mark.parametrize("module", ["isosample", "isosample.integral.reference"])
def test_importing_does_not_import_numba(module: str) -> None:
    code = f"import sys, {module}; sys.exit('numba' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0

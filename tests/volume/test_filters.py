"""Filters: heat spreads as far in world units along every axis, edges stay, placements too, bad input is refused."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from isosample.errors import InputError, MissingDependencyError
from isosample.volume import diffusion_kernels, filters
from isosample.volume.filters import anisotropic_diffusion, gaussian, longest_time_step, median
from isosample.volume.grid import Volume

if TYPE_CHECKING:
    from collections.abc import Callable

    from isosample.volume.grid import F64

UNIT = 2.0**-24
SPACINGS = [(1.0, 1.0, 1.0), (0.5, 0.5, 0.5), (0.8, 1.0, 2.5)]
FILTERS: dict[str, Callable[..., Volume]] = {
    "diffusion": lambda volume, **more: anisotropic_diffusion(volume, iterations=2, **more),
    "gaussian": lambda volume, **more: gaussian(volume, 1.0, **more),
    "median": lambda volume, **more: median(volume, 1.0, **more),
}
TURN = np.array([[0.8, -0.36, -0.48], [0.6, 0.48, 0.64], [0.0, -0.8, 0.6]])


def impulse(spacing: tuple[float, float, float], half: int = 20) -> Volume:
    samples = np.zeros((2 * half + 1,) * 3, dtype=np.float32)
    samples[half, half, half] = 1.0
    return Volume(samples, spacing=spacing)


def floats(volume: Volume) -> F64:
    return volume.array.astype(np.float64)


def second_moments(volume: Volume) -> F64:
    """Along x, y, z [world²], of samples whose centre is the middle one."""
    samples = floats(volume)
    steps = [np.arange(count) - (count - 1) / 2.0 for count in volume.size_xyz]
    return np.array(
        [
            (
                samples.sum(axis=tuple(other for other in range(3) if other != 2 - axis)) * steps[axis] ** 2
            ).sum()
            * volume.spacing[axis] ** 2
            / samples.sum()
            for axis in range(3)
        ]
    )


@pytest.mark.parametrize("spacing", SPACINGS)
def test_without_edges_the_diffusion_is_the_heat_equation(spacing: tuple[float, float, float]) -> None:
    """With a large conductance: an explicit step adds 2 Δt to the second moment along every axis, in world units."""
    volume = impulse(spacing)
    step = 0.5 * longest_time_step(volume)
    iterations = 8
    warm = anisotropic_diffusion(volume, conductance=1e4, iterations=iterations, time_step=step)
    # The conductance exp(−|∇f|² / (2 k² s²)) is above 1 − N / (2 k²), as no slope exceeds √N times the typical one.
    # Float32 is rounded once per step and sample, whose weight is at most 20² of steps.
    tolerance = volume.array.size / 2e8 + iterations * UNIT * 400.0
    assert second_moments(warm) == pytest.approx(2.0 * step * iterations, rel=tolerance)
    assert warm.array.sum(dtype=np.float64) == pytest.approx(1.0, abs=iterations * UNIT * 8)


def test_a_wrong_use_of_the_spacing_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    """As in ITK: divided by the spacing once."""
    right = diffusion_kernels.diffuse_layers

    def once(field: Any, result: Any, first: int, last: int, inverse: F64, *more: float) -> None:
        right(field, result, first, last, np.sqrt(inverse), *more)

    monkeypatch.setattr(diffusion_kernels, "diffuse_layers", once)
    with pytest.raises(AssertionError):
        test_without_edges_the_diffusion_is_the_heat_equation((0.8, 1.0, 2.5))


def test_on_a_spacing_of_one_the_diffusion_is_that_of_itk() -> None:
    sitk = pytest.importorskip("SimpleITK")
    samples = np.random.default_rng(1).random((9, 10, 11)).astype(np.float32)
    samples[:, :, 5:] += 3.0
    theirs = sitk.GradientAnisotropicDiffusionImageFilter()
    theirs.SetTimeStep(0.0625)
    theirs.SetNumberOfIterations(5)
    theirs.SetConductanceParameter(1.0)
    expected = sitk.GetArrayFromImage(theirs.Execute(sitk.GetImageFromArray(samples)))
    found = anisotropic_diffusion(Volume(samples), time_step=0.0625, iterations=5, conductance=1.0).array
    assert np.abs(expected - samples).max() > 0.1
    # Five steps in float32 of numbers below 4; ITK's slopes and exponents are float32 too, some 20 roundings a step.
    assert np.abs(found.astype(np.float64) - expected).max() <= 5 * 20 * UNIT * 4.0


def test_the_default_step_is_what_itk_recommends_on_a_spacing_of_one() -> None:
    samples = np.random.default_rng(2).random((5, 6, 7)).astype(np.float32)
    default = anisotropic_diffusion(Volume(samples)).array
    assert np.array_equal(default, anisotropic_diffusion(Volume(samples), time_step=1.0 / 16.0).array)


def test_noise_is_smoothed_and_edges_stay() -> None:
    """A step of height 10 in noise of 0.1: the noise falls below half, the edge keeps its height and its place."""
    rng = np.random.default_rng(3)
    samples = np.where(np.arange(24) < 12, 0.0, 10.0) + 0.1 * rng.normal(size=(16, 16, 24))
    smooth = anisotropic_diffusion(Volume(samples), conductance=0.5, iterations=10).array
    assert smooth[:, :, 2:10].std() < 0.5 * samples[:, :, 2:10].std()
    edge = smooth[:, :, 12].mean() - smooth[:, :, 11].mean()
    assert edge == pytest.approx(10.0, abs=0.1)
    blurred = gaussian(Volume(samples), 1.0).array
    assert blurred[:, :, 12].mean() - blurred[:, :, 11].mean() < 5.0


def test_no_sample_leaves_the_range_with_the_longest_step() -> None:
    samples = np.random.default_rng(4).random((7, 8, 9)).astype(np.float32)
    volume = Volume(samples, spacing=(0.5, 1.0, 3.0))
    smooth = anisotropic_diffusion(
        volume, conductance=1e3, iterations=30, time_step=longest_time_step(volume)
    )
    assert samples.min() - 30 * UNIT <= smooth.array.min()
    assert smooth.array.max() <= samples.max() + 30 * UNIT


def test_the_parts_of_the_threads_make_no_difference(monkeypatch: pytest.MonkeyPatch) -> None:
    volume = Volume(np.random.default_rng(5).random((9, 5, 6)))
    whole = floats(anisotropic_diffusion(volume, iterations=3))
    monkeypatch.setattr(filters, "_parts", lambda layers: [(n, n + 1) for n in range(layers)])
    # The mean square is summed in another order: 1e-15 of the exponent.
    assert np.abs(floats(anisotropic_diffusion(volume, iterations=3)) - whole).max() <= 3 * 2 * UNIT


def test_the_compiled_diffusion_computes_what_its_source_says(monkeypatch: pytest.MonkeyPatch) -> None:
    volume = Volume(np.random.default_rng(6).random((3, 4, 3)), spacing=(1.0, 2.0, 0.5))
    expected = floats(anisotropic_diffusion(volume, iterations=2))
    for name in ("slope_at", "flux_behind", "diffuse_layers", "squared_slopes"):
        monkeypatch.setattr(diffusion_kernels, name, getattr(diffusion_kernels, name).py_func)
    assert np.abs(floats(anisotropic_diffusion(volume, iterations=2)) - expected).max() <= 4 * UNIT


@pytest.mark.parametrize("spacing", SPACINGS)
def test_a_gaussian_is_as_wide_in_world_units_along_every_axis(spacing: tuple[float, float, float]) -> None:
    sigma = 1.3
    wide = gaussian(impulse(spacing, half=24), sigma)
    # The kernel is cut off where 1e-6 of its sum is left, at most 8 sigma away: 64e-6 of the variance.
    assert second_moments(wide) == pytest.approx(sigma**2, rel=65e-6)
    assert wide.array.sum(dtype=np.float64) == pytest.approx(1.0, abs=1e-6)


def heat_kernel(sigma: float, count: int) -> F64:
    """T(k) for |k| <= count, as the inverse Fourier transform of exp(σ² (cos θ − 1)): no Bessel function."""
    length = 4 * count
    angles = 2.0 * np.pi * np.arange(length // 2 + 1) / length
    exponent = np.maximum(sigma**2 * (np.cos(angles) - 1.0), -700.0)  # e^-700 is nothing, and no underflow
    ring = np.fft.irfft(np.exp(exponent), n=length)
    return np.concatenate([ring[-count:], ring[: count + 1]])


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("sigma", [0.05, 0.3, 1.0, 2.0, 4.0, 8.0, 12.0, 16.0, 26.0, 37.0, 50.0, 64.0, 256.0])
def test_an_impulse_becomes_the_closed_form_of_the_heat_kernel(sigma: float, axis: int) -> None:
    """Along one axis; along the others the samples are so far apart that nothing spreads (σ² / 10⁸ of it)."""
    count = 8 + int(6 * sigma)
    shape, spacing = [3, 3, 3], [1e4 * sigma] * 3
    shape[axis], spacing[axis] = 2 * count + 1, 1.0
    samples = np.zeros(shape, dtype=np.float32)
    middle = tuple(edge // 2 for edge in shape)
    samples[middle] = 1.0
    smooth = gaussian(Volume(samples, spacing=(spacing[2], spacing[1], spacing[0])), sigma)
    line = np.moveaxis(floats(smooth), axis, 0)[:, 1, 1]
    expected = heat_kernel(sigma, count)
    # What is cut off, 1e-6 of the sum, goes to the others in proportion; three roundings; 2e-8 leaves for the sides.
    # Of the tail of 5e-7 at either end a weight is at most all or, by Mills' ratio at 4.9 sigma, 5.2 / sigma.
    cut = 5e-7 * min(1.0, 5.2 / sigma)
    assert np.abs(line - expected).max() <= (1e-6 + 3 * UNIT + 2e-8) * expected.max() + cut
    assert line.sum() == pytest.approx(1.0, abs=1e-6)


def test_a_wrong_kernel_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    """That of sampled values exp(−k² / 2 σ²), whose variance is wrong where σ is small."""
    from isosample.volume import discrete_gaussian

    def sampled(sigma: float) -> F64:
        values = np.exp(-0.5 * (np.arange(-9.0, 10.0) / max(sigma, 0.25)) ** 2)
        weights: F64 = values / values.sum()
        return weights

    monkeypatch.setattr(discrete_gaussian, "discrete_gaussian", sampled)
    with pytest.raises(AssertionError):
        test_an_impulse_becomes_the_closed_form_of_the_heat_kernel(0.3, 0)


def test_the_samples_of_the_border_go_on_behind_it() -> None:
    """A step that goes on to infinity on both sides, although the kernel is far wider than the box."""
    samples = np.zeros((4, 5, 40), dtype=np.uint8)
    samples[:, :, 20:] = 200
    smooth = gaussian(Volume(samples), 30.0).array
    kernel = heat_kernel(30.0, 200)
    expected = np.array([200.0 * kernel[200 + 20 - n :].sum() for n in range(40)])
    assert np.abs(smooth[2, 2] - expected).max() <= 200 * 3e-6


def test_the_parts_of_the_gaussian_make_no_difference(monkeypatch: pytest.MonkeyPatch) -> None:
    from isosample.volume import discrete_gaussian

    volume = Volume(np.random.default_rng(9).random((5, 6, 7)))
    whole = gaussian(volume, 1.5).array
    monkeypatch.setattr(discrete_gaussian, "PART_SAMPLES", 1)
    assert np.array_equal(gaussian(volume, 1.5).array, whole)


@pytest.mark.parametrize("dtype", [np.uint8, np.int16, np.float16, np.float32, np.float64])
def test_a_median_is_that_of_the_box(dtype: type[np.generic]) -> None:
    """Against scipy; the box has 3 x 3 samples in a slice and none above it, where slices are 2.5 apart."""
    pytest.importorskip("SimpleITK")
    from scipy.ndimage import median_filter

    samples = (np.random.default_rng(7).random((5, 6, 7)) * 100).astype(dtype)
    found = median(Volume(samples, spacing=(1.0, 0.9, 2.5)), 1.0).array
    assert found.dtype == samples.dtype
    expected = median_filter(samples.astype(np.float64), size=(1, 3, 3), mode="nearest")
    assert np.array_equal(found.astype(np.float64), expected)


@pytest.mark.parametrize("name", FILTERS)
def test_filters_keep_placement_and_shape_and_tell_their_progress(name: str) -> None:
    pytest.importorskip("SimpleITK")
    samples = np.random.default_rng(8).integers(0, 1000, (6, 7, 8)).astype(">i2")
    volume = Volume(samples, spacing=(0.5, 1.0, 2.0), origin=(3.0, -4.0, 5.0), direction=TURN, name="scan")
    before = samples.copy()
    told: list[tuple[int, int]] = []
    found = FILTERS[name](volume, progress=lambda done, total: told.append((done, total)))
    assert found.geometry == volume.geometry
    assert found.name == "scan"
    assert not np.array_equal(found.array, before)
    assert np.array_equal(samples, before)
    assert told
    assert all(0 <= done <= total for done, total in told)
    assert told[-1][0] == told[-1][1]


@pytest.mark.parametrize("name", FILTERS)
def test_a_constant_volume_stays_what_it_is(name: str) -> None:
    pytest.importorskip("SimpleITK")
    found = FILTERS[name](Volume(np.full((4, 5, 6), 7.0)))
    assert np.abs(floats(found) - 7.0).max() <= 7.0 * 1e-6  # a Gaussian's weights sum to 1 up to rounding


@pytest.mark.parametrize("name", FILTERS)
def test_samples_that_are_not_finite_are_refused(name: str) -> None:
    pytest.importorskip("SimpleITK")
    samples = np.zeros((3, 3, 3))
    samples[0, 0, 0], samples[2, 2, 2] = np.nan, np.inf
    with pytest.raises(InputError, match=r"1 NaN and 1 infinite samples.*replace them first"):
        FILTERS[name](Volume(samples))


def test_a_missing_simpleitk_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "SimpleITK", None)
    with pytest.raises(MissingDependencyError, match=r"(?i)a median needs SimpleITK.*isosample\[medical\]"):
        median(Volume(np.zeros((3, 3, 3))), 1.0)


@pytest.mark.parametrize(
    ("run", "message"),
    [
        (lambda v: anisotropic_diffusion(v, conductance=0.0), "conductance 0.0 must be"),
        (lambda v: anisotropic_diffusion(v, iterations=0), "iterations 0 must be"),
        (lambda v: anisotropic_diffusion(v, time_step=0.2), r"time step 0.2 must be .* at most 0.166667"),
        (lambda v: gaussian(v, 0.0), "sigma 0.0 is impossible"),
        (lambda v: gaussian(v, 1e4), "10000 samples; a Gaussian may have 256"),
        (lambda v: median(v, -1.0), "radius -1.0 is impossible"),
        (lambda v: median(v, 0.4), "0 x 0 x 0 samples"),
        (lambda v: median(v, 17.0), "17 x 17 x 17 samples .* expected 1 to 16"),
    ],
)
def test_impossible_numbers_are_refused(run: Callable[[Volume], Volume], message: str) -> None:
    with pytest.raises(InputError, match=message):
        run(Volume(np.zeros((3, 3, 3))))

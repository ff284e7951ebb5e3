"""Wood grain: Parseval's theorem, bands of a synthetic sine and of a stepped plane, leakage, refusals."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from isosample.compare.differences import rmse
from isosample.compare.image_pair import Pixels
from isosample.compare.wood_grain import grain_band, wood_grain_energy
from isosample.errors import InputError

from .pictures import random_picture, seeds

if TYPE_CHECKING:
    from isosample.volume.grid import F64

HEIGHT, WIDTH = 48, 64
ALL_FREQUENCIES = (0.0, 1.0)  # the largest radial frequency is sqrt(1/2)
ROUNDING = 1e-11  # transforms of 3072 values: log2(3072) x 2^-53 x a few, relative to the largest term


def sine(amplitude: float, across: int, down: int, phase: float = 0.3) -> F64:
    """(HEIGHT, WIDTH, 4), a sine of whole periods across and down, in the green channel."""
    y, x = np.indices((HEIGHT, WIDTH))
    error = np.zeros((HEIGHT, WIDTH, 4))
    error[..., 1] = amplitude * np.sin(2 * np.pi * (across * x / WIDTH + down * y / HEIGHT) + phase)
    return error


def band_about(across: int, down: int) -> tuple[float, float]:
    """A band that holds the frequency and the eight neighbours to which the window spreads it."""
    radii = [math.hypot((across + i) / WIDTH, (down + j) / HEIGHT) for i in (-1, 0, 1) for j in (-1, 0, 1)]
    return min(radii) - 1e-9, max(radii) + 1e-9


def energy(error: F64, band: tuple[float, float]) -> float:
    truth = np.zeros_like(error)
    return wood_grain_energy(error, truth, band=band)


@given(
    amplitude=st.floats(1e-3, 1.0),
    across=st.integers(2, WIDTH // 2 - 2),
    down=st.integers(2, HEIGHT // 2 - 2),
    phase=st.floats(0.0, 6.28),
)
def test_a_sines_energy_is_an_eighth_of_its_amplitude_squared(
    amplitude: float, across: int, down: int, phase: float
) -> None:
    # mean square A^2/2 in one of four channels. The window has the harmonics 0 and ±1, its square 0, ±1, ±2;
    # none of them meets the doubled frequency, so that the weighted mean square is that of the sine
    error = sine(amplitude, across, down, phase)
    expected = amplitude**2 / 8
    assert energy(error, ALL_FREQUENCIES) == pytest.approx(expected, rel=ROUNDING)
    assert energy(error, band_about(across, down)) == pytest.approx(expected, rel=ROUNDING)


def test_nothing_of_a_sine_is_outside_its_band() -> None:
    error = sine(0.5, 12, 7)
    low, high = band_about(12, 7)
    for band in ((0.0, low), (high, 1.0)):
        assert energy(error, band) <= ROUNDING * 0.5**2


@given(seeds)
def test_all_frequencies_give_the_weighted_variance(seed: int) -> None:
    # Parseval, evaluated without a transform
    image, truth = random_picture(seed), random_picture(seed + 1)
    height, width = image.shape[:2]
    y, x = np.indices((height, width))
    weight = (np.sin(np.pi * (y + 0.5) / height) * np.sin(np.pi * (x + 0.5) / width))[..., None] ** 2
    error = image - truth
    mean = (weight * error).sum(axis=(0, 1)) / weight.sum()
    variance = (weight**2 * (error - mean) ** 2).sum() / (4 * (weight**2).sum())
    assert wood_grain_energy(image, truth, band=ALL_FREQUENCIES) == pytest.approx(
        float(variance), rel=ROUNDING
    )


@given(seeds, st.sets(st.sampled_from([0.05, 0.1, 0.2, 0.35, 0.5, 0.65]), min_size=1))
def test_energies_of_neighbouring_bands_add_up(seed: int, cuts: set[float]) -> None:
    image, truth = random_picture(seed, height=40, width=40), random_picture(seed + 1, height=40, width=40)
    edges = [0.0, *sorted(cuts), 1.0]
    parts = [wood_grain_energy(image, truth, band=band) for band in pairwise(edges)]
    assert sum(parts) == pytest.approx(wood_grain_energy(image, truth, band=ALL_FREQUENCIES), rel=ROUNDING)


def test_the_band_includes_its_low_end_and_not_its_high_end() -> None:
    error = sine(1.0, 16, 0)  # 0.25 cycles/pixel, exact
    below, above = energy(error, (0.0, 0.25)), energy(error, (0.25, 1.0))
    assert below + above == pytest.approx(1 / 8, rel=ROUNDING)
    # Hann squares (1/4, 1, 1/4) / 1.5 across: the frequency itself and the one above, and the side lines down
    # (radius beyond 0.25), are in the upper band; (15, 0) and (15, ±1) are below: 1/6
    assert below == pytest.approx(1 / 8 / 6, rel=ROUNDING)


def test_energy_grows_as_the_square_of_the_error() -> None:
    image, truth = random_picture(1), random_picture(2)
    single = wood_grain_energy(image, truth, band=(0.2, 0.4))
    assert wood_grain_energy(3 * image, 3 * truth, band=(0.2, 0.4)) == pytest.approx(9 * single, rel=ROUNDING)


def test_a_constant_error_has_no_grain() -> None:
    truth = random_picture(2)
    assert wood_grain_energy(truth + 0.5, truth, band=ALL_FREQUENCIES) <= 1e-28  # (2^-53 x 0.5 x a few)^2


def test_a_slow_error_stays_out_of_the_band() -> None:
    # Half a period over the picture jumps at the border. Under the window it is (cos πu − cos 3πu)/4, whose
    # second derivative jumps by 4π²: coefficients 4π²/(2πk)³, and from k = 10 on the energy
    # 2 Σ 1/(2πk³)² = 1.31e-7 of 1/16 in all, 2.1e-6. Folding adds less than a tenth. Without a window: 4e-2.
    x = (np.arange(WIDTH) + 0.5) / WIDTH
    error = np.broadcast_to(np.cos(np.pi * x)[:, None], (HEIGHT, WIDTH, 4))
    assert energy(error, (10 / WIDTH, 1.0)) < 2.3e-6 * energy(error, ALL_FREQUENCIES)


def test_the_steps_of_a_sampled_plane_lie_in_the_band_of_its_tilt() -> None:
    # The error of a plane sampled in steps: a saw-tooth, depth modulo step. Here it has 8 pixels per period,
    # the values j/8: its first coefficient is (1/8)/(exp(−2πi/8) − 1), and 2 |c_1|² = 1/(128 sin²(π/8)), which
    # is 65 % of its variance; the rest lies above the band
    step, pixel_size = 0.5, 0.1
    tilt = math.degrees(math.atan(step / (8 * pixel_size)))  # 8 pixels per step
    depth = np.arange(WIDTH) * pixel_size * math.tan(math.radians(tilt)) + 0.01
    error = np.broadcast_to(((depth / step) % 1.0)[:, None], (HEIGHT, WIDTH, 4))
    band = grain_band(step=step, pixel_size=pixel_size, tilts=(tilt - 10, tilt + 10))
    fundamental = 1 / (128 * math.sin(math.pi / 8) ** 2)
    assert energy(error, band) == pytest.approx(fundamental, rel=1e-9)
    others = grain_band(step=step, pixel_size=pixel_size, tilts=(5.0, 15.0))
    assert energy(error, others) < 1e-9


def test_the_root_of_white_noise_energy_compares_with_rmse() -> None:
    # E = s^2 times the share of frequencies in the band; 3072 x 4 samples: standard deviation about 2.5 %
    rng = np.random.default_rng(9)
    noise = rng.normal(0.0, 0.1, (HEIGHT, WIDTH, 4))
    zero = np.zeros_like(noise)
    assert math.sqrt(energy(noise, ALL_FREQUENCIES)) == pytest.approx(rmse(noise, zero), rel=0.08)
    disc = math.pi * (0.4**2 - 0.2**2)
    assert energy(noise, (0.2, 0.4)) == pytest.approx(0.01 * disc, rel=0.15)


def test_the_visible_average_weights_the_energy_to_what_is_shown() -> None:
    # same error, opaque in the middle columns only: the sum is divided by the window there
    error = sine(0.5, 12, 7)
    columns = slice(16, 48)
    error[:, : columns.start] = error[:, columns.stop :] = 0.0
    truth = np.zeros_like(error)
    truth[:, columns, 3] = 1.0
    image = truth + error
    window = np.sin(np.pi * (np.arange(WIDTH) + 0.5) / WIDTH) ** 4
    expected = wood_grain_energy(image, truth, band=(0.1, 0.4)) * window.sum() / window[columns].sum()
    visible = wood_grain_energy(image, truth, band=(0.1, 0.4), pixels=Pixels.VISIBLE)
    assert visible == pytest.approx(expected, rel=ROUNDING)


def test_the_grain_of_a_tilt_is_pixels_per_step() -> None:
    low, high = grain_band(step=2.0, pixel_size=0.5, tilts=(45.0, 60.0))
    assert low == pytest.approx(0.25, rel=1e-15)  # one pixel deepens by 0.5, a quarter of a step
    assert high == pytest.approx(0.25 * math.sqrt(3.0), rel=1e-14)


@pytest.mark.parametrize("band", [(0.3, 0.3), (0.4, 0.2), (-0.1, 0.2), (math.nan, 0.2), (0.1, math.nan)])
def test_an_impossible_band_is_refused(band: tuple[float, float]) -> None:
    with pytest.raises(InputError, match="expected 0 <= low < high"):
        energy(sine(1.0, 4, 4), band)


@pytest.mark.parametrize("band", [(0.8, 0.9), (0.001, 0.002)])
def test_a_band_without_a_frequency_is_refused(band: tuple[float, float]) -> None:
    with pytest.raises(InputError, match="no frequency of a 64x48 picture"):
        energy(sine(1.0, 4, 4), band)


@pytest.mark.parametrize(
    ("step", "pixel_size", "tilts", "message"),
    [
        (0.0, 1.0, (15.0, 60.0), "step 0 and"),
        (1.0, -1.0, (15.0, 60.0), "pixel_size -1"),
        (math.nan, 1.0, (15.0, 60.0), "step nan"),
        (1.0, 0.1, (60.0, 15.0), "60 to 15 degrees"),
        (1.0, 0.1, (0.0, 15.0), "0 to 15 degrees"),
        (1.0, 0.1, (15.0, 90.0), "15 to 90 degrees"),
        (1.0, 0.5, (15.0, 60.0), "0.866025 cycles/pixel; a picture shows up to 0.5"),
    ],
)
def test_an_impossible_grain_is_refused(
    step: float, pixel_size: float, tilts: tuple[float, float], message: str
) -> None:
    with pytest.raises(InputError, match=message):
        grain_band(step=step, pixel_size=pixel_size, tilts=tilts)

"""Displayed differences: closed forms for uniform pictures, published colours, backgrounds, saturation."""

from __future__ import annotations

import math
import subprocess
import sys
from typing import TYPE_CHECKING

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from isosample.compare.image_pair import Pixels
from isosample.compare.perceptual import delta_e_2000, displayed_pair, flip, ssim
from isosample.errors import InputError, MissingDependencyError

from .pictures import BLACK, grey, names_of, needs_flip, random_picture, seeds, uniform

if TYPE_CHECKING:
    from collections.abc import Callable

WHITE = (1.0, 1.0, 1.0)
RED, GREEN, BLUE = ((1.0, 0.0, 0.0, 1.0), (0.0, 1.0, 0.0, 1.0), (0.0, 0.0, 1.0, 1.0))
# CIELAB (D65, 2°) of the sRGB primaries, as published by B. Lindbloom's calculator to 4 decimals
LAB = {
    RED: (53.2408, 80.0925, 67.2032),
    GREEN: (87.7347, -86.1827, 83.1793),
    BLUE: (32.2970, 79.1875, -107.8602),
}
MEASURES: dict[str, Callable[..., float]] = {"ssim": ssim, "delta_e_2000": delta_e_2000, "flip": flip}
each_measure = pytest.mark.parametrize("name", names_of(MEASURES))


def srgb(linear: float) -> float:
    """The encoding of IEC 61966-2-1, written out once more."""
    return 12.92 * linear if linear <= 0.0031308 else 1.055 * math.pow(linear, 1 / 2.4) - 0.055


def lightness(level: float) -> float:
    """CIE L* of a grey of linear `level` > 0.0089."""
    return 116.0 * math.cbrt(level) - 16.0


@given(st.floats(0.0, 1.0), st.floats(0.0, 1.0))
def test_ssim_of_greys_is_the_luminance_term(first: float, second: float) -> None:
    a, b = srgb(first), srgb(second)
    constant = 0.01**2  # (K1 x data range)^2; the structure term is C2/C2 = 1
    expected = (2 * a * b + constant) / (a * a + b * b + constant)
    # variances that should be 0 are rounding, 2^-52, against C2 = 9e-4: 1e-12
    assert ssim(grey(first), grey(second), background=BLACK) == pytest.approx(expected, abs=1e-11)


def test_ssim_is_that_of_the_paper_in_a_picture_of_one_window() -> None:
    # Wang et al. 2004, eq. 13 to 16, summed directly: Gaussian weights of sum 1, population covariance
    rng = np.random.default_rng(11)
    image, truth = (np.concatenate([rng.random((11, 11, 3)), np.ones((11, 11, 1))], axis=-1) for _ in "ab")
    bell = np.exp(-0.5 * (np.arange(-5, 6) / 1.5) ** 2)
    weight = np.outer(bell, bell) / bell.sum() ** 2
    scores = []
    for channel in range(3):
        x, y = (np.vectorize(srgb)(picture[..., channel]) for picture in (image, truth))
        mean_x, mean_y = (weight * x).sum(), (weight * y).sum()
        dx, dy = x - mean_x, y - mean_y
        luminance = (2 * mean_x * mean_y + 1e-4) / (mean_x**2 + mean_y**2 + 1e-4)
        structure = (2 * (weight * dx * dy).sum() + 9e-4) / ((weight * (dx**2 + dy**2)).sum() + 9e-4)
        scores.append(luminance * structure)
    assert ssim(image, truth, background=BLACK) == pytest.approx(np.mean(scores), rel=1e-11)


def test_ssim_of_an_inverted_texture_is_negative() -> None:
    texture = np.random.default_rng(3).choice([0.2, 0.8], (32, 32, 1)) * np.ones(4)
    texture[..., 3] = 1.0
    inverted = 1.0 - texture
    inverted[..., 3] = 1.0
    assert ssim(texture, inverted, background=BLACK) < -0.5


@given(seeds)
def test_ssim_is_symmetric_and_at_most_one(seed: int) -> None:
    image, truth = random_picture(seed), random_picture(seed + 1)
    forth = ssim(image, truth, background=BLACK)
    assert forth == pytest.approx(ssim(truth, image, background=BLACK), rel=1e-12)
    assert -1.0 <= forth < 1.0


def test_ssim_sees_lost_structure_where_rmse_is_equal() -> None:
    rng = np.random.default_rng(6)
    truth = uniform((0.5, 0.5, 0.5, 1.0), height=32, width=32)
    shift = np.zeros_like(truth)
    shift[..., :3] = 0.05
    signs = rng.choice([-1.0, 1.0], (32, 32, 1))
    assert ssim(truth + signs * shift, truth, background=BLACK) < ssim(truth + shift, truth, background=BLACK)


def test_a_window_needs_eleven_pixels() -> None:
    small = uniform((0.5, 0.5, 0.5, 1.0), height=11, width=10)
    with pytest.raises(InputError, match="10x11 pixels; SSIM needs at least 11x11"):
        ssim(small, small, background=BLACK)
    fits = uniform((0.5, 0.5, 0.5, 1.0), height=11, width=11)
    assert ssim(fits, fits, background=BLACK) == 1.0


def test_visible_pixels_without_a_full_window_are_refused() -> None:
    edge = np.zeros((16, 16, 4))
    edge[4] = 0.5
    with pytest.raises(InputError, match="within 5 pixels of the border"):
        ssim(edge, edge, background=BLACK, pixels=Pixels.VISIBLE)
    edge[5] = 0.5
    assert ssim(edge, edge, background=BLACK, pixels=Pixels.VISIBLE) == 1.0


@given(st.floats(0.01, 1.0), st.floats(0.01, 1.0))
def test_delta_e_of_greys_follows_from_their_lightness(first: float, second: float) -> None:
    one, other = lightness(first), lightness(second)
    mean = 0.5 * (one + other)
    weight = 1 + 0.015 * (mean - 50) ** 2 / math.sqrt(20 + (mean - 50) ** 2)
    # the library's matrix and white point agree to 5 digits: greys get a chroma up to 0.0053, or 0.008 after
    # the factor of up to 1.5 on a*; the constants of sRGB cost another 1e-4 of L*
    expected = abs(one - other) / weight
    assert delta_e_2000(grey(first), grey(second), background=BLACK) == pytest.approx(expected, abs=0.009)


@pytest.mark.parametrize(("first", "second"), [(RED, GREEN), (GREEN, BLUE), (BLUE, RED)])
def test_delta_e_of_primaries_is_that_of_their_published_colours(
    first: tuple[float, float, float, float], second: tuple[float, float, float, float]
) -> None:
    from skimage.color import deltaE_ciede2000

    expected = float(deltaE_ciede2000(np.array(LAB[first]), np.array(LAB[second])))  # type: ignore[no-untyped-call]
    # Lab published to 5e-5, and the matrices of 6 digits differ by 1e-3 of Lab (3e-3 for blue)
    assert delta_e_2000(uniform(first), uniform(second), background=BLACK) == pytest.approx(
        expected, abs=5e-3
    )


@pytest.mark.parametrize(
    ("first", "second", "expected"),
    [  # rows 1, 9 and 17 of table 1 in Sharma, Wu and Dalal 2005
        ((50.0, 2.6772, -79.7751), (50.0, 0.0, -82.7485), 2.0425),
        ((50.0, 2.49, -0.001), (50.0, -2.49, 0.0009), 7.1792),
        ((50.0, 2.5, 0.0), (73.0, 25.0, -18.0), 27.1492),
    ],
)
def test_the_formula_of_the_library_is_the_published_one(
    first: tuple[float, ...], second: tuple[float, ...], expected: float
) -> None:
    from skimage.color import deltaE_ciede2000

    found = float(deltaE_ciede2000(np.array(first), np.array(second)))  # type: ignore[no-untyped-call]
    assert found == pytest.approx(expected, abs=5.1e-5)  # printed to 4 decimals


def test_delta_e_is_a_mean_over_the_counted_pixels() -> None:
    truth = np.zeros((16, 16, 4))
    truth[:8] = (0.5, 0.5, 0.5, 1.0)
    image = 0.5 * truth
    image[..., 3] = truth[..., 3]
    whole = delta_e_2000(grey(0.25), grey(0.5), background=BLACK)
    assert delta_e_2000(image, truth, background=BLACK) == pytest.approx(whole / 2, rel=1e-12)
    visible = delta_e_2000(image, truth, background=BLACK, pixels=Pixels.VISIBLE)
    assert visible == pytest.approx(whole, rel=1e-12)


def flip_of_uniform(first: tuple[float, float, float], second: tuple[float, float, float]) -> float:
    """FLIP of two uniform pictures from their CIELAB: no edges, and filters keep constants."""

    def distance(one: tuple[float, ...], other: tuple[float, ...]) -> float:
        (l1, a1, b1), (l2, a2, b2) = ((p[0], 0.01 * p[0] * p[1], 0.01 * p[0] * p[2]) for p in (one, other))
        return math.pow(abs(l1 - l2) + math.hypot(a1 - a2, b1 - b2), 0.7)

    largest = distance(LAB[GREEN], LAB[BLUE])
    knee, found = 0.4 * largest, distance(first, second)
    return 0.95 / knee * found if found < knee else 0.95 + (found - knee) / (largest - knee) * 0.05


@pytest.mark.parametrize(("first", "second"), [(1.0, 0.0), (0.5, 0.01), (0.5, 0.4), (0.2, 0.21)])
@needs_flip
def test_flip_of_greys_is_the_papers_colour_term(first: float, second: float) -> None:
    one, other = ((lightness(v) if v else 0.0, 0.0, 0.0) for v in (first, second))
    # the package's white point is not the one of the published Lab: 1e-3 of Lab, 0.7 x that of a distance,
    # and float32 filters cost 1e-6
    found = flip(grey(first), grey(second), background=BLACK)
    assert found == pytest.approx(flip_of_uniform(one, other), rel=2e-3)


@needs_flip
def test_flip_is_one_between_green_and_blue() -> None:
    assert flip(uniform(GREEN), uniform(BLUE), background=BLACK) == pytest.approx(1.0, abs=1e-6)


@needs_flip
def test_flip_forgives_fine_noise_seen_from_afar() -> None:
    truth = uniform((0.5, 0.5, 0.5, 1.0), height=32, width=32)
    noise = np.random.default_rng(2).choice([-0.1, 0.1], (32, 32, 1)) * np.array([1.0, 1.0, 1.0, 0.0])
    near, far = (
        flip(truth + noise, truth, background=BLACK, pixels_per_degree=density) for density in (20.0, 120.0)
    )
    assert 0.0 < far < near


@pytest.mark.parametrize("density", [0.0, -1.0, math.inf, math.nan])
def test_flip_refuses_an_impossible_viewer(density: float) -> None:
    with pytest.raises(InputError, match="pixels_per_degree is"):
        flip(grey(0.5), grey(0.5), background=BLACK, pixels_per_degree=density)


PACKAGES = {
    "ssim": ("skimage.metrics", "scikit-image"),
    "delta_e_2000": ("skimage.color", "scikit-image"),
    "flip": ("flip_evaluator", "flip-evaluator"),
}


@pytest.mark.parametrize("name", PACKAGES)
def test_without_its_package_a_measure_says_what_to_install(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    module, package = PACKAGES[name]
    monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(MissingDependencyError, match=rf'needs {package}.*pip install "isosample\[compare\]"'):
        MEASURES[name](grey(0.5), grey(0.5), background=BLACK)


def test_importing_the_measures_loads_no_heavy_package() -> None:
    names = "'skimage', 'scipy', 'flip_evaluator', 'moderngl', 'PIL', 'matplotlib'"
    check = f"import sys, isosample.compare.metrics; sys.exit(any(n in sys.modules for n in ({names})))"
    assert subprocess.run([sys.executable, "-c", check], check=False).returncode == 0


@each_measure
def test_the_background_shows_through(name: str) -> None:
    # a half-transparent grey over white equals an opaque one of 0.25 + 0.5, whatever its own background
    glass, opaque = uniform((0.25, 0.25, 0.25, 0.5)), uniform((0.75, 0.75, 0.75, 1.0))
    measure = MEASURES[name]
    perfect = measure(opaque, opaque, background=BLACK)
    assert measure(glass, opaque, background=WHITE) == pytest.approx(perfect, abs=1e-12)
    assert abs(measure(glass, opaque, background=BLACK) - perfect) > 0.01


@each_measure
@pytest.mark.parametrize(
    "background", [(0.0, 0.0), (0.0, 0.0, 0.0, 1.0), (0.0, 1.1, 0.0), (0.0, math.nan, 0.0)]
)
def test_a_background_that_is_no_opaque_colour_is_refused(name: str, background: tuple[float, ...]) -> None:
    with pytest.raises(InputError, match=r"the background is .*; expected linear R, G, B, each 0 to 1"):
        MEASURES[name](grey(0.5), grey(0.5), background=background)


@each_measure
def test_a_background_must_be_stated(name: str) -> None:
    with pytest.raises(TypeError, match="background"):
        MEASURES[name](grey(0.5), grey(0.5))


def test_saturated_pixels_are_marked() -> None:
    truth = grey(0.5)
    image = truth.copy()
    image[1, 2, 0] = 1.5
    image[3, 4, 1] = -0.1
    image[5, 6, 2] = 1.0 + 1e-6  # rounding: no display shows it
    pair = displayed_pair(image, truth, background=BLACK, pixels=Pixels.ALL)
    assert np.argwhere(pair.saturated).tolist() == [[1, 2], [3, 4]]
    assert pair.image[1, 2, 0] == 1.0
    assert pair.image[3, 4, 1] == 0.0
    swapped = displayed_pair(truth, image, background=BLACK, pixels=Pixels.ALL)
    assert np.array_equal(swapped.saturated, pair.saturated)

"""Plain measures: closed forms, bounds between them, invariances, refusals."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from isosample.compare.differences import max_error, percentile_error, psnr, rmse, tangent_step
from isosample.compare.image_pair import Pixels
from isosample.compare.metrics import delta_e_2000, flip, ssim, wood_grain_energy
from isosample.errors import InputError

from .pictures import BLACK, names_of, random_picture, seeds, uniform

if TYPE_CHECKING:
    from collections.abc import Callable

    from isosample.volume.grid import F64

ROUNDING = 1e-12  # sums of about 10^3 terms of size 1: 10^3 x 2^-53 = 1.1e-13 relative, and a margin of 9


def bumped(value: float, *, at: tuple[int, int, int] = (3, 5, 1), size: int = 10) -> tuple[F64, F64]:
    """A picture that differs from the truth in one component by `value`."""
    truth = uniform((0.25, 0.25, 0.25, 0.5), height=size, width=size)
    image = truth.copy()
    image[at] += value
    return image, truth


MEASURES: dict[str, Callable[..., float]] = {
    "rmse": rmse,
    "max_error": max_error,
    "percentile_error": lambda a, b, **k: percentile_error(a, b, 99.9, **k),
    "psnr": lambda a, b, **k: psnr(a, b, peak=1.0, **k),
    "tangent_step": tangent_step,
    "wood_grain_energy": lambda a, b, **k: wood_grain_energy(a, b, band=(0.0, 1.0), **k),
    "ssim": lambda a, b, **k: ssim(a, b, background=BLACK, **k),
    "delta_e_2000": lambda a, b, **k: delta_e_2000(a, b, background=BLACK, **k),
    "flip": lambda a, b, **k: flip(a, b, background=BLACK, **k),
}
each_measure = pytest.mark.parametrize("name", names_of(MEASURES))


def test_rmse_is_the_root_mean_square_over_pixels_and_components() -> None:
    # one of 10 x 10 x 4 components is off by 0.2: sqrt(0.04 / 400) = 0.01
    assert rmse(*bumped(0.2)) == pytest.approx(0.01, rel=ROUNDING)


def test_rmse_of_a_uniform_difference_is_that_difference() -> None:
    truth = random_picture(1)
    assert rmse(truth + 0.125, truth) == pytest.approx(0.125, rel=ROUNDING)


@pytest.mark.parametrize("size", [1e-200, 1e-30, 1e30])
def test_rmse_neither_vanishes_nor_overflows(size: float) -> None:
    truth = uniform((0.0, 0.0, 0.0, 0.0))
    assert rmse(truth + size, truth) == pytest.approx(size, rel=ROUNDING)


def test_max_error_finds_one_component_and_its_size_not_its_sign() -> None:
    for value in (0.375, -0.375):
        assert max_error(*bumped(value)) == 0.375  # exact: 0.25 ± 0.375 are sums of powers of 2


@pytest.mark.parametrize(
    ("percent", "rank"), [(99.9, 999), (99.91, 1000), (50.0, 500), (0.1, 1), (100.0, 1000)]
)
def test_percentile_error_is_the_error_at_its_rank(percent: float, rank: int) -> None:
    # errors 1, 2, …, 1000 in the pixels, each in another component, shuffled: the k-th smallest is k
    order = np.random.default_rng(4).permutation(1000)
    image = np.zeros((20, 50, 4))
    image.reshape(1000, 4)[np.arange(1000), np.arange(1000) % 4] = (order + 1) * np.where(
        order % 3, 1.0, -1.0
    )
    assert percentile_error(image, np.zeros_like(image), percent) == rank


@given(seeds, st.floats(0.1, 100.0))
def test_at_least_the_stated_share_of_pixels_keeps_the_percentile_error(seed: int, percent: float) -> None:
    image, truth = random_picture(seed), random_picture(seed // 2 + 1)
    worst = np.abs(image - truth).max(axis=-1)
    bound = percentile_error(image, truth, percent)
    assert (worst <= bound).mean() >= percent / 100 - 1e-12  # the mean of 221 booleans rounds
    assert (worst < bound).mean() < percent / 100 + 1e-12


@pytest.mark.parametrize(("peak", "decibels"), [(1.0, 40.0), (10.0, 60.0), (0.01, 0.0)])
def test_psnr_is_relative_to_the_stated_peak(peak: float, decibels: float) -> None:
    assert psnr(*bumped(0.2), peak=peak) == pytest.approx(decibels, abs=1e-10)  # rmse 0.01


def test_psnr_of_equal_pictures_is_infinite_and_of_barely_different_ones_is_not() -> None:
    truth = uniform((0.0, 0.0, 0.0, 0.0))
    assert psnr(truth, truth, peak=1.0) == math.inf
    assert psnr(truth + 1e-200, truth, peak=1.0) == pytest.approx(4000.0, rel=ROUNDING)


def test_psnr_asks_for_its_peak() -> None:
    with pytest.raises(TypeError, match="peak"):
        psnr(*bumped(0.2))  # type: ignore[call-arg]


def test_a_tangent_step_is_the_jump_that_the_truth_does_not_have() -> None:
    # a ramp of 1/64 per pixel, and the same with a jump of 1/4 more at one column: powers of 2, exact
    truth = np.broadcast_to(np.arange(16.0)[:, None] / 64, (12, 16, 4)).copy()
    image = truth.copy()
    image[:, 9:] += 0.25
    assert tangent_step(image, truth) == 0.25
    assert tangent_step(image.swapaxes(0, 1), truth.swapaxes(0, 1)) == 0.25
    assert tangent_step(-image, -truth) == 0.25


def test_a_jump_that_the_truth_has_too_is_no_tangent_step() -> None:
    truth = uniform((0.0, 0.0, 0.0, 0.0))
    truth[:, 8:] = 1.0
    assert tangent_step(truth + 0.25, truth) == 0.0
    assert tangent_step(np.zeros_like(truth), truth) == 0.0  # a blurred edge: the other pairs are equal


def test_a_tangent_step_is_negative_where_the_picture_is_smoother_everywhere() -> None:
    truth = (np.indices((4, 4)).sum(axis=0) % 2)[..., None] * np.ones(4)  # every neighbour differs by 1
    assert tangent_step(0.25 * truth, truth) == -0.75


def test_a_step_at_the_outline_counts_among_visible_pixels() -> None:
    image, truth = np.zeros((2, 4, 5, 4))
    truth[2, 2], image[2, 2] = 0.25, 0.75
    assert tangent_step(image, truth, pixels=Pixels.VISIBLE) == 0.5


@given(seeds)
def test_plain_measures_keep_their_order(seed: int) -> None:
    image, truth = random_picture(seed), random_picture(seed + 1)
    worst = max_error(image, truth)
    assert 0.0 < rmse(image, truth) <= worst * (1 + ROUNDING)
    assert percentile_error(image, truth, 50.0) <= percentile_error(image, truth, 99.9) <= worst
    assert percentile_error(image, truth, 100.0) == worst
    assert tangent_step(image, truth) <= 2 * worst * (1 + ROUNDING)


@given(seeds, st.floats(0.25, 4.0))
def test_plain_measures_scale_with_the_difference(seed: int, scale: float) -> None:
    image, truth = random_picture(seed), random_picture(seed + 1)
    assert rmse(scale * image, scale * truth) == pytest.approx(scale * rmse(image, truth), rel=ROUNDING)
    assert max_error(scale * image, scale * truth) == pytest.approx(
        scale * max_error(image, truth), rel=ROUNDING
    )
    step = tangent_step(image, truth)
    assert tangent_step(scale * image, scale * truth) == pytest.approx(
        scale * step, rel=ROUNDING, abs=ROUNDING
    )
    loss = psnr(image, truth, peak=1.0) - 20 * math.log10(scale)
    assert psnr(scale * image, scale * truth, peak=1.0) == pytest.approx(loss, abs=1e-9)


@each_measure
@settings(max_examples=10)
@given(seed=seeds)
def test_mirroring_both_pictures_changes_no_measure(name: str, seed: int) -> None:
    image, truth = random_picture(seed), random_picture(seed + 1)
    before = MEASURES[name](image, truth)
    # FLIP works in float32 and sums its filters in another order: about 100 roundings on a pixel's path
    tolerance = 100 * 2.0**-24 if name == "flip" else 1e-9
    for mirrored in (np.s_[::-1], np.s_[:, ::-1]):
        assert MEASURES[name](image[mirrored], truth[mirrored]) == pytest.approx(before, rel=tolerance)


@each_measure
def test_a_larger_error_scores_worse(name: str) -> None:
    truth = random_picture(7, height=24, width=24) * 0.5 + 0.2
    noise = np.random.default_rng(8).uniform(-0.2, 0.2, truth.shape)
    scores = [MEASURES[name](truth + scale * noise, truth) for scale in (0.05, 0.1, 0.2, 0.4, 0.8)]
    falling = name in {"psnr", "ssim"}
    assert scores == sorted(scores, reverse=falling)
    assert len(set(scores)) == len(scores)


@each_measure
def test_equal_pictures_have_the_perfect_score(name: str) -> None:
    perfect = {"psnr": math.inf, "ssim": 1.0}.get(name, 0.0)
    picture = random_picture(3)
    assert MEASURES[name](picture, picture.copy()) == pytest.approx(perfect, abs=ROUNDING)


@each_measure
def test_an_empty_surround_dilutes_the_measure_of_all_pixels_only(name: str) -> None:
    truth = np.zeros((40, 40, 4))
    truth[12:28, 12:28] = (0.3, 0.2, 0.1, 0.5)
    image = truth.copy()
    image[12:28, 12:28] *= 0.5 + np.random.default_rng(5).random((16, 16, 1))
    wide = [np.pad(picture, ((20, 20), (20, 20), (0, 0))) for picture in (image, truth)]
    measure = MEASURES[name]
    inner, outer = (measure(*pair, pixels=Pixels.VISIBLE) for pair in ((image, truth), wide))
    if name in {"wood_grain_energy"}:  # its window depends on the picture's size
        assert measure(*wide, pixels=Pixels.ALL) < outer
        return
    # FLIP's filters see the same surround; its float32 sums differ in nothing but the empty border
    assert outer == pytest.approx(inner, rel=1e-6 if name == "flip" else 1e-9)
    everything = [measure(*pair, pixels=Pixels.ALL) for pair in ((image, truth), wide)]
    if name in {"max_error", "tangent_step"}:
        assert everything == [inner, inner]
    elif name in {"psnr", "ssim"}:
        assert inner < everything[0] < everything[1]
    elif name == "percentile_error":
        assert everything[1] <= everything[0] <= inner
    else:
        assert inner > everything[0] > everything[1]


@each_measure
def test_what_only_one_picture_shows_is_counted(name: str) -> None:
    shown = np.zeros((20, 20, 4))
    shown[8:12, 8:12] = 0.5
    perfect = MEASURES[name](shown, shown, pixels=Pixels.VISIBLE)
    for pair in ((shown, np.zeros_like(shown)), (np.zeros_like(shown), shown)):
        score = MEASURES[name](*pair, pixels=Pixels.VISIBLE)
        if name == "tangent_step" and pair[1] is shown:
            assert score <= 0.0  # a missing object has no jump of its own
        else:
            assert abs(score - perfect) > 1e-3 if name != "psnr" else score < 10.0


@each_measure
def test_different_shapes_are_refused_with_both_named(name: str) -> None:
    with pytest.raises(InputError, match=r"\(16, 17, 4\).*\(16, 16, 4\).*one size"):
        MEASURES[name](np.zeros((16, 17, 4)), np.zeros((16, 16, 4)))


@each_measure
@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, 1e39])
@pytest.mark.parametrize("which", [0, 1])
def test_a_picture_that_is_not_finite_gets_no_score(name: str, value: float, which: int) -> None:
    pair = np.zeros((2, 16, 16, 4))
    pair[which, 2, 11, 3] = value
    with pytest.raises(
        InputError, match=rf"the {('image', 'truth')[which]} is \S+ at row 2, column 11, channel 3"
    ):
        MEASURES[name](*pair)


@each_measure
@pytest.mark.parametrize(
    ("picture", "message"),
    [
        (np.zeros((16, 16, 3)), r"\(16, 16, 3\); expected \(H, W, 4\)"),
        (np.zeros((16, 16)), r"\(16, 16\); expected \(H, W, 4\)"),
        (np.zeros((0, 16, 4)), r"\(0, 16, 4\); expected \(H, W, 4\)"),
        (np.zeros((16, 16, 4), dtype=np.uint8), "is uint8; expected floating-point"),
        (np.zeros((16, 16, 4), dtype=np.complex64), "is complex64; expected floating-point"),
    ],
)
def test_what_is_no_linear_rgba_picture_is_refused(name: str, picture: Any, message: str) -> None:
    with pytest.raises(InputError, match=message):
        MEASURES[name](picture, picture)


@each_measure
def test_no_visible_pixel_is_an_error_not_a_perfect_score(name: str) -> None:
    empty = np.zeros((16, 16, 4))
    with pytest.raises(InputError, match="none of 256 pixels has an alpha above 0"):
        MEASURES[name](empty, empty, pixels=Pixels.VISIBLE)


@each_measure
@pytest.mark.parametrize("dtype", [np.float16, np.float32])
def test_narrow_floats_are_measured_in_float64(name: str, dtype: type[np.floating[Any]]) -> None:
    image, truth = (random_picture(seed).astype(dtype) for seed in (1, 2))
    assert MEASURES[name](image, truth) == MEASURES[name](image.astype(np.float64), truth.astype(np.float64))


@pytest.mark.parametrize("peak", [0.0, -1.0, math.inf, math.nan])
def test_an_impossible_peak_is_refused(peak: float) -> None:
    with pytest.raises(InputError, match="peak is"):
        psnr(*bumped(0.1), peak=peak)


@pytest.mark.parametrize("percent", [0.0, -1.0, 100.5, math.nan])
def test_an_impossible_percentile_is_refused(percent: float) -> None:
    with pytest.raises(InputError, match="percent is"):
        percentile_error(*bumped(0.1), percent)


def test_a_single_pixel_has_no_step() -> None:
    with pytest.raises(InputError, match="1x1 pixels; a step needs two neighbours"):
        tangent_step(np.zeros((1, 1, 4)), np.zeros((1, 1, 4)))
    assert tangent_step(np.zeros((1, 2, 4)), np.zeros((1, 2, 4))) == 0.0

"""The summary: every measure as computed alone, the choices kept, JSON without infinities."""

from __future__ import annotations

import json
import math
import sys

import numpy as np
import pytest

from isosample.compare import metrics
from isosample.compare.metrics import Pixels, summarise
from isosample.errors import InputError, MissingDependencyError

from .pictures import BLACK, grey, needs_flip, random_picture

BAND = (0.1, 0.3)
GREY = (0.2, 0.3, 0.4)


@pytest.mark.parametrize("pixels", Pixels)
def test_a_summary_holds_each_measure_as_computed_alone(pixels: Pixels) -> None:
    image, truth = random_picture(1), random_picture(2)
    found = summarise(image, truth, background=GREY, peak=2.0, pixels=pixels, grain_band=BAND)
    assert found.rmse == metrics.rmse(image, truth, pixels=pixels)
    assert found.max_error == metrics.max_error(image, truth, pixels=pixels)
    assert found.percentile_error == metrics.percentile_error(image, truth, 99.9, pixels=pixels)
    assert found.worst_pixels_share == metrics.worst_pixels_share(image, truth, 0.1, pixels=pixels)
    assert found.psnr == metrics.psnr(image, truth, peak=2.0, pixels=pixels)
    assert found.ssim == metrics.ssim(image, truth, background=GREY, pixels=pixels)
    assert found.delta_e_2000 == metrics.delta_e_2000(image, truth, background=GREY, pixels=pixels)
    assert found.tangent_step == metrics.tangent_step(image, truth, pixels=pixels)
    assert found.wood_grain_energy == metrics.wood_grain_energy(image, truth, band=BAND, pixels=pixels)
    assert found.flip is None
    assert (found.peak, found.background, found.pixels, found.grain_band) == (2.0, GREY, pixels, BAND)
    visible = int(((image[..., 3] > 0) | (truth[..., 3] > 0)).sum())
    assert found.counted_pixels == (visible if pixels is Pixels.VISIBLE else 13 * 17)


@needs_flip
def test_flip_is_there_when_asked_for() -> None:
    image, truth = random_picture(1), random_picture(2)
    found = summarise(image, truth, background=GREY, with_flip=True)
    assert found.flip == metrics.flip(image, truth, background=GREY)


def test_flip_that_was_asked_for_is_never_left_out(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "flip_evaluator", None)
    with pytest.raises(MissingDependencyError):
        summarise(grey(0.5), grey(0.5), background=BLACK, with_flip=True)


def test_a_summary_writes_json_and_reads_back() -> None:
    found = summarise(random_picture(1), random_picture(2), background=GREY, grain_band=BAND)
    written = json.loads(json.dumps(found.to_dict(), allow_nan=False))
    assert written == found.to_dict()
    assert written["pixels"] == "all"
    assert written["background"] == list(GREY)
    assert written["grain_band"] == list(BAND)
    assert written["psnr"] == found.psnr
    assert list(written) == list(type(found).__slots__)


def test_equal_pictures_summarise_to_perfect_scores_and_valid_json() -> None:
    picture = random_picture(5).astype(np.float32)
    found = summarise(picture, picture, background=BLACK)
    assert (found.rmse, found.max_error, found.percentile_error, found.tangent_step) == (0, 0, 0, 0)
    assert (found.delta_e_2000, found.psnr) == (0, math.inf)
    assert found.ssim == pytest.approx(1.0, abs=1e-12)
    written = json.loads(json.dumps(found.to_dict(), allow_nan=False))
    assert written["psnr"] is None
    assert written["wood_grain_energy"] is None
    assert written["grain_band"] is None


def test_saturated_pixels_are_counted_where_they_count() -> None:
    truth = np.zeros((16, 16, 4))
    truth[4:12, 4:12] = 0.5
    image = truth.copy()
    image[6, 6] = (2.0, 2.0, 2.0, 1.0)
    image[0, 0] = (2.0, 0.0, 0.0, 0.0)  # light without opacity: not visible by the definition
    assert summarise(image, truth, background=BLACK).saturated_pixels == 2
    assert summarise(image, truth, background=BLACK, pixels=Pixels.VISIBLE).saturated_pixels == 1


def test_the_summarised_step_is_of_the_pixels_that_count() -> None:
    # every visible pair, at the outline too, jumps by 1/4 or 1/2 in the truth and half of it in the picture; the
    # pairs of the empty surround do not jump at all
    checks = (1 + np.indices((16, 16)).sum(axis=0) % 2)[..., None] * np.full(4, 0.25)
    truth = np.pad(checks, ((8, 8), (8, 8), (0, 0)))
    assert summarise(0.5 * truth, truth, background=BLACK).tangent_step == 0.0
    visible = summarise(0.5 * truth, truth, background=BLACK, pixels=Pixels.VISIBLE)
    assert visible.tangent_step == -0.125


def test_a_summary_refuses_what_a_measure_refuses() -> None:
    image, truth = random_picture(1), random_picture(2)
    with pytest.raises(InputError, match="peak is 0"):
        summarise(image, truth, background=BLACK, peak=0.0)
    with pytest.raises(InputError, match="the background is"):
        summarise(image, truth, background=(2.0, 0.0, 0.0))
    with pytest.raises(InputError, match="expected equal shapes"):
        summarise(image, truth[1:], background=BLACK)

"""How much of the squared error a few pixels have: closed forms, what is left without them, refusals."""

from __future__ import annotations

import math

import numpy as np
import pytest

from isosample.compare.differences import rmse, worst_pixels_share
from isosample.compare.image_pair import Pixels
from isosample.errors import InputError

from .pictures import random_picture


def test_the_share_of_the_worst_pixels_is_that_of_their_squares() -> None:
    truth = np.zeros((40, 50, 4))  # 0.1 % of 2000 pixels are two
    image = truth.copy()
    image[3, 4] = (0.0, 0.3, 0.0, 0.4)  # 0.25
    image[5, 6] = (0.5, 0.0, 0.0, 0.0)  # 0.25
    image[7, 8:24] = (0.0, 0.0, 0.125, 0.0)  # 16 of 1/64: 0.25 together
    assert worst_pixels_share(image, truth, 0.1) == pytest.approx(2.0 / 3.0, rel=1e-15)
    assert worst_pixels_share(image, truth, 0.101) == pytest.approx(0.515625 / 0.75, rel=1e-15)  # three
    assert worst_pixels_share(image, truth, 100.0) == 1.0
    # of 18 visible pixels 0.1 % are one
    image[..., 3] = np.where(image.any(axis=-1), 1.0, 0.0)
    truth[..., 3] = image[..., 3]
    assert worst_pixels_share(image, truth, 0.1, pixels=Pixels.VISIBLE) == pytest.approx(
        0.25 / (0.25 + 0.09 + 0.25), rel=1e-15
    )


def test_without_its_worst_pixels_an_rmse_is_that_of_the_others() -> None:
    image, truth = random_picture(3), random_picture(4)
    share = worst_pixels_share(image, truth, 1.0)
    squares = np.sort(np.square(image - truth).sum(axis=-1).ravel())
    rest = math.sqrt(squares[: -math.ceil(squares.size / 100)].sum() / (4 * squares.size))
    assert rmse(image, truth) * math.sqrt(1.0 - share) == pytest.approx(rest, rel=1e-12)


def test_equal_pictures_have_no_worst_pixels_and_tiny_differences_do() -> None:
    picture = random_picture(5)
    assert worst_pixels_share(picture, picture, 0.1) == 0.0
    faint = np.zeros((11, 11, 4))
    faint[0, 0] = 1e-200  # whose square is 0 in float64
    assert worst_pixels_share(faint, np.zeros_like(faint), 0.1) == 1.0


@pytest.mark.parametrize("percent", [0.0, -1.0, 100.5, math.nan])
def test_a_share_of_no_pixels_is_refused(percent: float) -> None:
    with pytest.raises(InputError, match="percent is"):
        worst_pixels_share(random_picture(1), random_picture(2), percent)

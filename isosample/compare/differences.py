"""Plain measures of the linear difference between a picture and the truth."""

from __future__ import annotations

import math
from fractions import Fraction
from typing import TYPE_CHECKING

import numpy as np

from isosample.compare.image_pair import Pixels, counted_pixels, image_pair
from isosample.errors import InputError

if TYPE_CHECKING:
    import numpy.typing as npt

    from isosample.compare.image_pair import Mask
    from isosample.volume.grid import F64


def rmse(image: npt.ArrayLike, truth: npt.ArrayLike, *, pixels: Pixels = Pixels.ALL) -> float:
    """Root of the mean square difference over the four components of all counted pixels.

    Parameters
    ----------
    image, truth : (H, W, 4) array_like of float
        Premultiplied linear RGBA.
    pixels : Pixels
        Which pixels count.

    Returns
    -------
    error : float
        >= 0 [RGBA].

    Raises
    ------
    InputError
        If the pictures are not comparable or no pixel counts.
    """
    differences = _counted_differences(image, truth, pixels)
    largest = float(differences.max())
    if largest == 0.0:
        return 0.0
    # Scaled by the largest: squares of tiny differences do not vanish.
    return largest * math.sqrt(float(np.square(differences / largest).mean()))


def max_error(image: npt.ArrayLike, truth: npt.ArrayLike, *, pixels: Pixels = Pixels.ALL) -> float:
    """Largest difference of a component of a counted pixel.

    Parameters
    ----------
    image, truth : (H, W, 4) array_like of float
        Premultiplied linear RGBA.
    pixels : Pixels
        Which pixels count.

    Returns
    -------
    error : float
        >= 0 [RGBA].

    Raises
    ------
    InputError
        If the pictures are not comparable or no pixel counts.
    """
    return float(_counted_differences(image, truth, pixels).max())


def percentile_error(
    image: npt.ArrayLike, truth: npt.ArrayLike, percent: float, *, pixels: Pixels = Pixels.ALL
) -> float:
    """Least bound that the error keeps in a share of the counted pixels.

    Parameters
    ----------
    image, truth : (H, W, 4) array_like of float
        Premultiplied linear RGBA.
    percent : float
        Share of the pixels, in (0, 100]; 100 gives `max_error`.
    pixels : Pixels
        Which pixels count.

    Returns
    -------
    error : float
        At least `percent` % of the counted pixels differ by at most this in each component [RGBA]. It is the
        error of one of them: nothing is interpolated.

    Raises
    ------
    InputError
        If the pictures are not comparable, no pixel counts, or `percent` is out of its range.
    """
    if not 0.0 < percent <= 100.0:
        raise InputError(f"percent is {percent:g}; expected above 0 and up to 100, such as 99.9.")
    worst = _counted_differences(image, truth, pixels).max(axis=-1)
    # the decimal as written: 99.9 % of 1000 is 999
    rank = math.ceil(Fraction(str(percent)) * worst.size / 100)
    return float(np.partition(worst, rank - 1)[rank - 1])


def worst_pixels_share(
    image: npt.ArrayLike, truth: npt.ArrayLike, percent: float, *, pixels: Pixels = Pixels.ALL
) -> float:
    """Share of the squared error that lies in the worst pixels.

    Parameters
    ----------
    image, truth : (H, W, 4) array_like of float
        Premultiplied linear RGBA.
    percent : float
        How many of the counted pixels are the worst, in (0, 100]; rounded up to whole pixels.
    pixels : Pixels
        Which pixels count.

    Returns
    -------
    share : float
        In [0, 1]: the squares of the components' differences, summed over the pixels where that sum is largest, over
        the same of all pixels. 0 for equal pictures. Without these errors the RMSE would be sqrt(1 − share) of what
        it is.

    Raises
    ------
    InputError
        If the pictures are not comparable, no pixel counts, or `percent` is out of its range.
    """
    if not 0.0 < percent <= 100.0:
        raise InputError(f"percent is {percent:g}; expected above 0 and up to 100, such as 0.1.")
    differences = _counted_differences(image, truth, pixels)
    largest = float(differences.max())
    if largest == 0.0:
        return 0.0
    squares = np.sort(np.square(differences / largest).sum(axis=-1))  # scaled as in `rmse`
    rank = squares.size - math.ceil(Fraction(str(percent)) * squares.size / 100)
    return float(squares[rank:].sum() / squares.sum())


def psnr(image: npt.ArrayLike, truth: npt.ArrayLike, *, peak: float, pixels: Pixels = Pixels.ALL) -> float:
    """Peak signal-to-noise ratio, 20 log10(peak / rmse).

    Parameters
    ----------
    image, truth : (H, W, 4) array_like of float
        Premultiplied linear RGBA.
    peak : float
        Largest value that a component can have, > 0: 1 for unshaded pictures.
    pixels : Pixels
        Which pixels count.

    Returns
    -------
    ratio : float
        [dB]; infinite for equal pictures.

    Raises
    ------
    InputError
        If the pictures are not comparable, no pixel counts, or the peak is out of its range.
    """
    if not 0.0 < peak < math.inf:
        raise InputError(
            f"peak is {peak:g}; expected a finite number above 0, such as 1 for colours up to 1."
        )
    error = rmse(image, truth, pixels=pixels)
    return math.inf if error == 0.0 else 20.0 * (math.log10(peak) - math.log10(error))


def tangent_step(image: npt.ArrayLike, truth: npt.ArrayLike, *, pixels: Pixels = Pixels.ALL) -> float:
    """Largest jump between neighbouring pixels beyond the truth's.

    Parameters
    ----------
    image, truth : (H, W, 4) array_like of float
        Premultiplied linear RGBA.
    pixels : Pixels
        Which pixels count; a pair counts if one of its pixels does, so that outlines are judged.

    Returns
    -------
    step : float
        max(abs(d image) − abs(d truth)) over horizontal and vertical pairs and the four components [RGBA];
        at most twice `max_error`, and negative where the picture is smoother than the truth at every pair.

    Raises
    ------
    InputError
        If the pictures are not comparable, no pixel counts, or a picture is a single pixel.

    Notes
    -----
    A ray that passes just outside an isosurface misses its crossings: where rays become tangent to the
    surface, an integral over too few crossings jumps although the truth is smooth. RMSE hardly shows
    such lines.
    """
    estimate, reference = image_pair(image, truth)
    counted = counted_pixels(estimate, reference, pixels)
    if counted.size == 1:
        raise InputError("the pictures are 1x1 pixels; a step needs two neighbours. Render larger ones.")
    rows = _row_steps(estimate, reference, counted)
    columns = _row_steps(estimate.swapaxes(0, 1), reference.swapaxes(0, 1), counted.T)
    return float(np.concatenate([rows, columns]).max())


def _counted_differences(image: npt.ArrayLike, truth: npt.ArrayLike, pixels: Pixels) -> F64:
    """(N, 4) float64, absolute differences of the N counted pixels."""
    estimate, reference = image_pair(image, truth)
    differences: F64 = np.abs(estimate - reference)[counted_pixels(estimate, reference, pixels)]
    return differences


def _row_steps(estimate: F64, reference: F64, counted: Mask) -> F64:
    """(N, 4) float64, steps beyond the truth's from each row to the next, where one pixel counts."""
    beyond = np.abs(np.diff(estimate, axis=0)) - np.abs(np.diff(reference, axis=0))
    steps: F64 = beyond[counted[1:] | counted[:-1]]
    return steps

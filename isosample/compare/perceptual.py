"""Differences as an eye sees them: SSIM, CIE ΔE2000 and FLIP of the pictures as displayed."""

from __future__ import annotations

import importlib
import math
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from isosample.compare.image_pair import Pixels, counted_pixels, image_pair
from isosample.errors import InputError, MissingDependencyError
from isosample.integral.compositing import over
from isosample.rendering.image import srgb_from_linear

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy.typing as npt

    from isosample.compare.image_pair import Mask
    from isosample.volume.grid import F64

SSIM_SIGMA = 1.5  # [pixels] Wang et al. 2004
SSIM_RADIUS = 5  # of the 11 x 11 window that this sigma has there
HALF_STEP = 0.5 / 255  # what an 8-bit display does not show
FLIP_PIXELS_PER_DEGREE = 0.7 * 3840 / 0.7 * math.pi / 180  # 0.7 m from a display 3840 pixels and 0.7 m wide


class DisplayedPair(NamedTuple):
    """Two pictures over one background, as a display shows them."""

    image: F64  # (H, W, 3) linear RGB in [0, 1]
    truth: F64  # (H, W, 3) linear RGB in [0, 1]
    counted: Mask  # (H, W)
    saturated: (
        Mask  # (H, W), where a display cannot show one of the two: beyond [0, 1] by over half an 8-bit step
    )


def displayed_pair(
    image: npt.ArrayLike, truth: npt.ArrayLike, *, background: Sequence[float], pixels: Pixels
) -> DisplayedPair:
    """Both pictures over a background, saturated to what a display shows.

    Parameters
    ----------
    image, truth : (H, W, 4) array_like of float
        Premultiplied linear RGBA.
    background : (3,) sequence of float
        Opaque linear RGB, each in [0, 1].
    pixels : Pixels
        Which pixels count.

    Returns
    -------
    pair : DisplayedPair
        Highlights above 1 saturate, as in an 8-bit file; `saturated` tells where.

    Raises
    ------
    InputError
        If the pictures are not comparable, the background is not such a colour, or no pixel counts.
    """
    estimate, reference = image_pair(image, truth)
    counted = counted_pixels(estimate, reference, pixels)
    backdrop = np.array([*_checked_background(background), 1.0])
    shown = [over(picture, backdrop)[..., :3] for picture in (estimate, reference)]
    within = [np.clip(picture, 0.0, 1.0) for picture in shown]
    beyond = [np.abs(a - b).max(axis=-1) > HALF_STEP for a, b in zip(shown, within, strict=True)]
    return DisplayedPair(within[0], within[1], counted, beyond[0] | beyond[1])


def ssim(
    image: npt.ArrayLike,
    truth: npt.ArrayLike,
    *,
    background: Sequence[float],
    pixels: Pixels = Pixels.ALL,
) -> float:
    """Mean structural similarity of the displayed pictures.

    Parameters
    ----------
    image, truth : (H, W, 4) array_like of float
        Premultiplied linear RGBA; H, W >= 11.
    background : (3,) sequence of float
        Opaque linear RGB, each in [0, 1].
    pixels : Pixels
        Which pixels count. Those within 5 pixels of the border never do: the window leaves the picture there.

    Returns
    -------
    similarity : float
        In [-1, 1]; 1 for equal pictures.

    Raises
    ------
    InputError
        If the pictures are not comparable or smaller than the window, the background is not such a colour, or
        no pixel counts.
    MissingDependencyError
        If the package scikit-image is not installed.

    Notes
    -----
    [1]_ with its Gaussian window (σ = 1.5 pixels, 11 x 11), population covariance, K1 = 0.01, K2 = 0.03, on
    sRGB-encoded red, green and blue with the data range 1, averaged over the three.

    References
    ----------
    .. [1] Z. Wang, A. C. Bovik, H. R. Sheikh, E. P. Simoncelli, "Image quality assessment: from error
       visibility to structural similarity", IEEE TIP 13(4), 2004.
    """
    pair = displayed_pair(image, truth, background=background, pixels=pixels)
    inner = _inner_pixels(pair.counted)
    metrics = _module("skimage.metrics", "SSIM", "scikit-image")
    _, similarity = metrics.structural_similarity(
        srgb_from_linear(pair.image),
        srgb_from_linear(pair.truth),
        data_range=1.0,
        channel_axis=-1,
        gaussian_weights=True,
        sigma=SSIM_SIGMA,
        use_sample_covariance=False,
        full=True,
    )
    return float(similarity[inner].mean())


def delta_e_2000(
    image: npt.ArrayLike,
    truth: npt.ArrayLike,
    *,
    background: Sequence[float],
    pixels: Pixels = Pixels.ALL,
) -> float:
    """Mean colour difference CIE ΔE2000 of the displayed pictures.

    Parameters
    ----------
    image, truth : (H, W, 4) array_like of float
        Premultiplied linear RGBA.
    background : (3,) sequence of float
        Opaque linear RGB, each in [0, 1].
    pixels : Pixels
        Which pixels count.

    Returns
    -------
    difference : float
        >= 0; about 1 is a just noticeable difference between large patches.

    Raises
    ------
    InputError
        If the pictures are not comparable, the background is not such a colour, or no pixel counts.
    MissingDependencyError
        If the package scikit-image is not installed.

    Notes
    -----
    Linear RGB with sRGB primaries → sRGB → CIELAB (D65, 2° observer) → [1]_ with k_L = k_C = k_H = 1.

    References
    ----------
    .. [1] G. Sharma, W. Wu, E. N. Dalal, "The CIEDE2000 color-difference formula", Color Research and
       Application 30(1), 2005.
    """
    pair = displayed_pair(image, truth, background=background, pixels=pixels)
    color = _module("skimage.color", "the CIE ΔE2000 difference", "scikit-image")
    estimate, reference = (
        color.rgb2lab(srgb_from_linear(picture[pair.counted])) for picture in (pair.image, pair.truth)
    )
    differences = color.deltaE_ciede2000(reference, estimate)
    return float(differences.mean())


def flip(
    image: npt.ArrayLike,
    truth: npt.ArrayLike,
    *,
    background: Sequence[float],
    pixels: Pixels = Pixels.ALL,
    pixels_per_degree: float = FLIP_PIXELS_PER_DEGREE,
) -> float:
    """Mean FLIP of the displayed pictures: what is seen when they alternate on a screen.

    Parameters
    ----------
    image, truth : (H, W, 4) array_like of float
        Premultiplied linear RGBA.
    background : (3,) sequence of float
        Opaque linear RGB, each in [0, 1].
    pixels : Pixels
        Which pixels count.
    pixels_per_degree : float
        Of the viewer's visual angle, > 0; by default that of the paper, 67.02.

    Returns
    -------
    difference : float
        In [0, 1]; 0 for equal pictures.

    Raises
    ------
    InputError
        If the pictures are not comparable, the background is not such a colour, no pixel counts, or
        `pixels_per_degree` is out of its range.
    MissingDependencyError
        If the package flip-evaluator is not installed.

    Notes
    -----
    LDR-FLIP [1]_, computed by its authors' package in float32.

    References
    ----------
    .. [1] P. Andersson et al., "FLIP: a difference evaluator for alternating images", Proc. ACM CGIT
       3(2), 2020.
    """
    if not 0.0 < pixels_per_degree < math.inf:
        raise InputError(
            f"pixels_per_degree is {pixels_per_degree:g}; expected a finite number above 0, "
            f"such as {FLIP_PIXELS_PER_DEGREE:.2f}."
        )
    pair = displayed_pair(image, truth, background=background, pixels=pixels)
    evaluator = _module("flip_evaluator", "the FLIP difference", "flip-evaluator")
    reference, estimate = (np.ascontiguousarray(p, dtype=np.float32) for p in (pair.truth, pair.image))
    settings = {"ppd": pixels_per_degree}
    difference, *_ = evaluator.evaluate(reference, estimate, "LDR", False, False, False, settings)
    return float(difference[..., 0][pair.counted].mean(dtype=np.float64))


def _module(name: str, measure: str, package: str) -> Any:
    """Import a module that comes with the extra `compare`, or say how to install it."""
    try:
        return importlib.import_module(name)
    except ImportError as error:
        raise MissingDependencyError(
            f'{measure} needs {package}, which is not installed: pip install "isosample[compare]".'
        ) from error


def _checked_background(background: Sequence[float]) -> Sequence[float]:
    if len(background) != 3 or not all(0.0 <= component <= 1.0 for component in background):
        raise InputError(
            f"the background is {tuple(background)}; expected linear R, G, B, each 0 to 1. "
            "Name the opaque colour over which the pictures are shown."
        )
    return background


def _inner_pixels(counted: Mask) -> Mask:
    """The counted pixels whose SSIM window lies inside the picture."""
    side = 2 * SSIM_RADIUS + 1
    if min(counted.shape) < side:
        raise InputError(
            f"the pictures are {counted.shape[1]}x{counted.shape[0]} pixels; SSIM needs at least "
            f"{side}x{side}. Render larger ones."
        )
    inner = np.zeros_like(counted)
    core = (slice(SSIM_RADIUS, -SSIM_RADIUS), slice(SSIM_RADIUS, -SSIM_RADIUS))
    inner[core] = counted[core]
    if not inner.any():
        raise InputError(
            f"each visible pixel is within {SSIM_RADIUS} pixels of the border, where SSIM has no full "
            "window; count all pixels, or leave a margin about the volume."
        )
    return inner

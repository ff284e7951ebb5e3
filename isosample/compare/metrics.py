"""How far a picture is from the truth: every measure by one import, and all of them at once."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

from isosample.compare.differences import (
    max_error,
    percentile_error,
    psnr,
    rmse,
    tangent_step,
    worst_pixels_share,
)
from isosample.compare.image_pair import Pixels
from isosample.compare.perceptual import delta_e_2000, displayed_pair, flip, ssim
from isosample.compare.wood_grain import grain_band, wood_grain_energy

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy.typing as npt

__all__ = [
    "ErrorSummary", "Pixels", "delta_e_2000", "flip", "grain_band", "max_error", "percentile_error", "psnr",
    "rmse", "ssim", "summarise", "tangent_step", "wood_grain_energy", "worst_pixels_share",
]  # fmt: skip

HIGH_PERCENT, WORST_PERCENT = 99.9, 0.1  # of the summary


@dataclass(frozen=True, slots=True, kw_only=True)
class ErrorSummary:
    """All measures of one picture against the truth, and the choices that they depend on.

    Attributes
    ----------
    rmse, max_error, percentile_error, tangent_step : float
        [RGBA, premultiplied linear]; the percentile is the 99.9th.
    worst_pixels_share : float
        Share of the squared error in the worst 0.1 % of the pixels.
    psnr : float
        [dB] against `peak`; infinite for equal pictures.
    ssim, delta_e_2000 : float
        Of the pictures over `background`.
    flip : float or None
        None unless asked for.
    wood_grain_energy : float or None
        Mean square error in `grain_band`; None without a band.
    counted_pixels, saturated_pixels : int
        How many pixels count, and how many of them a display cannot show in one of the pictures: there the
        displayed measures see the saturated colour.
    peak, background, pixels, grain_band
        The choices.
    """

    rmse: float
    max_error: float
    percentile_error: float
    worst_pixels_share: float
    psnr: float
    ssim: float
    delta_e_2000: float
    tangent_step: float
    flip: float | None
    wood_grain_energy: float | None
    counted_pixels: int
    saturated_pixels: int
    peak: float
    background: tuple[float, float, float]
    pixels: Pixels
    grain_band: tuple[float, float] | None

    def to_dict(self) -> dict[str, Any]:
        """All fields, JSON-ready; `psnr` is None where it is infinite (JSON has no infinity)."""
        fields = asdict(self)
        fields["psnr"] = self.psnr if math.isfinite(self.psnr) else None
        fields["pixels"] = self.pixels.value
        fields["background"] = list(self.background)
        fields["grain_band"] = None if self.grain_band is None else list(self.grain_band)
        return fields


def summarise(
    image: npt.ArrayLike,
    truth: npt.ArrayLike,
    *,
    background: Sequence[float],
    peak: float = 1.0,
    pixels: Pixels = Pixels.ALL,
    grain_band: tuple[float, float] | None = None,
    with_flip: bool = False,
) -> ErrorSummary:
    """All measures at once.

    Parameters
    ----------
    image, truth : (H, W, 4) array_like of float
        Premultiplied linear RGBA; H, W >= 11.
    background : (3,) sequence of float
        Opaque linear RGB in [0, 1] under the displayed pictures (SSIM, ΔE2000, FLIP).
    peak : float
        Of `psnr`, > 0.
    pixels : Pixels
        Which pixels count, in every measure.
    grain_band : (low, high), optional
        Of `wood_grain_energy` [cycles/pixel]; without it that measure is left out.
    with_flip : bool
        Whether FLIP is computed; it needs the package flip-evaluator.

    Returns
    -------
    summary : ErrorSummary
        Its `to_dict` is JSON-ready.

    Raises
    ------
    InputError
        If a measure refuses its input.
    MissingDependencyError
        If FLIP is asked for and flip-evaluator is not installed.
    """
    shown = displayed_pair(image, truth, background=background, pixels=pixels)
    red, green, blue = (float(component) for component in background)
    return ErrorSummary(
        rmse=rmse(image, truth, pixels=pixels),
        max_error=max_error(image, truth, pixels=pixels),
        percentile_error=percentile_error(image, truth, HIGH_PERCENT, pixels=pixels),
        worst_pixels_share=worst_pixels_share(image, truth, WORST_PERCENT, pixels=pixels),
        psnr=psnr(image, truth, peak=peak, pixels=pixels),
        ssim=ssim(image, truth, background=background, pixels=pixels),
        delta_e_2000=delta_e_2000(image, truth, background=background, pixels=pixels),
        tangent_step=tangent_step(image, truth, pixels=pixels),
        flip=flip(image, truth, background=background, pixels=pixels) if with_flip else None,
        wood_grain_energy=None
        if grain_band is None
        else wood_grain_energy(image, truth, band=grain_band, pixels=pixels),
        counted_pixels=int(shown.counted.sum()),
        saturated_pixels=int((shown.saturated & shown.counted).sum()),
        peak=float(peak),
        background=(red, green, blue),
        pixels=pixels,
        grain_band=grain_band,
    )

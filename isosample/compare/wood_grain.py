"""Wood grain: the energy of the error's spectrum in the band of the sampling step."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from isosample.compare.image_pair import Pixels, counted_pixels, image_pair
from isosample.errors import InputError

if TYPE_CHECKING:
    import numpy.typing as npt

    from isosample.volume.grid import F64

NYQUIST = 0.5  # cycles/pixel along an axis
GRAIN_TILTS = (15.0, 60.0)  # of surfaces on which steps are looked for [degrees]


def wood_grain_energy(
    image: npt.ArrayLike,
    truth: npt.ArrayLike,
    *,
    band: tuple[float, float],
    pixels: Pixels = Pixels.ALL,
) -> float:
    r"""Energy of the error in a band of spatial frequencies.

    Parameters
    ----------
    image, truth : (H, W, 4) array_like of float
        Premultiplied linear RGBA.
    band : (low, high)
        Radial frequencies [cycles/pixel], 0 <= low < high, `low` included and `high` not; `grain_band` gives
        the band of a sampling step. The largest radial frequency of a picture is :math:`\sqrt{1/2}`.
    pixels : Pixels
        Over which pixels the energy is averaged.

    Returns
    -------
    energy : float
        Mean square of the part of the error in the band [squared RGBA], >= 0; its root compares with `rmse`.

    Raises
    ------
    InputError
        If the pictures are not comparable, the band is empty or reversed, or it lies between the frequencies
        that a picture of this size resolves (multiples of 1/W and 1/H).

    Notes
    -----
    With the error e = image − truth, per channel c, and the window
    :math:`w(y, x) = \sin^2(\pi(y + \tfrac12)/H) \sin^2(\pi(x + \tfrac12)/W)` (Hann, nowhere 0),

    .. math::

        E = \frac{1}{4} \sum_c \; \sum_{low \le |k| < high}
            \frac{|F_c(k)|^2}{H\,W \sum_{\text{counted}} w^2}, \qquad
        F_c = \mathrm{DFT}\left[w\,(e_c - \bar e_c)\right], \qquad
        \bar e_c = \frac{\sum w e_c}{\sum w}, \qquad
        |k| = \sqrt{(k_x/W)^2 + (k_y/H)^2}.

    By Parseval's theorem the energies of bands that share no frequency add up, and all together give the mean
    of :math:`(e - \bar e)^2` weighted by :math:`w^2`. A sine of amplitude A with a whole number of
    periods (2 to N/2 − 2), in one channel, has the energy :math:`A^2/8` if the band holds its frequency and
    the neighbours 1/W and 1/H away, to which the window spreads it. The window keeps the picture's border (a
    jump from one side to the other) out of the band: the amplitude that a slowly varying error leaks into it
    falls as the cube of the distance in frequency. With `Pixels.VISIBLE` only the normalisation changes:
    where both pictures are empty the error is 0 already.
    """
    estimate, reference = image_pair(image, truth)
    counted = counted_pixels(estimate, reference, pixels)
    inside = _band_frequencies(counted.shape[0], counted.shape[1], band)
    window = np.outer(_hann(counted.shape[0]), _hann(counted.shape[1]))
    error = estimate - reference
    mean = np.tensordot(window, error, axes=2) / window.sum()
    spectrum = np.fft.fft2(window[..., None] * (error - mean), axes=(0, 1), norm="ortho")
    power = np.abs(spectrum[inside]) ** 2
    return float(power.sum() / (4.0 * np.square(window[counted]).sum()))


def grain_band(
    *, step: float, pixel_size: float, tilts: tuple[float, float] = GRAIN_TILTS
) -> tuple[float, float]:
    r"""Spatial frequencies at which a ray caster's sampling step shows on surfaces of some tilts.

    Parameters
    ----------
    step : float
        Distance between samples along a ray [world], > 0.
    pixel_size : float
        Distance between neighbouring rays [world], > 0.
    tilts : (least, greatest)
        Angles between surface and image plane [degrees], 0 < least < greatest < 90.

    Returns
    -------
    low, high : float
        Band for `wood_grain_energy` [cycles/pixel].

    Raises
    ------
    InputError
        If an argument is out of its range, or the grain of the greatest tilt is finer than a picture can show
        (above half a cycle per pixel, where it folds back to a lower frequency).

    Notes
    -----
    Parallel rays sampled at the depths n·step meet a plane tilted by θ at depths that grow by
    pixel_size·tan θ from pixel to pixel. The sampling error depends on depth modulo step, so it repeats
    pixel_size·tan θ/step times per pixel; harmonics lie above. For perspective, take the rays' distance at
    the surface.
    """
    if not (0.0 < step < math.inf and 0.0 < pixel_size < math.inf):
        raise InputError(f"step {step:g} and pixel_size {pixel_size:g} must be finite and above 0 [world].")
    least, greatest = tilts
    if not 0.0 < least < greatest < 90.0:
        raise InputError(f"tilts are {least:g} to {greatest:g} degrees; expected 0 < least < greatest < 90.")
    low, high = _grain(step, pixel_size, tilts)
    if high > NYQUIST:
        raise InputError(
            f"a tilt of {greatest:g} degrees gives {high:g} cycles/pixel; a picture shows up to {NYQUIST:g}. "
            "Render more pixels, or take a smaller greatest tilt."
        )
    return low, high


def grain_band_shown(*, step: float, pixel_size: float, size: tuple[int, int]) -> tuple[float, float] | None:
    """The band of `grain_band`, cut to what a picture can show.

    Parameters
    ----------
    step, pixel_size : float
        As of `grain_band`.
    size : (width, height)
        Pixels.

    Returns
    -------
    band : (low, high) or None
        Band for `wood_grain_energy` [cycles/pixel]; None where it lies between the frequencies that a picture of this
        size resolves, as where the whole picture shows less than a step.
    """
    low, high = _grain(step, pixel_size, GRAIN_TILTS)
    band = min(low, NYQUIST / 2.0), min(high, NYQUIST)
    return band if _frequencies_between(size[1], size[0], band).any() else None


def _grain(step: float, pixel_size: float, tilts: tuple[float, float]) -> tuple[float, float]:
    """Frequencies of the steps on surfaces of two tilts [cycles/pixel], however high."""
    low, high = (math.tan(math.radians(tilt)) * pixel_size / step for tilt in tilts)
    return low, high


def _hann(length: int) -> F64:
    window: F64 = np.sin(np.pi * (np.arange(length) + 0.5) / length) ** 2
    return window


def _band_frequencies(height: int, width: int, band: tuple[float, float]) -> npt.NDArray[np.bool_]:
    """(height, width) bool, which frequencies of the transform lie in the band."""
    low, high = band
    if not 0.0 <= low < high:
        raise InputError(f"the band is {low:g} to {high:g} cycles/pixel; expected 0 <= low < high.")
    inside = _frequencies_between(height, width, band)
    if not inside.any():
        raise InputError(
            f"no frequency of a {width}x{height} picture lies in {low:g} to {high:g} cycles/pixel; expected multiples "
            f"of 1/{width} and 1/{height} up to {_radii(height, width).max():.4f}. Widen the band."
        )
    return inside


def _frequencies_between(height: int, width: int, band: tuple[float, float]) -> npt.NDArray[np.bool_]:
    radius = _radii(height, width)
    inside: npt.NDArray[np.bool_] = (band[0] <= radius) & (radius < band[1])
    return inside


def _radii(height: int, width: int) -> F64:
    """(height, width), the radial frequencies of the transform [cycles/pixel]."""
    radii: F64 = np.hypot(np.fft.fftfreq(height)[:, None], np.fft.fftfreq(width))
    return radii

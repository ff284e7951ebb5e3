"""Convolution of samples with the discrete Gaussian kernel, along one axis after the other, in threads."""

from __future__ import annotations

import math
import os
from concurrent.futures import ThreadPoolExecutor
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    import numpy.typing as npt

    from isosample.volume.grid import F64, SampleArray

TRUNCATION = 1e-6  # of the kernel's sum, that is left out beyond its ends
PART_SAMPLES = 1 << 20  # of one task


def discrete_gaussian(sigma: float) -> F64:
    r"""Weights of the discrete Gaussian.

    Parameters
    ----------
    sigma : float
        Standard deviation [samples], >= 0.

    Returns
    -------
    weights : (2R + 1,) float64
        Symmetric, of sum 1; R is the smallest radius beyond which less than `TRUNCATION` of the sum would lie.

    Notes
    -----
    :math:`T(k) = e^{-\sigma^2} I_{|k|}(\sigma^2)` ([1]_, eq. 19): the only kernel whose repetition adds variances, and
    whose own variance is :math:`\sigma^2` however small.

    References
    ----------
    .. [1] T. Lindeberg, "Scale-space for discrete signals", IEEE TPAMI 12(3), 1990.
    """
    from scipy.special import ive

    half = ive(np.arange(math.ceil(6.0 * sigma) + 12), sigma * sigma)
    inside = half[0] + 2.0 * np.concatenate([[0.0], np.cumsum(half[1:])])
    radius = int(np.argmax(inside > 1.0 - TRUNCATION))
    whole = np.concatenate([half[radius:0:-1], half[: radius + 1]])
    weights: F64 = whole / whole.sum()
    return weights


def convolved(
    samples: SampleArray,
    sigmas: Sequence[float],
    dtype: npt.DTypeLike,
    progress: Callable[[int, int], None] | None = None,
) -> SampleArray:
    """Return samples that are smoothed along every axis; behind a border its samples go on.

    Parameters
    ----------
    samples : (Z, Y, X) array
        Finite, in the machine's byte order.
    sigmas : 3 floats
        Standard deviations along z, y, x [samples].
    dtype : float32 or float64
        Of the result. Sums are float64, and rounded once per axis.
    progress : callable, optional
        Called with (parts done, parts in all).

    Returns
    -------
    smooth : (Z, Y, X) array
        The only other array of that size that is made.
    """
    result: SampleArray = np.empty(samples.shape, dtype)
    passes = [(axis, discrete_gaussian(sigma)) for axis, sigma in enumerate(sigmas)]
    parts = {axis: list(_parts(samples.shape, axis)) for axis, _ in passes}
    total, done = sum(len(found) for found in parts.values()), 0
    source: SampleArray = samples
    with ThreadPoolExecutor(max_workers=os.cpu_count()) as pool:
        for axis, weights in passes:
            tasks = [
                pool.submit(_correlate, source[part], weights, axis, result[part]) for part in parts[axis]
            ]
            for task in tasks:
                task.result()
                done += 1
                if progress is not None:
                    progress(done, total)
            source = result
    return result


def _correlate(source: SampleArray, weights: F64, axis: int, result: SampleArray) -> None:
    """Convolve whole lines along one axis; source and result may be the same."""
    from scipy.ndimage import correlate1d

    correlate1d(source, weights, axis=axis, output=result, mode="nearest")


def _parts(shape: tuple[int, ...], axis: int) -> Iterator[tuple[Any, ...]]:
    """Yield slices that cut an array into parts with whole lines along an axis."""
    across = 1 if axis == 0 else 0
    width = max(1, PART_SAMPLES * shape[across] // math.prod(shape))
    for first in range(0, shape[across], width):
        part = slice(first, first + width)
        yield (slice(None), part) if across else (part,)

"""Smoothing of a volume before it is rendered: anisotropic diffusion, Gaussian, median; spacing is honoured.

>>> smooth = anisotropic_diffusion(volume, iterations=10)
"""

from __future__ import annotations

import itertools
import math
import os
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from isosample.defaults import DEFAULT_CONDUCTANCE, DEFAULT_ITERATIONS, DEFAULT_TIME_SHARE
from isosample.errors import InputError
from isosample.volume.readers.itk import simpleitk

if TYPE_CHECKING:
    from collections.abc import Callable

    import numpy.typing as npt

    from isosample.volume.grid import SampleArray, Volume

    F32 = npt.NDArray[np.float32]
    Progress = Callable[[int, int], None]

LARGEST_SIGMA = 256  # samples
LARGEST_RADIUS = 16  # samples: a median of 33³ of them
PERCENT = 100


def anisotropic_diffusion(
    volume: Volume,
    *,
    conductance: float = DEFAULT_CONDUCTANCE,
    iterations: int = DEFAULT_ITERATIONS,
    time_step: float | None = None,
    progress: Progress | None = None,
) -> Volume:
    r"""Return a volume whose noise is smoothed along edges, which stay.

    Parameters
    ----------
    volume : Volume
        With finite samples.
    conductance : float
        Slopes far above this multiple of the typical slope are edges; > 0. Large values smooth everything.
    iterations : int
        Steps, >= 1.
    time_step : float, optional
        Length of a step [world²], at most `longest_time_step`; three eighths of that by default.
    progress : callable, optional
        Called with (steps done, steps in all).

    Returns
    -------
    smooth : Volume
        float32, with the same placement.

    Raises
    ------
    InputError
        If a number is out of range or a sample is not finite.

    Notes
    -----
    Explicit steps of :math:`\partial_t f = \nabla \cdot (\exp(-|\nabla f|^2 / (2 k^2 s^2)) \nabla f)` ([1]_, with the
    whole gradient in the conductance), s² being the mean of \|∇f\|² before the step and k the conductance. On a
    spacing of 1 it is what ITK's gradient anisotropic diffusion computes; on any other, ITK divides by the spacing
    once where the equation does so twice, and smooths distant samples too much.

    References
    ----------
    .. [1] P. Perona, J. Malik, "Scale-space and edge detection using anisotropic diffusion", IEEE TPAMI 12(7), 1990.
    """
    from isosample.volume.diffusion_kernels import diffuse_layers, squared_slopes

    step = _time_step(volume, conductance, iterations, time_step)
    field = _finite_samples(volume, "the diffusion").astype(np.float32)
    inverse = 1.0 / np.array(volume.spacing[::-1])
    result = np.empty_like(field)
    parts = _parts(len(field))
    with ThreadPoolExecutor(max_workers=os.cpu_count()) as pool:
        for done in range(iterations):
            sums = [pool.submit(squared_slopes, field, *part, inverse) for part in parts]
            mean = math.fsum(one.result() for one in sums) / field.size
            if mean == 0.0:
                break  # constant: nothing diffuses
            scale = 1.0 / (2.0 * conductance**2 * mean)
            steps = [
                pool.submit(diffuse_layers, field, result, *part, inverse, scale, step) for part in parts
            ]
            for one in steps:
                one.result()
            field, result = result, field
            if progress is not None:
                progress(done + 1, iterations)
    return replace(volume, array=field)


def longest_time_step(volume: Volume) -> float:
    """Longest stable step of the diffusion [world²]: with it no sample leaves the range of its neighbours."""
    return float(0.5 / sum(1.0 / spacing**2 for spacing in volume.spacing))


def gaussian(volume: Volume, sigma: float, *, progress: Progress | None = None) -> Volume:
    """Return a volume smoothed by a Gaussian.

    Parameters
    ----------
    volume : Volume
        With finite samples. Behind its border the samples there go on.
    sigma : float
        Standard deviation [world], > 0; the same in every direction, whatever the spacing.
    progress : callable, optional
        Called with (parts done, parts in all).

    Returns
    -------
    smooth : Volume
        float32, or float64 where the samples are wider than 16 bits of an integer or are float64 themselves.

    Raises
    ------
    InputError
        If sigma is not positive and finite, is beyond the largest kernel, or a sample is not finite.

    Notes
    -----
    By the discrete Gaussian, whose variance is exact also where sigma is less than a sample, cut off where less than
    1e-6 of it is left.
    """
    from isosample.volume.discrete_gaussian import convolved

    if not (math.isfinite(sigma) and sigma > 0.0):
        raise InputError(f"a Gaussian of sigma {sigma!r} is impossible; give a length above 0 [world].")
    sigmas = [sigma / spacing for spacing in volume.spacing[::-1]]
    if max(sigmas) > LARGEST_SIGMA:
        raise InputError(
            f"sigma {sigma:g} is {max(sigmas):.6g} samples; a Gaussian may have {LARGEST_SIGMA}. Downsample first."
        )
    samples = _finite_samples(volume, "the Gaussian")
    real = _real_type(samples.dtype)
    stored = samples.astype(real) if samples.dtype == np.float16 else samples
    return replace(volume, array=convolved(stored, sigmas, real, progress))


def median(volume: Volume, radius: float, *, progress: Progress | None = None) -> Volume:
    """Return a volume of medians over boxes, through SimpleITK.

    Parameters
    ----------
    volume : Volume
        With finite samples.
    radius : float
        Half the edge of the box around a sample [world], rounded to whole samples along every axis.
    progress : callable, optional
        Called with (percent done, 100).

    Returns
    -------
    smooth : Volume
        With samples of the same type.

    Raises
    ------
    InputError
        If no other sample lies in the box, the box is too large, or a sample is not finite.
    MissingDependencyError
        If SimpleITK is not installed.
    """
    if not (math.isfinite(radius) and radius > 0.0):
        raise InputError(f"a median of radius {radius!r} is impossible; give a length above 0 [world].")
    reach = [math.floor(radius / spacing + 0.5) for spacing in volume.spacing]
    if not 1 <= max(reach) <= LARGEST_RADIUS:
        raise InputError(
            f"a radius of {radius:g} world units is {' x '.join(map(str, reach))} samples (x, y, z) at the spacing "
            f"{volume.spacing}; expected 1 to {LARGEST_RADIUS} along the closest axis."
        )
    sitk = simpleitk("a median")
    samples = _finite_samples(volume, "the median")
    box = sitk.MedianImageFilter()
    box.SetRadius(reach)
    stored = samples.astype(np.float32) if samples.dtype == np.float16 else samples
    filtered = _through_itk(sitk, box, volume, stored, progress)
    return replace(filtered, array=filtered.array.astype(samples.dtype))


def _time_step(volume: Volume, conductance: float, iterations: int, time_step: float | None) -> float:
    """Check the numbers of a diffusion; return the length of a step."""
    if not (math.isfinite(conductance) and conductance > 0.0):
        raise InputError(f"conductance {conductance!r} must be a finite number above 0.")
    if iterations < 1:
        raise InputError(f"iterations {iterations!r} must be a whole number >= 1.")
    longest = longest_time_step(volume)
    step = DEFAULT_TIME_SHARE * longest if time_step is None else time_step
    if not 0.0 < step <= longest:
        raise InputError(
            f"time step {time_step!r} must be above 0 and at most {longest:.6g}, where steps are stable at the spacing "
            f"{volume.spacing}; take more iterations instead."
        )
    return step


def _parts(layers: int) -> list[tuple[int, int]]:
    """First layer and one behind the last, of as many parts as there are cores."""
    ends = np.linspace(0, layers, min(layers, os.cpu_count() or 1) + 1).astype(int).tolist()
    return list(itertools.pairwise(ends))


def _finite_samples(volume: Volume, what: str) -> SampleArray:
    """Samples in memory, in the machine's byte order; raise where one is not finite."""
    nan_count, infinity_count = volume.nonfinite_counts
    if nan_count or infinity_count:
        raise InputError(
            f"{volume.name} has {nan_count} NaN and {infinity_count} infinite samples, which {what} would spread; "
            "replace them first."
        )
    samples = np.asarray(volume.in_memory().array)
    return np.ascontiguousarray(samples, dtype=samples.dtype.newbyteorder("="))


def _real_type(dtype: np.dtype[Any]) -> type[np.float32 | np.float64]:
    """Floating point type that holds every sample of a type."""
    narrow = dtype.itemsize <= (2 if dtype.kind in "iu" else 4)
    return np.float32 if narrow else np.float64


def _through_itk(
    sitk: Any, chosen: Any, volume: Volume, samples: SampleArray, progress: Progress | None
) -> Volume:
    """Run one of SimpleITK's filters on samples with the volume's spacing."""
    image = sitk.GetImageFromArray(samples)
    image.SetSpacing(volume.spacing)
    if progress is not None:
        chosen.AddCommand(
            sitk.sitkProgressEvent, lambda: progress(round(PERCENT * chosen.GetProgress()), PERCENT)
        )
    found: SampleArray = sitk.GetArrayFromImage(chosen.Execute(image))
    if progress is not None:
        progress(PERCENT, PERCENT)
    return replace(volume, array=found)

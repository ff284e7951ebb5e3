"""A transfer function as one texture: what ``shaders/pass/transfer.glsl`` reads."""

from __future__ import annotations

import itertools
import math
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from isosample.rendering.frame import shared_constants
from isosample.rendering.raycast_settings import PeakWeight
from isosample.transfer.peaks import find_peaks
from isosample.transfer.value_bands import HIGHEST, LOWEST

if TYPE_CHECKING:
    from isosample.rendering.scene import ValueScale
    from isosample.transfer.peaks import TransferPeak
    from isosample.transfer.transfer_function import TransferFunction
    from isosample.transfer.value_bands import ValueBands

    F32 = npt.NDArray[np.float32]
    F64 = npt.NDArray[np.float64]

TEXELS = ("OPTICS_LOW", "OPTICS_HIGH", "RANGE", "IMPULSE", "SHEET", "PEAK", "PEAK_PLACE")  # see layouts.glsl
ROUNDING = 2.0**-20  # of a normalised value: 16 roundings of float32, of which an interpolation has 10
LEAST_WIDTH = 1e-30  # of a band that has an inside; the inverse is a float32 number


def transfer_texels(
    bands: ValueBands, peaks: list[TransferPeak], weight: PeakWeight, *, sampled: bool
) -> F32:
    """Texels of a transfer function.

    Parameters
    ----------
    bands : ValueBands
    peaks : list of TransferPeak
        With normalised values (`shown_peaks`).
    weight : PeakWeight
        What the sheet of a level is at which the extinction has a peak: with `PAPER` what the paper composites there,
        the opacity of its extinction over a length of 1; with `INTEGRAL` a mark, red 1 and opacity 0.
    sampled : bool
        Whether there are rows of the sampled function.

    Returns
    -------
    texels : (rows, BAND_START_COUNT, 4) float32
        Bins, sampled function, bands; see the shader file.
    """
    width, band_texels = (shared_constants()[name] for name in ("BAND_START_COUNT", "BAND_TEXELS"))
    blocks = [_bins(bands, width)[None]]
    if sampled:
        sampled_rows = shared_constants()["SAMPLED_ROWS"]
        values = np.linspace(0.0, 1.0, sampled_rows * width)
        blocks.append(bands.evaluate(values).reshape(sampled_rows, width, 4))
    records = _records(bands, peaks, weight)
    rows = -(-len(records) * band_texels // width)
    table = np.zeros((rows * width, 4))
    table[: records.shape[0] * band_texels] = records.reshape(-1, 4)
    return np.concatenate([*blocks, table.reshape(rows, width, 4)]).astype(np.float32)


def has_few_bands(bands: ValueBands) -> bool:
    """Whether no bin meets more than two bands."""
    bins = _bins(bands, shared_constants()["BAND_START_COUNT"])
    return bool((bins[:, 1] - bins[:, 0]).max() <= 1.0)


def _bins(bands: ValueBands, count: int) -> F64:
    """(count, 4): first and last band of every bin of [0, 1], the largest extinction in these, the first one's end.

    The outer bins hold all values beyond them.
    """
    edges = np.searchsorted(bands.levels, np.arange(count + 1) / count, side="right")
    edges[0], edges[-1] = 0, len(bands.levels)
    bins = np.zeros((count, 4))
    bins[:, 0], bins[:, 1] = edges[:-1], edges[1:]
    bins[:, 3] = bands.ends[edges[:-1], 1]
    largest = bands.optics[:, :, 3].max(axis=1)
    bins[:, 2] = [largest[first : last + 1].max() for first, last in itertools.pairwise(edges)]
    return bins


def _records(bands: ValueBands, peaks: list[TransferPeak], weight: PeakWeight) -> F64:
    """(N, BAND_TEXELS, 4) of N bands or peaks, whichever are more."""
    texel = {name: shared_constants()[f"TEXEL_{name}"] for name in TEXELS}
    count = len(bands.ends)
    records = np.zeros((max(count, len(peaks)), shared_constants()["BAND_TEXELS"], 4))
    width = bands.ends[:, 1] - bands.ends[:, 0]
    wide = width > LEAST_WIDTH
    records[:count, texel["OPTICS_LOW"]], records[:count, texel["OPTICS_HIGH"]] = (
        bands.optics[:, 0],
        bands.optics[:, 1],
    )
    records[:count, texel["RANGE"], :2] = bands.ends
    records[:count, texel["RANGE"], 2] = bands.optics[:, :, 3].max(axis=1)
    records[:count, texel["RANGE"], 3] = np.where(wide, 1.0, 0.0) / np.where(wide, width, 1.0)
    records[: count - 1, texel["IMPULSE"]] = bands.impulses
    for number, peak in enumerate(peaks):
        opacity = peak.strength if peak.isosurface else -np.expm1(-peak.strength)
        records[number, texel["PEAK"]] = (*peak.color, opacity)
        records[number, texel["PEAK_PLACE"], :2] = (peak.value, peak.isosurface)
        if not peak.isosurface:
            level = int(np.abs(bands.levels - np.float32(peak.value)).argmin())
            records[level, texel["SHEET"]] = (
                (1, 0, 0, 0) if weight is PeakWeight.INTEGRAL else (*peak.color, opacity)
            )
    return records


def shown_peaks(transfer_function: TransferFunction, scale: ValueScale) -> list[TransferPeak]:
    """Peaks that values of the volume can come near to, ascending, with normalised values."""
    found = []
    for peak in find_peaks(transfer_function):
        value = float(scale.normalise(np.array(peak.value)))
        if LOWEST < value < HIGHEST:
            found.append(peak._replace(value=value))
    return found


def looked_up_intervals(intervals: F64, scale: ValueScale, cells: int, *, whole_cells: bool) -> F64:
    """Intervals of values at which a lookup shows something.

    Parameters
    ----------
    intervals : (N, 2) float64
        Closed intervals of data values with extinction (`visible_intervals`).
    scale : ValueScale
        Of the volume.
    cells : int
        Of the table, between normalised values 0 and 1; values beyond are taken for these.
    whole_cells : bool
        False: the lookup interpolates between the ends of a cell, and shows nothing at an end where nothing is visible.
        True: it takes the mean over a cell, lower end included, but that of the first one.

    Returns
    -------
    seen : (N, 2) float64
        Closed intervals that hold the given ones, and values whose float32 number may be off by `ROUNDING`.
    """
    low, high = scale.low, scale.high
    if not low <= high:  # no sample is finite
        return intervals
    places = cells * scale.normalise(np.clip(intervals, low, high))
    slack = cells * ROUNDING
    first = np.floor(places[:, 0] - slack) if whole_cells else np.ceil(places[:, 0] - slack) - 1.0
    last = np.floor(places[:, 1] + slack) + 1.0
    width = 1.0 / scale.inverse_width
    # Much of a volume may have its lowest value, which is 0 exactly: what is visible above it only does not reach it.
    lower = np.maximum(low + width * (first / cells - ROUNDING), math.nextafter(low, math.inf))
    upper = high + width * (last / cells - 1.0 + ROUNDING)
    lower[intervals[:, 0] <= low] = -math.inf
    upper[(last >= cells) if whole_cells else (intervals[:, 1] >= high)] = math.inf
    meets = (intervals[:, 1] >= low) & (intervals[:, 0] <= high)
    seen: F64 = np.where(meets[:, None], np.stack([lower, upper], axis=-1), intervals)
    return seen

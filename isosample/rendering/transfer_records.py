"""A transfer function as records in the layouts of the shaders."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from isosample.rendering.frame import storage_dtype
from isosample.rendering.raycast_settings import PeakWeight
from isosample.transfer.peaks import find_peaks
from isosample.transfer.value_bands import HIGHEST, LOWEST

if TYPE_CHECKING:
    from isosample.rendering.scene import ValueScale
    from isosample.transfer.transfer_function import TransferFunction
    from isosample.transfer.value_bands import ValueBands

    F64 = npt.NDArray[np.float64]

LEAST_WIDTH = 1e-30  # of a band that has an inside; the inverse is a float32 number


def visible_intervals(transfer_function: TransferFunction) -> F64:
    """(N, 2) float64, closed intervals of data values with extinction, and isosurfaces as points.

    Ascending by their lower ends; neighbouring slopes are one interval each.
    """
    slopes = [(slope.low.value, slope.high.value) for slope in transfer_function.slopes() if slope.visible]
    points = [(surface.value, surface.value) for surface in transfer_function.isosurfaces]
    return np.array(sorted([*slopes, *points]), dtype=np.float64).reshape(-1, 2)


def band_records(bands: ValueBands) -> npt.NDArray[np.void]:
    """(K + 1,) struct Band; ends and widths are those of the float32 numbers that the shader compares."""
    records = np.zeros(len(bands.ends), dtype=storage_dtype("Band"))
    records["low"], records["high"] = bands.optics[:, 0], bands.optics[:, 1]
    records["value_low"], records["value_high"] = bands.ends[:, 0], bands.ends[:, 1]
    width = bands.ends[:, 1] - bands.ends[:, 0]
    records["extinction_max"] = bands.optics[:, :, 3].max(axis=1)
    wide = width > LEAST_WIDTH
    records["inverse_width"] = np.where(wide, 1.0, 0.0) / np.where(wide, width, 1.0)
    return records


def level_records(bands: ValueBands, peaks: npt.NDArray[np.void], weight: PeakWeight) -> npt.NDArray[np.void]:
    """(max(K, 1),) struct Level, for walks through the bands.

    The sheet of a level that is a peak of the extinction is what the paper composites there: its colour and the
    opacity of its extinction over a length of 1; with the weight `INTEGRAL` it is a mark, with red 1 and opacity 0.
    """
    records = np.zeros(max(len(bands.levels), 1), dtype=storage_dtype("Level"))
    records["impulse"][: len(bands.levels)] = bands.impulses
    for peak in peaks[peaks["isosurface"] == 0]:
        level = int(np.abs(bands.levels - peak["value"]).argmin())
        opacity = -np.expm1(-float(peak["color"][3]))
        records["sheet"][level] = (
            (1, 0, 0, 0) if weight is PeakWeight.INTEGRAL else (*peak["color"][:3], opacity)
        )
    return records


def shown_peaks(transfer_function: TransferFunction, scale: ValueScale) -> npt.NDArray[np.void]:
    """(P,) struct Peak, of those that values of the volume can come near to, ascending."""
    found = [
        peak
        for peak in find_peaks(transfer_function)
        if LOWEST < (peak.value - scale.low) * scale.inverse_width < HIGHEST
    ]
    records = np.zeros(len(found), dtype=storage_dtype("Peak"))
    for record, peak in zip(records, found, strict=True):
        places = scale.normalise(np.array([peak.value, peak.low, peak.high]))
        record["value"], record["low"], record["high"] = np.clip(places, LOWEST, HIGHEST)
        record["color"] = (*peak.color, peak.strength)
        record["isosurface"] = peak.isosurface
    return records


def band_starts(levels: F64, count: int) -> npt.NDArray[np.uint32]:
    """(count + 1,) uint32: the band of a value in bin i of [0, 1] is one of entry i to entry i + 1.

    The outer bins hold all values beyond them.
    """
    starts = np.searchsorted(levels, np.arange(count + 1) / count, side="right")
    starts[0], starts[-1] = 0, len(levels)
    return starts.astype(np.uint32)

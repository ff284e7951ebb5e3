"""Peaks of a transfer function, and the table of those between two values.

Source: Knoll et al. 2009, section 4.1.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import numpy.typing as npt

from isosample.defaults import MOST_PEAKS
from isosample.errors import CapacityError, InputError

if TYPE_CHECKING:
    from isosample.transfer.transfer_function import TransferFunction

NO_PEAK = 0xFFFF


class TransferPeak(NamedTuple):
    """A local maximum of the extinction, or an isosurface.

    Attributes
    ----------
    value : float
        In data units.
    color : 3 floats
        Straight linear RGB.
    strength : float
        Extinction [1/world], or the opacity of an isosurface.
    isosurface : bool
    """

    value: float
    color: tuple[float, float, float]
    strength: float
    isosurface: bool


def find_peaks(transfer_function: TransferFunction) -> list[TransferPeak]:
    """Local maxima of the extinction and isosurfaces, by ascending values.

    A plateau has a peak at both of its ends. At one value the extinction's peak comes before the isosurface.
    """
    found = [
        TransferPeak(surface.value, surface.color, surface.opacity, True)
        for surface in transfer_function.isosurfaces
    ]
    return sorted([*_maxima(transfer_function), *found], key=lambda peak: (peak.value, peak.isosurface))


def _maxima(transfer_function: TransferFunction) -> list[TransferPeak]:
    """Peaks of the extinction, with the optics of the side where there is more of it."""
    found = []
    for value in transfer_function.peaks():
        sides = [transfer_function.evaluate(value, side=side) for side in ("left", "right")]
        color, extinction = max(sides, key=lambda side: float(side[1]))
        red, green, blue = color.tolist()
        found.append(TransferPeak(value, (red, green, blue), float(extinction), False))
    return found


def peak_table(values: npt.ArrayLike, bins: int) -> npt.NDArray[np.uint16]:
    """Peaks that may lie between two normalised values, in the order in which the way from one to the other meets them.

    Parameters
    ----------
    values : (P,) array_like of float
        Normalised values of the peaks, ascending.
    bins : int
        Bins of [0, 1]; the outer two hold what lies beyond.

    Returns
    -------
    table : (bins, bins, 4) uint16
        ``table[back, front]`` for a stretch from a value in bin `front` to one in bin `back`: the first four peaks from
        one bin to the other, both included; descending where ``back < front``; `NO_PEAK` behind the last.

    Raises
    ------
    InputError
        If the values do not ascend or there are less than two bins.
    CapacityError
        If there are more peaks than 16 bits can number.
    """
    ascending = np.asarray(values, dtype=np.float64)
    if bins < 2 or (np.diff(ascending) < 0.0).any():
        raise InputError(
            f"{bins} bins of peaks at {ascending.tolist()}; expected two bins, ascending values."
        )
    if len(ascending) >= NO_PEAK:
        raise CapacityError(
            f"{len(ascending)} peaks are more than {NO_PEAK - 1}; use a transfer function of fewer, or exact crossings."
        )
    numbers = np.clip(ascending * bins, 0, bins - 1).astype(np.int64)
    first = np.searchsorted(numbers, np.arange(bins), side="left")  # peak in this bin or above
    last = np.searchsorted(numbers, np.arange(bins), side="right") - 1  # in this bin or below
    back, front = np.meshgrid(np.arange(bins), np.arange(bins), indexing="ij")
    rising = (back >= front)[..., None]
    places = np.arange(MOST_PEAKS)
    peaks = np.where(rising, first[front][..., None] + places, last[front][..., None] - places)
    inside = np.where(rising, peaks <= last[back][..., None], peaks >= first[back][..., None])
    return np.where(inside, peaks, NO_PEAK).astype(np.uint16)

"""Values inside the visible slopes of a transfer function."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from isosample.transfer.sample_shares import SampleShares
    from isosample.transfer.transfer_function import TransferFunction


class SlopeValues(NamedTuple):
    """Values inside one visible slope.

    Attributes
    ----------
    constant : bool
        Whether neither extinction nor colour changes along the slope.
    start, stop : float
        Ends of its part inside the value range, in data units.
    values : list of float
        Ascending, without the two ends.
    """

    constant: bool
    start: float
    stop: float
    values: list[float]


def slope_values(
    transfer_function: TransferFunction,
    value_range: tuple[float, float],
    per_slope: int,
    shares: SampleShares | None = None,
) -> list[SlopeValues]:
    """Values inside every visible slope, as far as it is inside the value range.

    Parameters
    ----------
    transfer_function : TransferFunction
    value_range : (low, high)
        Of the field, in data units.
    per_slope : int
        Number of values in each, >= 0.
    shares : SampleShares, optional
        Of the volume. Slopes of constant extinction and colour are often wide, with the samples at one end: their
        values are spaced half by the samples then. All others are evenly spaced.
    """
    low, high = value_range
    found = []
    for slope in transfer_function.slopes():
        start, stop = max(low, slope.low.value), min(high, slope.high.value)
        if slope.visible and start < stop:
            if slope.constant and shares is not None:
                inner = shares.spaced(start, stop, per_slope)
            else:
                inner = np.linspace(start, stop, per_slope + 2)[1:-1].tolist()
            found.append(SlopeValues(slope.constant, start, stop, inner))
    return found


def plateau_values(
    transfer_function: TransferFunction,
    value_range: tuple[float, float],
    per_slope: int,
    shares: SampleShares | None = None,
) -> list[float]:
    """Those of `slope_values` that are inside slopes of constant extinction and colour: what light alone needs."""
    slopes = slope_values(transfer_function, value_range, per_slope, shares)
    return [value for slope in slopes if slope.constant for value in slope.values]

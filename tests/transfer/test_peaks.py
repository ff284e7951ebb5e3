"""Peaks of a transfer function, and the table of those between two values."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from isosample.defaults import MOST_PEAKS
from isosample.errors import CapacityError, InputError
from isosample.transfer.peaks import NO_PEAK, find_peaks, peak_table
from isosample.transfer.transfer_function import ControlPoint, Isosurface, TransferFunction

RED, BLUE, GREEN = (1.0, 0.0, 0.0), (0.0, 0.0, 1.0), (0.0, 1.0, 0.0)


def curve(*points: tuple[float, float], isosurfaces: tuple[float, ...] = ()) -> TransferFunction:
    """Red transfer function through (value, extinction)."""
    return TransferFunction(
        [ControlPoint(value, RED, extinction) for value, extinction in points],
        [Isosurface(value, GREEN, 0.5) for value in isosurfaces],
    )


def places(transfer_function: TransferFunction) -> list[float]:
    """Value of every peak."""
    return [peak.value for peak in find_peaks(transfer_function)]


def test_every_tent_has_its_peak_whatever_the_valley_between_two() -> None:
    assert places(curve((0, 0), (1, 2), (2, 0), (5, 0), (6, 3), (7, 0))) == [1.0, 6.0]
    assert places(curve((0, 0), (1, 2), (2, 1), (6, 3), (7, 0))) == [1.0, 6.0]
    assert places(curve((0, 0), (1, 2), (2, 1), (4, 1), (6, 3), (7, 0))) == [1.0, 6.0]


def test_a_plateau_has_a_peak_at_both_ends() -> None:
    assert places(curve((0, 0), (1, 2), (3, 2), (4, 0))) == [1.0, 3.0]


def test_a_step_s_peak_has_the_optics_of_its_higher_side() -> None:
    points = [
        ControlPoint(0, RED, 1),
        ControlPoint(1, RED, 2),
        ControlPoint(1, BLUE, 5),
        ControlPoint(2, RED, 0),
    ]
    (peak,) = find_peaks(TransferFunction(points))
    assert (peak.value, peak.color, peak.strength, peak.isosurface) == (1.0, BLUE, 5.0, False)


def test_an_isosurface_is_a_peak_and_follows_the_extinction_s_peak_at_its_value() -> None:
    found = find_peaks(curve((0, 0), (1, 2), (2, 0), isosurfaces=(0.5, 1.0)))
    assert [(peak.value, peak.isosurface) for peak in found] == [(0.5, True), (1.0, False), (1.0, True)]
    assert (found[0].color, found[0].strength) == (GREEN, 0.5)


def test_extinction_without_end_peaks_at_the_last_point() -> None:
    assert places(curve((0, 0), (1, 2))) == [1.0]


def brute_force(values: list[float], bins: int, front: int, back: int) -> list[int]:
    """Entry of the table, from its definition."""
    numbers = [min(max(int(np.floor(value * bins)), 0), bins - 1) for value in values]
    low, high = min(front, back), max(front, back)
    inside = [i for i, number in enumerate(numbers) if low <= number <= high]
    ordered = (inside if back >= front else inside[::-1])[:MOST_PEAKS]
    return ordered + [NO_PEAK] * (MOST_PEAKS - len(ordered))


@given(st.lists(st.floats(-0.5, 1.5), max_size=9), st.integers(2, 7))
def test_the_table_holds_what_its_definition_says(values: list[float], bins: int) -> None:
    values = sorted(values)
    table = peak_table(values, bins)
    for back, front in itertools.product(range(bins), repeat=2):
        assert table[back, front].tolist() == brute_force(values, bins, front, back)


def test_more_peaks_than_16_bits_number_are_refused() -> None:
    with pytest.raises(CapacityError, match="65535 peaks"):
        peak_table(np.linspace(0, 1, 65535), 2)


def test_descending_peaks_are_refused() -> None:
    with pytest.raises(InputError, match="ascending"):
        peak_table([0.5, 0.4], 4)

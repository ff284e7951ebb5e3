"""Crossing lists are checked, and thinned out."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from isosample.errors import InputError
from isosample.integral.crossing_lists import CrossingLists, checked_lists


def two_rays() -> CrossingLists:
    return CrossingLists(
        first=np.array([0, 3, 3, 6]),
        distance=np.array([0.0, 1.0, 2.0, 0.5, 0.5, 0.75]),
        level=np.array([-1, 0, -1, -1, 1, -1]),
        rising=np.array([True, True, False, True, False, False]),
        slope=np.array([np.nan, 0.5, np.nan, np.nan, np.nan, np.nan]),
        residual=np.zeros(6),
        value=np.zeros(6),
        tolerance=np.zeros(6),
    )


def test_sound_lists_pass_and_are_not_copied() -> None:
    lists = two_rays()
    checked = checked_lists(lists, 2)
    assert all(np.shares_memory(a, b) for a, b in zip(lists, checked, strict=True))
    assert lists.ray.tolist() == [0, 0, 0, 2, 2, 2]


@pytest.mark.parametrize(
    ("column", "row", "wrong", "message"),
    [
        ("first", 1, 7, "first must ascend"),
        ("first", 0, 1, "first must ascend"),
        ("distance", 1, np.inf, "entry 1 .* not finite"),
        ("distance", 2, 0.5, "entry 2 .* sort each ray"),
        ("level", 4, 2, "entry 4 .* not -1 to 1"),
        ("level", 4, -2, "entry 4 .* not -1 to 1"),
        ("slope", 1, -0.5, "entry 1 .* slope below 0"),
        ("slope", 1, np.inf, "entry 1 .* infinite slope"),
        ("residual", 1, -1.0, "entry 1 .* residual"),
        ("residual", 1, np.nan, "entry 1 .* residual"),
        ("value", 3, np.nan, "entry 3 .* value is not finite"),
        ("tolerance", 3, -1.0, "entry 3 .* tolerance"),
    ],
)
def test_a_wrong_entry_is_named(column: str, row: int, wrong: float, message: str) -> None:
    lists = two_rays()
    getattr(lists, column)[row] = wrong
    with pytest.raises(InputError, match=message):
        checked_lists(lists, 2)


def test_columns_of_another_length_are_refused() -> None:
    columns: dict[str, Any] = two_rays()._asdict()
    with pytest.raises(InputError, match=r"slope has shape \(5,\)"):
        checked_lists(CrossingLists(**(columns | {"slope": np.zeros(5)})), 2)


def test_a_ray_may_begin_before_the_last_one_ended() -> None:
    lists = two_rays()
    assert lists.distance[3] < lists.distance[2]
    checked_lists(lists, 2)


def test_kept_entries_stay_with_their_rays() -> None:
    kept = two_rays().keep(np.array([True, False, True, True, True, False]))
    assert kept.first.tolist() == [0, 2, 2, 4]
    assert kept.distance.tolist() == [0.0, 2.0, 0.5, 0.5]

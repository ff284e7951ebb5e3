"""Settings refuse what they cannot mean, naming it."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from isosample.errors import InputError
from isosample.rendering.settings import ClipPlane, Material, RenderSettings, check_size
from isosample.transfer.isovalues import MAX_PER_SLOPE, plan_isovalues
from isosample.transfer.transfer_function import TransferFunction
from isosample.volume.grid import Volume

TF = TransferFunction.from_dict(
    {
        "points": [
            {"value": 0, "color": [1, 0, 0], "extinction": 0},
            {"value": 1, "color": [1, 0, 0], "extinction": 1},
        ]
    }
)


@pytest.mark.parametrize(
    ("options", "named"),
    [
        ({"background": (0.0, 0.0, 0.0)}, "background"),
        ({"background": (0.0, 0.0, 2.0, 1.0)}, "background"),
        ({"min_transmittance": 1.0}, "min_transmittance 1"),
        ({"min_transmittance": -0.1}, "min_transmittance -0.1"),
        ({"fragment_budget_bytes": 100}, "100 bytes"),
        ({"sort_capacity": 0}, "sort_capacity 0"),
        ({"sort_capacity": 3.5}, "sort_capacity 3.5"),
        ({"clip_planes": (ClipPlane(1.0, 0.0, 0.0, 0.0),) * 9}, "9 clip planes"),
        ({"clip_planes": ((1.0, 0.0, 0.0, 0.0),)}, "must be a ClipPlane"),
    ],
)
def test_a_setting_out_of_range_is_named(options: dict[str, Any], named: str) -> None:
    with pytest.raises(InputError, match=named):
        RenderSettings(**options)


@pytest.mark.parametrize("size", [800, (0, 1), (1, 2, 3), (1.5, 2), ("a", 1), (-1, 4)])
def test_a_picture_size_is_two_whole_numbers(size: Any) -> None:
    with pytest.raises(InputError, match="picture size"):
        check_size(size)
    assert check_size((np.int64(3), 4)) == (3, 4)


@pytest.mark.parametrize("numbers", [(0.0, 0.0, 0.0, 1.0), (np.nan, 0.0, 1.0, 0.0), (1.0, 0.0, 0.0, np.inf)])
def test_a_clip_plane_needs_a_normal_and_finite_numbers(numbers: tuple[float, ...]) -> None:
    with pytest.raises(InputError, match="clip plane"):
        ClipPlane(*numbers)


@pytest.mark.parametrize("name", ["ambient", "diffuse", "specular", "shininess"])
def test_a_negative_coefficient_is_named(name: str) -> None:
    with pytest.raises(InputError, match=name):
        Material(**{name: -1.0})


@pytest.mark.parametrize("per_slope", [-1, 2.5, MAX_PER_SLOPE + 1])
def test_values_per_slope_are_a_whole_number_that_a_scene_can_hold(per_slope: Any) -> None:
    with pytest.raises(InputError, match="per_slope"):
        plan_isovalues(TF, (0.0, 1.0), per_slope=per_slope)


def test_integers_beyond_float64_are_refused_not_merged() -> None:
    samples = 2**60 + np.arange(27).reshape(3, 3, 3)
    with pytest.raises(InputError, match=r"2\^53"):
        _ = Volume(samples).value_range
    assert Volume(2**52 + np.arange(27).reshape(3, 3, 3)).value_range == (2.0**52, 2.0**52 + 26)

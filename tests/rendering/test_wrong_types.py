"""What is no volume or no transfer function is refused with how to make one, by everything that takes them."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

import isosample
from isosample.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Callable

ARRAY = np.random.default_rng(1).random((4, 5, 6))
VOLUME = isosample.Volume(ARRAY)
RED = (1.0, 0.0, 0.0)
TF = isosample.TransferFunction(
    [isosample.ControlPoint(0.1, RED, 0.0), isosample.ControlPoint(0.9, RED, 1.0)]
)
TAKERS: dict[str, Callable[[Any, Any], object]] = {
    "render": isosample.render,
    "raycast": isosample.raycast,
    "RayCaster": isosample.RayCaster,
    "render_reference": isosample.render_reference,
    "choose_method": isosample.choose_method,
    "step_for_tolerance": lambda volume, tf: isosample.step_for_tolerance(volume, tf, 0.1),
}


@pytest.mark.parametrize("take", TAKERS.values(), ids=TAKERS)
def test_what_is_no_transfer_function_is_told_how_to_become_one(take: Callable[[Any, Any], object]) -> None:
    for path in ("bone.json", Path("bone.json")):
        with pytest.raises(
            InputError,
            match=r"transfer_function is .*bone\.json'.*isosample\.TransferFunction\.load\('bone\.json'\)",
        ):
            take(VOLUME, path)
    with pytest.raises(InputError, match=r"transfer_function is 5; expected a TransferFunction\."):
        take(VOLUME, 5)
    with pytest.raises(InputError, match=r"isosample\.TransferFunction\.from_dict"):
        take(VOLUME, TF.to_dict())


@pytest.mark.parametrize("take", TAKERS.values(), ids=TAKERS)
def test_what_is_no_volume_is_told_how_to_become_one(take: Callable[[Any, Any], object]) -> None:
    with pytest.raises(InputError, match=r"array of shape \(4, 5, 6\).*isosample\.Volume\(array\)"):
        take(ARRAY, TF)
    with pytest.raises(InputError, match=r"volume is 'head\.nrrd'.*isosample\.open_volume\('head\.nrrd'\)"):
        take("head.nrrd", TF)
    with pytest.raises(InputError, match=r"volume is None; expected a Volume"):
        take(None, TF)


def test_another_transfer_function_of_a_ray_caster_is_checked_too() -> None:
    with (
        isosample.RayCaster(VOLUME, TF) as caster,
        pytest.raises(InputError, match=r"TransferFunction\.load"),
    ):
        caster.set_transfer_function("bone.json")  # type: ignore[arg-type]


def test_the_parts_of_the_pipeline_tell_the_same() -> None:
    with pytest.raises(InputError, match=r"isosample\.Volume\(array\)"):
        isosample.render(ARRAY)  # type: ignore[arg-type]  # the transfer function is suggested
    with pytest.raises(InputError, match=r"isosample\.Volume\(array\)"):
        isosample.TransferFunction.suggest(ARRAY)  # type: ignore[arg-type]
    with pytest.raises(InputError, match=r"isosample\.Volume\(array\)"):
        isosample.extract_surfaces(ARRAY, [0.5])  # type: ignore[arg-type]
    with pytest.raises(InputError, match=r"TransferFunction\.load\('bone\.json'\)"):
        isosample.plan_isovalues("bone.json", (0.0, 1.0))  # type: ignore[arg-type]

"""What a quality asks of the meshes: the same words mean the same in Python and on the command line."""

from __future__ import annotations

from typing import Any, NoReturn

import numpy as np
import pytest

from isosample.cli import build_parser
from isosample.cli.sources import quality_of
from isosample.errors import InputError
from isosample.rendering import preparation, tolerance
from isosample.rendering.quality import Quality
from isosample.surfaces.settings import REFINEMENTS
from isosample.volume.grid import Volume
from rendering.scenes import ramp_tf


@pytest.mark.parametrize(
    ("asked", "words", "most_pieces"),
    [
        ({}, "", 1),
        ({"refine": 4}, "--refine 4", 4),
        ({"refine": "auto"}, "--refine auto", None),
        ({"tolerance": 1 / 16}, "--tolerance 1/16", None),
        ({"tolerance": 1 / 16, "refine": 2}, "--tolerance 1/16 --refine 2", 2),
        ({"tolerance": 1 / 16, "refine": "auto"}, "--tolerance 1/16 --refine auto", None),
    ],
)
def test_a_refinement_means_the_same_in_python_and_on_the_command_line(
    asked: dict[str, Any], words: str, most_pieces: int | None
) -> None:
    args = build_parser().parse_args(["render", "volume.npy", "-o", "out.png", *words.split()])
    assert quality_of(args) == Quality(**asked)
    assert Quality(**asked).most_pieces == most_pieces


@pytest.mark.parametrize(("refine", "most"), [(None, REFINEMENTS[-1]), ("auto", REFINEMENTS[-1]), (2, 2)])
def test_a_tolerance_refines_as_far_as_it_needs_unless_it_is_told_otherwise(
    monkeypatch: pytest.MonkeyPatch, refine: Any, most: int
) -> None:
    class SearchedError(Exception):
        pass

    limits: list[int] = []

    def search(*_: object, max_refine: int, **__: object) -> NoReturn:
        limits.append(max_refine)
        raise SearchedError

    monkeypatch.setattr(tolerance, "plan_for_tolerance", search)
    volume = Volume(np.broadcast_to(np.arange(5.0), (4, 4, 5)))
    quality = Quality(tolerance=1 / 16, refine=refine)
    with pytest.raises(SearchedError):
        preparation.prepare_surfaces(volume, ramp_tf(*volume.value_range, (0.0, 0.4)), quality)
    assert limits == [most]


@pytest.mark.parametrize("refine", [0, 3, "most", 16])
def test_a_refinement_that_there_is_not_is_refused(refine: Any) -> None:
    with pytest.raises(InputError, match=r"refine .* must be one of \(1, 2, 4, 8\), or 'auto'"):
        Quality(refine=refine)

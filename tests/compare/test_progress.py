"""A comparison tells what it does from the beginning, with nothing done yet, and to the end of every stage."""

from __future__ import annotations

import pytest

from compare.small_comparison import CAMERAS, PER_SLOPES, REPEAT, SIZE, STEPS, small_experiment
from isosample.compare.experiment import run_experiment

pytestmark = pytest.mark.usefixtures("gl")


def test_every_stage_is_told_from_nothing_to_all_of_it_in_every_group() -> None:
    told: list[tuple[str, int, int]] = []
    # as little memory as there is: every setting is a group of its own
    experiment = small_experiment(methods=("data-centric", "pre-integrated"), budget_bytes=1)
    run_experiment(experiment, lambda *report: told.append(report))
    count, pixels = len(PER_SLOPES) + len(STEPS), SIZE[0] * SIZE[1] * len(CAMERAS)
    frames = REPEAT * len(CAMERAS)
    assert told[0] == ("reference", 0, pixels)
    wholes = {"reference": pixels, "warm up": 3, "prepare": count, "frames": frames, "judge": count}
    assert list(dict.fromkeys(stage for stage, _, _ in told)) == list(wholes)
    for stage, whole in wholes.items():
        own = [done for name, done, _ in told if name == stage]
        assert {of for name, _, of in told if name == stage} == {whole}
        if stage == "frames":
            assert own == list(range(whole + 1)) * count
            continue
        assert own == sorted(own)
        assert (own[0], own[-1]) == (0, whole)
        assert stage == "reference" or set(own) == set(range(whole + 1))

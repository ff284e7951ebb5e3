"""The verdict is what the numbers say: recomputed another way from random results, and read back from sentences."""

from __future__ import annotations

import itertools
import re
from typing import Any

import numpy as np
import pytest

from compare.recomputed import recomputed_break_even, recomputed_fastest
from isosample.compare.verdict import (
    TARGETS,
    Verdict,
    frames_to_break_even,
    judge,
    last_frame_ahead,
)
from isosample.compare.verdict_sentences import LEVEL, NOUNS
from isosample.defaults import COMPARED_METHODS

METHOD_OF = {noun: method for method, noun in NOUNS.items()}
DATA_CENTRIC = COMPARED_METHODS[0]
LEAD = r"(?:, (level|[\d.]+×) (?:with|ahead of) ([a-z -]+)|, alone)"
FASTEST = re.compile(r"by ([a-z -]+) at (?:an RMSE of )?([\d.]+) \(([\d.]+) ms" + LEAD + r"\)")


def entry(
    method: str,
    rmse: float,
    frame: float,
    setup: float,
    label: str = "step 1",
    *,
    worst: float = 0.0,
    hidden: int = 0,
) -> dict[str, Any]:
    """What the verdict reads of an entry."""
    told = {"worst_pixels_share": worst, "not_shown": {"isosurfaces": hidden} if hidden else {}}
    return {
        "name": f"{method}-{rmse:.9f}-{frame:.9f}",
        "method": method,
        "label": label,
        "setup_seconds": setup,
        "summary": {"rmse": rmse, "frame_seconds": frame} | told,
    }


def random_results(seed: int) -> list[dict[str, Any]]:
    """Some of the methods with errors and times about the targets, some of them equal."""
    rng = np.random.default_rng(seed)
    methods = [method for method in COMPARED_METHODS if rng.random() < 0.8] or [DATA_CENTRIC]
    found = []
    for method in methods:
        for _ in range(int(rng.integers(1, 6))):
            rmse = float(rng.choice([*TARGETS, 10 ** rng.uniform(-4, -1.5)]))
            frame = float(rng.choice([0.02, 10 ** rng.uniform(-3, 0.5)]))
            found.append(entry(method, rmse, frame, float(10 ** rng.uniform(-2, 2))))
    return found


@pytest.mark.parametrize("seed", range(40))
def test_races_and_break_even_are_those_of_another_computation(seed: int) -> None:
    entries = random_results(seed)
    verdict = judge(entries)
    assert {race.target: race.seconds for race in verdict.races} == recomputed_fastest(entries, TARGETS)
    assert recomputed_break_even(entries, TARGETS) == (
        None if verdict.break_even is None else (verdict.break_even.target, verdict.break_even.frames)
    )


@pytest.mark.parametrize("seed", range(40))
def test_the_first_sentence_names_winner_time_and_lead_at_every_error(seed: int) -> None:
    entries = random_results(seed)
    verdict = judge(entries)
    told = {float(found[1]): (found[0], *found[2:]) for found in FASTEST.findall(verdict.sentences[0])}
    fastest = recomputed_fastest(entries, TARGETS)
    assert set(told) == {target for target, seconds in fastest.items() if seconds}
    for target, (noun, time, lead, second) in told.items():
        ranked = sorted(fastest[target].items(), key=lambda pair: pair[1])
        assert METHOD_OF[noun] in [method for method, seconds in ranked if seconds == ranked[0][1]]
        assert float(time) == pytest.approx(1e3 * ranked[0][1], rel=0.05, abs=0.5)  # two digits, or whole ms
        if len(ranked) == 1:
            assert not lead
            continue
        ratio = ranked[1][1] / ranked[0][1]
        assert METHOD_OF[second] in fastest[target]
        assert lead == "level" if ratio < LEVEL else float(lead[:-1]) == pytest.approx(ratio, abs=0.051)


@pytest.mark.parametrize("seed", range(40))
def test_the_second_sentence_names_everyone_who_loses_and_nobody_else(seed: int) -> None:
    entries = random_results(seed)
    fastest = recomputed_fastest(entries, TARGETS)
    losers = set()
    for method in {one["method"] for one in entries}:
        for seconds in fastest.values():
            if method not in seconds or seconds[method] >= LEVEL * min(seconds.values()):
                losers.add(method)
    named = {method for noun, method in METHOD_OF.items() if f"{noun} (" in judge(entries).sentences[1]}
    assert named == losers


def test_a_loss_is_told_by_its_factor_and_what_is_out_of_reach() -> None:
    entries = [
        entry(DATA_CENTRIC, 0.0005, 0.010, 1.0),
        entry("post-classified", 0.003, 0.005, 0.1),
        entry("pre-integrated", 0.0009, 0.030, 0.1),
    ]
    assert judge(entries).sentences[1] == (
        "Where methods lose: the data-centric method (2.0× slower than the fastest at 0.005), post-classification "
        "(RMSE 0.003 at best), pre-integration (6.0×, 3.0× and 3.0× slower than the fastest at 0.005, 0.002 and 0.001)."
    )


def third(own_setup: float, own_frame: float) -> Verdict:
    return judge(
        [
            entry(DATA_CENTRIC, 0.001, own_frame, own_setup, "5 per slope"),
            entry("pre-integrated", 0.001, 0.1, 0.5),
        ]
    )


def test_the_third_sentence_is_about_the_break_even() -> None:
    sides = "at RMSE 0.001 (5 per slope) against pre-integration (step 1)"
    assert third(2.5, 0.05).sentences[2] == (
        f"The data-centric precomputation has paid after 40 frames {sides}: 2.5 s of setup against 0.5 s."
    )
    assert third(0.4, 0.05).sentences[2] == (
        f"The data-centric method is ahead from the first frame on {sides}: 0.4 s of setup against 0.5 s."
    )
    assert third(0.25, 0.1875).sentences[
        2
    ] == (  # 0.625 s against 0.7 s after two frames, 0.8125 against 0.8 after three
        f"The data-centric method is ahead up to frame 2 {sides}: 0.25 s of setup against 0.5 s, and its frames are "
        "slower."
    )
    assert third(0.4, 0.1).sentences[2].startswith("The data-centric method is ahead from the first frame on")
    assert third(0.45, 0.2).sentences[2].startswith("The data-centric precomputation never pays")
    assert third(2.5, 0.1).sentences[2] == (
        f"The data-centric precomputation never pays {sides}: 2.5 s of setup against 0.5 s, and its frames are no "
        "faster."
    )


@pytest.mark.parametrize(
    "entries",
    [
        [entry(DATA_CENTRIC, 0.0005, 0.01, 1.0)],
        [entry("pre-integrated", 0.0005, 0.01, 1.0), entry("peak-finding", 0.0005, 0.01, 1.0)],
        [entry(DATA_CENTRIC, 0.5, 0.01, 1.0), entry("pre-integrated", 0.0005, 0.01, 1.0)],
    ],
)
def test_without_two_sides_there_is_no_break_even(entries: list[dict[str, Any]]) -> None:
    verdict = judge(entries)
    assert verdict.break_even is None
    assert verdict.sentences[2].startswith("There is no break-even: ")


@pytest.mark.parametrize(
    ("own", "rival", "told"),
    [
        (0.0086, 0.0005, "the data-centric method (0.0086 at best) never gets to 0.005"),
        (0.0005, 0.012, "the best ray caster (0.012 at best) never gets to 0.005"),
        (
            0.0086,
            0.012,
            "the data-centric method (0.0086 at best) and the best ray caster (0.012 at best) never get to 0.005",
        ),
    ],
)
def test_without_a_break_even_it_is_said_which_side_does_not_get_to_which_error(
    own: float, rival: float, told: str
) -> None:
    entries = [
        entry(DATA_CENTRIC, 2 * own, 0.01, 1.0),
        entry(DATA_CENTRIC, own, 0.02, 1.0),
        entry("post-classified", 0.5, 0.02, 0.1),
        entry("pre-integrated", rival, 0.02, 0.1),
    ]
    assert (
        judge(entries).sentences[2] == f"There is no break-even: it takes both sides at one RMSE, and {told}."
    )


@pytest.mark.parametrize(("hidden", "told"), [(1, "1 isosurface"), (3, "3 isosurfaces")])
def test_isosurfaces_that_a_method_does_not_show_are_told_once(hidden: int, told: str) -> None:
    entries = [
        entry("post-classified", 0.1, 0.02, 0.1, hidden=hidden),
        entry("post-classified", 0.09, 0.04, 0.1, hidden=hidden),
        entry("pre-integrated", 0.001, 0.02, 0.1),
    ]
    assert judge(entries).sentences[3:] == (
        f"Post-classification does not show {told} of the transfer function, which its samples do not meet: that is "
        "part of its error.",
    )


def test_an_error_that_few_pixels_make_is_told_of_the_settings_that_the_verdict_names() -> None:
    entries = [
        entry(DATA_CENTRIC, 0.0045, 0.01, 1.0, "1 per slope", worst=0.9),  # the fastest at 0.005
        entry(DATA_CENTRIC, 0.0040, 0.02, 1.0, "5 per slope", worst=0.96),  # neither fastest nor closest
        entry(DATA_CENTRIC, 0.0018, 0.025, 1.0, "9 per slope", worst=0.84),  # the fastest at 0.002
        entry(DATA_CENTRIC, 0.0015, 0.03, 1.0, "tolerance 1/64", worst=0.49),  # the closest: below half
        entry("peak-finding", 0.0080, 0.02, 1.0, "step 1", worst=0.5),
        entry("peak-finding", 0.0090, 0.02, 1.0, "step 2", worst=0.99),
        entry("pre-integrated", 0.0005, 0.02, 1.0, worst=0.3),
    ]
    # sqrt(1 - 0.84) 0.0018 = 0.00072, sqrt(1 - 0.5) 0.008 = 0.0057
    assert judge(entries).sentences[3:] == (
        "A few pixels, such as those on outlines, make the RMSE of the data-centric method (9 per slope: 0.1 % of the "
        "pixels have 84 % of the squared error; RMSE 0.0018, without them 0.00072) and peak finding (step 1: 0.1 % of "
        "the pixels have 50 % of the squared error; RMSE 0.008, without them 0.0057).",
    )


def test_what_nobody_reaches_is_said() -> None:
    entries = [entry("post-classified", 0.003, 0.02, 0.1)]
    assert judge(entries).sentences[0].endswith("(20 ms, alone); none reaches 0.002 and 0.001.")
    assert (
        judge([entry("post-classified", 0.3, 0.02, 0.1)]).sentences[0]
        == "No method reaches an RMSE of 0.005."
    )


@pytest.mark.parametrize(
    ("setup", "frame", "rival_setup", "rival_frame"),
    list(itertools.product([0.0, 0.25, 7.0], [0.5, 1.0], [0.0, 0.25, 7.0], [0.5, 1.0, 2.0])),
)
def test_the_break_even_is_the_first_frame_that_is_not_behind_and_the_last_is_told_where_there_is_one(
    setup: float, frame: float, rival_setup: float, rival_frame: float
) -> None:
    costs = (setup, frame, rival_setup, rival_frame)  # exact in binary, as are their sums
    ahead = [n for n in range(1, 1000) if setup + n * frame <= rival_setup + n * rival_frame]
    assert frames_to_break_even(*costs) == (ahead[0] if ahead else None)
    assert last_frame_ahead(*costs) == (ahead[-1] if ahead and ahead[-1] < 999 else None)

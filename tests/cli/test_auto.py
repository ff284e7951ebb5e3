"""`render --method auto` renders by the method that is expected to take the least time, and says which and why."""

from __future__ import annotations

import json
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cli.harness import TF, Run, content, write_json
from isosample.cli import auto
from isosample.rendering import method_costs
from isosample.volume import macrocells
from isosample.wording import duration

pytestmark = pytest.mark.usefixtures("gl")

AUTO = "render blob.npy --tf tf.json --size 24x16 --method auto --stats stats.json -o auto.npy"


def choice() -> dict[str, Any]:
    found: dict[str, Any] = json.loads(Path("stats.json").read_text(encoding="utf-8"))["choice"]
    return found


def favour(monkeypatch: pytest.MonkeyPatch, method: str) -> None:
    """Let one method cost a second per frame, and the others a minute."""
    costs = {
        f"{name} {stage}": {"start": 1.0 if name == method else 60.0}
        for name in ("data-centric", "pre-integrated", "peak-finding")
        for stage in ("prepare", "frame")
    }
    monkeypatch.setattr(method_costs, "SOFTWARE", costs | {"factors": {}})


def sharp() -> None:
    """tf.json with an isosurface."""
    write_json(Path("tf.json"), TF | {"isosurfaces": [{"value": 60, "color": [1, 1, 1], "opacity": 0.5}]})


@pytest.mark.parametrize(
    ("method", "isosurface", "same_as"),
    [
        ("data-centric", False, "data-centric"),
        ("data-centric", True, "data-centric"),
        ("pre-integrated", False, "pre-integrated"),
        ("peak-finding", True, "peak-finding --peak-weight integral --crossings exact"),
    ],
)
def test_the_cheaper_method_makes_the_picture(
    run: Run, monkeypatch: pytest.MonkeyPatch, method: str, isosurface: bool, same_as: str
) -> None:
    if isosurface:
        sharp()
    favour(monkeypatch, method)
    outcome = run(AUTO)
    assert outcome.status == 0, outcome.err
    told = choice()
    assert told["method"] == method
    rays = "peak-finding" if isosurface else "pre-integrated"
    assert set(told["estimated_seconds"]) == {"data-centric", rays}
    assert outcome.fields()["method"].startswith(f"{method}, chosen: ")
    assert told["reason"] in outcome.fields()["method"]
    assert run(f"render blob.npy --tf tf.json --size 24x16 --method {same_as} -o named.npy").status == 0
    np.testing.assert_array_equal(np.load("auto.npy"), np.load("named.npy"))


@pytest.mark.parametrize("film", ["", "--turntable 2"])
@pytest.mark.parametrize(
    ("options", "times"), [("", 1), ("--reconstruction cubic", 1), ("--macrocells 3", 2)]
)
def test_the_bounds_of_the_choice_are_those_of_the_ray_caster(
    run: Run, monkeypatch: pytest.MonkeyPatch, options: str, times: int, film: str
) -> None:
    """Unless the ray caster is to have another number of macrocells."""
    favour(monkeypatch, "pre-integrated")
    seen: list[int] = []

    def counted(*args: Any) -> Any:
        seen.append(1)
        return original(*args)

    original = macrocells._ranges
    monkeypatch.setattr(macrocells, "_ranges", counted)
    assert run(f"{AUTO} {options} {film}").status == 0
    assert choice()["method"] != "data-centric"
    assert len(seen) == times


def test_a_film_shares_the_preparation(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    costs = {
        "data-centric prepare": {"start": 10.0},
        "data-centric frame": {"start": 1.0},
        "pre-integrated prepare": {"start": 0.0},
        "pre-integrated frame": {"start": 4.0},
        "factors": {},
    }
    monkeypatch.setattr(method_costs, "SOFTWARE", costs)
    assert run(AUTO).status == 0
    assert choice()["method"] == "pre-integrated"  # 4 s against 11 s
    assert run(f"{AUTO} --turntable 4").status == 0
    assert choice()["method"] == "data-centric"  # 16 s against 14 s
    told = choice()["estimated_seconds"]["data-centric"]
    assert told["total"] == pytest.approx(told["spent"] + 10.0 + 4 * 1.0)
    assert (told["read"], told["frames"]) == (0.0, 4)


def test_the_estimate_holds_what_was_spent_before_in_words_that_people_read(
    run: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    costs = {
        f"{method} {stage}": {"start": seconds}
        for method, seconds in (("data-centric", 5000.0), ("pre-integrated", 1000.0))
        for stage in ("prepare", "frame")
    }
    monkeypatch.setattr(method_costs, "SOFTWARE", costs | {"factors": {}})
    before = time.process_time()  # start-up and reading come after, and count with it
    outcome = run(AUTO)
    assert outcome.status == 0, outcome.err
    told = choice()["estimated_seconds"]
    assert {one["spent"] for one in told.values()} == {told["pre-integrated"]["spent"]}
    assert before < told["pre-integrated"]["spent"] <= time.process_time()
    total = told["pre-integrated"]["total"]
    assert total == pytest.approx(2000.0 + told["pre-integrated"]["spent"])
    said = f"{duration(total)} by pre-integrated against {duration(told['data-centric']['total'])} by data-centric"
    assert said in outcome.fields()["method"]
    assert " min by pre-integrated" in said
    assert " h by data-centric" in said


@pytest.mark.parametrize(
    ("options", "method"),
    [
        ("--per-slope 2", "data-centric"),
        ("--segment linear", "data-centric"),
        ("--integration 2d", "pre-integrated"),
        ("--peak-mode xor", "peak-finding"),
        ("--quadrature riemann", "peak-finding"),
        ("--crossings secant --peaks 2", "peak-finding"),
        ("--step 1/4", "pre-integrated"),
    ],
)
def test_options_of_one_method_restrict_the_choice(run: Run, options: str, method: str) -> None:
    outcome = run(f"{AUTO} {options}")
    assert outcome.status == 0, outcome.err
    assert choice()["method"] == method


def test_what_the_options_say_about_peaks_is_kept(run: Run) -> None:
    sharp()
    assert run(f"{AUTO} --crossings secant --peaks 2").status == 0
    named = "--method peak-finding --peak-weight integral --crossings secant --peaks 2"
    assert run(f"render blob.npy --tf tf.json --size 24x16 {named} -o named.npy").status == 0
    np.testing.assert_array_equal(np.load("auto.npy"), np.load("named.npy"))


def test_a_cache_folder_is_rendered_by_its_meshes(run: Run, cache: Path) -> None:
    outcome = run(f"render {cache.name} --size 24x16 --method auto --stats stats.json -o auto.npy")
    assert outcome.status == 0, outcome.err
    assert choice()["method"] == "data-centric"
    assert "cache folder" in choice()["reason"]


def test_a_tolerance_is_searched_for_by_the_chosen_method(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    favour(monkeypatch, "pre-integrated")
    outcome = run(f"{AUTO} --tolerance 1/100")
    assert outcome.status == 0, outcome.err
    report = json.loads(Path("stats.json").read_text(encoding="utf-8"))["tolerance"]
    assert (report["tolerance"], report["missed"]) == (0.01, None)
    assert f"steps of {report['step']:.3g} voxels" in outcome.fields()["tolerance"]
    named = f"--method pre-integrated --step {report['step']!r}"
    assert run(f"render blob.npy --tf tf.json --size 24x16 {named} -o named.npy").status == 0
    np.testing.assert_array_equal(np.load("auto.npy"), np.load("named.npy"))


@pytest.mark.parametrize(
    ("options", "named"),
    [
        ("--tolerance 1/100 --step 1/4", ("--tolerance", "--step", "leave out one")),
        ("--tolerance 1/100 --per-slope 2", ("--tolerance", "--per-slope", "leave out one")),
        ("--per-slope 2 --step 1/4", ("--per-slope", "--step", "leave out one")),
        ("--integration 2d --peak-mode xor", ("--integration", "--peak-mode", "leave out one")),
        ("--sampling differential --step 1/4", ("--step", "--sampling uniform")),
    ],
)
def test_options_that_no_method_has_together_are_refused(
    run: Run, folder: Path, options: str, named: tuple[str, ...]
) -> None:
    before = content(folder)
    outcome = run(f"{AUTO} {options}")
    assert (outcome.status, outcome.out) == (2, "")
    assert outcome.err.count("\n") == 1
    for part in named:
        assert part in outcome.err
    assert content(folder) == before


def test_rays_through_a_cache_folder_are_refused(run: Run, cache: Path) -> None:
    outcome = run(f"render {cache.name} --method auto --step 1/4 -o auto.npy")
    assert outcome.status == 2
    assert "name the volume file" in outcome.err


def test_a_suggested_transfer_function_is_noted_once(run: Run) -> None:
    outcome = run("render blob.npy --size 24x16 --method auto --stats stats.json -o auto.npy")
    assert outcome.status == 0
    assert outcome.err.count("suggested from the histogram") == 1
    stats = json.loads(Path("stats.json").read_text(encoding="utf-8"))
    assert stats["transfer_function"] == "suggested from the histogram"


PLAIN = "render blob.npy --tf tf.json --size 24x16 -o out.npy"
SLOW = "isosample: note: about 2 min are estimated, most of them for isosurfaces, and "


@pytest.mark.parametrize(
    ("more", "favoured", "told"),
    [
        ("", "pre-integrated", True),
        ("", "data-centric", False),
        ("--method data-centric", "pre-integrated", False),  # asked for
        ("--per-slope 3", "pre-integrated", False),  # of isosurfaces
        ("--refine 2", "pre-integrated", False),
        ("--cache meshes", "pre-integrated", False),
        pytest.param("--tolerance 1/16", "pre-integrated", False, marks=pytest.mark.slow),
        ("--turntable 2", "pre-integrated", False),
        ("--reconstruction cubic", "pre-integrated", False),
    ],
)
def test_that_the_ray_caster_would_be_far_quicker_is_told_where_nobody_asked_for_isosurfaces(
    run: Run, monkeypatch: pytest.MonkeyPatch, more: str, favoured: str, told: bool
) -> None:
    favour(monkeypatch, favoured)
    monkeypatch.setattr(auto, "FEWEST_SAMPLES", 1)
    outcome = run(f"{PLAIN} {more}")
    assert outcome.status == 0, outcome.err
    assert outcome.err.startswith(SLOW) == told
    assert ("--method auto" in outcome.err) == told


def test_a_small_volume_is_not_estimated(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    favour(monkeypatch, "pre-integrated")
    assert run(PLAIN).err == ""


def test_what_is_told_changes_no_bit_of_the_picture(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    favour(monkeypatch, "pre-integrated")
    assert run(f"{PLAIN} --stats plain.json").status == 0
    expected = np.load("out.npy")
    monkeypatch.setattr(auto, "FEWEST_SAMPLES", 1)
    outcome = run(f"{PLAIN} --stats stats.json")
    assert outcome.err.startswith(SLOW)
    np.testing.assert_array_equal(np.load("out.npy"), expected)
    found, plain = (
        json.loads(Path(name).read_text(encoding="utf-8")) for name in ("stats.json", "plain.json")
    )
    assert found.keys() == plain.keys()  # nothing was chosen
    assert found["transfer_function"] == "tf.json"

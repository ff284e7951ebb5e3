"""Tolerances, refinement, error maps and strictness from the command line."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import PIL.Image
import pytest

from isosample.cli import EXIT_FAILED, data_centric, summary
from isosample.defaults import AUTO_DISTANCE
from isosample.errors import UnrepairedError

if TYPE_CHECKING:
    from cli.harness import Run

pytestmark = pytest.mark.usefixtures("gl")

RENDER = "render blob.npy --tf tf.json --size 24x16"


def statistics(name: str = "stats.json") -> dict[str, object]:
    found: dict[str, object] = json.loads(Path(name).read_text(encoding="utf-8"))
    return found


def test_a_tolerance_is_searched_for_and_told(run: Run) -> None:
    outcome = run(f"{RENDER} --tolerance 1/16 --stats stats.json -o out.png")
    assert outcome.status == 0
    assert outcome.fields()["tolerance"].startswith("0.0625: reached; all but 0.1 % of the pixels of 4 views")
    assert outcome.fields()["tolerance"].endswith(", measured against the reference")
    report = statistics()["tolerance"]
    assert isinstance(report, dict)
    assert report["missed"] is None
    assert report["reached"] <= 1 / 16
    assert len(report["views"]) == 4
    assert "(|cubic - linear|)" in outcome.fields()["error"]


@pytest.mark.parametrize(("indicator", "mesh"), [(0.5, 0.02), (0.02, 0.5)])
def test_the_larger_estimate_of_an_error_map_is_told_first(indicator: float, mesh: float) -> None:
    told = summary.error_line({"indicator": indicator, "mesh": mesh, "interval": 0.9})
    assert told.startswith("probably below 0.5 for 99.9 % of the pixels")


def test_a_tolerance_that_few_isovalues_cannot_reach_is_reported_as_missed(run: Run) -> None:
    outcome = run(f"{RENDER} --tolerance 1/1000 --max-isovalues 4 -o out.png")
    assert outcome.status == 0
    assert "NOT reached, isovalues" in outcome.fields()["tolerance"]


def test_a_cache_keeps_the_plan_of_a_tolerance(run: Run) -> None:
    assert run("precompute blob.npy --tf tf.json --tolerance 1/16 --cache meshes").status == 0
    outcome = run("render meshes --size 24x16 --error-map errors.npy -o out.png")
    assert outcome.status == 0
    assert "reached" in outcome.fields()["tolerance"]
    assert np.load("errors.npy").shape == (16, 24, 3)


@pytest.mark.parametrize(
    "option", ["--tolerance 1/16", "--refine 2", "--reconstruction cubic", "--max-isovalues 9"]
)
def test_the_meshes_of_a_cache_are_what_they_are(run: Run, option: str) -> None:
    assert run("precompute blob.npy --tf tf.json --cache meshes").status == 0
    outcome = run(f"render meshes {option} -o out.png")
    assert outcome.status == 2
    assert option.split()[0] in outcome.err
    assert not Path("out.png").exists()


@pytest.mark.parametrize(
    ("options", "told"),
    [
        ("--tolerance 1/16 --per-slope 3", "--per-slope 3"),
        ("--max-isovalues 9", "--tolerance"),
        ("--tolerance 0", "'0' must be an error from 1e-05 to 1"),
        ("--tolerance 1/0", "'1/0' must be an error"),
        ("--tolerance 2", "'2' must be an error"),
        ("--tolerance 1/16 --segment linear", "--segment linear makes another picture"),
        ("--tolerance 1/16 --no-curved", "leave out --curved and --no-curved"),
        ("--refine 3", "'3' must be 1, 2, 4, 8 or auto"),
        ("--error-map errors.jpg", "errors.jpg"),
        ("--reconstruction linear", "invalid choice: 'linear'"),
    ],
)
def test_options_that_contradict_or_say_nothing_are_refused(run: Run, options: str, told: str) -> None:
    outcome = run(f"{RENDER} {options} -o out.png")
    assert outcome.status == 2
    assert told in outcome.err
    assert not Path("out.png").exists()


def test_an_error_map_is_drawn_in_false_colours(run: Run) -> None:
    pytest.importorskip("matplotlib")
    outcome = run(f"{RENDER} --error-map errors.png --stats stats.json -o out.png")
    assert outcome.status == 0
    for part in ("probably below", "of two estimates", "of the meshes", "none of them measured", "not tight"):
        assert part in outcome.fields()["error"]
    picture = np.asarray(PIL.Image.open("errors.png").convert("RGB")).reshape(-1, 3)
    assert len(np.unique(picture, axis=0)) > 200  # a scale of colours, not one
    found = statistics()["error_99.9_percent"]
    assert isinstance(found, dict)
    assert 0 < found["indicator"] <= found["interval"] <= 1


def test_automatic_refinement_comes_within_its_distance(run: Run) -> None:
    assert run(f"{RENDER} --refine auto --stats auto.json -o out.png").status == 0
    assert run(f"{RENDER} --stats plain.json -o out.png").status == 0
    found, plain = statistics("auto.json"), statistics("plain.json")
    assert found["refine"] in (2, 4, 8)
    assert plain["refine"] == 1
    assert "mesh_distance" not in plain
    distance = found["mesh_distance"]
    assert isinstance(distance, float)
    assert 0.0 < distance <= AUTO_DISTANCE


def test_a_refinement_that_does_not_come_within_its_distance_says_so(run: Run) -> None:
    noise = np.random.default_rng(3).random((6, 6, 6)).astype(np.float32) * 100.0
    np.save("noise.npy", noise)
    outcome = run("render noise.npy --tf tf.json --size 16x16 --refine auto --stats stats.json -o out.png")
    assert outcome.status == 0
    distance = statistics()["mesh_distance"]
    assert isinstance(distance, float)
    assert distance > AUTO_DISTANCE
    assert "not within 0.01" in outcome.out


@pytest.mark.parametrize("more", ["", "--memory 16GiB"])
def test_a_cache_whose_refinement_does_not_come_within_its_distance_says_so(run: Run, more: str) -> None:
    np.save("noise.npy", np.random.default_rng(3).random((6, 6, 6)).astype(np.float32) * 100.0)
    made = run(f"precompute noise.npy --tf tf.json --refine auto --cache meshes {more}")
    assert made.status == 0, made.err
    (told,) = (line for line in made.out.splitlines() if "not within 0.01" in line)
    drawn = run("render meshes --size 16x16 --stats stats.json -o out.png")
    assert told in drawn.out.splitlines()
    distance = statistics()["mesh_distance"]
    assert isinstance(distance, float)
    assert distance > AUTO_DISTANCE
    # Other isovalues are other meshes, of which nothing is known; and without --refine auto nothing is asked for.
    for command in ("render meshes --per-slope 0", "render noise.npy --tf tf.json"):
        assert "not within" not in run(f"{command} --size 16x16 -o out.png").out


def test_info_takes_no_options_that_it_would_ignore(run: Run) -> None:
    outcome = run("info blob.npy --tf tf.json --plan --tolerance 1/16")
    assert outcome.status == 2
    assert "--tolerance" in outcome.err


def test_a_strict_picture_without_guesses_is_the_same(run: Run) -> None:
    assert run(f"{RENDER} --strict -o strict.npy").status == 0
    assert run(f"{RENDER} -o out.npy").status == 0
    np.testing.assert_array_equal(np.load("strict.npy"), np.load("out.npy"))


def test_a_strict_picture_with_guesses_is_refused(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    seen: list[int] = []
    check = summary.check_strict

    def with_guesses(stats: dict[str, object]) -> None:
        seen.append(int(str(stats["unrepaired_pixels"])))
        check(stats | {"unrepaired_pixels": 3})

    monkeypatch.setattr(data_centric, "check_strict", with_guesses)
    outcome = run(f"{RENDER} --strict -o out.png")
    assert (outcome.status, seen) == (EXIT_FAILED, [0])
    assert outcome.err.startswith("isosample: error: 3 pixels lack a crossing")
    assert not Path("out.png").exists()
    with pytest.raises(UnrepairedError):
        check({"unrepaired_pixels": 1})


@pytest.mark.usefixtures("gl")
@pytest.mark.parametrize(
    ("most", "told"),
    [
        (10**9, "--refine auto ended at 8, the finest that there is: the meshes are "),
        (
            1,
            "--refine auto ended at 1, as finer meshes might have more than 20 000 000 triangles (fewer isovalues",
        ),
    ],
)
@pytest.mark.parametrize(
    "command",
    [
        "render {} --size 8x8 -o out.npy",
        "render {} --size 8x8 --turntable 2 -o out.npy",
        "precompute {} --cache meshes",
        "precompute {} --cache meshes --memory 16GiB",
    ],
)
def test_a_refinement_that_ends_early_says_why_and_what_helps(
    run: Run, monkeypatch: pytest.MonkeyPatch, command: str, most: int, told: str
) -> None:
    for module in ("rendering.refinement", "cli.summary"):
        monkeypatch.setattr(f"isosample.{module}.AUTO_DISTANCE", 1e-9)
    monkeypatch.setattr("isosample.rendering.refinement.DEFAULT_MAX_TRIANGLES", most)
    outcome = run(command.format("blob.npy --tf tf.json --per-slope 0 --refine auto"))
    assert outcome.status == 0, outcome.err
    assert told in outcome.out
    assert "isosample filter" in outcome.out

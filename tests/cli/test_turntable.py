"""`render --turntable N` films a full turn by any method, and makes once what does not depend on the view."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import PIL.Image
import pytest

import isosample
from cli.harness import Run, blob, content, write_json

pytestmark = pytest.mark.usefixtures("gl")

VIEW = "--tf tf.json --size 24x16 --elevation 20"
METHODS = ("data-centric", "post-classified", "pre-integrated", "peak-finding", "reference")
ONCE = {
    "data-centric": {"extractions": 1, "mesh_uploads": 1},
    "post-classified": {"volume_uploads": 1},
    "pre-integrated": {"volume_uploads": 1},
    "peak-finding": {"volume_uploads": 1},
    "reference": {"reference_tracers": 1},
}


def statistics() -> dict[str, Any]:
    found: dict[str, Any] = json.loads(Path("stats.json").read_text(encoding="utf-8"))
    return found


@pytest.mark.parametrize("method", METHODS)
def test_a_frame_has_the_bits_of_the_picture_from_there(run: Run, method: str) -> None:
    source = f"render blob.npy {VIEW} --method {method}"
    outcome = run(f"{source} --azimuth 10 --turntable 4 --stats stats.json -o film.npy")
    assert outcome.status == 0, outcome.err
    for number in range(4):
        assert run(f"{source} --azimuth {10 + 90 * number} -o single.npy").status == 0
        np.testing.assert_array_equal(np.load(f"film-{number:03}.npy"), np.load("single.npy"))
    made = statistics()["turntable"]["made_once"]
    # Of the lists' memory the first frame may ask for more as it finds out how long they are.
    assert made.pop("fragment_pools", 0) <= 3
    assert {kind: number for kind, number in made.items() if kind != "programs_compiled"} == ONCE[method]
    assert statistics()["turntable"]["made_again"] == {}
    assert outcome.fields()["made again"] == "nothing"


def test_a_cache_folder_turns_without_an_extraction(run: Run, cache: Path) -> None:
    outcome = run(f"render {cache.name} --size 24x16 --turntable 3 --stats stats.json -o film.npy")
    assert outcome.status == 0, outcome.err
    assert "extractions" not in statistics()["turntable"]["made_once"]
    assert run(f"render {cache.name} --size 24x16 --azimuth 120 -o single.npy").status == 0
    np.testing.assert_array_equal(np.load("film-001.npy"), np.load("single.npy"))


def test_a_camera_file_turns_about_its_target_and_up(run: Run) -> None:
    camera = isosample.Camera.orbit(isosample.Volume(blob()).box, azimuth=10, elevation=30, aspect=1.5)
    write_json(Path("camera.json"), camera.to_dict())
    film = "render blob.npy --tf tf.json --size 24x16 --camera camera.json --turntable 5"
    assert run(f"{film} --stats stats.json -o film.npy").status == 0
    cameras = isosample.turntable(camera, 5)
    assert statistics()["turntable"]["cameras"] == [one.to_dict() for one in cameras]
    write_json(Path("third.json"), cameras[2].to_dict())
    assert run("render blob.npy --tf tf.json --size 24x16 --camera third.json -o single.npy").status == 0
    np.testing.assert_array_equal(np.load("film-002.npy"), np.load("single.npy"))


def test_a_gif_and_an_mp4_have_every_frame(run: Run) -> None:
    assert run(f"render blob.npy {VIEW} --turntable 6 --frame-rate 10 -o film.gif").status == 0
    with PIL.Image.open("film.gif") as film:
        # Pillow joins frames that are equal; the blob seen from two opposite sides is no such pair.
        assert (film.size, film.n_frames, film.info["duration"]) == ((24, 16), 6, 100)  # type: ignore[attr-defined]
    av = pytest.importorskip("av", reason="extra video")
    assert run(f"render blob.npy {VIEW} --turntable 6 --frame-rate 10 -o film.mp4").status == 0
    with av.open("film.mp4") as container:
        assert container.streams.video[0].average_rate == 10
        assert sum(1 for _ in container.decode(video=0)) == 6


def test_statistics_tell_the_seconds_of_every_frame(run: Run) -> None:
    outcome = run(f"render blob.npy {VIEW} --turntable 5 --stats stats.json -o film.png")
    assert outcome.fields()["film"].startswith("film-000.png to film-004.png (5 frames of 24 x 16 pixels)")
    told = statistics()
    seconds = told["turntable"]["seconds"]
    assert len(seconds["frames"]) == told["turntable"]["frames"] == 5
    assert seconds["amortised_frame"] == (seconds["preparation"] + sum(seconds["frames"])) / 5
    assert told["turntable"]["fragments_by_frame"][0] == told["fragments"]
    assert told["turntable"]["files"] == [f"film-{number:03}.png" for number in range(5)]
    assert (told["source"], told["method"]) == ("blob.npy", "data-centric")


def test_files_of_a_longer_film_are_told(run: Run) -> None:
    assert "remain" not in run(f"render blob.npy {VIEW} --turntable 4 -o film.png").out
    shorter = run(f"render blob.npy {VIEW} --turntable 2 -o film.png")
    assert "2 files of another film remain: film-002.png to film-003.png" in shorter.out


@pytest.mark.parametrize(
    ("options", "told"),
    [
        ("--turntable 1 -o film.gif", ("is 1;", "at least 2")),
        ("--turntable 4 -o film.tif", (".tif", ".mp4")),
        ("--turntable 4 --size 25x16 -o film.mp4", ("25x16", "26x16")),
        ("--turntable 4 --frame-rate 99 -o film.gif", ("99", "50")),
        ("--turntable 4 --frame-rate 10 -o film.png", ("--frame-rate", "leave it out")),
        ("--frame-rate 10 -o film.png", ("--frame-rate", "--turntable")),
        ("--turntable 4 --error-map e.npy -o film.png", ("--error-map", "leave out")),
        ("--turntable 4 -o none/film.gif", ("none", "does not exist")),
        ("-o film.mp4", ("film.mp4", "--turntable")),
    ],
)
def test_what_no_film_can_have_is_refused_at_once(
    run: Run, folder: Path, options: str, told: tuple[str, ...]
) -> None:
    before = content(folder)
    outcome = run(f"render blob.npy --tf tf.json {options}")
    assert (outcome.status, outcome.out) == (2, "")
    assert outcome.err.count("\n") == 1
    for part in told:
        assert part in outcome.err
    assert content(folder) == before


def test_no_frame_takes_the_place_of_an_input(run: Run, folder: Path) -> None:
    Path("blob.npy").rename("film-001.npy")
    before = content(folder)
    outcome = run("render film-001.npy --tf tf.json --size 16x16 --turntable 2 -o film.npy")
    assert outcome.status == 2
    assert "film-001.npy is also the input" in outcome.err
    assert content(folder) == before

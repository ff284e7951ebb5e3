"""`isosample compare` leaves a report, results and pictures; every option reaches the comparison or is an error."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import PIL.Image
import pytest

import isosample
from cli.harness import Run, write_json
from isosample.cli import build_parser
from isosample.defaults import DEFAULT_SCREEN_ERROR

pytestmark = pytest.mark.usefixtures("gl")

COMPARE = "compare blob.npy --tf tf.json --size 16x12 --repeat 1 -o out"
RAYS = "--methods post-classified,peak-finding"


def results() -> dict[str, Any]:
    found: dict[str, Any] = json.loads(Path("out/results.json").read_text(encoding="utf-8"))
    return found


def test_a_comparison_leaves_report_results_plots_and_pictures(run: Run) -> None:
    outcome = run(f"{COMPARE} --steps 2,1 --per-slopes 1,3")
    assert outcome.status == 0, outcome.err
    names = {path.name for path in Path("out").iterdir()}
    plots = {f"{name}.svg" for name in ("error_against_time", "error_against_samples", "histogram")}
    assert plots | {"report.html", "results.json", "results.csv", "pictures"} <= names
    document = results()
    assert len(document["entries"]) == 2 + 3 * 2
    assert len(list(Path("out/pictures").glob("*.png"))) == 1 + 3 * 8
    with PIL.Image.open("out/pictures/camera-1_reference.png") as picture:
        assert picture.size == (16, 12)
    assert outcome.out.startswith("\n".join(document["verdict"]["sentences"]))
    for entry in document["entries"]:
        assert f"{entry['summary']['rmse']:.2e}" in outcome.out
    assert "out/report.html" in outcome.out
    assert (document["scene"]["source"], document["scene"]["transfer_function_source"]) == (
        "blob.npy",
        "tf.json",
    )


def test_a_comparison_without_a_terminal_tells_what_it_has_begun(run: Run) -> None:
    outcome = run(f"{COMPARE} --steps 2 --per-slopes 1")
    stages = [line.removeprefix("isosample: ") for line in outcome.err.splitlines()]
    assert stages == [f"{stage}: begun" for stage in ("reference", "warm up", "prepare", "frames", "judge")]


def test_options_reach_the_comparison(run: Run) -> None:
    words = "--clip 0,1,0,-4 --background 0.5,0.25,0 --reconstruction cubic --peak-weight paper --crossings secant"
    assert (
        run(f"{COMPARE} {RAYS} --steps 1 --adaptive --stage compute --cameras 2 --azimuth 10 {words}").status
        == 0
    )
    document = results()
    settings = document["settings"]
    assert settings["clip_planes"] == [[0.0, 1.0, 0.0, -4.0]]
    assert settings["background"] == [0.5, 0.25, 0.0, 1.0]
    expected = {
        "reconstruction": "cubic", "peak_weight": "paper", "crossings": "secant", "adaptive": True,
        "stage": "compute", "repeat": 1, "size": [16, 12], "methods": ["post-classified", "peak-finding"],
    }  # fmt: skip
    assert {name: settings[name] for name in expected} == expected
    box = isosample.open_volume("blob.npy").box
    cameras = [isosample.Camera.orbit(box, azimuth=angle, aspect=4 / 3) for angle in (10.0, 190.0)]
    assert settings["cameras"] == [camera.to_dict() for camera in cameras]
    assert all(len(entry["views"]) == 2 for entry in document["entries"])


def test_with_light_every_method_and_the_reference_are_lit(run: Run) -> None:
    words = "--methods data-centric,pre-integrated --steps 0.25 --per-slopes 9"
    assert run(f"{COMPARE} {words} --shading").status == 0
    lit = results()
    assert lit["settings"]["material"] == [0.35, 0.65, 0.2, 32.0]
    page = Path("out/report.html").read_text(encoding="utf-8")
    assert "all lit, 16 × 12 pixels" in page
    assert "ambient 0.35, diffuse 0.65, specular 0.2, shininess 32" in page
    with PIL.Image.open("out/pictures/camera-1_reference.png") as picture:
        seen = np.asarray(picture).astype(float)
    assert run(f"{COMPARE} {words}").status == 0
    assert results()["settings"]["material"] is None
    assert "colours as they are" in Path("out/report.html").read_text(encoding="utf-8")
    with PIL.Image.open("out/pictures/camera-1_reference.png") as picture:
        assert np.abs(np.asarray(picture) - seen).max() > 20.0
    for entry in lit["entries"]:  # a picture without light would be off by more than a tenth
        assert entry["summary"]["rmse"] < 0.02


def test_a_camera_of_a_file_and_differential_sampling(run: Run) -> None:
    camera = isosample.Camera.orbit(isosample.open_volume("blob.npy").box, azimuth=77.0).to_dict()
    write_json(Path("camera.json"), camera)
    words = "--camera camera.json --sampling differential --pixel-scales 4,1"
    assert run(f"{COMPARE} {RAYS} {words}").status == 0
    document = results()
    assert document["settings"]["cameras"] == [camera]
    swept = [(entry["parameter"], entry["value"]) for entry in document["entries"]]
    assert swept == [("s_k", 4.0), ("s_k", 1.0)] * 2


def test_a_tolerance_alone_is_the_whole_sweep_of_the_meshes(run: Run) -> None:
    assert run(f"{COMPARE} --methods data-centric --tolerances 1/16").status == 0
    (entry,) = results()["entries"]
    assert (entry["parameter"], entry["value"], entry["label"]) == ("tolerance", 1 / 16, "tolerance 1/16")


def test_quick_is_less_of_everything(run: Run) -> None:
    assert run("compare blob.npy --tf tf.json --quick --size 11x11 -o out").status == 0
    document = results()
    assert document["settings"]["repeat"] == 3
    assert len(document["entries"]) == 8


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("--methods magic", "'magic' must be one of data-centric, post-classified"),
        ("--methods pre-integrated,pre-integrated", "names a value twice"),
        ("--methods data-centric --steps 1", "--steps has no part in a comparison of data-centric"),
        ("--methods pre-integrated --per-slopes 1", "--per-slopes has no part"),
        ("--pixel-scales 4", "--pixel-scales has no part"),
        (
            "--sampling differential --steps 1",
            "--steps has no part in a comparison with --sampling differential",
        ),
        ("--methods pre-integrated --tolerances 1/64", "--tolerances has no part"),
        (
            "--methods pre-integrated,peak-finding --details 2",
            "--details has no part in a comparison of pre-integrated",
        ),
        (
            "--methods data-centric --adaptive",
            "--adaptive has no part in a comparison of data-centric: it belongs to",
        ),
        (
            "--methods data-centric --sampling uniform",
            "--sampling has no part in a comparison of data-centric",
        ),
        (
            "--methods pre-integrated --peak-weight paper",
            "--peak-weight has no part in a comparison of pre-integrated",
        ),
        ("--methods data-centric,post-classified --crossings exact", "--crossings has no part"),
        ("--steps 0", "'0' must be a number above 0"),
        ("--repeat 0", "'0' must be a whole number >= 1"),
        ("--cameras 0", "'0' must be a whole number >= 1"),
        ("--cameras 2 --camera camera.json", "--camera camera.json and --cameras 2 both place the camera"),
        ("--size 10x40", "--size 10x40 is too small to be judged; give 11x11 or more."),
    ],
)
def test_what_makes_no_sense_is_refused_before_the_long_work(run: Run, words: str, message: str) -> None:
    outcome = run(f"compare blob.npy --tf tf.json -o out {words}")
    assert (outcome.status, outcome.out) == (2, "")
    assert message in outcome.err
    assert not Path("out/results.json").exists()


def test_help_says_how_coarse_meshes_may_be_without_an_option_that_a_comparison_lacks() -> None:
    args = build_parser().parse_args(["compare", "blob.npy", "-o", "out"])
    helps = {action.dest: action.help or "" for action in args.parser._actions}
    assert f"less than {DEFAULT_SCREEN_ERROR:g} pixel off" in helps["details"]
    assert not any("--screen-error" in text for text in helps.values())


def test_a_mesh_cache_is_no_volume(run: Run, cache: Path) -> None:
    outcome = run(f"compare {cache} -o out")
    assert outcome.status == 2
    assert "is a mesh cache, not a volume" in outcome.err


def test_a_missing_package_is_named_first(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    import importlib.util

    there = importlib.util.find_spec
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None if name == "jinja2" else there(name))
    outcome = run(COMPARE)
    assert outcome.status == 2
    assert 'a comparison needs Jinja2: pip install "isosample[compare]".' in outcome.err

"""A small comparison: equal conventions, frames in turn, results that say it all, a verdict that follows from them."""

from __future__ import annotations

import csv
import json
import os
import subprocess
import sys
from dataclasses import fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

import isosample
from compare.recomputed import recomputed_break_even, recomputed_fastest
from compare.small_comparison import CAMERAS, PER_SLOPES, REPEAT, SIZE, STEPS, blob_scene, small_experiment
from isosample.compare import contenders
from isosample.compare.contenders import ComparedScene, Parameter, Setting, SurfaceContender
from isosample.compare.experiment import Experiment, run_experiment
from isosample.compare.frames import draw_once, time_frames
from isosample.compare.metrics import rmse
from isosample.compare.results import write_results, write_table
from isosample.compare.sweep import Sweep
from isosample.defaults import COMPARED_METHODS
from isosample.errors import InputError
from isosample.rendering import screen_error
from isosample.rendering.image import Image
from isosample.rendering.raycast_settings import RaycastSettings, Sampling

if TYPE_CHECKING:
    from collections.abc import Sequence

    from isosample.compare.experiment import Outcome
    from isosample.rendering.camera import Camera

pytestmark = pytest.mark.usefixtures("gl")


@pytest.fixture(scope="module")
def outcome(gl: object) -> Outcome:
    """The small comparison, run once."""
    return run_experiment(small_experiment())


@pytest.fixture(scope="module")
def document(outcome: Outcome, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """results.json of it, read back."""
    path = tmp_path_factory.mktemp("results") / "results.json"
    write_results(outcome.results.to_dict(), path)
    read: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    return read


def test_every_setting_of_every_method_has_an_entry(document: dict[str, Any]) -> None:
    found = [(entry["method"], entry["parameter"], entry["value"]) for entry in document["entries"]]
    surfaces = [("data-centric", "isovalues per slope", float(number)) for number in PER_SLOPES]
    rays = [(method, "step", step) for method in COMPARED_METHODS[1:] for step in STEPS]
    assert found == surfaces + rays
    assert len({entry["name"] for entry in document["entries"]}) == len(found)


def test_no_setting_pays_for_the_first_extraction_of_a_volume(monkeypatch: pytest.MonkeyPatch) -> None:
    """One of the volume itself is discarded before any setting is prepared; without such a method there is none."""
    made: list[tuple[Setting, bool]] = []
    prepare = contenders.SurfaceContender.prepare

    def counted(one: contenders.SurfaceContender) -> None:
        prepare(one)
        made.append((one.setting, one._scene.volume.name == "blob.npy"))

    monkeypatch.setattr(contenders.SurfaceContender, "prepare", counted)
    run_experiment(small_experiment(methods=("data-centric",)))
    discarded = Setting("data-centric", Parameter.PER_SLOPE, 1)
    timed = [Setting("data-centric", Parameter.PER_SLOPE, float(number)) for number in PER_SLOPES]
    assert [setting for setting, is_real in made if is_real] == [discarded, *timed]
    made.clear()
    run_experiment(small_experiment(methods=("pre-integrated",)))
    assert made == []


COMPILED = """
import gc
from numba.core.dispatcher import Dispatcher
from compare.small_comparison import blob_scene
from isosample.compare.contenders import Parameter, Setting, contender
from isosample.compare.warm_up import warm_up
from isosample.compare.sweep import Sweep

def kernels():
    found = [one for one in gc.get_objects() if isinstance(one, Dispatcher)]
    return {(one.py_func.__qualname__, str(kind)) for one in found for kind in one.signatures}

scene = blob_scene()
warm_up(scene, Sweep(methods=("data-centric",), per_slopes=(), tolerances=(1 / 32,)))
before = kernels()
one = contender(scene, Setting("data-centric", Parameter.TOLERANCE, 1 / 32))
one.prepare()
assert one._prepared.plan.report["refine"] > 1
print(len(before), *sorted(kernels() - before))
"""


def test_a_tolerance_does_not_pay_for_what_is_compiled_once() -> None:
    """In a process of its own, where nothing is compiled or loaded yet."""
    tests = Path(__file__).resolve().parents[1]
    done = subprocess.run(
        [sys.executable, "-c", COMPILED],
        env=os.environ | {"PYTHONPATH": os.pathsep.join([str(tests.parent), str(tests)])},
        capture_output=True,
        text=True,
        check=False,
        timeout=300,
    )
    assert done.returncode == 0, done.stderr
    before, *late = done.stdout.split()
    assert int(before) > 10
    assert late == []


def test_pictures_are_those_of_the_library_under_one_set_of_conventions(outcome: Outcome) -> None:
    scene = blob_scene()
    for place, camera in enumerate(CAMERAS):
        common: dict[str, Any] = {"camera": camera, "size": SIZE, "settings": scene.render}
        truth = isosample.render_reference(scene.volume, scene.transfer_function, **common)
        np.testing.assert_array_equal(outcome.references[place], truth.rgba)
        meshes = isosample.render(scene.volume, scene.transfer_function, per_slope=PER_SLOPES[1], **common)
        name = f"data-centric-per-slope-{PER_SLOPES[1]}"
        np.testing.assert_array_equal(outcome.pictures[name][place], meshes.rgba)
        settings = isosample.RaycastSettings(
            classification=isosample.Classification.POST_CLASSIFIED, step=0.5
        )
        rays = isosample.raycast(scene.volume, scene.transfer_function, raycast=settings, **common)
        np.testing.assert_array_equal(outcome.pictures["post-classified-step-1-2"][place], rays.rgba)


def test_errors_are_those_of_the_pictures_and_together_those_of_all_cameras(
    outcome: Outcome, document: dict[str, Any]
) -> None:
    for entry in document["entries"]:
        pictures = outcome.pictures[entry["name"]]
        for place, view in enumerate(entry["views"]):
            assert view["errors"]["rmse"] == rmse(pictures[place], outcome.references[place])
        # one wide picture of all cameras, of equal sizes: its mean square is the mean of theirs
        together = rmse(np.concatenate(pictures, axis=1), np.concatenate(outcome.references, axis=1))
        assert entry["summary"]["rmse"] == pytest.approx(together, rel=1e-12)


def test_finer_steps_come_closer_to_the_reference(document: dict[str, Any]) -> None:
    for method in ("post-classified", "pre-integrated"):
        errors = [entry["summary"]["rmse"] for entry in document["entries"] if entry["method"] == method]
        assert errors[1] < errors[0]


def test_frames_are_counted_and_summed_up_by_medians(document: dict[str, Any]) -> None:
    for entry in document["entries"]:
        medians = []
        for view in entry["views"]:
            assert len(view["wall_seconds"]) == len(view["gpu_seconds_of_frames"]) == REPEAT
            assert view["frame_seconds"] == sorted(view["wall_seconds"])[REPEAT // 2]
            told = [gpu for gpu in view["gpu_seconds_of_frames"] if gpu is not None]
            assert all(
                gpu <= wall
                for gpu, wall in zip(told, view["wall_seconds"], strict=False)
                if len(told) == REPEAT
            )
            medians.append(view["frame_seconds"])
        assert entry["summary"]["frame_seconds"] == pytest.approx(sum(medians) / len(medians), rel=1e-12)
        parts = [entry[f"{part}_seconds"] for part in ("precompute", "prepare", "load")]
        assert entry["setup_seconds"] == pytest.approx(sum(parts), rel=1e-12)
        assert (parts[0] > 0.0) == (entry["method"] == "data-centric")


def test_the_verdict_follows_from_the_file(document: dict[str, Any]) -> None:
    targets = document["settings"]["targets"]
    races = {race["target"]: race["seconds"] for race in document["verdict"]["races"]}
    assert races == recomputed_fastest(document["entries"], targets)
    found = document["verdict"]["break_even"]
    expected = recomputed_break_even(document["entries"], targets)
    assert expected == (None if found is None else (found["target"], found["frames"]))


def test_the_verdict_on_a_scan_follows_from_its_numbers(real_volumes: Path, gl: object) -> None:
    volume = isosample.open_volume(real_volumes / "nucleon.nhdr")
    scene = ComparedScene(
        volume=volume, transfer_function=isosample.TransferFunction.suggest(volume), size=(32, 32)
    )
    sweep = Sweep(steps=(2.0, 0.5), per_slopes=(1, 5), tolerances=())
    camera = isosample.Camera.orbit(volume.box, azimuth=30.0)
    found = run_experiment(
        Experiment(scene=scene, cameras=(camera,), sweep=sweep, repeat=3)
    ).results.to_dict()
    targets = found["settings"]["targets"]
    races = {race["target"]: race["seconds"] for race in found["verdict"]["races"]}
    assert races == recomputed_fastest(found["entries"], targets)
    told = found["verdict"]["break_even"]
    expected = recomputed_break_even(found["entries"], targets)
    assert expected == (None if told is None else (told["target"], told["frames"]))


def test_the_table_has_every_number_of_the_file(document: dict[str, Any], tmp_path: Path) -> None:
    write_table(document, tmp_path / "results.csv")
    with (tmp_path / "results.csv").open(newline="", encoding="utf-8") as file:
        rows = {(row["name"], row["camera"]): row for row in csv.DictReader(file)}
    assert len(rows) == len(document["entries"]) * (1 + len(CAMERAS))
    for entry in document["entries"]:
        whole = rows[entry["name"], "all"]
        for name, value in (entry["summary"] | {"not_shown": None}).items():
            assert whole.get(name, "") == ("" if value is None else str(value))
        for reason, count in entry["summary"]["not_shown"].items():
            assert int(whole[f"not_shown.{reason}"]) == count
        assert float(whole["setup_seconds"]) == entry["setup_seconds"]
        for number, view in enumerate(entry["views"], start=1):
            row = rows[entry["name"], str(number)]
            assert [float(one) for one in row["wall_seconds"].split()] == view["wall_seconds"]
            assert float(row["rmse"]) == view["errors"]["rmse"]
            for reason, count in view["cost"]["skipped"].items():
                assert int(row[f"skipped.{reason}"]) == count


def test_the_file_says_what_was_run(document: dict[str, Any]) -> None:
    assert (document["format"], document["version"]) == ("isosample comparison", 1)
    assert document["settings"]["cameras"] == [camera.to_dict() for camera in CAMERAS]
    shared = {field.name for field in fields(RaycastSettings)} - {"classification", "step", "pixel_scale"}
    assert shared <= set(document["settings"])
    assert document["settings"]["transfer_lookup"] == "exact"
    assert isosample.TransferFunction.from_dict(document["scene"]["transfer_function"]).to_dict() == (
        blob_scene().transfer_function.to_dict()
    )
    assert sum(document["scene"]["histogram"]["counts"]) == blob_scene().volume.array.size
    assert document["machine"]["isosample"] == isosample.__version__
    assert document["machine"]["driver"]["renderer"]


class _Recorder:
    """Stands for a contender; writes down what is asked of it."""

    precompute_seconds = 0.0
    bytes = 0

    def __init__(self, name: str, log: list[str]) -> None:
        self.setting = Setting("post-classified", Parameter.STEP, 1.0)
        self._name = name
        self._log = log

    def prepare(self) -> None:
        raise AssertionError(f"{self._name} is prepared already")

    def load(self, cameras: Sequence[Camera]) -> float:
        assert cameras == CAMERAS
        self._log.append(f"load {self._name}")
        return 0.5

    def frame(self, camera: Camera) -> Image:
        self._log.append(f"{self._name}{CAMERAS.index(camera)}")
        return Image(np.zeros((1, 1, 4), np.float32), {"seconds": {"render": 0.25, "prepare": 0.125}})

    def release(self) -> None:
        self._log.append(f"release {self._name}")


def test_frames_are_drawn_in_turn_after_one_of_every_view_that_does_not_count() -> None:
    log: list[str] = []
    recorders = [_Recorder(name, log) for name in "abc"]
    timings = [draw_once(one, CAMERAS) for one in recorders]
    time_frames(recorders, timings, CAMERAS, 2, lambda *_: None)
    warm = ["load a", "a0", "a1", "load b", "b0", "b1", "load c", "c0", "c1"]
    first, second = ["a0", "b0", "c0", "a1", "b1", "c1"], ["b0", "c0", "a0", "b1", "c1", "a1"]
    assert log == [*warm, *first, *second]
    assert [[len(frames) for frames in timing.wall] for timing in timings] == [[2, 2]] * 3
    assert [(timing.prepare_seconds, timing.load_seconds) for timing in timings] == [(0.125, 0.375)] * 3


def test_meshes_for_a_tolerance_are_as_coarse_as_all_views_allow(monkeypatch: pytest.MonkeyPatch) -> None:
    seen: list[object] = []

    def within(_renderer: object, report: dict[str, Any], cameras: Sequence[Camera], *_: object) -> float:
        seen.extend([report["tolerance"], *cameras])
        return 0.0625

    monkeypatch.setattr(screen_error, "screen_error_within", within)
    scene = replace(blob_scene(), details=1, size=(12, 8))
    for parameter, value, expected in ((Parameter.TOLERANCE, 1 / 8, 0.0625), (Parameter.PER_SLOPE, 1, 0.25)):
        one = contenders.contender(scene, Setting("data-centric", parameter, value))
        one.prepare()
        one.load(CAMERAS)
        assert one.frame(CAMERAS[1]).stats["screen_error"] == expected
        one.release()
    assert seen == [1 / 8, *CAMERAS]


def test_differential_sampling_is_swept_by_pixel_scale() -> None:
    swept = Sweep(methods=("peak-finding",), pixel_scales=(8.0, 2.0)).settings(Sampling.DIFFERENTIAL)
    assert swept == [[Setting("peak-finding", Parameter.PIXEL_SCALE, value) for value in (8.0, 2.0)]]


@pytest.mark.parametrize(
    ("methods", "message"),
    [
        ((), r"methods \(\) must be one or more"),
        (("magic",), "'magic' must be one of data-centric"),
        (("post-classified", "post-classified"), "each once"),
    ],
)
def test_methods_are_known_and_differ(methods: tuple[str, ...], message: str) -> None:
    with pytest.raises(InputError, match=message):
        Sweep(methods=methods)


def test_the_meshes_of_a_lit_scene_are_planned_for_light() -> None:
    setting = Setting("data-centric", Parameter.PER_SLOPE, 3)
    scene = blob_scene()
    lit = replace(scene, render=replace(scene.render, material=isosample.Material()))
    assert [SurfaceContender(one, setting).quality.lit for one in (scene, lit)] == [False, True]

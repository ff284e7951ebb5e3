"""A small comparison: equal conventions, frames in turn, results that say it all, a verdict that follows from them."""

from __future__ import annotations

import csv
import json
import math
import os
import subprocess
import sys
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

import isosample
from compare.recomputed import recomputed_break_even, recomputed_fastest
from compare.small_comparison import CAMERAS, PER_SLOPES, REPEAT, SIZE, STEPS, blob_scene, small_experiment
from isosample.compare import contenders, experiment
from isosample.compare.contenders import SAMPLE_BYTES, TRIANGLE_BYTES, ComparedScene, Parameter, Setting
from isosample.compare.conventions import grain_band_of
from isosample.compare.experiment import Experiment, run_experiment
from isosample.compare.frames import draw_once, time_frames
from isosample.compare.metrics import rmse
from isosample.compare.report_tables import facts
from isosample.compare.results import write_results, write_table
from isosample.compare.sweep import Sweep
from isosample.defaults import COMPARED_METHODS
from isosample.errors import InputError
from isosample.rendering import screen_error
from isosample.rendering.image import Image
from isosample.rendering.raycast_settings import RaycastSettings, Sampling

if TYPE_CHECKING:
    from collections.abc import Sequence

    from isosample.compare.contenders import Contender
    from isosample.compare.experiment import Outcome
    from isosample.compare.frames import Timing
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
from isosample.compare.experiment import warm_up
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
        for name, value in entry["summary"].items():
            assert whole[name] == ("" if value is None else str(value))
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


@dataclass(slots=True)
class Groups:
    """What was timed together, and what was loaded and freed."""

    sizes: list[int] = field(default_factory=list)
    held: list[int] = field(default_factory=list)  # bytes, of every contender that was timed
    loaded: int = 0
    most_loaded: int = 0


@pytest.fixture
def groups(monkeypatch: pytest.MonkeyPatch) -> Groups:
    """Filled while a comparison runs."""
    seen = Groups()

    def counted(group: Sequence[Contender], *rest: Any) -> None:
        seen.sizes.append(len(group))
        seen.held += [one.bytes for one in group]
        time_frames(group, *rest)

    def loading(one: Contender, cameras: Sequence[Camera]) -> Timing:
        seen.loaded += 1
        seen.most_loaded = max(seen.loaded, seen.most_loaded)
        return draw_once(one, cameras)

    def freeing(kind: type[contenders.SurfaceContender | contenders.RayContender]) -> None:
        release = kind.release

        def counted_release(one: Any) -> None:
            seen.loaded -= one._renderer is not None if hasattr(one, "_renderer") else one._caster is not None
            release(one)

        monkeypatch.setattr(kind, "release", counted_release)

    monkeypatch.setattr(experiment, "time_frames", counted)
    monkeypatch.setattr(experiment, "draw_once", loading)
    monkeypatch.setattr(experiment, "warm_up", lambda *_: None)
    freeing(contenders.SurfaceContender)
    freeing(contenders.RayContender)
    return seen


def picture_bytes(entries: int) -> int:
    """Memory of so many entries' pictures and the references: four float32 per pixel."""
    return 16 * SIZE[0] * SIZE[1] * len(CAMERAS) * (entries + 1)


@pytest.mark.parametrize(("spare", "expected"), [(0, [3, 1]), (-1, [2, 2])])
def test_contenders_that_do_not_fit_together_are_measured_in_groups(
    groups: Groups, spare: int, expected: list[int]
) -> None:
    texture = SAMPLE_BYTES * blob_scene().volume.array.size
    methods = ("post-classified", "pre-integrated")
    asked = small_experiment(budget_bytes=picture_bytes(4) + 3 * texture + spare, methods=methods)
    found = run_experiment(asked).results.to_dict()
    assert (groups.sizes, groups.most_loaded, groups.loaded) == (expected, max(expected), 0)
    assert [entry["name"] for entry in found["entries"]] == [
        f"{method}-step-{step}" for method in methods for step in ("2", "1-2")
    ]


def test_fragments_count_as_they_are_and_before_that_as_they_may_be(groups: Groups) -> None:
    most = 1 << 20
    scene = blob_scene()
    scene = replace(scene, render=replace(scene.render, fragment_budget_bytes=most))
    asked = replace(small_experiment(methods=("data-centric",)), scene=scene)
    found = run_experiment(asked).results.to_dict()
    meshes = [TRIANGLE_BYTES * entry["summary"]["triangles_extracted"] for entry in found["entries"]]
    pools = [held - mesh for held, mesh in zip(groups.held, meshes, strict=True)]
    assert all(0 < pool <= most for pool in pools)
    assert pools[0] < most
    # the first has drawn when the second one comes, of which only the bound is known
    both = picture_bytes(2) + groups.held[0] + meshes[1] + most
    for spare, expected in ((0, [2]), (-1, [1, 1])):
        groups.sizes.clear()
        run_experiment(replace(asked, budget_bytes=both + spare))
        assert groups.sizes == expected


def test_what_is_loaded_is_freed_where_a_later_setting_fails(
    groups: Groups, monkeypatch: pytest.MonkeyPatch
) -> None:
    prepare = contenders.RayContender.prepare

    def fails(one: contenders.RayContender) -> None:
        if one.setting.value == STEPS[1]:
            raise InputError("no more")
        prepare(one)

    monkeypatch.setattr(contenders.RayContender, "prepare", fails)
    with pytest.raises(InputError, match="no more"):
        run_experiment(small_experiment(methods=("pre-integrated", "post-classified")))
    assert (groups.most_loaded, groups.loaded) == (2, 0)


HALF_VOXELS = isosample.Volume(np.zeros((9, 9, 9), np.float32), spacing=(0.5, 1.0, 0.75))  # 4 x 8 x 6
CENTRE = (2.0, 4.0, 3.0)


def seen_from_afar(**size: float) -> isosample.Camera:
    """A camera 9 in front of the centre of the box; orthographic with a height, else perspective."""
    kind = isosample.Projection.ORTHOGRAPHIC if "height" in size else isosample.Projection.PERSPECTIVE
    eye = (CENTRE[0], CENTRE[1], CENTRE[2] + 9.0)
    return isosample.Camera(projection=kind, eye=eye, target=CENTRE, **size)  # type: ignore[arg-type]


def test_the_grain_band_is_that_of_one_voxel_and_stays_below_the_finest_frequency() -> None:
    camera = seen_from_afar(height=10.0)
    band = grain_band_of(camera, (100, 100), HALF_VOXELS)  # pixels of 0.1, a fifth of a voxel
    expected = (0.2 * math.tan(math.radians(15)), 0.2 * math.tan(math.radians(60)))
    assert band == pytest.approx(expected)
    assert grain_band_of(camera, (10, 10), HALF_VOXELS) == (0.25, 0.5)
    window = 2 * math.degrees(math.atan(5.0 / 9.0))  # as high in the middle of the box
    assert grain_band_of(seen_from_afar(fov_y_degrees=window), (100, 100), HALF_VOXELS) == pytest.approx(
        expected
    )


def test_the_grain_band_does_not_depend_on_how_far_the_target_is() -> None:
    far = seen_from_afar(fov_y_degrees=30.0)
    near = replace(far, target=(far.eye[0], far.eye[1], far.eye[2] - 0.01))
    band = grain_band_of(far, (64, 64), HALF_VOXELS)
    assert band is not None
    assert grain_band_of(near, (64, 64), HALF_VOXELS) == pytest.approx(band)


def test_a_picture_of_less_than_a_voxel_has_no_grain_band() -> None:
    # The steps repeat tan 60° x (height / 64) / 0.5 times per pixel at most: less than once per picture below
    # a height of 0.5 / tan 60° = 0.2887.
    assert grain_band_of(seen_from_afar(height=0.29), (64, 64), HALF_VOXELS) is not None
    assert grain_band_of(seen_from_afar(height=0.28), (64, 64), HALF_VOXELS) is None
    away = seen_from_afar(fov_y_degrees=30.0)
    away = replace(away, target=(away.eye[0], away.eye[1], away.eye[2] + 1.0))
    assert grain_band_of(away, (64, 64), HALF_VOXELS) is None


@pytest.mark.parametrize("height", [None, 0.2])
def test_a_comparison_with_a_target_at_the_eye_or_without_a_grain_band_runs_to_its_end(
    height: float | None, tmp_path: Path
) -> None:
    size = {"fov_y_degrees": 30.0} if height is None else {"height": height}
    kind = isosample.Projection.PERSPECTIVE if height is None else isosample.Projection.ORTHOGRAPHIC
    camera = isosample.Camera(projection=kind, eye=(5.5, 6.0, 40.0), target=(5.5, 6.0, 39.999), **size)  # type: ignore[arg-type]
    asked = replace(small_experiment(methods=("pre-integrated",)), cameras=(camera,), repeat=1)
    found = run_experiment(asked).results.to_dict()
    write_results(found, tmp_path / "results.json")
    grains = [entry["summary"]["wood_grain"] for entry in found["entries"]]
    assert [grain is None for grain in grains] == [height is not None] * len(grains)
    told = dict(
        facts(found | {"scene": found["scene"] | {"source": "", "transfer_function_source": ""}})[1][1]
    )
    assert ("none, the picture shows too little" in told["wood grain"]) == (height is not None)
    assert "tilts of 15° to 60°" in told["wood grain"]


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


def test_a_lit_scene_has_no_reference() -> None:
    scene = blob_scene()
    with pytest.raises(InputError, match="no shading"):
        ComparedScene(
            volume=scene.volume,
            transfer_function=scene.transfer_function,
            size=SIZE,
            render=isosample.RenderSettings(material=isosample.Material()),
        )

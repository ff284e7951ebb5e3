"""`--fit visible` fills the picture with what the transfer function shows, by every method and from every side."""

from __future__ import annotations

import json
import math
import shlex
from pathlib import Path
from typing import Any

import numpy as np
import PIL.Image
import pytest

import isosample
from cli.fit_cases import FIRST, LAST, RENDER, SIZE, WHITE, write_cube
from cli.harness import Run, write_json
from isosample.cli import console
from isosample.cli.methods import METHODS
from isosample.compare.false_color import shown
from isosample.rendering import framing

pytestmark = pytest.mark.usefixtures("gl")


@pytest.fixture(autouse=True)
def cube(folder: Path) -> isosample.Volume:
    """The volume of cube.npy, which is there with tent.json."""
    return write_cube(folder)


def opacity(name: str) -> np.ndarray[tuple[int, ...], np.dtype[np.float32]]:
    found: np.ndarray[tuple[int, ...], np.dtype[np.float32]] = np.load(name)[..., 3]
    return found


@pytest.mark.parametrize("method", METHODS)
def test_what_is_visible_is_in_the_middle_and_as_large_as_its_box(run: Run, method: str) -> None:
    """The field falls to 0.5 half a cell beyond the ones, so that 6 cells are seen of a box of 7."""
    outcome = run(f"{RENDER} --method {method} -o out.npy")
    assert outcome.status == 0, outcome.err
    for axis in (0, 1):
        seen = np.flatnonzero(opacity("out.npy").any(axis=axis))
        # The window is the diameter of the box's sphere, 7 sqrt(3); a pixel is seen where its centre is.
        width = SIZE * 6.0 / (7.0 * math.sqrt(3.0))
        assert abs(len(seen) - width) <= 1.0
        assert abs((seen[0] + seen[-1] + 1) / 2 - SIZE / 2) <= 1.0
    assert run(f"{RENDER} --method {method} --fit volume -o whole.npy").status == 0
    assert opacity("whole.npy").astype(bool).sum() < 0.2 * opacity("out.npy").astype(bool).sum()


@pytest.mark.parametrize("method", [*METHODS, "auto"])
@pytest.mark.parametrize("projection", ["orthographic", "perspective"])
def test_all_methods_take_the_box_of_the_same_cells(
    run: Run, cube: isosample.Volume, method: str, projection: str
) -> None:
    options = f"--azimuth 40 --elevation 20 --zoom 1.25 --projection {projection}"
    assert run(f"{RENDER} --method {method} {options} -o out.npy").status == 0
    box = isosample.visible_box(cube, isosample.TransferFunction.load("tent.json"))
    np.testing.assert_array_equal(box.corner, FIRST - 1.0)
    np.testing.assert_array_equal(box.edges, np.diag(LAST - FIRST + 2.0))
    camera = isosample.Camera.orbit(
        box, azimuth=40, elevation=20, zoom=1.25, projection=isosample.Projection(projection)
    )
    write_json(Path("camera.json"), camera.to_dict())
    placed = RENDER.replace("--fit visible", "--camera camera.json")
    assert run(f"{placed} --method {method} -o placed.npy").status == 0
    np.testing.assert_array_equal(np.load("out.npy"), np.load("placed.npy"))


@pytest.mark.parametrize("projection", ["orthographic", "perspective"])
@pytest.mark.parametrize("method", ["data-centric", "reference"])
def test_an_eye_between_the_box_and_the_volume_s_faces_sees_all_that_is_visible(
    run: Run, cube: isosample.Volume, method: str, projection: str
) -> None:
    """As in a volume from which all but what is visible is cut away, whose faces are closer than the eye."""
    first, last = FIRST - 2, LAST + 3
    part = tuple(slice(low, high) for low, high in zip(first[::-1], last[::-1], strict=True))
    np.save("part.npy", cube.array[part])
    box = isosample.visible_box(cube, isosample.TransferFunction.load("tent.json"))
    camera = isosample.Camera.orbit(box, azimuth=10, projection=isosample.Projection(projection))
    assert (np.array(camera.eye) > 0).all()
    assert (np.array(camera.eye) < np.subtract(cube.size_xyz, 1)).all()
    there = "--fit visible --azimuth 10 --method"
    assert run(f"{RENDER} {there} {method} --projection {projection} -o out.npy").status == 0
    words = RENDER.replace("cube.npy", "part.npy")
    assert run(f"{words} {there} {method} --projection {projection} -o alone.npy").status == 0
    found, expected = np.load("out.npy"), np.load("alone.npy")
    assert expected.any()
    # The reference errs by 1e-10. Else float32 places of crossings, some 50 units from the volume's middle or the eye,
    # err by 2^-23 of that; there are 26 at most, and the extinction is 2.
    error = 2e-10 if method == "reference" else 26 * 50 * 2.0**-23 * 2
    assert np.abs(found - expected).max() <= error


@pytest.mark.parametrize(
    "words",
    [
        "render cube.npy --tf tent.json --fit visible --method reference --size 4x4 -o out.npy",
        "precompute cube.npy --tf tent.json --memory 16GiB --cache meshes",
    ],
)
def test_the_search_tells_its_progress(run: Run, monkeypatch: pytest.MonkeyPatch, words: str) -> None:
    monkeypatch.setattr(console, "MOMENT", -1.0)
    assert "isosample: frame: 100 % after" in run(words).err


@pytest.mark.parametrize("method", [*METHODS, "auto"])
def test_what_a_smooth_reconstruction_alone_shows_is_framed(run: Run, method: str) -> None:
    """The cubic spline overshoots the ones by up to a tenth, in their cube; no sample is above 1."""
    points = [{"value": v, "color": WHITE, "extinction": 1} for v in (1.01, 2)]
    write_json(Path("over.json"), {"points": points})
    words = f"render cube.npy --tf over.json --size {SIZE}x{SIZE} --reconstruction cubic --method {method}"
    assert run(f"{words} -o whole.npy").status == 0
    outcome = run(f"{words} --fit visible -o out.npy")
    assert outcome.status == 0, outcome.err
    whole, fitted = (opacity(name).astype(bool) for name in ("whole.npy", "out.npy"))
    if method == "data-centric":  # it is not refused; meshes begin between two samples, and none is above 1
        assert not whole.any()
    else:
        assert 0 < whole.sum() < fitted.sum()
    for edge in (fitted[0], fitted[-1], fitted[:, 0], fitted[:, -1]):
        assert not edge.any()
    assert "nothing to fit" in run(f"{words} --reconstruction trilinear --fit visible -o no.npy").err


@pytest.mark.parametrize("method", [name for name in (*METHODS, "auto") if name != "post-classified"])
def test_an_isosurface_at_the_background_s_value_is_framed_by_what_it_is_around(
    run: Run, cube: isosample.Volume, method: str
) -> None:
    """Of a pit in the ground, which ends at the ground's value: there it is seen, and nowhere else."""
    pit = 0.0 - cube.array.astype(np.float32)
    np.save("pit.npy", pit)
    write_json(
        Path("ground.json"), {"points": [], "isosurfaces": [{"value": 0, "color": WHITE, "opacity": 1}]}
    )
    words = f"render pit.npy --tf ground.json --size {SIZE}x{SIZE} --method {method}"
    assert run(f"{words} --fit visible -o out.npy").status == 0
    box = isosample.visible_box(isosample.Volume(pit), isosample.TransferFunction.load("ground.json"))
    np.testing.assert_array_equal(box.corner, FIRST - 1.0)
    np.testing.assert_array_equal(box.edges, np.diag(LAST - FIRST + 2.0))
    seen = opacity("out.npy").astype(bool)
    assert seen.mean() > 0.2
    assert not (seen[0] | seen[-1] | seen[:, 0] | seen[:, -1]).any()


@pytest.mark.parametrize("method", [*METHODS, "auto"])
def test_masked_samples_are_not_framed(run: Run, cube: isosample.Volume, method: str) -> None:
    """A far sample of one is alone among masked ones, and so is one of infinity: no cell there is whole."""
    spoilt = cube.array.copy()
    spoilt[30:33, 18:21, 14:17] = np.nan
    spoilt[31, 19, 15] = 1.0
    spoilt[2, 2, 2] = np.inf
    np.save("spoilt.npy", spoilt)
    words = f"{RENDER} --method {method}"
    assert run(f"{words.replace('cube.npy', 'spoilt.npy')} --nan masked -o masked.npy").status == 0
    assert run(f"{words} -o out.npy").status == 0
    # Places of crossings as above: the chunks of the two meshes are made apart.
    error = 26 * 50 * 2.0**-23 * 2 if method == "data-centric" else 0.0
    np.testing.assert_allclose(np.load("masked.npy"), np.load("out.npy"), rtol=0, atol=error)


@pytest.mark.parametrize("method", ["data-centric", "post-classified", "reference"])
def test_a_turn_keeps_its_distance_and_has_the_bits_of_single_pictures(run: Run, method: str) -> None:
    words = f"{RENDER} --method {method} --projection perspective"
    assert run(f"{words} --turntable 3 --stats stats.json -o film.npy").status == 0
    stats: dict[str, Any] = json.loads(Path("stats.json").read_text(encoding="utf-8"))
    cameras = stats["turntable"]["cameras"]
    centre = (FIRST + LAST) / 2.0
    for camera in cameras:
        np.testing.assert_allclose(camera["target"], centre, rtol=0, atol=1e-12)
    away = [math.dist(camera["eye"], camera["target"]) for camera in cameras]
    np.testing.assert_allclose(away, away[0], rtol=1e-12)
    assert run(f"{words} --azimuth 120 -o single.npy").status == 0
    np.testing.assert_array_equal(np.load("film-001.npy"), np.load("single.npy"))


def test_a_comparison_is_framed_as_the_commands_that_it_gives(run: Run) -> None:
    pytest.importorskip("jinja2")
    sweep = "--methods data-centric,pre-integrated --steps 1 --per-slopes 2 --repeat 1"
    view = "--size 24x20 --fit visible --azimuth 30 --cameras 2"
    outcome = run(f"compare cube.npy --tf tent.json {sweep} {view} -o out")
    assert outcome.status == 0, outcome.err
    document: dict[str, Any] = json.loads(Path("out/results.json").read_text(encoding="utf-8"))
    assert len(document["entries"]) == 2
    for entry in document["entries"]:
        for number, one in enumerate(entry["views"], start=1):
            words = shlex.split(one["command"])[1:-1]
            assert run(*words, "again.npy").status == 0
            with PIL.Image.open(f"out/pictures/camera-{number}_{entry['name']}.png") as kept:
                again = shown(np.load("again.npy"), document["settings"]["backdrop"])
                np.testing.assert_array_equal(again, np.asarray(kept.convert("RGB")))
            assert (
                np.load("again.npy")[..., 3].astype(bool).mean() > 0.2
            )  # 0.02 of the whole volume's picture


def test_the_volume_s_box_is_the_default(run: Run) -> None:
    for method in METHODS:
        words = f"render cube.npy --tf tent.json --size 16x12 --method {method} --azimuth 20"
        assert run(f"{words} -o none.npy").status == 0
        assert run(f"{words} --fit volume -o volume.npy").status == 0
        assert run(f"{words} --fit visible -o visible.npy").status == 0
        np.testing.assert_array_equal(np.load("none.npy"), np.load("volume.npy"))
        assert not np.array_equal(np.load("none.npy"), np.load("visible.npy"))


@pytest.mark.parametrize("method", [*METHODS, "auto"])
def test_nothing_visible_cannot_fill_a_picture(run: Run, method: str) -> None:
    write_json(
        Path("nothing.json"), {"points": [{"value": v, "color": WHITE, "extinction": 1} for v in (7, 8)]}
    )
    outcome = run(f"render cube.npy --tf nothing.json --fit visible --method {method} -o out.npy")
    assert outcome.status == 2
    assert "shows nothing of cube.npy, whose values go from 0 to 1: there is nothing to fit" in outcome.err
    assert not Path("out.npy").exists()


@pytest.mark.parametrize("method", ["", "--method data-centric", "--method auto"])
def test_that_there_is_nothing_to_fit_is_told_before_a_cache_folder_is_begun(run: Run, method: str) -> None:
    write_json(
        Path("nothing.json"), {"points": [{"value": v, "color": WHITE, "extinction": 1} for v in (7, 8)]}
    )
    words = f"render cube.npy --tf nothing.json --cache meshes {method} -o out.npy"
    assert "there is nothing to fit" in run(f"{words} --fit visible").err
    assert not Path("meshes").exists()
    assert run(words).status == 0
    assert Path("meshes").exists()


def test_a_comparison_reads_a_file_once(
    run: Run, cube: isosample.Volume, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It takes the volume into memory, where the box is looked for, too."""
    pytest.importorskip("jinja2")
    h5py = pytest.importorskip("h5py")
    with h5py.File("cube.h5", "w") as file:
        file.create_dataset("cube", data=cube.array, chunks=(8, 8, 8))
    searched: list[bool] = []
    search = framing.visible_span

    def noted(volume: isosample.Volume, *words: Any, **options: Any) -> Any:
        searched.append(volume.stays_in_file)
        return search(volume, *words, **options)

    monkeypatch.setattr(framing, "visible_span", noted)
    sweep = "--methods data-centric --per-slopes 2 --repeat 1 --size 24x20 --fit visible"
    assert run(f"compare cube.h5 --tf tent.json {sweep} -o out").status == 0
    assert searched == [False]


@pytest.mark.parametrize("command", ["render cube.npy -o out.npy", "compare cube.npy -o out"])
def test_a_camera_file_leaves_nothing_to_fit(run: Run, cube: isosample.Volume, command: str) -> None:
    write_json(Path("camera.json"), isosample.Camera.orbit(cube.box).to_dict())
    outcome = run(f"{command} --camera camera.json --fit visible")
    assert outcome.status == 2
    assert "--fit and --camera camera.json both place the camera" in outcome.err

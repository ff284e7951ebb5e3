"""`--fit visible` of a cache folder, which knows the box that the volume has, or what adds it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cli.fit_cases import FIRST, LAST, RENDER, SIZE, TENT, WHITE, write_cube
from cli.harness import Run, write_json
from isosample.rendering import framing
from isosample.surfaces import volume_file
from isosample.surfaces.cache_files import read_json
from isosample.surfaces.cache_files import write_json as write_checked
from isosample.volume import shown_cells

pytestmark = pytest.mark.usefixtures("gl")


@pytest.fixture(autouse=True)
def _cube(folder: Path) -> None:
    """What all tests read: cube.npy and tent.json."""
    write_cube(folder)


@pytest.mark.parametrize("more", ["", "--memory 16GiB", "--details 2"])
def test_a_cache_folder_is_framed_as_its_volume(run: Run, more: str) -> None:
    details = "--details 2" if "details" in more else ""
    assert run(f"{RENDER} {details} --azimuth 30 -o volume.npy").status == 0
    for _ in range(2):
        assert run(f"precompute cube.npy --tf tent.json --cache meshes {more}").status == 0
        for tf in ("", "--tf tent.json"):
            picture = f"render meshes {tf} --size {SIZE}x{SIZE} --fit visible --azimuth 30 -o cache.npy"
            assert run(picture).status == 0
            np.testing.assert_array_equal(np.load("cache.npy"), np.load("volume.npy"))


def test_with_a_memory_budget_a_box_that_the_folder_knows_is_not_searched_for(
    run: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    """But that of another transfer function is, however alike, and where the scene is none of this version."""
    searches: list[object] = []
    search = framing.visible_span

    def noted(*words: Any, **options: Any) -> Any:
        searches.append(words)
        return search(*words, **options)

    def visible_after(tf: str) -> object:
        assert run(f"precompute cube.npy --tf {tf} --memory 16GiB --cache meshes").status == 0
        return read_json(Path("meshes/scene.json"), "scene")["visible"]

    monkeypatch.setattr(framing, "visible_span", noted)
    inside = [(FIRST - 1).tolist(), (LAST + 1).tolist()]
    for name, further in (("nothing", 7.0), ("wider", -0.25)):
        moved = [{**point, "value": point["value"] + further} for point in TENT["points"]]
        write_json(Path(f"{name}.json"), {"points": moved})
    for tf, expected in (("tent.json", inside), ("nothing.json", None), ("wider.json", inside)):
        searches.clear()
        assert visible_after(tf) == expected
        assert len(searches) == 1
        assert visible_after(tf) == expected
        assert len(searches) == 1
    scene = read_json(Path("meshes/scene.json"), "scene")
    entries = {name: scene[name] for name in scene if name not in ("format", "version", "settings")}
    write_checked(Path("meshes/scene.json"), "scene", entries)
    assert visible_after("wider.json") == inside
    assert len(searches) == 2


def test_the_first_scene_of_a_cache_that_render_makes_tells_its_box(run: Run) -> None:
    words = f"render cube.npy --tf tent.json --size {SIZE}x{SIZE}"
    assert run(f"{words} --cache meshes -o out.npy").status == 0
    assert run(f"{words} --fit visible -o volume.npy").status == 0
    assert run(f"render meshes --size {SIZE}x{SIZE} --fit visible -o cache.npy").status == 0
    np.testing.assert_array_equal(np.load("cache.npy"), np.load("volume.npy"))


@pytest.mark.parametrize("more", ["", "--fit visible"])
def test_the_first_scene_of_a_cache_is_scanned_for_its_box_and_its_name_at_once(
    run: Run, monkeypatch: pytest.MonkeyPatch, more: str
) -> None:
    def refuse(*_: object) -> None:
        raise AssertionError("a scan of the volume tells this")

    monkeypatch.setattr(shown_cells, "_ranges", refuse)
    monkeypatch.setattr(volume_file, "scan_volume", refuse)
    words = f"render cube.npy --tf tent.json --method data-centric --size 16x12 --cache meshes {more}"
    assert run(f"{words} -o out.npy").status == 0
    assert read_json(Path("meshes/scene.json"), "scene")["visible"] == [
        (FIRST - 1).tolist(),
        (LAST + 1).tolist(),
    ]


def test_the_box_that_was_found_to_choose_a_method_is_not_searched_for_again(
    run: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    searches: list[object] = []
    search = shown_cells.shown_span

    def noted(*words: Any, **options: Any) -> Any:
        searches.append(words)
        return search(*words, **options)

    monkeypatch.setattr(framing, "shown_span", noted)
    for method in ("", "--method auto --cache meshes --per-slope 2"):
        searches.clear()
        words = f"render cube.npy --tf tent.json --fit visible --size 16x12 {method} -o out.npy"
        assert run(words).status == 0
        assert len(searches) == 1


def test_a_folder_that_does_not_know_the_box_says_what_adds_it(run: Run) -> None:
    assert run("precompute cube.npy --tf tent.json --cache meshes").status == 0
    write_json(Path("other.json"), {"points": TENT["points"][1:]})
    scene = read_json(Path("meshes/scene.json"), "scene")
    known = scene.pop("visible")
    assert known == [(FIRST - 1).tolist(), (LAST + 1).tolist()]
    render = "render meshes --fit visible -o out.npy"
    assert run("precompute cube.npy --tf other.json --cache meshes").status == 0
    for command in (f"{render} --tf tent.json", render):
        outcome = run(command)
        assert (outcome.status, outcome.err.count("\n")) == (2, 1)
        cure = "`isosample precompute` with the same volume, options and --cache, and with this transfer function"
        assert cure in outcome.err
        assert not Path("out.npy").exists()
        # As a version that knew no such boxes left it.
        entries = {name: value for name, value in scene.items() if name not in ("format", "version")}
        write_checked(Path("meshes/scene.json"), "scene", entries)
    assert run("render meshes -o out.npy").status == 0
    assert run("precompute cube.npy --tf tent.json --cache meshes").status == 0
    assert run(render).status == 0


@pytest.mark.parametrize("more", ["", "--memory 16GiB"])
def test_a_folder_of_a_smooth_reconstruction_frames_what_that_shows(run: Run, more: str) -> None:
    points = [{"value": v, "color": WHITE, "extinction": 1} for v in (1.01, 2)]
    write_json(Path("over.json"), {"points": points})
    assert run("precompute cube.npy --tf over.json --reconstruction cubic --cache meshes").status == 0
    picture = f"render meshes --size {SIZE}x{SIZE} --fit visible -o cache.npy"
    assert run(picture).status == 0
    volume = picture.replace("meshes", "cube.npy --tf over.json --reconstruction cubic")
    assert run(volume.replace("cache.npy", "volume.npy")).status == 0
    np.testing.assert_array_equal(np.load("cache.npy"), np.load("volume.npy"))
    assert run(f"precompute cube.npy --tf over.json --cache meshes {more}").status == 0
    assert "shows nothing of meshes" in run(picture).err


@pytest.mark.parametrize("made", ["precompute", "precompute --memory 16GiB", "render -o first.npy"])
def test_a_cache_folder_knows_that_nothing_is_visible(run: Run, made: str) -> None:
    """For which there is no remedy; unlike a folder that does not know, which then does."""
    write_json(
        Path("nothing.json"), {"points": [{"value": v, "color": WHITE, "extinction": 1} for v in (7, 8)]}
    )
    command, *more = made.split(" ", 1)
    again = f"{command} cube.npy --tf nothing.json --cache meshes {' '.join(more)}"
    assert run(again).status == 0
    picture = "render meshes --fit visible -o out.npy"
    told = "shows nothing of meshes, whose values go from 0 to 1: there is nothing to fit"
    assert told in run(picture).err
    rewritten = read_json(Path("meshes/scene.json"), "scene")
    assert rewritten.pop("visible", 0) is None
    entries = {name: value for name, value in rewritten.items() if name not in ("format", "version")}
    write_checked(Path("meshes/scene.json"), "scene", entries)
    assert "does not tell where" in run(picture).err
    assert run("precompute cube.npy --tf nothing.json --cache meshes").status == 0
    outcome = run(picture)
    assert (outcome.status, outcome.err.count("\n")) == (2, 2)  # that nothing will be shown is noted before
    assert told in outcome.err

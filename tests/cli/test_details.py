"""`--details` and `--screen-error`: coarser meshes in a folder, and pictures that take them."""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import numpy as np
import pytest

from cli.harness import Run, write_json
from isosample.cli import cached_scenes
from isosample.cli.data_centric import spread
from isosample.cli.values import screen_error
from isosample.surfaces.cache import open_cache
from isosample.surfaces.stored_surfaces import StoredSurfaces
from isosample.surfaces.surface_set import SurfaceSet
from isosample.volume.analytic import GaussianMixture, sample_field

VIEW = "--size 40x30 --azimuth 30"
TF = {
    "points": [
        {"value": 0.1, "color": [0.1, 0.3, 1.0], "extinction": 0.0},
        {"value": 0.5, "color": [1.0, 0.7, 0.1], "extinction": 0.3},
        {"value": 0.9, "color": [1.0, 0.7, 0.1], "extinction": 0.0},
    ]
}


@pytest.fixture
def smooth(folder: Path) -> Path:
    """A folder with a smooth volume and a transfer function."""
    field = GaussianMixture(
        centres=((-0.3, 0, 0.1), (0.35, 0.1, 0)), widths=(0.3, 0.25), amplitudes=(1.0, 0.9)
    )
    np.save(folder / "smooth.npy", sample_field(field, (30,) * 3, lower=(-1.0,) * 3, upper=(1.0,) * 3).array)
    write_json(folder / "smooth.json", TF)
    return folder


def test_pictures_of_a_folder_with_details_take_fewer_triangles(run: Run, smooth: Path) -> None:
    run("precompute smooth.npy --tf smooth.json --per-slope 2 --cache plain")
    assert run("precompute smooth.npy --tf smooth.json --per-slope 2 --details 3 --cache fine").status == 0
    drawn = {}
    for name, options in {
        "plain": "",
        "fine": "--screen-error 0",
        "near": "--screen-error 1/20",
        "far": "--screen-error 1",
    }.items():
        source = "plain" if name == "plain" else "fine"
        outcome = run(f"render {source} {VIEW} {options} --stats {name}.json -o {name}.npy")
        assert outcome.status == 0
        drawn[name] = json.loads(Path(f"{name}.json").read_text())["triangles"]["drawn"]
        assert ("pieces coarser" in outcome.fields()["triangles"]) == (name in ("near", "far"))
    assert np.array_equal(np.load("plain.npy"), np.load("fine.npy"))
    assert drawn["plain"] == drawn["fine"] > drawn["near"] > drawn["far"]


@pytest.mark.parametrize("source", ["smooth.npy --tf smooth.json --per-slope 4 --details 3", "meshes"])
def test_details_beyond_the_mesh_budget_give_the_same_picture(run: Run, smooth: Path, source: str) -> None:
    run("precompute smooth.npy --tf smooth.json --per-slope 4 --details 3 --cache meshes")
    batches = {}
    for name, options in {"whole": "", "batches": "--mesh-budget 64KiB"}.items():
        view = f"{VIEW} --screen-error 1/2 --clip 1,0,0,-9 --stats {name}.json -o {name}.npy"
        assert run(f"render {source} {view} {options}").status == 0
        told = json.loads(Path(f"{name}.json").read_text())
        assert told["skipped"]["chunks_coarser"] > 0
        batches[name] = told["mesh_batches"]
    assert batches["whole"] == 1 < batches["batches"]
    picture = np.load("whole.npy")
    assert picture[..., 3].max() > 0.1
    assert np.array_equal(np.load("batches.npy"), picture)


def test_another_transfer_function_finds_the_details_of_its_isovalues(run: Run, smooth: Path) -> None:
    run("precompute smooth.npy --tf smooth.json --per-slope 2 --details 2 --cache meshes")
    recoloured = {"points": [point | {"color": [0.0, 1.0, 0.0]} for point in TF["points"]]}
    write_json(Path("green.json"), recoloured)
    outcome = run(f"render meshes --tf green.json --per-slope 2 {VIEW} -o green.npy")
    assert "pieces coarser" in outcome.fields()["triangles"]
    assert "lacks" not in outcome.err


def test_absent_details_are_told_and_damaged_ones_are_an_error(run: Run, smooth: Path) -> None:
    run("precompute smooth.npy --tf smooth.json --per-slope 3 --details 2 --cache meshes")
    other = json.loads(Path("meshes/scene.json").read_text())["details"][1]["surfaces"]
    run("precompute smooth.npy --tf smooth.json --per-slope 4 --cache meshes")
    run("precompute smooth.npy --tf smooth.json --per-slope 2 --details 2 --cache meshes")
    finest = run(f"render meshes --per-slope 4 {VIEW} -o finest.npy")
    assert finest.status == 0
    assert "0 of its scene's 2 details are used" in finest.err
    assert finest.err.count("\n") == 1
    assert "pieces coarser" not in finest.fields()["triangles"]

    own = Path("meshes/scene.json").read_text()
    listed = next(Path(f"meshes/surfaces/{entry['key']}.npz") for entry in other if entry["key"] not in own)
    whole = listed.read_bytes()
    listed.write_bytes(whole[:-40])
    damaged = run(f"render meshes --per-slope 3 {VIEW} -o damaged.npy")
    assert damaged.status != 0
    assert f"{listed.name} is damaged" in damaged.err
    listed.unlink()
    absent = run(f"render meshes --per-slope 3 {VIEW} -o absent.npy")
    assert absent.status == 0
    assert "1 of its scene's 2 details are used" in absent.err


def test_verify_names_the_lists_of_the_scene_that_are_missing(run: Run, smooth: Path) -> None:
    run("precompute smooth.npy --tf smooth.json --per-slope 2 --details 2 --cache meshes")
    scene = json.loads(Path("meshes/scene.json").read_text())
    for part, what in ((scene, " of scene.json"), (scene["details"][1], ", detail 2, of scene.json")):
        entry = part["surfaces"][0]
        listed = Path(f"meshes/surfaces/{entry['key']}.npz")
        whole = listed.read_bytes()
        listed.unlink()
        outcome = run("cache verify meshes")
        assert outcome.status == 1
        assert f"{listed}: isosurface {float.fromhex(entry['isovalue'])!r}{what} is missing" in outcome.out
        listed.write_bytes(whole)
    assert run("cache verify meshes").status == 0


def test_details_count_when_it_is_asked_whether_meshes_fit_the_memory(
    run: Run, smooth: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run("precompute smooth.npy --tf smooth.json --per-slope 2 --details 2 --cache meshes")
    surfaces = open_cache("meshes").surfaces
    finest = int(surfaces.chunk_table["bytes"].sum())
    monkeypatch.setattr(cached_scenes, "LARGEST_IN_MEMORY", finest)
    assert isinstance(cached_scenes.scene_from_cache(Path("meshes"), None).surfaces, StoredSurfaces)
    whole = finest + sum(int(one.chunk_table["bytes"].sum()) for one in surfaces.details)
    monkeypatch.setattr(cached_scenes, "LARGEST_IN_MEMORY", whole)
    assert isinstance(cached_scenes.scene_from_cache(Path("meshes"), None).surfaces, SurfaceSet)


def test_details_of_a_volume_and_of_a_volume_read_piece_by_piece(run: Run, smooth: Path) -> None:
    assert (
        "pieces coarser"
        in run(f"render smooth.npy --tf smooth.json --details 2 {VIEW} -o a.npy").fields()["triangles"]
    )
    run("precompute smooth.npy --tf smooth.json --details 2 --memory 16GiB --cache lazy")
    assert run(f"render lazy {VIEW} -o b.npy").status == 0
    assert np.array_equal(np.load("a.npy"), np.load("b.npy"))


def test_a_film_takes_coarser_meshes_too(run: Run, smooth: Path) -> None:
    run("precompute smooth.npy --tf smooth.json --per-slope 2 --details 2 --cache meshes")
    assert run("render meshes --size 20x16 --turntable 3 --stats film.json -o film.npy").status == 0
    assert json.loads(Path("film.json").read_text())["skipped"]["chunks_coarser"] > 0


def test_a_tolerance_decides_unless_the_displacement_is_given(run: Run, smooth: Path) -> None:
    run("precompute smooth.npy --tf smooth.json --tolerance 0.02 --details 2 --cache meshes")
    for options in ("", "--screen-error 2"):
        outcome = run(f"render meshes {VIEW} {options} --stats s.json -o a.npy")
        assert outcome.status == 0
        told = json.loads(Path("s.json").read_text())
        assert told["tolerance"]["missed"] is None
        assert outcome.fields()["screen error"] == f"at most {told['screen_error']:g} pixel"
        assert (told["screen_error"] <= 0.25) == (not options)
    assert told["skipped"]["chunks_coarser"] > 0
    assert run("render meshes --size 20x16 --turntable 3 --stats film.json -o film.npy").status == 0
    film = json.loads(Path("film.json").read_text())
    assert film["screen_error"] in (0.0, 0.03125, 0.0625, 0.125, 0.25)


@pytest.mark.parametrize(
    ("frames", "looked_at"), [(1, [0]), (3, [0, 1, 2]), (4, [0, 1, 2, 3]), (7, [0, 1, 3, 5])]
)
def test_a_film_is_looked_at_from_four_sides(frames: int, looked_at: list[int]) -> None:
    assert spread(list(range(frames))) == looked_at  # type: ignore[arg-type,comparison-overlap]


def test_a_budget_leaves_the_details_of_the_scene(run: Run, smooth: Path) -> None:
    outcome = run("precompute smooth.npy --tf smooth.json --details 2 --cache-budget 1KiB --cache meshes")
    assert outcome.status == 0
    assert "they stay" in outcome.err
    assert run("cache verify meshes").status == 0
    assert run(f"render meshes {VIEW} -o a.npy").status == 0


def test_details_of_an_earlier_run_are_used_again_with_a_budget(run: Run, smooth: Path) -> None:
    command = "precompute smooth.npy --tf smooth.json --details 2 --cache-budget 1KiB --cache meshes"
    first = run(f"{command} --per-slope 2").fields()["details"]
    assert first.startswith("2 (")
    assert first.endswith(" 0 pieces reused)")
    second = run(f"{command} --per-slope 5").fields()["details"]  # thirds of a slope are among its sixths
    assert not second.endswith(" 0 pieces reused)")


def test_a_screen_error_without_details_is_told(run: Run, smooth: Path) -> None:
    run("precompute smooth.npy --tf smooth.json --per-slope 1 --cache meshes")
    outcome = run(f"render meshes --screen-error 1 {VIEW} -o a.npy")
    assert outcome.status == 0
    assert "--screen-error 1 changes nothing: meshes has no coarser meshes" in outcome.err
    assert outcome.err.count("\n") == 1


@pytest.mark.parametrize("text", ["0", "0.00", ".0", "0/1", "0e5", "-0"])
def test_zero_may_be_written_in_any_way(text: str) -> None:
    assert str(screen_error(text)) == "0.0"


@pytest.mark.parametrize("text", ["-1/4", "1/0", "1/-4", "inf", "1e308/1e-308", "1,2", "", "/"])
def test_what_is_no_number_of_pixels_is_refused(text: str) -> None:
    with pytest.raises(argparse.ArgumentTypeError, match="must be a number of pixels >= 0"):
        screen_error(text)


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        ("precompute smooth.npy --details 0", "'0' must be a whole number from 1 to 5"),
        ("precompute smooth.npy --details 6", "'6' must be a whole number from 1 to 5"),
        ("precompute smooth.npy --details few", "'few' must be a whole number from 1 to 5"),
        ("render smooth.npy --screen-error -1 -o a.png", "must be a number of pixels >= 0"),
        ("render smooth.npy --screen-error nan -o a.png", "nan"),
        (
            "render smooth.npy --method reference --screen-error 1 -o a.png",
            "--screen-error is about isosurfaces",
        ),
        ("render smooth.npy --method pre-integrated --details 2 -o a.png", "--details is about isosurfaces"),
        (
            "compare smooth.npy --methods pre-integrated --details 2 -o out",
            "--details has no part in a comparison of pre-integrated",
        ),
    ],
)
def test_impossible_details_are_one_line(run: Run, smooth: Path, words: str, expected: str) -> None:
    outcome = run(*words.split())
    assert outcome.status == 2
    assert expected in outcome.err
    assert outcome.err.count("\n") == 1


def test_a_folder_cannot_be_given_details(run: Run, smooth: Path) -> None:
    run("precompute smooth.npy --tf smooth.json --per-slope 1 --cache meshes")
    outcome = run(f"render meshes --details 2 {VIEW} -o a.png")
    assert outcome.status == 2
    assert "--details belongs to a volume file" in outcome.err

"""`--details` and `--screen-error`: coarser meshes in a folder, and pictures that take them."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from cli.harness import Run, write_json
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


def test_another_transfer_function_finds_the_details_of_its_isovalues(run: Run, smooth: Path) -> None:
    run("precompute smooth.npy --tf smooth.json --per-slope 2 --details 2 --cache meshes")
    recoloured = {"points": [point | {"color": [0.0, 1.0, 0.0]} for point in TF["points"]]}
    write_json(Path("green.json"), recoloured)
    outcome = run(f"render meshes --tf green.json --per-slope 2 {VIEW} -o green.npy")
    assert "pieces coarser" in outcome.fields()["triangles"]


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
        assert run(f"render meshes {VIEW} {options} --stats s.json -o a.npy").status == 0
        told = json.loads(Path("s.json").read_text())
        assert told["tolerance"]["missed"] is None
    assert told["skipped"]["chunks_coarser"] > 0


def test_a_budget_leaves_the_details_of_the_scene(run: Run, smooth: Path) -> None:
    outcome = run("precompute smooth.npy --tf smooth.json --details 2 --cache-budget 1KiB --cache meshes")
    assert outcome.status == 0
    assert "they stay" in outcome.err
    assert run("cache verify meshes").status == 0
    assert run(f"render meshes {VIEW} -o a.npy").status == 0


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

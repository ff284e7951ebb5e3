"""`filter` writes a smoothed volume with the placement of the original, and refuses options of another filter."""

from __future__ import annotations

import json
import sys
from typing import TYPE_CHECKING

import numpy as np
import pytest

from cli.harness import Run, blob
from isosample.volume.filters import anisotropic_diffusion, gaussian, median
from isosample.volume.grid import Volume
from isosample.volume.readers import open_volume

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

WORDS: dict[str, Callable[[Volume], Volume]] = {
    "--anisotropic-diffusion": anisotropic_diffusion,
    "--anisotropic-diffusion --conductance 2 --iterations 3 --time-step 0.05": lambda volume: (
        anisotropic_diffusion(volume, conductance=2.0, iterations=3, time_step=0.05)
    ),
    "--gaussian 1.5": lambda volume: gaussian(volume, 1.5),
    "--median 2": lambda volume: median(volume, 2.0),
}


@pytest.mark.parametrize("words", WORDS)
def test_the_file_is_what_the_function_gives(run: Run, folder: Path, words: str) -> None:
    pytest.importorskip("SimpleITK")
    outcome = run(f"filter blob.npy --spacing 1,1.5,2 {words} -o out.nrrd")
    assert (outcome.status, outcome.err) == (0, "")
    found = open_volume(folder / "out.nrrd")
    expected = WORDS[words](Volume(blob(), spacing=(1.0, 1.5, 2.0)))
    assert np.array_equal(found.array, expected.array)
    assert found.geometry == expected.geometry
    fields = outcome.fields()
    assert fields["volume"].startswith("out.nrrd (")
    assert fields["samples"] == "10 x 9 x 8 float32"
    assert fields["filter"] == ("anisotropic-diffusion" if "diffusion" in words else words.removeprefix("--"))


@pytest.mark.parametrize("name", ["out.nrrd", "out.nii.gz", "out.mha", "out.npy"])
def test_every_format_can_be_rendered_from(run: Run, name: str) -> None:
    pytest.importorskip("SimpleITK")
    assert run(f"filter blob.npy --gaussian 1 -o {name}").status == 0
    assert run(f"info {name}").status == 0


def test_a_numpy_file_has_no_spacing_and_that_is_told(run: Run) -> None:
    outcome = run("filter blob.npy --anisotropic-diffusion --spacing 1,1.5,2 -o out.npy")
    assert outcome.status == 0
    assert outcome.err == "isosample: note: out.npy holds no spacing; read it with --spacing 1,1.5,2\n"
    assert run("filter blob.npy --anisotropic-diffusion -o out.npy").err == ""


def test_json_tells_what_the_table_tells(run: Run, folder: Path) -> None:
    told = json.loads(run("filter blob.npy --anisotropic-diffusion -o out.npy --json").out)
    assert told["volume"] == "out.npy"
    assert told["bytes"] == (folder / "out.npy").stat().st_size
    assert (told["filter"], told["type"], told["samples"]) == ("anisotropic-diffusion", "float32", [10, 9, 8])
    assert told["range"][1] < told["range_before"][1] == float(blob().max())
    assert told["seconds"] > 0.0


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("-o out.npy", "one of the arguments --anisotropic-diffusion --gaussian --median is required"),
        ("--gaussian 1 --median 1 -o out.npy", "--median: not allowed with argument --gaussian"),
        ("--gaussian 1 --iterations 3 -o out.npy", "--iterations belongs to --anisotropic-diffusion"),
        ("--median 1 --time-step 0.1 -o out.npy", "--time-step belongs to --anisotropic-diffusion"),
        ("--gaussian 0 -o out.npy", "'0' must be above 0"),
        ("--median 0.2 -o out.npy", "a radius of 0.2 world units is 0 x 0 x 0 samples"),
        ("--anisotropic-diffusion --iterations 0 -o out.npy", "iterations 0 must be a whole number >= 1"),
        (
            "--anisotropic-diffusion --time-step 1 -o out.npy",
            "time step 1.0 must be above 0 and at most 0.166667",
        ),
        ("--gaussian 1 -o out.tif", "out.tif is no volume file that can be written; it ends in .nrrd or"),
        ("--gaussian 1 -o blob.npy", "--output blob.npy is also the input blob.npy"),
        ("--gaussian 1 -o absent/out.npy", "the folder absent does not exist"),
        ("--gaussian 1", "the following arguments are required: -o/--output"),
    ],
)
def test_wrong_words_are_refused_in_one_line(run: Run, folder: Path, words: str, message: str) -> None:
    before = {path.name: path.read_bytes() for path in folder.iterdir()}
    outcome = run(f"filter blob.npy {words}")
    assert (outcome.status, outcome.out) == (2, "")
    assert message in outcome.err
    assert outcome.err.count("\n") == 1
    assert {path.name: path.read_bytes() for path in folder.iterdir()} == before


def test_samples_that_are_not_finite_are_refused(run: Run) -> None:
    samples = blob()
    samples[0, 0, 0] = np.nan
    np.save("hole.npy", samples)
    outcome = run("filter hole.npy --anisotropic-diffusion -o out.npy")
    assert outcome.status == 2
    assert "hole.npy has 1 NaN and 0 infinite samples" in outcome.err


def test_a_missing_simpleitk_is_told_before_the_long_work(
    run: Run, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "SimpleITK", None)
    outcome = run("filter blob.npy --anisotropic-diffusion -o out.nrrd")
    assert outcome.status == 2
    assert (
        'writing out.nrrd needs SimpleITK, which is not installed: pip install "isosample[medical]"'
        in outcome.err
    )
    assert run("filter blob.npy --anisotropic-diffusion -o out.npy").status == 0
    assert not (folder / "out.nrrd").exists()

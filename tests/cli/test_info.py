"""`info` tells what is in the file, as text, as JSON, and as a plan; all of it plain where nobody watches."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest

from cli.harness import TF, Run, blob, content, write_json
from isosample.transfer.isovalues import plan_isovalues
from isosample.transfer.transfer_function import TransferFunction
from isosample.volume.grid import Volume

if TYPE_CHECKING:
    from isosample.volume.grid import SampleArray

META_HEADER = """\
ObjectType = Image
NDims = 3
BinaryData = True
BinaryDataByteOrderMSB = False
TransformMatrix = 0 1 0 -1 0 0 0 0 1
Offset = 5 -6 7
ElementSpacing = 0.5 1 2
DimSize = 10 9 8
ElementType = MET_FLOAT
ElementDataFile = LOCAL
"""


def write_turned() -> None:
    """blob.npy as turned.mha: a quarter turn about z, away from the origin, with three spacings."""
    Path("turned.mha").write_bytes(META_HEADER.encode() + blob().tobytes())


def test_text_tells_size_type_placement_and_values(run: Run) -> None:
    outcome = run("info blob.npy")
    assert outcome.status == 0
    assert outcome.err == ""
    fields = outcome.fields()
    assert fields["name"] == "blob.npy"
    assert fields["size (x, y, z)"] == "10 x 9 x 8"
    assert fields["samples"] == "float32, 720, 2.8 KiB"
    assert fields["box"] == "0, 0, 0 to 9, 8, 7"
    low, high = (float(number) for number in fields["values"].split(" to "))
    assert (low, high) == pytest.approx((blob().min(), blob().max()), rel=1e-8)  # nine digits are shown
    assert fields["NaN, infinite"] == "0, 0"


def test_text_has_a_histogram_of_sixteen_ranges(run: Run) -> None:
    lines = run("info blob.npy").out.splitlines()[10:]
    assert lines[0].split("  ")[0] == "values from"
    rows = [line.split() for line in lines[1:]]
    edges = np.linspace(blob().min(), blob().max(), 17)
    assert [float(row[0]) for row in rows] == pytest.approx(edges[:-1], rel=1e-5)  # six digits are shown
    assert [float(row[1]) for row in rows] == pytest.approx(edges[1:], rel=1e-5)
    assert [int(row[2]) for row in rows] == np.histogram(blob(), edges)[0].tolist()


@pytest.mark.parametrize(
    ("samples", "bins"),
    [
        (blob(), 256),
        (np.arange(1000, dtype=np.int16).reshape(10, 10, 10), 250),  # four whole values in each
        (np.full((2, 3, 4), 7, np.uint8), 1),
    ],
    ids=["float", "integer", "constant"],
)
def test_json_has_a_histogram_of_all_samples(run: Run, samples: SampleArray, bins: int) -> None:
    np.save("any.npy", samples)
    found = json.loads(run("info any.npy --json").out)["histogram"]
    assert len(found["counts"]) == bins
    assert found["counts"] == np.histogram(samples, found["edges"])[0].tolist()
    assert sum(found["counts"]) == samples.size


def test_json_has_every_number_exactly(run: Run) -> None:
    samples = blob()
    samples[0, 0, :3] = [np.nan, np.inf, -np.inf]
    np.save("holed.npy", samples)
    found = json.loads(run("info holed.npy --json --spacing 0.5,1,2").out)
    finite = samples[np.isfinite(samples)]
    assert found["size_xyz"] == [10, 9, 8]
    assert found["dtype"] == "float32"
    assert found["bytes"] == samples.nbytes
    assert found["spacing"] == [0.5, 1.0, 2.0]
    assert found["value_range"] == [float(finite.min()), float(finite.max())]
    assert (found["nan_count"], found["infinity_count"]) == (1, 2)
    assert np.ptp(found["box_corners"], axis=0).tolist() == [4.5, 8.0, 14.0]
    assert "plan" not in found


def test_a_volume_without_a_finite_sample_is_described_all_the_same(run: Run) -> None:
    np.save("nan.npy", np.full((3, 4, 5), np.nan))
    outcome = run("info nan.npy")
    assert outcome.fields()["values"] == "none is finite"
    assert "values from" not in outcome.out
    found = json.loads(run("info nan.npy --json").out)
    assert (found["value_range"], found["histogram"]) == (None, None)


def test_headerless_samples_are_read_by_shape_and_type(run: Run) -> None:
    np.arange(24, dtype=">u2").tofile("a.raw")
    found = json.loads(run("info a.raw --shape 2,3,4 --dtype >u2 --json").out)
    assert found["size_xyz"] == [2, 3, 4]
    assert found["value_range"] == [0, 23]


def test_frame_index_drops_origin_and_direction_and_keeps_spacing(run: Run) -> None:
    pytest.importorskip("SimpleITK")
    write_turned()
    world = json.loads(run("info turned.mha --json").out)
    assert world["origin"] == [5, -6, 7]
    assert world["direction"] != np.eye(3).tolist()
    assert json.loads(run("info turned.mha --frame world --json").out) == world
    index = json.loads(run("info turned.mha --frame index --json").out)
    assert index["origin"] == [0, 0, 0]
    assert index["direction"] == np.eye(3).tolist()
    assert index["spacing"] == world["spacing"] == [0.5, 1, 2]
    assert index["value_range"] == world["value_range"]


@pytest.mark.parametrize(("option", "per_slope"), [("", 5), ("--per-slope 2", 2), ("--per-slope 0", 0)])
def test_the_plan_is_that_of_the_library(run: Run, option: str, per_slope: int) -> None:
    low, high = float(blob().min()), float(blob().max())
    expected = plan_isovalues(TransferFunction.from_dict(TF), (low, high), per_slope=per_slope)
    outcome = run(f"info blob.npy --tf tf.json --plan {option}")
    text = outcome.out.splitlines()
    start = next(number for number, line in enumerate(text) if " isovalues in the range" in line)
    title, heading, *lines, left_out = text[start:]
    assert title.startswith(f"{len(expected.isovalues)} isovalues in the range")
    assert heading.split()[:3] == ["level", "isovalue", "reason"]
    assert [line.split()[:2] for line in lines] == [
        [str(level), f"{value:.9g}"] for level, value in enumerate(expected.isovalues)
    ]
    assert left_out.startswith("left out: ")
    found = json.loads(run(f"info blob.npy --tf tf.json --plan --json {option}").out)["plan"]
    assert found == expected.to_dict()


@pytest.mark.parametrize("option", ["--plan", "--plan --json", "--histogram out.png"])
def test_a_transfer_function_beyond_the_range_is_told(run: Run, option: str) -> None:
    ends = [{"value": value, "color": [1, 1, 1], "extinction": 1} for value in (200, 300)]
    write_json(Path("beyond.json"), {"points": ends})
    outcome = run(f"info blob.npy --tf beyond.json {option}")
    assert outcome.status == 0
    assert "nothing is visible" in outcome.err
    assert "its visible part is 200 to 300" in outcome.err
    assert run(f"info blob.npy --tf tf.json {option}").err == ""


def test_a_plan_without_a_transfer_function_says_that_one_is_suggested(run: Run) -> None:
    outcome = run("info blob.npy --plan")
    assert outcome.status == 0
    assert outcome.err == (
        "isosample: note: no --tf is given; using a transfer function suggested from the histogram\n"
    )
    assert " isovalues in the range " in outcome.out


def test_the_histogram_is_a_picture(run: Run) -> None:
    pytest.importorskip("matplotlib")
    from PIL import Image

    outcome = run("info blob.npy --tf tf.json --plan --histogram out.png")
    assert outcome.status == 0, outcome.err
    with Image.open("out.png") as picture:
        assert min(picture.size) > 100


def test_the_isovalues_of_a_plot_are_as_many_as_are_asked_for(run: Run, folder: Path) -> None:
    pytest.importorskip("matplotlib")
    plots = []
    for options in ("", "--per-slope 1", "--per-slope 9"):
        outcome = run(f"info blob.npy --tf tf.json --histogram out.png {options}")
        assert outcome.status == 0, outcome.err
        plots.append((folder / "out.png").read_bytes())
    assert len(set(plots)) == 3


def test_the_files_that_are_written_are_told(run: Run, folder: Path) -> None:
    pytest.importorskip("matplotlib")
    outcome = run("info blob.npy --suggest begin.json --histogram plot.png")
    assert outcome.fields()["suggested transfer function"] == "begin.json"
    assert outcome.fields()["plot of the histogram"] == "plot.png"
    assert (folder / "plot.png").stat().st_size > 0
    assert "suggested" not in run("info blob.npy").out


def test_a_suggested_transfer_function_is_written_and_is_the_one_that_is_rendered(
    run: Run, folder: Path
) -> None:
    outcome = run("info blob.npy --suggest begin.json --plan --json")
    assert (outcome.status, outcome.err) == (0, "")
    suggested = TransferFunction.suggest(Volume(blob()))
    assert TransferFunction.load(folder / "begin.json") == suggested
    assert "bytes" in json.loads(outcome.out)
    assert json.loads(outcome.out)["plan"] == json.loads(run("info blob.npy --plan --json").out)["plan"]


@pytest.mark.parametrize(
    ("options", "named"),
    [
        ("--suggest begin.png", "begin.png ends in .png; a transfer function ends in .json"),
        ("--suggest begin.json --tf tf.json", "leave out one of them"),
        ("--suggest blob.npy", "blob.npy ends in .npy"),
        ("--suggest absent/begin.json", "the folder absent does not exist"),
    ],
)
def test_a_suggestion_that_has_no_place_is_refused(run: Run, folder: Path, options: str, named: str) -> None:
    before = content(folder)
    outcome = run(f"info blob.npy {options}")
    assert (outcome.status, outcome.out) == (2, "")
    assert named in outcome.err
    assert content(folder) == before


def test_a_plot_that_cannot_be_made_is_told_before_the_volume_is_opened(
    run: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    outcome = run("info absent.npy --histogram out.png")
    assert (outcome.status, outcome.out) == (2, "")
    assert "isosample[plot]" in outcome.err

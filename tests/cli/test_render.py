"""`render` leaves its files whole, and tells what they show, what they cost and where they may be off."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import NoReturn

import numpy as np
import pytest

import isosample
from cli.harness import Run, blob, write_json
from cli.rendered import EXTINCTION, RENDER, ROUNDING, opacity_after, pixels, write_slab
from isosample.cli.methods import METHODS
from isosample.cli.summary import say_flaws
from isosample.errors import InputError
from isosample.rendering.reference_image import render_reference
from isosample.wording import percentage, thousands

pytestmark = pytest.mark.usefixtures("gl")

BEYOND = {"points": [{"value": value, "color": [1, 1, 1], "extinction": 1} for value in (200, 300)]}


def test_a_png_is_the_picture_in_srgb(run: Run) -> None:
    import PIL.Image

    assert run(f"{RENDER} --background 0.5,0.25,0 -o out.PNG").status == 0
    assert run(f"{RENDER} --background 0.5,0.25,0 -o out.npy").status == 0
    with PIL.Image.open("out.PNG") as picture:
        assert picture.size == (24, 16)
        assert picture.mode == "RGBA"
        found = np.asarray(picture)
    # IEC 61966-2-1: 0.5 -> 0.7354, 0.25 -> 0.5371, of 255
    assert found[0, 0].tolist() == [188, 137, 0, 255]
    np.testing.assert_array_equal(found, isosample.Image(pixels()).srgb8())


def test_the_summary_says_where_the_picture_is_and_that_nothing_was_lost(run: Run) -> None:
    outcome = run(f"{RENDER} -o out.png")
    fields = outcome.fields()
    assert list(fields) == ["picture", "isovalues", "triangles", "fragments", "seconds"]
    assert fields["picture"] == "out.png (24 x 16 pixels)"
    assert fields["isovalues"] == "13"
    assert fields["fragments"].endswith("lost 0)")


def test_the_summary_tells_segments_that_were_cut(run: Run) -> None:
    write_slab()
    Path("dense.json").write_text(Path("white.json").read_text().replace(f"{EXTINCTION}", "40.0"))
    render = "render slab.npy --tf dense.json --size 16x16 --segment constant -o out.npy"
    assert "above 1" not in run(render).out
    cut = run(f"{render} --segment-opacity first-order --stats stats.json")
    count = json.loads(Path("stats.json").read_text())["saturated_segments"]
    assert count > 0
    assert f"{thousands(count)} segments with an opacity above 1" in cut.out


@pytest.mark.parametrize("refined", [False, True])
@pytest.mark.parametrize(
    ("pixels", "guessed", "named"),
    [
        # 1000 x 1000 pixels: a thousandth of them is what errors and tolerances leave out.
        (1000, 1, ()),
        (1001, 0, ("0.1 % of the pixels may be visibly off",)),
        (82_000, 9000, ("8.2 % of the pixels", "in 9 000 pixels by a guess", "--strict")),
    ],
)
def test_repaired_crossings_are_told_in_one_line_with_cures_where_they_are_many(
    capfd: pytest.CaptureFixture[str], pixels: int, guessed: int, named: tuple[str, ...], refined: bool
) -> None:
    stats = {"band_violations": 123_456, "repaired_pixels": pixels, "unrepaired_pixels": guessed}
    say_flaws(stats, 1000 * 1000, refined=refined)
    told = capfd.readouterr().out
    assert len(told.splitlines()) == bool(named)
    for part in named and (*named, "isosample filter", "--method pre-integrated"):
        assert part in told
    assert ("--refine" in told) == (bool(named) and not refined)
    assert ("guess" in told) == (bool(named) and guessed > 0)


def test_a_noisy_volume_says_how_much_of_its_picture_is_repaired(run: Run) -> None:
    noise = np.random.default_rng(3).random((12, 12, 12)).astype(np.float32) * 100.0
    np.save("noise.npy", noise)
    for film in ("", "--turntable 2"):
        for refine in ("", "--refine auto"):
            render = f"render noise.npy --tf tf.json --size 40x40 {film} {refine}"
            outcome = run(f"{render} --stats stats.json -o out.npy")
            assert outcome.status == 0, outcome.err
            stats = json.loads(Path("stats.json").read_text(encoding="utf-8"))
            assert 0 < stats["unrepaired_pixels"] <= stats["repaired_pixels"] <= stats["band_violations"]
            share = stats["repaired_pixels"] / (1600 * (2 if film else 1))
            (told,) = (line for line in outcome.out.splitlines() if "visibly off" in line)
            assert f"{percentage(share)} of the pixels" in told
            assert ("--refine" in told) == (not refine)  # what was done is no advice


def test_the_reference_is_that_of_the_library_and_close_to_the_picture(run: Run) -> None:
    write_slab()
    slab = "render slab.npy --tf white.json --size 16x16 --clip -1,0,0,4"
    outcome = run(f"{slab} --method reference --stats stats.json -o reference.npy")
    assert outcome.status == 0, outcome.err
    assert "float64 reference" in outcome.fields()["picture"]
    stats = json.loads(Path("stats.json").read_text(encoding="utf-8"))
    assert (stats["method"], stats["source"]) == ("reference", "slab.npy")
    assert run(f"{slab} -o out.npy").status == 0
    # A constant medium is exact in both: what is left is the picture's float32.
    np.testing.assert_allclose(pixels(), pixels("reference.npy"), rtol=0, atol=ROUNDING)
    assert pixels()[8, 6, 3] == pytest.approx(opacity_after(7), abs=ROUNDING)


def test_the_lit_reference_is_that_of_the_library(run: Run) -> None:
    scene = "render blob.npy --tf tf.json --size 16x16 --method reference"
    assert run(f"{scene} --shading -o lit.npy").status == 0
    assert run(f"{scene} --shading --turntable 2 -o film.npy").status == 0
    assert run(f"{scene} -o plain.npy").status == 0
    volume, tf = isosample.open_volume("blob.npy"), isosample.TransferFunction.load("tf.json")
    settings = isosample.RenderSettings(material=isosample.Material())
    exact = render_reference(
        volume, tf, camera=isosample.Camera.orbit(volume.box), size=(16, 16), settings=settings
    ).rgba
    np.testing.assert_array_equal(pixels("lit.npy"), exact)
    np.testing.assert_array_equal(np.load(min(Path().glob("film*.npy"))), exact)
    assert np.abs(pixels("plain.npy") - exact).max() > 0.05


def test_statistics_hold_what_the_contract_names(run: Run) -> None:
    assert run(f"{RENDER} --stats stats.json -o out.png").status == 0
    stats = json.loads(Path("stats.json").read_text(encoding="utf-8"))
    assert stats["method"] == "data-centric"
    assert stats["size"] == [24, 16]
    assert stats["isovalues"] == [20, 25, 30, 35, 40, 45, 50, 55, 60, 65, 70, 75, 80]
    assert stats["triangles"]["extracted"] >= stats["triangles"]["drawn"] > 0
    assert stats["samples_per_ray"]["mean"] == stats["fragments"] / (24 * 16)
    assert stats["samples_per_ray"]["max"] == stats["max_depth_complexity"] > 1
    assert stats["lost_fragments"] == 0
    assert stats["renderer"]
    assert {"plan", "extract", "build", "resolve"} <= stats["seconds"].keys()
    assert all(seconds >= 0 for seconds in stats["seconds"].values())
    assert "rays_ended_early" in stats["skipped"]
    assert (stats["source"], stats["transfer_function"]) == ("blob.npy", "tf.json")


def test_plan_prints_the_isovalues_of_the_picture(run: Run) -> None:
    outcome = run(f"{RENDER} --plan -o out.png")
    assert outcome.out.startswith("13 isovalues in the range ")
    assert "picture " in outcome.out


def test_without_a_transfer_function_one_is_suggested_and_said(run: Run) -> None:
    outcome = run("render blob.npy --size 16x16 -o out.npy")
    assert outcome.status == 0
    assert outcome.err.splitlines() == [
        "isosample: note: no --tf is given; using a transfer function suggested from the histogram"
    ]
    expected = isosample.render(isosample.Volume(blob()), size=(16, 16)).rgba
    assert expected[..., 3].max() > 0.1
    np.testing.assert_array_equal(pixels(), expected)


@pytest.mark.parametrize(
    ("command", "work"),
    [
        ("render blob.npy -o out.npy", "preparation.prepare_surfaces"),
        ("precompute blob.npy --cache meshes", "preparation.prepare_surfaces"),
        ("precompute blob.npy --memory 1GiB --cache meshes", "stored_preparation.prepare_stored_surfaces"),
        ("render blob.npy --method pre-integrated -o out.npy", "raycaster.RayCaster"),
        ("render blob.npy --method reference -o out.npy", "reference_image.ReferenceRenderer"),
    ],
)
def test_that_nothing_is_visible_is_told_before_the_work(
    run: Run, monkeypatch: pytest.MonkeyPatch, command: str, work: str
) -> None:
    def fail(*_: object, **__: object) -> NoReturn:
        raise InputError("the work begins.")

    write_json(Path("beyond.json"), BEYOND)
    monkeypatch.setattr(f"isosample.rendering.{work}", fail)
    first, last = run(f"{command} --tf beyond.json").err.splitlines()
    assert first.startswith("isosample: note: nothing is visible")
    assert last == "isosample: error: the work begins."


def test_a_cache_seen_by_a_transfer_function_beyond_its_range_says_so(run: Run) -> None:
    write_json(Path("beyond.json"), BEYOND)
    assert run("precompute blob.npy --tf tf.json --cache meshes").status == 0
    outcome = run("render meshes --tf beyond.json --size 16x16 -o out.npy")
    assert outcome.status == 0
    assert "its visible part is 200 to 300" in outcome.err
    assert not pixels().any()


@pytest.mark.parametrize("film", ["", "--turntable 2"])
@pytest.mark.parametrize("method", [*METHODS, "auto"])
def test_a_picture_of_nothing_is_empty_and_says_so(run: Run, method: str, film: str) -> None:
    write_json(Path("beyond.json"), BEYOND)
    outcome = run(f"render blob.npy --tf beyond.json --method {method} --size 16x16 {film} -o out.npy")
    assert outcome.status == 0
    low, high = float(blob().min()), float(blob().max())
    told = (
        f"nothing is visible: the transfer function has no extinction inside the volume's range, {low:g} to {high:g}; "
        "its visible part is 200 to 300"
    )
    assert outcome.err.splitlines() == [f"isosample: note: {told}"]
    assert "the picture is empty" not in outcome.out
    for name in ["out-000.npy", "out-001.npy"] if film else ["out.npy"]:
        assert not np.load(name).any()


@pytest.mark.parametrize("film", ["", "--turntable 2"])
@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(
    ("words", "why"),
    [
        (
            "--clip 1,0,0,-1e6",
            "the picture is empty, for everything is cut away: the clip planes leave nothing of",
        ),
        (
            "--camera away.json",
            "the picture is empty, for the volume's box, 0, 0, 0 to 9, 8, 7, is behind the eye",
        ),
    ],
)
def test_a_picture_that_clip_planes_or_the_view_make_empty_says_which(
    run: Run, method: str, film: str, words: str, why: str
) -> None:
    write_json(
        Path("away.json"),
        {"projection": "perspective", "eye": [4, 4, 40], "target": [4, 4, 80], "fov_y_degrees": 30},
    )
    outcome = run(f"{RENDER} {words} --background 1,0.3,0.7 --method {method} {film} -o out.npy")
    assert outcome.status == 0, outcome.err
    if film and "--camera" in words:  # a turn about the target: the volume is behind one of two eyes
        assert [line for line in outcome.out.splitlines() if f"1 of 2 frames, from frame 0 on: {why}" in line]
        return
    assert outcome.out.count(why) == 1
    if film:
        assert f"2 of 2 frames, from frame 0 on: {why}" in outcome.out


def test_what_only_a_spline_reaches_is_not_called_nothing(run: Run) -> None:
    """The cubic of samples 0, 1, 1, 0 rises to 9/8 between them, which is above all samples."""
    samples = np.zeros((4, 4, 4), dtype=np.float32)
    samples[:, :, 1:3] = 1.0
    np.save("ridge.npy", samples)
    ends = [{"value": value, "color": [1, 1, 1], "extinction": 9} for value in (1.05, 1.2)]
    write_json(Path("top.json"), {"points": ends})
    ridge = "render ridge.npy --tf top.json --size 16x16 --method pre-integrated -o out.npy"
    assert "nothing is visible" in run(ridge).err
    outcome = run(f"{ridge} --reconstruction cubic")
    assert outcome.err == ""
    assert pixels()[..., 3].max() > 0.1


def test_a_picture_takes_the_place_of_an_old_one_and_nothing_else_appears(run: Run, folder: Path) -> None:
    Path("out.npy").write_bytes(b"old")
    assert run(f"{RENDER} --stats out.json -o out.npy").status == 0
    assert pixels().shape == (16, 24, 4)
    assert pixels().dtype == np.float32
    assert sorted(path.name for path in folder.iterdir()) == ["blob.npy", "out.json", "out.npy", "tf.json"]


def test_one_pixel_is_a_picture(run: Run) -> None:
    assert run("render blob.npy --tf tf.json --size 1x1 -o out.npy").status == 0
    assert pixels().shape == (1, 1, 4)
    assert pixels()[0, 0, 3] > 0.5


def test_names_that_are_no_utf8_reach_the_statistics(run: Run) -> None:
    name = b"caf\xe9.npy".decode("utf-8", "surrogateescape")
    Path("blob.npy").rename(name)
    outcome = run("render", name, "--tf", "tf.json", "--size", "16x16", "-o", "out.npy", "--stats", "s.json")
    assert outcome.status == 0, outcome.err
    assert json.loads(Path("s.json").read_bytes())["source"] == name


@pytest.mark.parametrize("method", ["data-centric", "pre-integrated", "auto"])
def test_a_picture_that_the_driver_cannot_hold_is_refused_before_the_volume_is_looked_at(
    run: Run, monkeypatch: pytest.MonkeyPatch, method: str
) -> None:
    def refuse(*_: object, **__: object) -> None:
        raise AssertionError("the long work has begun")

    monkeypatch.setattr("isosample.cli.sources.transfer_function_of", refuse)
    outcome = run(f"render blob.npy --tf tf.json --size 999999x8 --method {method} -o out.png")
    assert outcome.status == 2
    assert "999999 x 8 pixels is larger than this driver's" in outcome.err


def test_an_error_map_that_cannot_be_made_is_told_before_the_work(
    run: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    outcome = run("render absent.npy --error-map errors.png -o out.png")
    assert outcome.status == 2
    assert "isosample[plot]" in outcome.err
    assert "absent.npy" in run("render absent.npy --error-map errors.npy -o out.png").err

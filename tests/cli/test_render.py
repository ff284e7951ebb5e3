"""`render` gives the library's picture: every option reaches it, and closed forms hold from end to end."""

from __future__ import annotations

import json
import math
import sys
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

import isosample
from cli.harness import Run, blob, write_json
from cli.test_info import write_turned
from isosample.cli import build_parser
from isosample.cli.methods import METHODS
from isosample.cli.render import settings_of
from isosample.cli.summary import say_flaws
from isosample.wording import percentage, thousands

pytestmark = pytest.mark.usefixtures("gl")

RENDER = "render blob.npy --tf tf.json --size 24x16"
EXTINCTION = 0.125
# Rounding of a constant medium: a few float32 operations on an optical depth below 2, where exp(-x) and its
# error are below 1; 16 roundings of 2**-24 are ample for the resolve pass of two crossings.
ROUNDING = 16 * 2.0**-24


def pixels(name: str = "out.npy") -> npt.NDArray[np.float32]:
    picture: npt.NDArray[np.float32] = np.load(name)
    return picture


def by_library(**options: Any) -> npt.NDArray[np.float32]:
    """The picture of blob.npy with tf.json, made without the command line."""
    camera = options.pop("camera", {})
    volume = isosample.Volume(blob())
    return isosample.render(
        volume,
        isosample.TransferFunction.load("tf.json"),
        size=(24, 16),
        **{name: options.pop(name) for name in ("per_slope", "refine", "reconstruction") if name in options},
        camera=isosample.Camera.orbit(volume.box, aspect=1.5, **camera),
        settings=isosample.RenderSettings(**options),
    ).rgba


def write_slab() -> None:
    """slab.npy: a ramp along x from 0 to 9 in a box of 9 x 8 x 7, and white.json: one extinction everywhere."""
    np.save("slab.npy", np.broadcast_to(np.arange(10, dtype=np.float32), (8, 9, 10)))
    ends = [{"value": value, "color": [1, 1, 1], "extinction": EXTINCTION} for value in (-1, 20)]
    write_json(Path("white.json"), {"points": ends})


def opacity_after(length: float) -> float:
    return -math.expm1(-EXTINCTION * length)


def column_x(width: int = 16) -> npt.NDArray[np.float64]:
    """x of every pixel column's centre in the default view of the slab, whose bounding sphere fits."""
    radius = math.sqrt(9**2 + 8**2 + 7**2) / 2
    centres: npt.NDArray[np.float64] = 4.5 + radius * (2 * (np.arange(width) + 0.5) / width - 1)
    return centres


SETTINGS: dict[str, dict[str, Any]] = {
    "": {},
    "--azimuth 30 --elevation -20 --zoom 1.5": {"camera": {"azimuth": 30.0, "elevation": -20.0, "zoom": 1.5}},
    "--up z --azimuth 30": {"camera": {"up_axis": isosample.UpAxis.Z, "azimuth": 30.0}},
    "--azimuth -30": {"camera": {"azimuth": -30.0}},
    "--projection perspective": {"camera": {"projection": isosample.Projection.PERSPECTIVE}},
    "--per-slope 1": {"per_slope": 1},
    "--segment linear": {"segment": isosample.SegmentRule.LINEAR},
    "--curved": {"curved": True},
    "--reconstruction cubic": {"reconstruction": isosample.Reconstruction.CUBIC},
    "--reconstruction catmull-rom": {"reconstruction": isosample.Reconstruction.CATMULL_ROM},
    "--reconstruction bspline --no-curved": {
        "reconstruction": isosample.Reconstruction.BSPLINE,
        "curved": False,
    },
    "--refine 2": {"refine": 2},
    "--segment constant": {"segment": isosample.SegmentRule.CONSTANT},
    "--segment constant --segment-opacity exponential": {"segment": isosample.SegmentRule.CONSTANT},
    "--segment constant --segment-opacity first-order": {
        "segment": isosample.SegmentRule.CONSTANT_FIRST_ORDER
    },
    "--shading": {"material": isosample.Material()},
    "--background 0.5,0.25,0": {"background": (0.5, 0.25, 0.0, 1.0)},
    "--background 0.5,0.25,0,0.5": {"background": (0.5, 0.25, 0.0, 0.5)},
    "--clip -1,0,0,4.25": {"clip_planes": (isosample.ClipPlane(-1.0, 0.0, 0.0, 4.25),)},
    "--clip=-1,0,0,4.25 --clip 0,1,0,-3": {
        "clip_planes": (isosample.ClipPlane(-1.0, 0.0, 0.0, 4.25), isosample.ClipPlane(0.0, 1.0, 0.0, -3.0))
    },
}


@pytest.mark.parametrize(("options", "expected"), SETTINGS.items(), ids=SETTINGS.keys())
def test_an_option_gives_the_bits_of_the_library_with_that_setting(
    run: Run, options: str, expected: dict[str, Any]
) -> None:
    outcome = run(f"{RENDER} {options} -o out.npy")
    assert outcome.status == 0, outcome.err
    assert outcome.err == ""
    np.testing.assert_array_equal(pixels(), by_library(**expected))


def test_every_setting_changes_the_picture(run: Run) -> None:
    same = {"--segment constant --segment-opacity exponential"}  # spells out what --segment constant means
    pictures = set()
    for options in SETTINGS.keys() - same:
        run(f"{RENDER} {options} -o out.npy")
        pictures.add(pixels().tobytes())
    assert len(pictures) == len(SETTINGS) - len(same)


def test_a_camera_file_gives_the_bits_of_the_same_orbit(run: Run) -> None:
    camera = isosample.Camera.orbit(isosample.Volume(blob()).box, azimuth=30, aspect=1.5)
    write_json(Path("camera.json"), camera.to_dict())
    assert run(f"{RENDER} --camera camera.json -o file.npy").status == 0
    assert run(f"{RENDER} --azimuth 30 -o orbit.npy").status == 0
    np.testing.assert_array_equal(pixels("file.npy"), pixels("orbit.npy"))


def test_an_upright_picture_fits_the_box_to_its_width(run: Run) -> None:
    assert run("render blob.npy --tf tf.json --size 16x24 -o out.npy").status == 0
    expected = isosample.render(
        isosample.Volume(blob()), isosample.TransferFunction.load("tf.json"), size=(16, 24)
    )
    np.testing.assert_array_equal(pixels(), expected.rgba)


@pytest.mark.parametrize("stage", ["auto", "fragment", "compute"])
def test_the_stage_reaches_the_settings(stage: str) -> None:
    args = build_parser().parse_args(["render", "blob.npy", "-o", "out.npy", "--stage", stage])
    assert settings_of(args).stage.value == stage


def test_both_stages_give_the_same_picture(run: Run) -> None:
    for stage in ("fragment", "compute"):
        assert run(f"{RENDER} --stage {stage} -o {stage}.npy").status == 0
    assert pixels("fragment.npy")[..., 3].max() > 0.5
    np.testing.assert_allclose(pixels("fragment.npy"), pixels("compute.npy"), rtol=0, atol=1e-5)


def test_a_slab_has_the_opacity_of_its_thickness(run: Run) -> None:
    write_slab()
    assert run("render slab.npy --tf white.json --size 16x16 -o out.npy").status == 0
    np.testing.assert_allclose(pixels()[8, 8], opacity_after(7), rtol=0, atol=ROUNDING)  # white: all four
    assert not pixels()[0].any()


def test_spacing_lengthens_the_way_through_a_raw_slab(run: Run) -> None:
    write_slab()
    Path("slab.raw").write_bytes(np.load("slab.npy").astype("u1").tobytes())
    read = "--shape 10,9,8 --dtype uint8"
    assert run(f"render slab.raw {read} --tf white.json --size 16x16 -o one.npy").status == 0
    assert run("render slab.npy --tf white.json --size 16x16 -o float.npy").status == 0
    np.testing.assert_allclose(pixels("one.npy"), pixels("float.npy"), rtol=0, atol=ROUNDING)
    assert run(f"render slab.raw {read} --spacing 1,1,2 --tf white.json --size 16x16 -o two.npy").status == 0
    np.testing.assert_allclose(pixels("two.npy")[8, 8], opacity_after(14), rtol=0, atol=ROUNDING)


@pytest.mark.parametrize("clip", ["--clip -1,0,0,4", "--clip=-1,0,0,4", "--clip -.25,0,0,1"])
def test_a_clip_plane_keeps_the_side_where_it_is_positive(run: Run, clip: str) -> None:
    write_slab()
    assert run(f"render slab.npy --tf white.json --size 16x16 {clip} -o out.npy").status == 0
    x = column_x()
    inside = (x >= 0) & (x <= 4)
    assert inside.any()
    expected = np.where(inside, opacity_after(7), 0.0)
    np.testing.assert_allclose(pixels()[8, :, 3], expected, rtol=0, atol=ROUNDING)


def test_clip_planes_across_the_view_thin_the_slab(run: Run) -> None:
    write_slab()
    clips = "--clip 0,0,-1,5.5 --clip 0,0,1,-2"  # 2 <= z <= 5.5
    assert run(f"render slab.npy --tf white.json --size 16x16 {clips} -o out.npy").status == 0
    np.testing.assert_allclose(pixels()[8, 8, 3], opacity_after(3.5), rtol=0, atol=ROUNDING)


def test_frame_index_gives_the_picture_of_the_bare_samples(run: Run) -> None:
    pytest.importorskip("SimpleITK")
    write_turned()
    view = "--tf tf.json --size 24x16 --azimuth 20 --up y"
    assert run(f"render turned.mha --frame index {view} -o index.npy").status == 0
    assert run(f"render blob.npy --spacing 0.5,1,2 {view} -o bare.npy").status == 0
    assert run(f"render turned.mha {view} -o world.npy").status == 0
    np.testing.assert_array_equal(pixels("index.npy"), pixels("bare.npy"))
    assert not np.array_equal(pixels("index.npy"), pixels("world.npy"))


@pytest.mark.parametrize("method", METHODS)
def test_scans_in_patient_axes_are_seen_from_the_front_head_up(run: Run, method: str) -> None:
    pytest.importorskip("SimpleITK")
    write_turned()
    view = f"--tf tf.json --size 24x16 --azimuth 20 --method {method}"
    pictures = {}
    for name, source, up in (
        ("default", "turned.mha", ""),
        ("z", "turned.mha", "--up z"),
        ("y", "turned.mha", "--up y"),
        ("index", "turned.mha --frame index", ""),
        ("index y", "turned.mha --frame index", "--up y"),
    ):
        assert run(f"render {source} {view} {up} -o out.npy").status == 0
        pictures[name] = pixels()
    np.testing.assert_array_equal(pictures["default"], pictures["z"])
    assert not np.array_equal(pictures["default"], pictures["y"])
    np.testing.assert_array_equal(pictures["index"], pictures["index y"])


def test_a_cache_and_a_film_of_a_scan_in_patient_axes_begin_at_its_front(run: Run) -> None:
    pytest.importorskip("SimpleITK")
    write_turned()
    assert run("render turned.mha --tf tf.json --size 24x16 -o volume.npy").status == 0
    assert run("precompute turned.mha --tf tf.json --cache turned_meshes").status == 0
    assert run("render turned_meshes --size 24x16 -o cache.npy").status == 0
    np.testing.assert_array_equal(pixels("cache.npy"), pixels("volume.npy"))
    assert run("render turned_meshes --size 24x16 --turntable 2 -o film.npy").status == 0
    np.testing.assert_array_equal(pixels("film-000.npy"), pixels("volume.npy"))
    volume = isosample.open_volume("turned.mha")
    image = isosample.render(volume, isosample.TransferFunction.load("tf.json"), size=(24, 16))
    np.testing.assert_array_equal(image.rgba, pixels("volume.npy"))


def test_time_and_channel_choose_the_samples(run: Run) -> None:
    np.save("movie.npy", np.stack([np.zeros_like(blob()), blob()]))
    np.save("parts.npy", np.stack([blob(), np.zeros_like(blob())], axis=-1))
    assert run(f"{RENDER} -o out.npy").status == 0
    view = "--tf tf.json --size 24x16"
    assert run(f"render movie.npy --time 1 {view} -o time.npy").status == 0
    assert run(f"render parts.npy --channel 0 {view} -o channel.npy").status == 0
    np.testing.assert_array_equal(pixels("time.npy"), pixels())
    np.testing.assert_array_equal(pixels("channel.npy"), pixels())


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


@pytest.mark.parametrize(
    ("pixels", "guessed", "named"),
    [
        # 1000 x 1000 pixels: a thousandth of them is what errors "of 99.9 % of the pixels" leave out.
        (16, 0, ("0.0016 % of the pixels", "may be slightly off there")),
        (1000, 1, ("0.1 % of the pixels", "1 pixel by a guess", "--strict", "may be slightly off there")),
        (
            1001,
            0,
            (
                "0.1 % of the pixels",
                "isosample filter",
                "--refine",
                "--tolerance",
                "--method auto",
                "visibly off",
            ),
        ),
        (82_000, 9000, ("8.2 % of the pixels", "9 000 pixels by a guess", "isosample filter")),
    ],
)
def test_repaired_crossings_are_told_with_their_share_of_the_picture_and_a_cure_where_it_is_large(
    capfd: pytest.CaptureFixture[str], pixels: int, guessed: int, named: tuple[str, ...]
) -> None:
    stats = {"band_violations": 123_456, "repaired_pixels": pixels, "unrepaired_pixels": guessed}
    say_flaws(stats, 1000 * 1000)
    told = capfd.readouterr().out
    for part in ("123 456 crossings", *named):
        assert part in told
    assert ("slightly" in told) != ("isosample filter" in told)
    assert ("guess" in told) == (guessed > 0)
    say_flaws(dict.fromkeys(stats, 0), 1000 * 1000)
    assert capfd.readouterr().out == ""


def test_a_noisy_volume_says_how_much_of_its_picture_is_repaired(run: Run) -> None:
    noise = np.random.default_rng(3).random((12, 12, 12)).astype(np.float32) * 100.0
    np.save("noise.npy", noise)
    for film in ("", "--turntable 2"):
        outcome = run(f"render noise.npy --tf tf.json --size 40x40 {film} --stats stats.json -o out.npy")
        assert outcome.status == 0, outcome.err
        stats = json.loads(Path("stats.json").read_text(encoding="utf-8"))
        assert 0 < stats["unrepaired_pixels"] <= stats["repaired_pixels"] <= stats["band_violations"]
        share = stats["repaired_pixels"] / (1600 * (2 if film else 1))
        assert f"on the rays of {percentage(share)} of the pixels" in outcome.out
        assert "isosample filter" in outcome.out


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


@pytest.mark.parametrize("film", ["", "--turntable 2"])
@pytest.mark.parametrize("method", [*METHODS, "auto"])
def test_a_picture_of_nothing_is_empty_and_says_so(run: Run, method: str, film: str) -> None:
    ends = [{"value": value, "color": [1, 1, 1], "extinction": 1} for value in (200, 300)]
    write_json(Path("beyond.json"), {"points": ends})
    outcome = run(f"render blob.npy --tf beyond.json --method {method} --size 16x16 {film} -o out.npy")
    assert outcome.status == 0
    low, high = float(blob().min()), float(blob().max())
    told = (
        f"nothing is visible: the transfer function has no extinction inside the volume's range, {low:g} to {high:g}; "
        "its visible part is 200 to 300"
    )
    assert outcome.out.splitlines().count(told) == 1
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


def test_a_mask_is_rendered_like_its_0_and_1(run: Run) -> None:
    mask = blob() > 40
    write_json(
        Path("mask.json"), {"points": [{"value": v, "color": [1, 0, 0], "extinction": 3 * v} for v in (0, 1)]}
    )
    pictures = []
    for name, samples in (("mask.npy", mask), ("ones.npy", mask.astype(np.uint8))):
        np.save(name, samples)
        assert run(f"render {name} --tf mask.json --size 24x16 -o out.npy").status == 0
        pictures.append(pixels())
    assert pictures[0][..., 3].max() > 0.5
    np.testing.assert_array_equal(pictures[0], pictures[1])


def test_what_only_a_spline_reaches_is_not_called_nothing(run: Run) -> None:
    """The cubic of samples 0, 1, 1, 0 rises to 9/8 between them, which is above all samples."""
    samples = np.zeros((4, 4, 4), dtype=np.float32)
    samples[:, :, 1:3] = 1.0
    np.save("ridge.npy", samples)
    ends = [{"value": value, "color": [1, 1, 1], "extinction": 9} for value in (1.05, 1.2)]
    write_json(Path("top.json"), {"points": ends})
    ridge = "render ridge.npy --tf top.json --size 16x16 --method pre-integrated -o out.npy"
    assert "nothing is visible" in run(ridge).out
    outcome = run(f"{ridge} --reconstruction cubic")
    assert "nothing is visible" not in outcome.out
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


def test_a_budget_of_meshes_on_the_gpu_makes_batches_and_changes_no_bit(run: Run, folder: Path) -> None:
    x, y, z = np.mgrid[-1:1:80j, -1:1:80j, -1:1:80j]  # several bricks
    np.save("large.npy", (100 * np.exp(-(x * x + y * y + z * z))).astype(np.float32))
    pictures, batches = [], []
    for more in ("", "--mesh-budget 2MiB"):
        words = f"render large.npy --tf tf.json --size 24x24 -o out.npy --stats stats.json {more}"
        outcome = run(words)
        assert outcome.status == 0, outcome.err
        pictures.append((folder / "out.npy").read_bytes())
        batches.append(json.loads((folder / "stats.json").read_text())["mesh_batches"])
    assert pictures[0] == pictures[1]
    assert batches[0] < batches[1]
    assert "64 KiB" in run("render large.npy --tf tf.json --size 24x24 -o out.npy --mesh-budget 1KiB").err


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

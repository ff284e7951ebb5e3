"""Every wrong input ends in one line that names it, exit status 2, and no file that was not there before."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest

from cli.harness import TF, Run, blob, content, write_json

Setup = Callable[[], object]


class Wrong(NamedTuple):
    """A command line, what its message must name, and the files that it needs beside the usual ones."""

    arguments: str
    named: tuple[str, ...]
    setup: Setup = lambda: None


def array(name: str, samples: Any, dtype: str = "f4") -> Setup:
    return lambda: np.save(name, np.asarray(samples, dtype))


def file(name: str, data: bytes) -> Setup:
    return lambda: Path(name).write_bytes(data)


def folder(name: str) -> Setup:
    return lambda: Path(name).mkdir()


def write_folder_with(name: str) -> None:
    """The folder `meshes` with one empty file in it."""
    path = Path("meshes", name)
    path.parent.mkdir(parents=True)
    path.touch()


def tf(**changes: object) -> Setup:
    return lambda: write_json(Path("bad.json"), TF | changes)


def tf_point(**changes: object) -> Setup:
    """A transfer function whose second point differs."""
    points: list[dict[str, object]] = [dict(point) for point in TF["points"]]
    points[1] |= changes
    return tf(points=points)


def camera(**changes: object) -> Setup:
    entries = {"projection": "orthographic", "eye": [0, 0, 9], "target": [0, 0, 0], "height": 9}
    return lambda: write_json(Path("camera.json"), entries | changes)


def rgb_tiff() -> None:
    import tifffile

    tifffile.imwrite("colour.tif", np.zeros((4, 5, 6, 3), np.uint8), photometric="rgb")


def part(pattern: str) -> Path:
    """The first file of the cache that fits a pattern."""
    return min(Path("meshes").glob(pattern))


def altered(name: str, old: bytes, new: bytes) -> Setup:
    """A cache with one file in which bytes of the same number differ."""

    def alter() -> None:
        path = part(name)
        before = path.read_bytes()
        assert old in before
        path.write_bytes(before.replace(old, new, 1))

    return alter


def cut(name: str) -> Setup:
    """A cache with one file that ends early."""

    def shorten() -> None:
        path = part(name)
        path.write_bytes(path.read_bytes()[:-40])

    return shorten


def removed(name: str) -> Setup:
    return lambda: part(name).unlink()


RENDER = "render blob.npy --tf tf.json --size 16x16 -o out.png"
HOLED = np.where(np.arange(720).reshape(8, 9, 10) == 300, np.nan, blob())
COMMAND_LINES = {
    "no command": Wrong("", ("COMMAND", "isosample --help")),
    "unknown command": Wrong("rendr blob.npy", ("'rendr'", "isosample --help")),
    "unknown option": Wrong(
        f"{RENDER} --sise 9x9", ("--sise", "did you mean --size", "isosample render --help")
    ),
    "option by another ending": Wrong(f"{RENDER} --shade", ("--shade", "did you mean --shading?")),
    "abbreviated option": Wrong(f"{RENDER} --elev 9", ("--elev", "did you mean --elevation")),
    "one word too many": Wrong(f"{RENDER} more.npy", ("more.npy",)),
    "no output": Wrong("render blob.npy", ("-o/--output",)),
    "no value": Wrong(f"{RENDER} --azimuth", ("--azimuth",)),
    "size of zero": Wrong(f"{RENDER} --size 0x16", ("'0x16'", "WxH")),
    "size without a height": Wrong(f"{RENDER} --size 800", ("'800'", "WxH")),
    "size that is negative": Wrong(f"{RENDER} --size -8x8", ("'-8x8'",)),
    "size beyond any picture": Wrong(f"{RENDER} --size 99999999x1", ("'99999999x1'",)),
    "clip of three numbers": Wrong(f"{RENDER} --clip 1,0,0", ("'1,0,0'", "NX,NY,NZ,D")),
    "clip without a direction": Wrong(f"{RENDER} --clip 0,0,0,5", ("'0,0,0,5'", "length 0")),
    "clip that is not finite": Wrong(f"{RENDER} --clip -1,0,0,inf", ("'-1,0,0,inf'", "finite")),
    "nine clip planes": Wrong(f"{RENDER} {'--clip 1,0,0,0 ' * 9}", ("9 clip planes", "at most 8")),
    "background above one": Wrong(f"{RENDER} --background 1,2,1", ("'1,2,1'", "between 0 and 1")),
    "background by name": Wrong(f"{RENDER} --background white", ("'white'", "R,G,B")),
    "unknown projection": Wrong(f"{RENDER} --projection isometric", ("'isometric'", "perspective")),
    "zoom of zero": Wrong(f"{RENDER} --zoom 0", ("'0'", "--zoom", "above 0")),
    "zoom beyond float32": Wrong(f"{RENDER} --zoom 1e9", ("'1e9'", "--zoom", "1e+06")),
    "normal that is too short": Wrong(f"{RENDER} --clip 1e-300,0,0,1", ("'1e-300,0,0,1'", "1e-100")),
    "normal that is too long": Wrong(f"{RENDER} --clip -1e300,0,0,1", ("'-1e300,0,0,1'", "1e+100")),
    "unknown axis": Wrong(f"{RENDER} --up x", ("'x'", "--up")),
    "isovalues of the reference": Wrong(f"{RENDER} --method reference --per-slope 0", ("--per-slope",)),
    "plan of the reference": Wrong(f"{RENDER} --method reference --plan", ("--plan", "reference")),
    "segments of the reference": Wrong(f"{RENDER} --method reference --segment constant", ("--segment",)),
    "stage of the reference": Wrong(f"{RENDER} --method reference --stage compute", ("--stage",)),
    "cache of the reference": Wrong(f"{RENDER} --method reference --cache meshes", ("--cache",)),
    "azimuth in words": Wrong(f"{RENDER} --azimuth north", ("'north'", "--azimuth")),
    "elevation that is not finite": Wrong(f"{RENDER} --elevation nan", ("'nan'", "--elevation")),
    "unknown segment": Wrong(f"{RENDER} --segment wavy", ("'wavy'", "linear")),
    "opacity of a linear segment": Wrong(
        f"{RENDER} --segment-opacity first-order", ("--segment-opacity first-order", "--segment constant")
    ),
    "unknown method": Wrong(f"{RENDER} --method splatting", ("'splatting'", "data-centric")),
    "unknown stage": Wrong(f"{RENDER} --stage vertex", ("'vertex'", "compute")),
    "unknown frame": Wrong(f"{RENDER} --frame screen", ("'screen'", "index")),
    "unknown treatment of NaN": Wrong(f"{RENDER} --nan zero", ("'zero'", "masked")),
    "negative number per slope": Wrong(f"{RENDER} --per-slope -2", ("'-2'", "--per-slope")),
    "number per slope in words": Wrong(f"{RENDER} --per-slope some", ("'some'", "--per-slope")),
    "number per slope without a plan": Wrong("info blob.npy --per-slope 3", ("--per-slope 3", "--plan")),
    "number per slope of a transfer function without a plan": Wrong(
        "info blob.npy --tf tf.json --per-slope 9", ("--per-slope 9", "not shown", "--plan")
    ),
    "number per slope of a bare histogram": Wrong(
        "info blob.npy --histogram h.png --per-slope 9", ("--per-slope 9", "--histogram with --tf")
    ),
    "light of a bare histogram": Wrong(
        "info blob.npy --histogram h.png --shading", ("--shading", "--histogram with --tf")
    ),
    "isovalue that is not finite": Wrong("export blob.npy --isovalue nan -o out.ply", ("'nan'",)),
    "no isovalue": Wrong("export blob.npy -o out.ply", ("--isovalue",)),
    "argument of doctor": Wrong("doctor now", ("'now'",)),
}
OUTPUTS = {
    "picture of unknown kind": Wrong(
        "render absent.npy -o out.jpg", ("out.jpg ends in .jpg", ".png or .npy")
    ),
    "picture without a suffix": Wrong("render absent.npy -o out", ("out has no suffix", ".png or .npy")),
    "picture that is a folder": Wrong(
        "render absent.npy -o out.png", ("out.png", "folder"), folder("out.png")
    ),
    "folder that is not there": Wrong("render absent.npy -o no/out.png", ("no/out.png", "does not exist")),
    "folder that is a file": Wrong("render absent.npy -o tf.json/out.png", ("tf.json", "not a folder")),
    "folder without permission": Wrong("render absent.npy -o /proc/out.png", ("/proc",)),
    "picture over the volume": Wrong("render blob.npy -o ../here/blob.npy", ("blob.npy", "input")),
    "picture over the volume by a link": Wrong(
        "render blob.npy -o link.npy", ("link.npy", "input"), lambda: Path("link.npy").symlink_to("blob.npy")
    ),
    "statistics over the transfer function": Wrong(f"{RENDER} --stats tf.json", ("tf.json", "input")),
    "statistics of unknown kind": Wrong("render absent.npy -o out.png --stats s.txt", ("s.txt", ".json")),
    "statistics nowhere": Wrong("render absent.npy -o out.png --stats no/s.json", ("no/s.json",)),
    "cache folder that is a file": Wrong("render absent.npy -o out.png --cache tf.json", ("tf.json",)),
    "cache folder without permission": Wrong("precompute absent.npy --cache /proc/meshes", ("/proc",)),
    "mesh of unknown kind": Wrong("export absent.npy --isovalue 5 -o out.fbx", ("out.fbx", ".glb")),
    "mesh nowhere": Wrong("export absent.npy --isovalue 5 -o no/out.ply", ("no/out.ply", "does not exist")),
    "plot of unknown kind": Wrong("info absent.npy --histogram out.jpg", ("out.jpg", ".png")),
    "name that is too long": Wrong(f"render absent.npy -o {'n' * 300}.png", ("nnn", "too long")),
}
VOLUMES = {
    "no file": Wrong("info absent.npy", ("absent.npy", "does not exist")),
    "no file to render": Wrong("render absent.npy -o out.png", ("absent.npy", "does not exist")),
    "empty file": Wrong("info empty.npy", ("empty.npy", "empty"), file("empty.npy", b"")),
    "folder without DICOM": Wrong("info scans", ("scans", "DICOM"), folder("scans")),
    "unknown kind": Wrong("info notes.txt", ("notes.txt", ".nrrd"), file("notes.txt", b"some words")),
    "incomplete .npy": Wrong("info cut.npy", ("cut.npy",), file("cut.npy", b"\x93NUMPY\1\0v\0{'descr'")),
    "raw without a shape": Wrong("info a.raw", ("a.raw", "--shape", "--dtype"), file("a.raw", bytes(64))),
    "raw without a type": Wrong("info a.raw --shape 4,4,4", ("a.raw", "--dtype"), file("a.raw", bytes(64))),
    "raw that is too short": Wrong(
        "info a.raw --shape 4,4,4 --dtype uint16", ("a.raw", "64 bytes", "128"), file("a.raw", bytes(64))
    ),
    "raw that is too long": Wrong(
        "info a.raw --shape 4,4,3 --dtype uint8", ("a.raw", "64 bytes", "48"), file("a.raw", bytes(64))
    ),
    "unknown type": Wrong(
        "info a.raw --shape 4,4,4 --dtype uint7", ("'uint7'", "uint8"), file("a.raw", bytes(64))
    ),
    "complex type": Wrong(
        "info a.raw --shape 4,4,4 --dtype complex64", ("'complex64'",), file("a.raw", bytes(512))
    ),
    "shape of two numbers": Wrong("info a.raw --shape 4,4 --dtype uint8", ("'4,4'", "X,Y,Z")),
    "shape with a zero": Wrong("info a.raw --shape 4,4,0 --dtype uint8", ("'4,4,0'", "above 0")),
    "shape of a file that has one": Wrong(
        "info blob.npy --shape 10,9,8 --dtype float32", ("blob.npy", "--shape")
    ),
    "spacing of zero": Wrong("info blob.npy --spacing 1,0,1", ("'1,0,1'", "above 0")),
    "negative spacing": Wrong("info blob.npy --spacing -1,1,1", ("'-1,1,1'", "above 0")),
    "four axes": Wrong("info movie.npy", ("movie.npy", "--time"), array("movie.npy", np.zeros((2, 3, 4, 5)))),
    "time beyond the last": Wrong(
        "info movie.npy --time 2", ("movie.npy", "--time 2"), array("movie.npy", np.zeros((2, 3, 4, 5)))
    ),
    "channel of one": Wrong("info blob.npy --channel 1", ("blob.npy", "--channel 1")),
    "negative channel": Wrong("info blob.npy --channel -1", ("'-1'", "--channel")),
    "colours": Wrong("info colour.tif", ("colour.tif", "--channel"), rgb_tiff),
    "two axes": Wrong("info flat.npy", ("flat.npy", "(4, 5)"), array("flat.npy", np.zeros((4, 5)))),
    "text": Wrong("info words.npy", ("words.npy",), array("words.npy", [[["a"]]], "U1")),
    "one voxel thick": Wrong(
        "precompute thin.npy --tf tf.json", ("thin.npy", "1"), array("thin.npy", np.zeros((1, 5, 6)))
    ),
    "constant without a transfer function": Wrong(
        "precompute same.npy", ("same.npy", "constant", "--tf"), array("same.npy", np.full((4, 5, 6), 7))
    ),
    "NaN": Wrong(
        "precompute holed.npy --tf tf.json", ("holed.npy", "1 ", "NaN", "--nan"), array("holed.npy", HOLED)
    ),
    "nothing but NaN": Wrong(
        "precompute nan.npy --nan masked", ("nan.npy",), array("nan.npy", np.full((4, 5, 6), np.nan))
    ),
    "isovalue beyond the range": Wrong(
        "export blob.npy --isovalue 200 -o out.ply",
        ("200", "out.ply", "the values of blob.npy go from 0.247875 to 93.6592"),
    ),
    "mesh cache as a volume": Wrong(
        "info meshes", ("meshes", "mesh cache"), lambda: write_folder_with("scene.json")
    ),
    "surfaces of a mesh cache as a volume": Wrong(
        "info meshes", ("meshes", "mesh cache"), lambda: write_folder_with("surfaces/1f3a.npz")
    ),
    "DICOM folder that has none, but a folder of surfaces": Wrong(
        "info meshes", ("meshes", "DICOM"), lambda: write_folder_with("surfaces/skull.ply")
    ),
}
TRANSFER_FUNCTIONS = {
    "no file": Wrong("info blob.npy --tf absent.json", ("absent.json",)),
    "a folder": Wrong("info blob.npy --tf scans", ("scans",), folder("scans")),
    "no text": Wrong("info blob.npy --tf blob.npy", ("blob.npy", "JSON")),
    "broken JSON": Wrong(
        "info blob.npy --tf bad.json", ("bad.json", "line 2"), file("bad.json", b'{"points":\n[}')
    ),
    "number that is not finite": Wrong(
        "info blob.npy --tf bad.json", ("bad.json", "NaN"), tf_point(value=np.nan)
    ),
    "descending values": Wrong(
        "info blob.npy --tf bad.json", ("bad.json", "points[2]", "80"), tf_point(value=90)
    ),
    "negative extinction": Wrong(
        "info blob.npy --tf bad.json", ("bad.json", "points[1]", "-0.5"), tf_point(extinction=-0.5)
    ),
    "unknown key": Wrong(
        "info blob.npy --tf bad.json", ("bad.json", "points[1]", "'alpha'"), tf_point(alpha=1)
    ),
    "unknown part": Wrong("info blob.npy --tf bad.json", ("bad.json", "'pionts'"), tf(pionts=[])),
    "an older file of 3D Slicer": Wrong(
        "render blob.npy --tf lung.vp -o out.png",
        ("lung.vp is a volume property of 3D Slicer in its older form", "as .vp.json"),
        lambda: Path("lung.vp").write_text("1\n1\n0.2\n8 0 0 1 1\n"),
    ),
    "colour above one": Wrong(
        "info blob.npy --tf bad.json", ("bad.json", "points[1]", "255"), tf_point(color=[0, 255, 0])
    ),
    "opacity without a distance": Wrong(
        "info blob.npy --tf bad.json",
        ("bad.json", "points[0]", "unit_distance"),
        tf(points=[{"value": 1, "color": [1, 1, 1], "opacity": 0.5}]),
    ),
    "opacity of nothing": Wrong(
        "info blob.npy --tf bad.json",
        ("bad.json", "isosurfaces[0]", "opacity 0"),
        tf(isosurfaces=[{"value": 1, "color": [1, 1, 1], "opacity": 0}]),
    ),
}
CAMERAS = {
    "no file": Wrong(f"{RENDER} --camera absent.json", ("absent.json",)),
    "no JSON": Wrong(f"{RENDER} --camera blob.npy", ("blob.npy", "JSON")),
    "no camera": Wrong(f"{RENDER} --camera tf.json", ("tf.json", "eye")),
    "eye at its target": Wrong(
        f"{RENDER} --camera camera.json", ("camera.json", "(0.0, 0.0, 9.0)"), camera(target=[0, 0, 9])
    ),
    "up along the view": Wrong(
        f"{RENDER} --camera camera.json", ("camera.json", "up", "parallel"), camera(up=[0, 0, 1])
    ),
    "size of the other projection": Wrong(
        f"{RENDER} --camera camera.json", ("camera.json", "fov_y_degrees 30"), camera(fov_y_degrees=30)
    ),
    "unknown projection": Wrong(
        f"{RENDER} --camera camera.json", ("camera.json", "'fisheye'"), camera(projection="fisheye")
    ),
    "placed twice": Wrong(
        f"{RENDER} --camera camera.json --azimuth 5", ("--azimuth", "camera.json"), camera()
    ),
}
CACHES = {
    "a volume's option": Wrong(
        "export meshes --isovalue 50 --spacing 1,1,1 -o out.ply", ("--spacing", "meshes")
    ),
    "a cache of a cache": Wrong("render meshes --cache more -o out.png", ("--cache", "meshes")),
    "a reference without the volume": Wrong(
        "render meshes --method reference -o out.png",
        ("meshes", "cache", "--method reference", "name the volume"),
    ),
    "as a volume": Wrong("precompute meshes --cache more", ("meshes", "cache")),
    "an isovalue that is not there": Wrong(
        "export meshes --isovalue 51 -o out.ply", ("meshes", "51.0", "50.0, 55.0")
    ),
    "no volume.json": Wrong(
        "export meshes --isovalue 50 -o out.ply", ("meshes", "volume.json"), removed("volume.json")
    ),
    "another version": Wrong(
        "export meshes --isovalue 50 -o out.ply",
        ("volume.json", "version 7"),
        altered("volume.json", b'"version": 3', b'"version": 7'),
    ),
    "an altered volume.json": Wrong(
        "export meshes --isovalue 50 -o out.ply",
        ("volume.json", "damaged"),
        altered("volume.json", b"blob", b"blub"),
    ),
    "an incomplete scene.json": Wrong(
        "export meshes --isovalue 50 -o out.ply", ("scene.json", "cannot be read"), cut("scene.json")
    ),
    "an incomplete boundary": Wrong(
        "export meshes --isovalue 50 -o out.ply", ("boundary.npz", "damaged"), cut("boundary.npz")
    ),
    "another volume": Wrong(
        "precompute other.npy --tf tf.json --cache meshes",
        ("meshes", "another volume"),
        array("other.npy", blob()[::-1] + 1),
    ),
}
PICTURES_OF_CACHES = {
    "a surface that is missing": Wrong(
        "render meshes -o out.png", ("meshes", "no isosurface", "isosample precompute"), removed("surfaces/*")
    ),
    "a surface that is incomplete": Wrong(
        "render meshes -o out.png", ("surfaces/", "damaged"), cut("surfaces/*")
    ),
    "a chunk that is missing": Wrong(
        "render meshes -o out.png", (".chunk is missing", "isosample precompute"), removed("chunks/*/*")
    ),
    "a chunk that is incomplete": Wrong(
        "render meshes -o out.png", (".chunk is damaged", "isosample precompute"), cut("chunks/*/*")
    ),
    "no scene.json": Wrong("render meshes -o out.png", ("scene.json", "not finished"), removed("scene.json")),
    "isovalues that are not there": Wrong(
        "render meshes --tf bad.json -o out.png", ("meshes", str(20 + 32.5 / 6)), tf_point(value=52.5)
    ),
    "masked surfaces that are not there": Wrong(
        "render meshes --nan masked -o out.png", ("meshes", "no isosurface", "for these settings")
    ),
    "a denser plan": Wrong("render meshes --per-slope 6 -o out.png", ("meshes", str(20 + 30 / 7))),
}
PICTURES_OF_VOLUMES = {
    "one voxel thick": Wrong(
        "render thin.npy -o out.png", ("thin.npy", "1"), array("thin.npy", np.zeros((1, 5, 6)))
    ),
    "constant": Wrong(
        "render same.npy -o out.png", ("same.npy", "constant"), array("same.npy", np.full((4, 5, 6), 7))
    ),
    "NaN": Wrong("render holed.npy -o out.png", ("holed.npy", "NaN", "--nan"), array("holed.npy", HOLED)),
    "infinite": Wrong(
        "render holed.npy -o out.png",
        ("holed.npy", "infin", "--nan"),
        array("holed.npy", np.where(np.isnan(HOLED), np.inf, HOLED)),
    ),
    "folder of the demo that is a file": Wrong("demo -o tf.json", ("tf.json", "folder")),
    "folder of the studies that is a file": Wrong("verify -o tf.json", ("tf.json", "folder")),
    "picture beyond the driver": Wrong(
        "render blob.npy --tf tf.json --size 1000000x1 -o out.png", ("1000000 x 1",)
    ),
    "another volume's cache": Wrong(
        "render blob.npy --spacing 1,1,2 --tf tf.json --cache meshes -o out.png",
        ("meshes", "another volume"),
        lambda: None,
    ),
}


def rows(table: dict[str, Wrong]) -> pytest.MarkDecorator:
    return pytest.mark.parametrize("wrong", table.values(), ids=table.keys())


def check_refusal(wrong: Wrong, run: Run, here: Path) -> None:
    """Run the command; it must name what is wrong in one line and leave the folder as it was."""
    wrong.setup()
    before = content(here)
    outcome = run(wrong.arguments)
    assert outcome.status == 2, outcome
    assert outcome.err.startswith("isosample: error: "), outcome.err
    assert outcome.err.count("\n") == 1, outcome.err
    assert outcome.err.endswith("\n")
    assert [word for word in wrong.named if word not in outcome.err] == [], outcome.err
    assert outcome.out == ""
    assert content(here) == before


@rows(COMMAND_LINES)
def test_a_wrong_command_line_is_named_in_one_line(wrong: Wrong, run: Run, folder: Path) -> None:
    check_refusal(wrong, run, folder)


@rows(OUTPUTS)
def test_an_output_that_cannot_be_written_is_named_before_any_input_is_read(
    wrong: Wrong, run: Run, folder: Path
) -> None:
    check_refusal(wrong, run, folder)


@rows(VOLUMES)
def test_a_wrong_volume_is_named_in_one_line(wrong: Wrong, run: Run, folder: Path) -> None:
    check_refusal(wrong, run, folder)


@rows(TRANSFER_FUNCTIONS)
def test_a_wrong_transfer_function_is_named_with_its_entry(wrong: Wrong, run: Run, folder: Path) -> None:
    check_refusal(wrong, run, folder)


@rows(CAMERAS)
def test_a_wrong_camera_is_named_in_one_line(wrong: Wrong, run: Run, folder: Path) -> None:
    check_refusal(wrong, run, folder)


@rows(CACHES)
@pytest.mark.usefixtures("cache")
def test_a_wrong_cache_folder_is_named_in_one_line(wrong: Wrong, run: Run, folder: Path) -> None:
    check_refusal(wrong, run, folder)


@rows(PICTURES_OF_CACHES | PICTURES_OF_VOLUMES)
@pytest.mark.usefixtures("gl", "cache")
def test_what_cannot_be_rendered_leaves_no_picture(wrong: Wrong, run: Run, folder: Path) -> None:
    check_refusal(wrong, run, folder)


def test_a_transfer_function_is_refused_before_the_volume_is_opened(run: Run) -> None:
    assert "absent.json" in run("render absent.npy --tf absent.json -o out.png").err
    assert "absent.json" in run("precompute absent.npy --tf absent.json").err
    assert "absent.json" in run("info absent.npy --tf absent.json").err


def test_debug_shows_where_an_error_came_from(run: Run) -> None:
    outcome = run("info absent.npy --debug")
    assert outcome.status == 2
    assert "Traceback (most recent call last)" in outcome.err
    assert outcome.err.splitlines()[-1].startswith("isosample: error: absent.npy")


def test_json_of_a_wrong_volume_is_no_half_document(run: Run) -> None:
    assert run("info absent.npy --json").out == ""
    assert json.loads(run("info blob.npy --json").out)["name"] == "blob.npy"

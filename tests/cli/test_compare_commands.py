"""The commands in a report draw its pictures again, bit for bit, whatever the comparison was asked for."""

from __future__ import annotations

import json
import shlex
from pathlib import Path
from typing import Any

import numpy as np
import PIL.Image
import pytest

import isosample
from cli.harness import TF, Run, write_json
from isosample.cli import build_parser
from isosample.cli.cameras import PLACING_OPTIONS
from isosample.cli.compare_commands import SHARED, render_command
from isosample.compare.false_color import shown

pytestmark = pytest.mark.usefixtures("gl")

COMPARE = "compare blob.npy --tf tf.json --size 16x12 --repeat 1 -o out"
SURFACE = {"value": 35, "color": [1, 1, 0], "opacity": 0.5}  # where weights of peaks tell
COMPARISONS = {
    "as it comes": "--steps 2,1/3 --per-slopes 1,3",
    "two cameras": "--steps 1 --tolerances 1/16 --cameras 2 --azimuth -12.5 --elevation 20 --zoom 1.5 --projection "
    "perspective --up z",
    "weights of the paper": "--methods peak-finding --steps 1 --peak-weight paper --crossings secant",
    "coarser meshes": "--methods data-centric --tolerances 1/8 --per-slopes 1 --details 3 --cameras 2",
    "differential": "--methods post-classified,peak-finding --sampling differential --pixel-scales 4,0.3 --adaptive",
    "look and volume": "--methods data-centric,pre-integrated --steps 1 --per-slopes 2 --clip -1,0,0,1e-5 --clip "
    "0,1,0,7.25 --background 0.1,0.2,0.3,0.5 --stage compute --reconstruction cubic --spacing 0.25,0.5,2 "
    "--frame index",
    "light": "--steps 1 --per-slopes 2 --tolerances 1/8 --shading",
    "a camera file": "--methods pre-integrated --steps 1 --camera camera.json --nan masked",
}
OWN = {  # options that say what is compared, or that a command spells out for every entry
    "help", "debug", "output", "quick", "methods", "repeat", "per_slopes", "tolerances", "steps", "pixel_scales",
    "cameras", "size", "camera", "sampling", "adaptive", "peak_weight", "crossings", "details", "source",
    *PLACING_OPTIONS,
}  # fmt: skip


@pytest.mark.parametrize("options", COMPARISONS.values(), ids=COMPARISONS.keys())
def test_every_command_draws_the_picture_that_was_judged(run: Run, options: str) -> None:
    write_json(Path("tf.json"), TF | {"isosurfaces": [SURFACE]})
    camera = isosample.Camera.orbit(isosample.open_volume("blob.npy").box, azimuth=77.0, aspect=4 / 3)
    write_json(Path("camera.json"), camera.to_dict())
    outcome = run(f"{COMPARE} {options}")
    assert outcome.status == 0, outcome.err
    document: dict[str, Any] = json.loads(Path("out/results.json").read_text(encoding="utf-8"))
    page = Path("out/report.html").read_text(encoding="utf-8")
    table = Path("out/results.csv").read_text(encoding="utf-8")
    for entry in document["entries"]:
        for number, view in enumerate(entry["views"], start=1):
            program, *words = shlex.split(view["command"])
            assert program == "isosample"
            assert words[-2:] == ["-o", f"camera-{number}_{entry['name']}.png"]
            drawn = run(*words[:-1], "again.npy")
            assert drawn.status == 0, drawn.err
            again = shown(np.load("again.npy"), document["settings"]["backdrop"])
            with PIL.Image.open(f"out/pictures/camera-{number}_{entry['name']}.png") as kept:
                np.testing.assert_array_equal(again, np.asarray(kept.convert("RGB")))
            assert f">{view['command']}<" in page
            assert view["command"] in table.replace('""', '"')


def test_no_option_of_a_comparison_is_left_out_of_its_commands() -> None:
    args = build_parser().parse_args(["compare", "blob.npy", "-o", "out"])
    known = {action.dest for action in args.parser._actions}
    assert known - OWN <= set(SHARED)


def test_how_coarse_meshes_were_for_all_views_of_a_comparison_goes_into_the_command_of_each() -> None:
    options = "compare blob.npy --tolerances 1/64 --details 2 --cameras 3 --azimuth 7 -o out"
    args = build_parser().parse_args(options.split())
    views = [{"cost": {"screen_error": error}} for error in (0.03125, 0.03125, 0.25)]
    entry = {"name": "e", "method": "data-centric", "parameter": "tolerance", "value": 1 / 64, "views": views}
    assert render_command(args, (9, 8), entry, 1) == (
        "isosample render blob.npy --method data-centric --tolerance 1/64 --details 2 --screen-error 1/32 --size 9x8 "
        "--azimuth 127 -o camera-2_e.png"
    )
    assert "--screen-error 1/4 " in render_command(args, (9, 8), entry, 2)
    counted = entry | {"parameter": "isovalues per slope", "value": 3.0}
    assert "--per-slope 3 --details 2 --size" in render_command(args, (9, 8), counted, 0)


def test_files_with_spaces_and_suggested_transfer_functions_are_drawn_again(run: Run) -> None:
    Path("blob.npy").rename("a blob.npy")
    words = ["compare", "a blob.npy", "--methods", "pre-integrated", "--steps", "2", "--size", "16x12"]
    assert run(*words, "--repeat", "1", "-o", "out").status == 0
    (entry,) = json.loads(Path("out/results.json").read_text(encoding="utf-8"))["entries"]
    command = entry["views"][0]["command"]
    assert command.startswith("isosample render 'a blob.npy' --method pre-integrated --step 2 ")
    assert "--tf" not in command
    assert run(*shlex.split(command)[1:-1], "again.npy").status == 0
    with PIL.Image.open("out/pictures/camera-1_pre-integrated-step-2.png") as kept:
        again = shown(np.load("again.npy"), (0.0, 0.0, 0.0))
        np.testing.assert_array_equal(again, np.asarray(kept.convert("RGB")))

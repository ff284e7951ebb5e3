"""`render` gives the library's picture: every option reaches it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

import isosample
from cli.harness import Run, blob, write_json
from cli.rendered import RENDER, pixels
from isosample.cli import build_parser
from isosample.cli.render import settings_of

pytestmark = pytest.mark.usefixtures("gl")


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


def test_time_and_channel_choose_the_samples(run: Run) -> None:
    np.save("movie.npy", np.stack([np.zeros_like(blob()), blob()]))
    np.save("parts.npy", np.stack([blob(), np.zeros_like(blob())], axis=-1))
    assert run(f"{RENDER} -o out.npy").status == 0
    view = "--tf tf.json --size 24x16"
    assert run(f"render movie.npy --time 1 {view} -o time.npy").status == 0
    assert run(f"render parts.npy --channel 0 {view} -o channel.npy").status == 0
    np.testing.assert_array_equal(pixels("time.npy"), pixels())
    np.testing.assert_array_equal(pixels("channel.npy"), pixels())


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

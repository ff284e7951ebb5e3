"""`render --method ...` of the ray caster gives the library's picture: every option reaches it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

import isosample
from cli.harness import Run, blob, write_json
from isosample.cli import build_parser
from isosample.cli.parser import join_negative_values
from isosample.cli.raycast import raycast_settings_of

pytestmark = pytest.mark.usefixtures("gl")

RENDER = "render blob.npy --tf tf.json --size 24x16 -o out.npy"
POST = isosample.Classification.POST_CLASSIFIED
PRE = isosample.Classification.PRE_INTEGRATED
PEAKS = isosample.Classification.PEAK_FINDING


def by_library(**raycast: Any) -> npt.NDArray[np.float32]:
    """The ray caster's picture of blob.npy with tf.json, made without the command line."""
    settings, camera = raycast.pop("settings", None), raycast.pop("camera", {})
    volume = isosample.Volume(blob())
    return isosample.raycast(
        volume,
        isosample.TransferFunction.load("tf.json"),
        camera=isosample.Camera.orbit(volume.box, aspect=1.5, **camera),
        size=(24, 16),
        settings=settings,
        raycast=isosample.RaycastSettings(**raycast),
    ).rgba


SETTINGS: dict[str, dict[str, Any]] = {
    "post-classified": {"classification": POST},
    "post-classified --step 1/4": {"classification": POST, "step": 0.25},
    "post-classified --sampling differential": {
        "classification": POST,
        "sampling": isosample.Sampling.DIFFERENTIAL,
    },
    "post-classified --sampling differential --pixel-scale 2": {
        "classification": POST,
        "sampling": isosample.Sampling.DIFFERENTIAL,
        "pixel_scale": 2.0,
    },
    "post-classified --jitter 3": {"classification": POST, "jitter": 3},
    "post-classified --quadrature riemann": {
        "classification": POST,
        "quadrature": isosample.Quadrature.RIEMANN,
    },
    "post-classified --transfer texture": {
        "classification": POST,
        "transfer_lookup": isosample.TransferLookup.TEXTURE,
    },
    "post-classified --reconstruction bspline": {
        "classification": POST,
        "reconstruction": isosample.Reconstruction.BSPLINE,
    },
    "post-classified --reconstruction bspline --filtering hardware": {
        "classification": POST,
        "reconstruction": isosample.Reconstruction.BSPLINE,
        "filtering": isosample.Filtering.HARDWARE,
    },
    "post-classified --azimuth 30 --projection perspective": {
        "classification": POST,
        "camera": {"azimuth": 30.0, "projection": isosample.Projection.PERSPECTIVE},
    },
    "post-classified --shading": {
        "classification": POST,
        "settings": isosample.RenderSettings(material=isosample.Material()),
    },
    "post-classified --background 0.5,0.25,0 --clip -1,0,0,4.25": {
        "classification": POST,
        "settings": isosample.RenderSettings(
            background=(0.5, 0.25, 0.0, 1.0), clip_planes=(isosample.ClipPlane(-1.0, 0.0, 0.0, 4.25),)
        ),
    },
    "pre-integrated": {"classification": PRE},
    "pre-integrated --integration 1d": {"classification": PRE, "integration": isosample.Integration.TABLE_1D},
    "pre-integrated --integration 2d --table-dtype float16": {
        "classification": PRE,
        "integration": isosample.Integration.TABLE_2D,
        "table_dtype": isosample.TableDtype.FLOAT16,
    },
    "pre-integrated --integration 2d": {"classification": PRE, "integration": isosample.Integration.TABLE_2D},
    "pre-integrated --integration 2d --table-size 32": {
        "classification": PRE,
        "integration": isosample.Integration.TABLE_2D,
        "table_size": 32,
    },
    "pre-integrated --integration 3d": {"classification": PRE, "integration": isosample.Integration.TABLE_3D},
    "peak-finding": {"classification": PEAKS},
    "peak-finding --peak-mode xor": {"classification": PEAKS, "peak_mode": isosample.PeakMode.XOR},
    "peak-finding --peak-mode peak-only": {
        "classification": PEAKS,
        "peak_mode": isosample.PeakMode.PEAK_ONLY,
    },
    "peak-finding --peak-weight integral": {
        "classification": PEAKS,
        "peak_weight": isosample.PeakWeight.INTEGRAL,
    },
    "peak-finding --peak-weight integral --crossings exact": {
        "classification": PEAKS,
        "peak_weight": isosample.PeakWeight.INTEGRAL,
        "crossings": isosample.Crossings.EXACT,
    },
    "peak-finding --shading": {
        "classification": PEAKS,
        "settings": isosample.RenderSettings(material=isosample.Material()),
    },
    "peak-finding --shading --root-iterations 0": {  # unlit, a peak looks the same wherever it lies in its step
        "classification": PEAKS,
        "root_iterations": 0,
        "settings": isosample.RenderSettings(material=isosample.Material()),
    },
}
SAME: dict[str, dict[str, Any]] = {  # options that leave this picture, or nearly, as it is
    "post-classified --sampling uniform --step 0.5 --no-skipping": {
        "classification": POST,
        "skipping": False,
    },
    "post-classified --macrocells 2": {"classification": POST, "macrocells": 2},
    "post-classified --filtering hardware": {
        "classification": POST,
        "filtering": isosample.Filtering.HARDWARE,
    },
    "post-classified --adaptive": {"classification": POST, "adaptive": True},
    "peak-finding --peak-bins 64 --peaks 4": {"classification": PEAKS, "peak_bins": 64, "peaks": 4},
    "peak-finding --peak-mode dvr-only": {"classification": PEAKS, "peak_mode": isosample.PeakMode.DVR_ONLY},
}
DRAWN = (  # by the command line too: all that is not in RaycastSettings, and one of each method
    "post-classified --azimuth 30 --projection perspective",
    "post-classified --background 0.5,0.25,0 --clip -1,0,0,4.25",
    "pre-integrated --integration 2d",
    "peak-finding --shading --root-iterations 0",
)


@pytest.mark.parametrize(("options", "expected"), (SETTINGS | SAME).items(), ids=(SETTINGS | SAME).keys())
def test_an_option_gives_the_library_s_setting(options: str, expected: dict[str, Any]) -> None:
    words = join_negative_values(f"{RENDER} --method {options}".split())
    raycast = {name: value for name, value in expected.items() if name not in ("settings", "camera")}
    args = build_parser().parse_args(words)
    assert raycast_settings_of(args, args.method) == isosample.RaycastSettings(**raycast)


@pytest.mark.parametrize("options", DRAWN)
def test_the_picture_has_the_bits_of_the_library_s(run: Run, options: str) -> None:
    outcome = run(f"{RENDER} --method {options}")
    assert outcome.status == 0, outcome.err
    assert outcome.err == ""
    np.testing.assert_array_equal(np.load("out.npy"), by_library(**SETTINGS[options]))


def test_every_setting_changes_the_picture() -> None:
    pictures = {by_library(**expected).tobytes() for expected in SETTINGS.values()}
    assert len(pictures) == len(SETTINGS)


def test_the_summary_and_the_statistics_tell_what_it_took(run: Run) -> None:
    outcome = run(f"{RENDER} --method peak-finding --stats stats.json")
    fields = outcome.fields()
    stats = json.loads(Path("stats.json").read_text())
    samples, macrocells = stats["samples_per_ray"], stats["macrocells"]
    assert (stats["method"], stats["source"]) == ("peak-finding", "blob.npy")
    assert stats["transfer_function"] == "tf.json"
    assert fields["picture"] == "out.npy (24 x 16 pixels), peak-finding, uniform sampling"
    assert fields["samples per ray"] == f"{samples['mean']:.1f} (at most {samples['max']})"
    assert fields["root evaluations per ray"] == f"{stats['root_evaluations_per_ray']:.1f}"
    assert f"{macrocells['occupied']} of {macrocells['of']} are occupied" in fields["macrocells per ray"]
    assert 0 < samples["mean"] <= samples["max"]
    assert stats["root_evaluations_per_ray"] > 0
    for method in ("post-classified", "pre-integrated"):  # which look for no roots
        assert "root evaluations" not in run(f"{RENDER} --method {method}").out


def test_isosurfaces_that_samples_cannot_meet_are_told(run: Run) -> None:
    surface = {"value": 50, "color": [1, 1, 1], "opacity": 0.5}
    ends = [{"value": value, "color": [1, 1, 1], "extinction": 0.1} for value in (10, 90)]
    write_json(Path("surface.json"), {"points": ends, "isosurfaces": [surface]})
    outcome = run("render blob.npy --tf surface.json --size 8x8 -o out.npy --method post-classified")
    assert "not shown: 1 of the transfer function's isosurfaces" in outcome.out
    outcome = run("render blob.npy --tf surface.json --size 8x8 -o out.npy --method pre-integrated")
    assert "not shown" not in outcome.out


def test_masked_samples_are_an_error_unless_they_are_left_out(run: Run) -> None:
    holed = np.where(np.arange(720).reshape(8, 9, 10) == 300, np.nan, blob())
    np.save("holed.npy", holed)
    line = "render holed.npy --tf tf.json --size 24x16 -o holed_out.npy --method pre-integrated"
    outcome = run(line)
    assert outcome.status == 2
    assert "--nan masked" in outcome.err or "nan_masked" in outcome.err
    assert run(f"{line} --nan masked").status == 0
    run(f"{RENDER} --method pre-integrated")
    assert np.isfinite(np.load("holed_out.npy")).all()
    assert not np.array_equal(np.load("holed_out.npy"), np.load("out.npy"))


@pytest.mark.parametrize(
    "method",
    [
        "post-classified",
        "post-classified --quadrature riemann",
        "pre-integrated",
        "pre-integrated --integration 1d",
        "peak-finding --peak-weight integral --crossings exact",
    ],
)
def test_every_method_that_converges_searches_for_the_step_of_a_tolerance(run: Run, method: str) -> None:
    outcome = run(f"{RENDER} --method {method} --tolerance 1/30 --stats stats.json")
    assert outcome.status == 0, outcome.err
    report = json.loads(Path("stats.json").read_text(encoding="utf-8"))["tolerance"]
    assert (report["tolerance"], report["missed"]) == (1 / 30, None)
    assert report["reached"] <= 1 / 30
    assert outcome.fields()["tolerance"].startswith(
        f"0.0333: reached; with steps of {report['step']:.3g} voxels"
    )
    searched = np.load("out.npy")
    assert run(f"{RENDER} --method {method} --step {report['step']!r}").status == 0
    np.testing.assert_array_equal(np.load("out.npy"), searched)


def test_a_tolerance_that_no_step_reaches_is_reported_with_the_steps_that_were_tried(run: Run) -> None:
    """Samples do not meet an isosurface, whatever their distance."""
    write_json(Path("tf.json"), {"isosurfaces": [{"value": 60, "color": [1, 1, 1], "opacity": 0.5}]})
    outcome = run(f"{RENDER} --method post-classified --tolerance 1/30")
    assert outcome.status == 0, outcome.err
    assert "NOT reached with any of " in outcome.fields()["tolerance"]
    assert "steps of 2 to 0.0" in outcome.fields()["tolerance"]

"""Every example runs as it stands, and every transfer function of the examples fits the scan it is for."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import isosample
from isosample.surfaces.cache import content_hash, load_cache, write_cache
from isosample.surfaces.extract import extract_surfaces

LARGE = ("carp",)  # takes twice as long as any other scan
EXAMPLES = Path(__file__).resolve().parents[1] / "examples"
sys.path.insert(0, str(EXAMPLES))
from gallery import SCENES, SETTINGS, Scene, render_scene  # noqa: E402


def run(script: str, folder: Path, *arguments: str) -> list[str]:
    """Run a script in a folder; return the names of the files it left."""
    done = subprocess.run(
        [sys.executable, str(EXAMPLES / script), *arguments],
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return sorted(path.name for path in folder.iterdir())


@pytest.mark.gl
def test_first_picture(tmp_path: Path) -> None:
    z, y, x = np.mgrid[-1:1:24j, -1:1:24j, -1:1:24j]
    np.save(tmp_path / "bump.npy", np.exp(-4 * (x * x + y * y + z * z)))
    assert run("first_picture.py", tmp_path, "bump.npy") == ["bump.npy", "picture.png"]


@pytest.mark.gl
def test_own_array(tmp_path: Path) -> None:
    assert run("own_array.py", tmp_path) == ["torus.png"]


@pytest.mark.gl
def test_orbit(tmp_path: Path) -> None:
    assert run("orbit.py", tmp_path) == ["orbit.gif"]


def test_meshes(tmp_path: Path) -> None:
    assert run("meshes.py", tmp_path) == ["marschner_lobb.ply"]


def test_every_transfer_function_has_a_scene() -> None:
    assert sorted(path.stem for path in (EXAMPLES / "tf").glob("*.json")) == sorted(
        scene.name for scene in SCENES
    )


@pytest.mark.gl
@pytest.mark.volumes
@pytest.mark.parametrize(
    "scene",
    [pytest.param(one, marks=[pytest.mark.slow] if one.name in LARGE else [], id=one.name) for one in SCENES],
)
def test_a_scan_renders_with_its_transfer_function_and_adds_up(scene: Scene, real_volumes: Path) -> None:
    size = (800, 800) if scene.name in {"nucleon", "aneurism", "vessels_mra", "hydrogenatom"} else (200, 200)
    image = render_scene(scene, real_volumes, size)
    assert image.stats["lost_fragments"] == 0
    # The crossings of a ray lead from the entry's band to the exit's, but where meshes of noisy data cut each other
    # over more than a cell: fewer than one in a thousand.
    assert image.stats["band_violations"] < 1e-3 * image.stats["fragments"]
    assert image.stats["fragments"] > 10_000
    red, green, blue = np.abs(image.rgba - np.asarray(SETTINGS.background)).max(axis=(0, 1))[:3]
    assert min(red, green, blue) > 0.1


@pytest.mark.gl
@pytest.mark.volumes
def test_a_cache_folder_gives_the_same_pixels_as_the_scan(real_volumes: Path, tmp_path: Path) -> None:
    volume = isosample.open_volume(real_volumes / "vessels_mra.nii.gz")
    tf = isosample.TransferFunction.load(EXAMPLES / "tf" / "vessels_mra.json")
    expected = isosample.render(volume, tf, size=(400, 300))
    plan = isosample.plan_isovalues(tf, volume.value_range)
    surfaces = extract_surfaces(volume, plan.isovalues)
    write_cache(
        tmp_path,
        surfaces,
        content_hash=content_hash(volume),
        transfer_function=tf,
        plan=plan,
        name=volume.name,
    )
    cached = load_cache(tmp_path)
    image = isosample.render_surfaces(cached.surfaces, cached.plan, size=(400, 300))
    assert np.array_equal(image.rgba, expected.rgba)


def test_first_picture_without_a_volume_says_how_to_call_it(tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, str(EXAMPLES / "first_picture.py")],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 1
    assert "first_picture.py VOLUME" in done.stderr
    assert "Traceback" not in done.stderr

"""`precompute` leaves a folder from which every picture is bit for bit that of the volume."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from cli.harness import TF, Run, blob, content, write_json
from isosample.surfaces.plain_chunks import PLAIN_MAGIC
from isosample.wording import byte_size

VIEW = "--size 24x16 --azimuth 30 --elevation -20"


def test_the_summary_tells_where_the_meshes_are_and_what_they_hold(run: Run, folder: Path) -> None:
    outcome = run("precompute blob.npy --tf tf.json --cache meshes")
    assert outcome.status == 0
    assert outcome.err == ""
    fields = outcome.fields()
    assert fields["cache"] == "meshes"
    assert fields["transfer function"] == "tf.json"
    assert fields["levels"] == "13 (0 reused)"  # 3 points and 5 values in each of 2 slopes
    assert int(fields["triangles"].replace(" ", "")) > 0
    size = sum(len(data) for data in content(folder / "meshes").values() if data is not None)
    assert fields["size"] == f"{size / 1024:.1f} KiB"


def test_a_second_run_extracts_nothing_and_changes_no_surface(run: Run, cache: Path) -> None:
    before = content(cache)
    outcome = run("precompute blob.npy --tf tf.json --cache meshes")
    assert outcome.fields()["levels"] == "13 (13 reused)"
    assert content(cache) == before


def test_a_moved_point_extracts_only_its_own_values(run: Run, cache: Path) -> None:
    points = [dict(point) for point in TF["points"]]
    points[2]["value"] = 89  # 56.5, 63 … 89 are new; 20, 25 … 50 stay
    write_json(Path("moved.json"), {"points": points})
    outcome = run("precompute blob.npy --tf moved.json --cache meshes")
    assert outcome.fields()["levels"] == "13 (7 reused)"


def test_the_default_folder_is_named_after_the_volume_and_its_content(
    run: Run, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    here = run("precompute blob.npy --tf tf.json --per-slope 0").fields()["cache"]
    assert here.startswith("meshes_cache/blob-")
    assert (folder / here / "scene.json").is_file()
    monkeypatch.setenv("ISOSAMPLE_CACHE", str(folder / "elsewhere"))
    there = run("precompute blob.npy --tf tf.json --per-slope 0").fields()["cache"]
    assert there == str(folder / "elsewhere" / Path(here).name)
    assert (Path(there) / "scene.json").is_file()
    np.save("blob.npy", blob() + 1)
    other = run("precompute blob.npy --tf tf.json --per-slope 0").fields()["cache"]
    assert Path(other).name != Path(there).name


@pytest.mark.usefixtures("gl")
def test_a_cache_folder_gives_the_bits_of_the_volume_without_it(run: Run, folder: Path) -> None:
    assert run(f"render blob.npy --tf tf.json -o volume.npy {VIEW}").status == 0
    assert run("precompute blob.npy --tf tf.json --cache meshes").status == 0
    (folder / "blob.npy").unlink()
    (folder / "tf.json").unlink()
    outcome = run(f"render meshes -o cache.npy {VIEW}")
    assert outcome.status == 0, outcome.err
    assert outcome.err == ""
    assert outcome.fields()["isovalues"] == "13 (13 from the cache)"
    picture = np.load("volume.npy")
    assert picture[..., 3].max() > 0.5
    assert (folder / "cache.npy").read_bytes() == (folder / "volume.npy").read_bytes()


@pytest.mark.usefixtures("gl", "cache")
def test_a_cache_folder_takes_new_colours_and_fewer_values(run: Run, folder: Path) -> None:
    recoloured = [point | {"color": [0.25, 0.5, 1]} for point in TF["points"]]
    write_json(Path("new.json"), {"points": recoloured})
    # thirds of a slope are among its sixths
    for options in ("--tf new.json", "--per-slope 2 --tf tf.json", "--per-slope 0 --tf new.json"):
        assert run(f"render blob.npy {options} -o volume.npy {VIEW}").status == 0
        outcome = run(f"render meshes {options} -o cache.npy {VIEW}")
        assert outcome.status == 0, outcome.err
        assert (folder / "cache.npy").read_bytes() == (folder / "volume.npy").read_bytes()


@pytest.mark.usefixtures("gl")
def test_rendering_with_a_cache_folder_fills_it_and_then_uses_it(run: Run, folder: Path) -> None:
    render = f"render blob.npy --tf tf.json --cache meshes {VIEW} --stats stats.json"
    pictures, reused = [], []
    for _ in range(2):
        assert run(f"{render} -o out.npy").status == 0
        pictures.append((folder / "out.npy").read_bytes())
        reused.append(json.loads(Path("stats.json").read_text())["levels_reused"])
    assert reused == [0, 13]
    assert pictures[0] == pictures[1]
    assert run(f"render meshes -o out.npy {VIEW}").status == 0
    assert (folder / "out.npy").read_bytes() == pictures[0]


@pytest.mark.usefixtures("gl", "cache")
def test_masked_surfaces_of_a_cache_are_drawn_where_they_are_asked_for(run: Run, folder: Path) -> None:
    masked = f"--nan masked -o out.npy {VIEW}"
    assert run(f"render meshes {masked}").status == 2  # its own are of the whole volume
    assert run(f"render blob.npy --tf tf.json --cache meshes {masked}").status == 0
    volume = (folder / "out.npy").read_bytes()
    assert run(f"render meshes {masked}").status == 0
    assert (folder / "out.npy").read_bytes() == volume


@pytest.mark.usefixtures("gl")
def test_masked_samples_stay_masked_in_the_cache(run: Run, folder: Path) -> None:
    samples = blob()
    samples[3:5, 4, 5] = np.nan
    np.save("holed.npy", samples)
    assert run(f"render holed.npy --nan masked --tf tf.json -o volume.npy {VIEW}").status == 0
    assert run("precompute holed.npy --nan masked --tf tf.json --cache meshes").status == 0
    for options in ("", "--tf tf.json", "--per-slope 5"):
        assert run(f"render meshes -o cache.npy {VIEW} {options}").status == 0
        assert (folder / "cache.npy").read_bytes() == (folder / "volume.npy").read_bytes()
    run(f"render blob.npy --tf tf.json -o whole.npy {VIEW}")
    assert (folder / "whole.npy").read_bytes() != (folder / "volume.npy").read_bytes()


@pytest.mark.parametrize("more", ["", "--memory 16GiB", "--tolerance 1/16"])
def test_plain_meshes_are_larger_and_give_the_same_picture(
    run: Run, folder: Path, request: pytest.FixtureRequest, more: str
) -> None:
    request.getfixturevalue("gl")
    pictures = []
    for name, plain in (("packed", ""), ("plain", "--plain")):
        outcome = run(f"precompute blob.npy --tf tf.json --cache {name} {plain} {more}")
        assert outcome.status == 0, outcome.err
        assert run(f"render {name} -o out.npy {VIEW}").status == 0
        pictures.append((folder / "out.npy").read_bytes())
    assert pictures[0] == pictures[1]
    packed, plain_chunks = (chunks_of(folder / name) for name in ("packed", "plain"))
    assert packed.keys() == plain_chunks.keys()
    assert not any(data.startswith(PLAIN_MAGIC) for data in packed.values())
    assert all(data.startswith(PLAIN_MAGIC) for data in plain_chunks.values())


@pytest.mark.parametrize("more", ["", "--memory 16GiB"])
def test_a_budget_makes_the_meshes_of_other_scenes_go(run: Run, folder: Path, more: str) -> None:
    words = f"precompute blob.npy --cache meshes {more}"
    assert run(f"{words} --tf tf.json --per-slope 0").status == 0
    own = chunks_of(folder / "meshes")  # of three levels, which the next scene has too
    assert run(f"{words} --tf tf.json").status == 0
    everything = chunks_of(folder / "meshes")
    assert own.keys() < everything.keys()
    size = sum(len(data) for data in own.values())
    outcome = run(f"{words} --tf tf.json --per-slope 0 --cache-budget {size / 1000:.3f}kB")
    assert outcome.status == 0, outcome.err
    assert outcome.fields()["levels"] == "3 (3 reused)"  # and though nothing was written, there is room
    assert outcome.fields()["meshes"].startswith(byte_size(size))
    assert chunks_of(folder / "meshes") == own


@pytest.mark.parametrize("more", ["", "--memory 16GiB"])
def test_a_scene_that_exceeds_its_budget_stays_whole(run: Run, folder: Path, more: str) -> None:
    outcome = run(f"precompute blob.npy --tf tf.json --cache meshes --cache-budget 1KiB {more}")
    assert outcome.status == 0
    assert "more than the budget of 1.0 KiB" in outcome.err
    again = run(f"precompute blob.npy --tf tf.json --cache meshes {more}")
    assert again.fields()["levels"] == "13 (13 reused)"


def chunks_of(cache: Path) -> dict[str, bytes]:
    """Return the chunks of a cache folder by name."""
    return {path.name: path.read_bytes() for path in cache.glob("chunks/*/*.chunk")}


@pytest.mark.parametrize("more", ["", "--refine auto", "--memory 16GiB", "--memory 16GiB --refine auto"])
def test_an_interrupted_run_says_that_it_can_go_on(
    run: Run, monkeypatch: pytest.MonkeyPatch, more: str
) -> None:
    def interrupt(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    name = (
        "stored_preparation.prepare_stored_surfaces" if "--memory" in more else "preparation.prepare_surfaces"
    )
    monkeypatch.setattr(f"isosample.rendering.{name}", interrupt)
    outcome = run(f"precompute blob.npy --tf tf.json --cache meshes {more}")
    assert outcome.status == 130
    assert "the same command goes on from there" in outcome.err
    assert outcome.err.endswith("isosample: interrupted\n")

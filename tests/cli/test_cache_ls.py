"""`cache ls` tells what the caches of meshes hold, and which can be used."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from cli.harness import TF, Run, chunks, content, write_json
from isosample.surfaces.cache import open_cache
from isosample.surfaces.cache_files import read_json
from isosample.surfaces.cache_files import write_json as write_checked
from isosample.surfaces.chunk_folder import ChunkFolder

if TYPE_CHECKING:
    from collections.abc import Callable


@pytest.mark.usefixtures("cache")
def test_ls_tells_what_each_cache_holds(run: Run, cache: Path) -> None:
    outcome = run("cache ls meshes")
    assert (outcome.status, outcome.err) == (0, "")
    rows = json.loads(run("cache ls meshes --json").out)
    entry = rows["caches"][0]
    assert (entry["name"], entry["size_xyz"], entry["problem"]) == ("blob.npy", [10, 9, 8], "")
    assert entry["surfaces"] == len(list(cache.glob("surfaces/*.npz")))
    assert entry["chunks"] == len(chunks(cache)) > 0
    assert entry["size_bytes"] == sum(len(data) for data in content(cache).values() if data)
    heads, row, total = outcome.out.splitlines()
    assert heads.split() == [
        "cache",
        "volume",
        "samples",
        "isosurfaces",
        "details",
        "meshes",
        "size",
        "used",
        "state",
    ]
    assert row.split()[:6] == ["meshes", "blob.npy", "10x9x8", "13", "0", str(entry["chunks"])]
    assert (row.split()[-1], entry["state"], entry["pieces_missing"]) == ("complete", "complete", 0)
    assert total.startswith("1 cache, ")


def test_ls_counts_isosurfaces_and_their_details_apart(run: Run) -> None:
    assert run("precompute blob.npy --tf tf.json --per-slope 0 --details 2 --cache coarse").status == 0
    entry = json.loads(run("cache ls coarse --json").out)["caches"][0]
    assert (entry["isovalues"], entry["details"], entry["surfaces"]) == (3, 2, 9)
    assert run("cache ls coarse").out.splitlines()[1].split()[3:5] == ["3", "2"]


@pytest.mark.parametrize("details", ["", "--details 2"])
def test_ls_marks_folders_whose_scene_lacks_meshes(run: Run, details: str) -> None:
    """Which is what a picture from the folder alone needs, whatever is missing of scenes that were there before."""
    words = f"precompute blob.npy --tf tf.json --per-slope 0 {details} --cache meshes"
    assert run(words).status == 0
    folder = Path("meshes")
    there = chunks(folder)
    max(scene_chunks(folder)).unlink()
    entry = json.loads(run("cache ls meshes --json").out)["caches"][0]
    assert (entry["pieces_missing"], entry["chunks"], entry["finished"]) == (1, len(there) - 1, True)
    assert entry["state"] == "incomplete"
    outcome = run("cache ls meshes")
    assert outcome.status == 0
    assert outcome.out.splitlines()[1].split()[-1] == "incomplete"
    assert (
        "incomplete: meshes: 1 piece of its scene is not there (evicted or removed): it cannot be rendered"
        in (outcome.out)
    )
    assert "is missing" in run("render meshes -o out.png --size 16x16").err
    assert run(words).status == 0
    assert run("cache ls meshes").out.splitlines()[1].split()[-1] == "complete"

    write_json(Path("other.json"), {"points": TF["points"][:2]})
    assert run(words.replace("tf.json", "other.json")).status == 0
    for path in set(chunks(folder)) - scene_chunks(folder):
        path.unlink()
    assert run("cache ls meshes").out.splitlines()[1].split()[-1] == "complete"
    assert run("cache verify meshes").fields()["incomplete"] == "1"


def scene_chunks(folder: Path) -> set[Path]:
    """The files of all chunks that the folder's scene needs."""
    tables = [one.chunk_table for one in open_cache(folder).surfaces.by_detail]
    store = ChunkFolder(folder)
    return {store.path(key.decode()) for table in tables for key in table["key"].tolist()}


def test_ls_tells_of_a_scene_whose_lists_are_damaged(run: Run, cache: Path) -> None:
    listed = min(cache.glob("surfaces/*.npz"))
    listed.write_bytes(listed.read_bytes()[:-40])
    outcome = run("cache ls meshes")
    assert outcome.status == 0
    assert outcome.out.splitlines()[1].split()[-1] == "unusable"
    assert f"cannot be used: meshes/surfaces/{listed.name} is damaged" in outcome.out


def rewrite(path: Path, kind: str, change: Callable[[dict[str, Any]], None]) -> None:
    """Change a document as another version with the same format might have written it: its digest is right."""
    document = read_json(path, kind)
    change(document)
    write_checked(
        path, kind, {name: document[name] for name in document if name not in ("format", "version")}
    )


LATER: dict[str, tuple[str, Callable[[dict[str, Any]], None]]] = {
    "reason": ("scene", lambda scene: scene["plan"]["reasons"].__setitem__(0, "halo")),
    "plan": ("scene", lambda scene: scene["plan"].pop("skipped")),
    "settings": ("scene", lambda scene: scene["settings"].update(adaptive=True)),
    "transfer function": ("scene", lambda scene: scene["transfer_function"].update(intervals=[])),
    "surfaces": ("scene", lambda scene: scene.update(pieces=scene.pop("surfaces"))),
    "geometry": ("cache", lambda volume: volume["geometry"].update(shear=0.0)),
    "size": ("cache", lambda volume: volume.pop("geometry")),
}


@pytest.mark.parametrize("entry", LATER)
def test_a_folder_of_a_later_version_hides_no_other(run: Run, cache: Path, entry: str) -> None:
    kind, change = LATER[entry]
    name = {"scene": "scene.json", "cache": "volume.json"}[kind]
    shutil.copytree(cache, cache.parent / "later")
    rewrite(Path("later") / name, kind, change)
    outcome = run("cache ls meshes later")
    assert (outcome.status, outcome.err) == (0, "")
    assert [row.split()[-1] for row in outcome.out.splitlines()[1:3]] == ["complete", "unusable"]
    problem = f"later/{name} has entries that this version does not understand ("
    assert f"cannot be used: {problem}" in outcome.out
    rows = json.loads(run("cache ls meshes later --json").out)["caches"]
    assert [row["state"] for row in rows] == ["complete", "unusable"]
    verified = run("cache verify meshes later")
    assert (verified.status, verified.fields()["damaged files"]) == (1, "1")
    assert problem in verified.out
    picture = run("render later -o out.png")
    assert (picture.status, picture.err.count("\n")) == (2, 1)
    assert problem in picture.err
    if kind == "cache":
        (Path("later") / name).unlink()
    assert run("precompute blob.npy --tf tf.json --cache later").status == 0
    assert content(Path("later")) == content(cache)

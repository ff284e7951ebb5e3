"""`cache verify` finds what is damaged or missing in the caches of meshes, and names what restores it."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from cli.harness import TF, Run, chunks, content, write_json
from isosample.surfaces.cache import open_cache
from isosample.surfaces.cache_files import read_arrays, read_json
from isosample.surfaces.cache_files import write_json as write_checked
from isosample.surfaces.chunk_folder import ChunkFolder
from isosample.surfaces.surface_files import rows_of_arrays


def test_verify_finds_every_kind_of_damage_and_changes_nothing(run: Run, cache: Path) -> None:
    assert run("cache verify meshes").fields()["damaged files"] == "0"
    first, second, third = chunks(cache)[:3]
    data = first.read_bytes()
    first.write_bytes(data[:-9] + bytes([data[-9] ^ 1]) + data[-8:])
    second.write_bytes(second.read_bytes()[:50])
    third.unlink()
    listed = min(cache.glob("surfaces/*.npz"))
    listed.write_bytes(listed.read_bytes()[:-40])
    (cache / "boundary.npz").write_bytes(b"")
    (cache / "scene.json").write_text("{}")
    before = content(cache)
    outcome = run("cache verify meshes")
    assert outcome.status == 1
    for path in (first, second, listed, cache / "boundary.npz", cache / "scene.json"):
        assert f"damaged: meshes/{path.relative_to(cache)}: " in outcome.out
    assert re.search(r"incomplete: meshes: 1 of \d+ pieces are not there \(evicted or removed\)", outcome.out)
    assert third.stem not in outcome.out
    assert content(cache) == before
    found = json.loads(run("cache verify meshes --json").out)["damaged"]
    assert len(found) == int(outcome.fields()["damaged files"]) >= 5


def test_what_verify_names_precompute_puts_right(run: Run, cache: Path) -> None:
    whole = content(cache)
    first, second = chunks(cache)[:2]
    first.write_bytes(first.read_bytes()[:50])
    second.unlink()
    assert run("cache verify meshes").status == 1
    outcome = run("precompute blob.npy --tf tf.json --cache meshes")
    assert outcome.status == 0
    assert (
        f"warning: 1 damaged chunk of meshes was extracted again; the first: meshes/chunks/{first.stem[:2]}"
        in (outcome.err)
    )
    assert content(cache) == whole
    assert run("cache verify meshes").status == 0


@pytest.mark.parametrize("harm", ["damage", "version", "entries", "no scene"])
def test_a_volume_json_that_cannot_be_used_names_one_remedy_and_it_works(
    run: Run, cache: Path, harm: str
) -> None:
    """Whatever else is wrong with the folder: other remedies would be refused as long as this file is there."""
    owner = cache / "volume.json"
    whole = content(cache)
    first = chunks(cache)[0]
    first.write_bytes(first.read_bytes()[:50])
    if harm == "no scene":
        (cache / "scene.json").unlink()
    if harm == "version":
        for path in (owner, cache / "scene.json"):
            document = json.loads(path.read_text(encoding="utf-8"))
            write_json(path, document | {"version": document["version"] + 1})
    elif harm == "entries":
        document = read_json(owner, "cache")
        entries = {name: document[name] for name in document if name not in ("format", "version")}
        write_checked(owner, "cache", entries | {"geometry": {}})
    else:
        owner.write_bytes(owner.read_bytes()[:-9])
    outcome = run("cache verify meshes")
    assert (outcome.status, outcome.fields()["damaged files"], outcome.fields()["incomplete"]) == (
        1,
        "1",
        "0",
    )
    told = [line for line in outcome.out.splitlines() if "  " not in line]
    assert [line.split(": ")[0] for line in told] == ["damaged", "the other files of meshes were not read"]
    assert outcome.out.count("isosample precompute") == 1
    assert len(json.loads(run("cache verify meshes --json").out)["remedies"]) == 1
    if harm == "version":
        assert "take another --cache folder, or delete this one" in outcome.out
        return
    assert "Remove this one file" in outcome.out
    owner.unlink()
    assert run("precompute blob.npy --tf tf.json --cache meshes").status == 0
    assert content(cache) == whole


def other_scene(run: Run) -> None:
    """Make the folder's scene another one; what tf.json needed stays, and the scene that is there knows none of it."""
    moved = {"points": [{**point, "value": point["value"] + 1} for point in TF["points"]]}
    write_json(Path("other.json"), moved)
    assert run("precompute blob.npy --tf other.json --cache meshes").status == 0


def chunk_of(folder: Path, isovalue: float) -> Path:
    """The chunk of an isosurface of any scene that the folder held; blob.npy has one brick."""
    lists = [rows_of_arrays(read_arrays(path, {})[0], path) for path in folder.glob("surfaces/*.npz")]
    (key,) = [key for rows in lists for key in rows["key"][rows["isovalue"] == isovalue].tolist()]
    return ChunkFolder(folder).path(key.decode())


@pytest.mark.parametrize("harm", ["damage", "eviction"])
def test_the_remedy_restores_the_scene_that_lacks_something(run: Run, cache: Path, harm: str) -> None:
    """Of a scene that the folder held before, whose transfer function it does not know, as of the one that it holds."""
    first = set(open_cache(cache).surfaces.isovalues.tolist())
    other_scene(run)
    second = set(open_cache(cache).surfaces.isovalues.tolist())
    whole = content(cache)

    def harmed(isovalue: float) -> str:
        path = chunk_of(cache, isovalue)
        if harm == "damage":
            path.write_bytes(path.read_bytes()[:50])
        else:
            path.unlink()
        outcome = run("cache verify meshes")
        assert outcome.status == (1 if harm == "damage" else 0)
        return outcome.out

    gone = max(first - second)
    told = harmed(gone)
    assert "remedy for the scene of meshes" not in told
    others = (
        "remedy for meshes that the scene of meshes does not need (of other transfer functions or options, or"
    )
    assert others in told
    assert f"of isosurface {gone!r}: the folder does not know what they were made for" in told
    assert run("precompute blob.npy --tf other.json --cache meshes").status == 0
    told = run("cache verify meshes").out  # what restores the one leaves the other
    assert others in told
    assert run("precompute blob.npy --tf tf.json --cache meshes").status == 0
    assert "remedy" not in run("cache verify meshes").out
    assert run("precompute blob.npy --tf other.json --cache meshes").status == 0
    assert content(cache) == whole

    told = harmed(max(second - first))
    assert others not in told
    assert "remedy for the scene of meshes (13 isosurfaces from 21 to 81 of blob.npy)" in told
    assert "same volume, transfer function, options and --cache" in told
    assert run("precompute blob.npy --tf other.json --cache meshes").status == 0
    assert content(cache) == whole


def test_damage_that_no_scene_is_known_to_need_is_told_as_that(run: Run, cache: Path) -> None:
    """A piece whose list is damaged, too, of which the list is the scene's still; and a list of no scene."""
    lists = sorted(cache.glob("surfaces/*.npz"))
    rows = rows_of_arrays(read_arrays(lists[0], {})[0], lists[0])
    path = ChunkFolder(cache).path(rows["key"][0].decode())
    for harmed in (lists[0], path):
        harmed.write_bytes(harmed.read_bytes()[:50])
    remedies = json.loads(run("cache verify meshes --json").out)["remedies"]
    assert [line.split(" of meshes")[0] for line in remedies] == ["remedy for the scene", "1 damaged file"]
    (cache / "scene.json").unlink()
    remedies = json.loads(run("cache verify meshes --json").out)["remedies"]
    assert [line.split(" of meshes")[0] for line in remedies] == ["2 damaged files"]


@pytest.mark.parametrize("harm", ["damaged", "missing", "later"])
def test_where_no_scene_can_be_read_nothing_is_told_to_be_of_another(
    run: Run, cache: Path, harm: str
) -> None:
    """The pieces are those of the scene that was there, which nothing tells any more."""
    whole = content(cache)
    path = cache / "scene.json"
    if harm == "damaged":
        path.write_text("{}")
    elif harm == "missing":
        path.unlink()
    else:  # understood but for the last of what is made of it
        document = read_json(path, "scene")
        entries = {name: document[name] for name in document if name not in ("format", "version")}
        write_checked(path, "scene", entries | {"plan": {}})
    chunks(cache)[0].unlink()
    found = json.loads(run("cache verify meshes --json").out)
    assert [row["pieces_missing"] for row in found["incomplete"]] == [1]
    assert [row["scene_pieces_missing"] for row in found["incomplete"]] == [None]
    told = run("cache verify meshes").out
    assert "other transfer functions" not in told
    assert "of them of its scene" not in told
    assert (
        "remedy for meshes of meshes, which has no scene that tells whether it needs them, of isosurf" in told
    )
    assert run("precompute blob.npy --tf tf.json --cache meshes").status == 0
    assert content(cache) == whole


def test_coarser_tries_of_a_refinement_are_not_called_another_scene(run: Run) -> None:
    """The scene needs the finest of them, and all were made by its own command."""
    words = "precompute blob.npy --tf tf.json --per-slope 0 --refine auto --cache tried"
    assert run(words).status == 0
    folder = Path("tried")
    whole = content(folder)
    own = set(open_cache(folder).surfaces.chunk_table["key"].tolist())
    tried = [path for path in chunks(folder) if path.stem.encode() not in own]
    assert tried
    tried[0].write_bytes(tried[0].read_bytes()[:50])
    told = run("cache verify tried").out
    assert "remedy for the scene" not in told
    assert "or of coarser tries of --refine auto), of isosurface" in told
    assert run(words).status == 0
    assert content(folder) == whole

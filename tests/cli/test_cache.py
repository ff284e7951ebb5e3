"""`cache` lists, verifies and prunes the caches of meshes."""

from __future__ import annotations

import json
import os
import re
import shutil
from typing import TYPE_CHECKING

import pytest

from cli.harness import Run, content

if TYPE_CHECKING:
    from pathlib import Path


def chunks(folder: Path) -> list[Path]:
    return sorted(folder.glob("chunks/*/*.chunk"))


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
    assert heads.split() == ["cache", "volume", "samples", "isosurfaces", "meshes", "size", "used"]
    assert row.split()[:5] == ["meshes", "blob.npy", "10x9x8", str(entry["surfaces"]), str(entry["chunks"])]
    assert total.startswith("1 cache, ")


def test_the_folder_of_all_caches_is_the_default(
    run: Run, cache: Path, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    outcome = run("cache ls")
    assert outcome.status == 2
    assert "meshes_cache does not exist" in outcome.err
    (folder / "all").mkdir()
    for name in ("one", "two"):
        shutil.copytree(cache, folder / "all" / name)
    monkeypatch.setenv("ISOSAMPLE_CACHE", "all")
    found = json.loads(run("cache ls --json").out)["caches"]
    assert [entry["folder"] for entry in found] == ["all/one", "all/two"]
    (folder / "all" / "two" / "volume.json").write_text('{"format": "isosample cache", "version": 2}')
    outcome = run("cache ls")
    assert outcome.status == 0
    assert "cannot be used: all/two/volume.json has format version 2" in outcome.out


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
    assert re.search(r"incomplete: meshes: 1 of \d+ pieces were evicted; run precompute again", outcome.out)
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
        f"warning: 1 damaged chunks of meshes were extracted again; the first: meshes/chunks/{first.stem[:2]}"
        in (outcome.err)
    )
    assert content(cache) == whole
    assert run("cache verify meshes").status == 0


def test_prune_removes_what_was_used_longest_ago_first(run: Run, cache: Path) -> None:
    there = chunks(cache)
    for number, path in enumerate(there):
        os.utime(path, (1e9 + number, 1e9 + number))
    sizes = [path.stat().st_size for path in there]
    budget = sum(sizes[3:])
    assert (
        run(f"cache prune meshes --budget {(budget + 1) / 1024:.9f}KiB --dry-run")
        .fields()["would remove"]
        .startswith("3 ")
    )
    assert chunks(cache) == there
    foretold = run(f"cache prune meshes --budget {(budget + 1) / 1024:.9f}KiB --dry-run --json")
    assert json.loads(foretold.out)["bytes_left"] == budget
    outcome = run(f"cache prune meshes --budget {(budget + 1) / 1024:.9f}KiB")
    assert outcome.status == 0
    assert outcome.fields()["removed"].startswith("3 meshes, ")
    assert chunks(cache) == there[3:]
    assert json.loads(run("cache prune meshes --budget 1GiB --json").out)["bytes_left"] == budget
    assert "is missing" in run("render meshes -o out.png --size 16x16").err
    verified = run("cache verify meshes --json")  # what made room is no damage
    assert verified.status == 0
    found = json.loads(verified.out)
    assert found["damaged"] == []
    assert [(row["cache"], row["pieces_missing"]) for row in found["incomplete"]] == [("meshes", 3)]


@pytest.mark.parametrize(
    ("words", "named"),
    [
        ("cache", "ls|verify|prune"),
        ("cache rm", "'rm'"),
        ("cache prune meshes", "--budget"),
        ("cache prune meshes --budget lots", "'lots'"),
        ("cache ls meshes --budget 1GiB", "--budget"),
        ("cache verify absent", "absent does not exist"),
        ("cache ls tf.json", "tf.json is not a folder"),
        ("cache ls .", "not a mesh cache"),
    ],
)
def test_a_wrong_command_is_named_in_one_line(run: Run, words: str, named: str) -> None:
    outcome = run(words)
    assert (outcome.status, outcome.out, outcome.err.count("\n")) == (2, "", 1)
    assert named in outcome.err

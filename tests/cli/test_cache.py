"""`cache` lists and prunes the caches of meshes."""

from __future__ import annotations

import json
import os
import shutil
from typing import TYPE_CHECKING

import pytest

from cli.harness import Run, chunks, content

if TYPE_CHECKING:
    from pathlib import Path


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
    assert [row.split()[-1] for row in outcome.out.splitlines()[1:3]] == ["complete", "unusable"]


def interrupt(monkeypatch: pytest.MonkeyPatch, run: Run, words: str) -> None:
    """Run `precompute` as if Ctrl-C were pressed before the scene is written."""
    from isosample.surfaces import cache

    def pressed(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patched:
        patched.setattr(cache, "write_cache", pressed)
        outcome = run(f"precompute {words}")
    assert outcome.status == 130
    assert "what was extracted is kept" in outcome.err


@pytest.mark.parametrize("more", ["", "--memory 16GiB"])
@pytest.mark.parametrize("render", ["render half -o out.png", "render half --tf tf.json -o out.png"])
def test_an_interrupted_cache_is_told_as_such_and_goes_on(
    run: Run, request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch, more: str, render: str
) -> None:
    request.getfixturevalue("gl")
    words = f"blob.npy --tf tf.json --cache half {more}"
    interrupt(monkeypatch, run, words)
    told = "half was not finished"
    outcome = run(render)
    assert (outcome.status, outcome.err.count("\n")) == (2, 1)
    for cure in (told, "isosample precompute", "same volume and --cache", "goes on from there"):
        assert cure in outcome.err
    assert "elete" not in outcome.err
    verified = run("cache verify half")
    assert (verified.status, verified.fields()["damaged files"]) == (0, "0")
    assert verified.fields()["incomplete"] == "1"
    assert f"incomplete: {told}" in verified.out
    assert json.loads(run("cache verify half --json").out)["unfinished"] == ["half"]
    listed = run("cache ls half")
    assert listed.out.splitlines()[1].split()[3] == "?"
    assert listed.out.splitlines()[1].split()[-1] == "unfinished"
    assert f"incomplete: {told}" in listed.out
    (entry,) = json.loads(run("cache ls half --json").out)["caches"]
    assert (entry["finished"], entry["state"]) == (False, "unfinished")
    finished = run(f"precompute {words}")
    assert finished.fields()["levels"] == "13 (13 reused)"
    assert run("cache verify half").fields()["incomplete"] == "0"
    assert run(render).status == 0


@pytest.mark.parametrize("name", ["scene.json", "boundary.npz", "volume.json"])
def test_the_cure_that_a_damaged_file_names_keeps_the_meshes(run: Run, cache: Path, name: str) -> None:
    whole = content(cache)
    (cache / name).write_bytes((cache / name).read_bytes()[:-9])
    outcome = run("render meshes -o out.png")
    assert outcome.status == 2
    assert "elete" not in outcome.err
    assert "isosample precompute` again with the same" in outcome.err
    if name == "volume.json":
        assert "Remove this one file" in outcome.err
        (cache / name).unlink()
    again = run("precompute blob.npy --tf tf.json --cache meshes")
    assert again.fields()["levels"] == "13 (13 reused)"
    assert content(cache) == whole


def test_prune_removes_what_was_used_longest_ago_first(run: Run, cache: Path) -> None:
    there = chunks(cache)
    for number, path in enumerate(there):
        os.utime(path, (1e9 + number, 1e9 + number))
    sizes = [path.stat().st_size for path in there]
    budget = sum(sizes[3:])
    pretended = run(f"cache prune meshes --budget {(budget + 1) / 1024:.9f}KiB --dry-run")
    assert pretended.fields()["would remove"].startswith("3 ")
    assert "incomplete" not in pretended.out
    assert chunks(cache) == there
    foretold = run(f"cache prune meshes --budget {(budget + 1) / 1024:.9f}KiB --dry-run --json")
    assert json.loads(foretold.out)["bytes_left"] == budget
    outcome = run(f"cache prune meshes --budget {(budget + 1) / 1024:.9f}KiB")
    assert outcome.status == 0
    assert outcome.fields()["removed"].startswith("3 meshes, ")
    assert (
        "meshes is now incomplete: 3 pieces of its scene are not there (evicted or removed): it cannot be "
        "rendered until `isosample precompute`" in outcome.out
    )
    assert chunks(cache) == there[3:]
    assert json.loads(run("cache prune meshes --budget 1GiB --json").out)["bytes_left"] == budget
    assert "is missing" in run("render meshes -o out.png --size 16x16").err
    verified = run("cache verify meshes --json")  # what made room is no damage
    assert verified.status == 0
    found = json.loads(verified.out)
    assert found["damaged"] == []
    assert [(row["cache"], row["pieces_missing"]) for row in found["incomplete"]] == [("meshes", 3)]


def test_prune_goes_on_after_a_folder_whose_scene_cannot_be_used(run: Run, cache: Path) -> None:
    shutil.copytree(cache, cache.parent / "more")
    (cache / "scene.json").write_text("{}")
    outcome = run("cache prune meshes more --budget 1KiB")
    assert (outcome.status, outcome.err) == (0, "")
    assert "cannot be used: meshes/scene.json is not an isosample scene" in outcome.out
    assert "more is now incomplete" in outcome.out


def test_prune_removes_what_killed_processes_left(run: Run, cache: Path) -> None:
    there = chunks(cache)
    left = cache / "surfaces" / f".{'0' * 32}.tmp"
    left.write_bytes(b"half a list")
    os.utime(left, (1e9, 1e9))
    foretold = json.loads(run("cache prune meshes --budget 1GiB --dry-run --json").out)["removed"]
    assert [(row["chunks"], row["leftovers"], row["leftover_bytes"]) for row in foretold] == [(0, 1, 11)]
    assert left.exists()
    outcome = run("cache prune meshes --budget 1GiB")
    assert "removed 1 half-written file (11 bytes) of meshes" in outcome.out
    assert outcome.fields()["removed"].startswith("0 meshes")
    assert not left.exists()
    assert chunks(cache) == there


@pytest.mark.usefixtures("cache")
@pytest.mark.parametrize(
    "words",
    [
        "cache prune --budget 1GiB --dry-run --json meshes",
        "cache prune --dry-run meshes --json --budget 1GiB",
        "cache --json prune meshes --budget 1GiB --dry-run",
    ],
)
def test_folder_and_options_stand_in_any_order(run: Run, words: str) -> None:
    expected = run("cache prune meshes --budget 1GiB --dry-run --json")
    assert expected.status == 0
    assert run(words) == expected
    for action in ("ls", "verify"):
        assert run(f"cache {action} --json meshes") == run(f"cache {action} meshes --json")


def test_several_folders_may_stand_about_an_option(run: Run, cache: Path) -> None:
    shutil.copytree(cache, cache.parent / "more")
    found = json.loads(run("cache verify meshes --json more").out)["caches"]
    assert found == ["meshes", "more"]


@pytest.mark.parametrize(
    ("words", "named"),
    [
        ("cache", "ls|verify|prune"),
        ("cache ls --jsno meshes", "unexpected argument '--jsno' (did you mean --json?)"),
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

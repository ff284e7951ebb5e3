"""A folder of one's own with a volume and a transfer function, a cache of them, and `run`."""

from __future__ import annotations

import math
import shutil
from typing import TYPE_CHECKING

import pytest

from cli.harness import Outcome, Run, words_of, write_scene
from isosample.cli import console, main

if TYPE_CHECKING:
    from pathlib import Path


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The current folder, which holds blob.npy and tf.json; the user's settings do not reach the test."""
    place = tmp_path / "here"
    place.mkdir()
    write_scene(place)
    monkeypatch.chdir(place)
    monkeypatch.setattr(
        console, "MOMENT", math.inf
    )  # on a slow machine nothing more is told than on a fast one
    monkeypatch.setattr("isosample.compiled.PATIENCE", math.inf)
    for variable in ("ISOSAMPLE_CACHE", "ISOSAMPLE_GL_BACKEND", "NO_COLOR", "FORCE_COLOR", "COLUMNS"):
        monkeypatch.delenv(variable, raising=False)
    return place


@pytest.fixture
def run(capfd: pytest.CaptureFixture[str]) -> Run:
    """Run one command in this process; what libraries write past Python is caught, too."""

    def run_here(*arguments: str | Path) -> Outcome:
        capfd.readouterr()
        status = main(words_of(arguments))
        return Outcome(status, *capfd.readouterr())

    return run_here


@pytest.fixture(scope="session")
def made_cache(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Cache folder of blob.npy with tf.json, made once; use `cache` for a copy."""
    place = tmp_path_factory.mktemp("made")
    write_scene(place)
    words = ["precompute", str(place / "blob.npy"), "--tf", str(place / "tf.json")]
    assert main([*words, "--cache", str(place / "meshes")]) == 0
    return place / "meshes"


@pytest.fixture
def cache(folder: Path, made_cache: Path) -> Path:
    """The folder `meshes` in the current folder: a cache of blob.npy with tf.json."""
    shutil.copytree(made_cache, folder / "meshes")
    return folder / "meshes"

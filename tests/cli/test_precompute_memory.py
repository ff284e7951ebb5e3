"""`precompute --memory` reads a volume piece by piece, keeps to its budget, and goes on where a killed run ended."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from cli.harness import ROOT, TF, Run, blob, content, write_json

if TYPE_CHECKING:
    import numpy.typing as npt

EDGE = 256
LEVELS = (30, 55, 80, 105, 130, 155, 180, 205)
BUDGET = 512
PATIENCE = 120.0  # seconds


def test_a_lazy_volume_leaves_the_folder_that_a_volume_in_memory_leaves(run: Run, folder: Path) -> None:
    zarr = pytest.importorskip("zarr")
    samples = blob()
    zarr.create_array(folder / "blob.zarr", shape=samples.shape, chunks=(3, 4, 5), dtype="f4")[...] = samples
    assert run("precompute blob.npy --tf tf.json --cache memory").status == 0
    outcome = run("precompute blob.zarr --tf tf.json --cache lazy --memory 16GiB")
    assert outcome.status == 0, outcome.err
    fields = outcome.fields()
    assert fields["levels"] == "13 (0 reused)"
    assert fields["pieces"].endswith("(0 reused)")
    assert fields["peak memory"].endswith(("MiB", "GiB"))  # of the process, which holds what other tests left
    memory, lazy = content(folder / "memory"), content(folder / "lazy")
    chunks = {name for name in memory if name.endswith(".chunk")}
    assert chunks
    assert chunks == {name for name in lazy if name.endswith(".chunk")}
    for name in (*chunks, "scene.json"):
        assert memory[name] == lazy[name], name


@pytest.mark.parametrize("most", [1, 10**9])
def test_automatic_refinement_ends_where_it_ends_in_memory(
    run: Run, folder: Path, monkeypatch: pytest.MonkeyPatch, most: int
) -> None:
    """Noise does not come within 0.01 voxel of its isosurfaces, however finely it is divided."""
    np.save("noise.npy", np.random.default_rng(3).random((6, 6, 6)).astype(np.float32) * 100.0)
    monkeypatch.setattr("isosample.rendering.refinement.DEFAULT_MAX_TRIANGLES", most)
    told = []
    for name, more in (("memory", ""), ("stored", "--memory 16GiB")):
        outcome = run(f"precompute noise.npy --tf tf.json --refine auto --cache {name} {more}")
        assert outcome.status == 0, outcome.err
        told += [line for line in outcome.out.splitlines() if "--refine auto ended at" in line]
    assert len(told) == 2
    assert told[0] == told[1]
    memory, stored = content(folder / "memory"), content(folder / "stored")
    assert memory["scene.json"] == stored["scene.json"]
    chunks = [{name for name in found if name.endswith(".chunk")} for found in (memory, stored)]
    assert chunks[0] == chunks[1]


def test_a_second_run_looks_at_nothing_again(run: Run, folder: Path) -> None:
    words = "precompute blob.npy --tf tf.json --memory 16GiB --cache meshes"
    assert run(words).status == 0
    before = content(folder / "meshes")
    (scan,) = [name for name in before if name.startswith("scan-")]
    outcome = run(words)
    assert outcome.fields()["levels"] == "13 (13 reused)"
    assert content(folder / "meshes") == before
    np.save("blob.npy", blob() + 1)
    outcome = run(words)
    assert outcome.status == 2  # the scan is outdated, and the folder another volume's
    assert "another volume" in outcome.err
    assert content(folder / "meshes")[scan] == before[scan]


def test_the_default_folder_is_found_without_looking_through_the_volume(
    run: Run, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    words = "precompute blob.npy --tf tf.json --memory 16GiB"
    first = run(words).fields()["cache"]
    assert first == run("precompute blob.npy --tf tf.json").fields()["cache"]

    def refuse(*_arguments: Any, **_options: Any) -> None:
        raise AssertionError("the volume was scanned again")

    monkeypatch.setattr("isosample.volume.scan.scan_volume", refuse)
    assert run(words).fields()["cache"] == first


def test_pieces_are_reused_when_a_point_moves(run: Run, folder: Path) -> None:
    words = "precompute blob.npy --memory 16GiB --cache meshes"
    assert run(f"{words} --tf tf.json").status == 0
    points = [dict(point) for point in TF["points"]]
    points[2]["value"] = 89
    write_json(Path("moved.json"), {"points": points})
    assert run(f"{words} --tf moved.json").fields()["levels"] == "13 (7 reused)"


@pytest.mark.usefixtures("gl")
def test_meshes_that_stay_in_their_folder_give_the_bits_of_those_in_memory(
    run: Run, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    view = "--size 24x16 --azimuth 30 --elevation -20"
    assert run("precompute blob.npy --tf tf.json --memory 16GiB --cache meshes").status == 0
    assert run(f"render meshes -o memory.npy {view}").status == 0
    monkeypatch.setattr("isosample.cli.cached_scenes.LARGEST_IN_MEMORY", 0)
    monkeypatch.setattr("isosample.surfaces.cache.in_memory", None)  # would load them all
    monkeypatch.setattr("isosample.surfaces.cached_surfaces.in_memory", None)
    picture = np.load("memory.npy")
    assert picture[..., 3].max() > 0.5
    for options in ("", "--tf tf.json"):  # the scene as it is, and surfaces chosen from it
        outcome = run(f"render meshes -o stored.npy {view} {options}")
        assert outcome.status == 0, outcome.err
        assert (folder / "memory.npy").read_bytes() == (folder / "stored.npy").read_bytes()


@pytest.mark.parametrize("size", ["0GiB", "-1GiB", "much", "2", "2 apples", "99999999TiB", "GiB"])
def test_a_size_that_is_none_is_refused(run: Run, size: str) -> None:
    outcome = run("precompute", "blob.npy", "--tf", "tf.json", f"--memory={size}")
    assert outcome.status == 2
    assert "no size of memory" in outcome.err


@pytest.mark.parametrize(
    ("options", "named"),
    [
        ("--memory 10MiB", "too small"),
        ("--memory 16GiB --tolerance 0.01", "--memory"),
        ("--memory 16GiB --reconstruction cubic", "--memory"),
    ],
)
def test_what_a_budget_cannot_do_is_told(run: Run, options: str, named: str) -> None:
    outcome = run(f"precompute blob.npy --tf tf.json --cache meshes {options}")
    assert outcome.status == 2
    assert named in outcome.err


def blobs() -> npt.NDArray[np.uint8]:
    """(256, 256, 256) samples between 0 and 255: two smooth blobs."""
    axis = np.linspace(-1, 1, EDGE, dtype=np.float32)
    total = np.zeros((EDGE,) * 3, dtype=np.float32)
    for centre, width, height in ((-0.3, 0.3, 200), (0.4, 0.2, 220)):
        bell = np.exp(-(((axis - centre) / width) ** 2))
        total += height * bell[:, None, None] * bell[None, :, None] * bell[None, None, :]
    return np.rint(total).astype(np.uint8)


def start(folder: Path, cache: str) -> subprocess.Popen[bytes]:
    """Begin the extraction of blobs.raw in a process of its own."""
    words = [
        "precompute",
        "blobs.raw",
        "--shape",
        f"{EDGE},{EDGE},{EDGE}",
        "--dtype",
        "uint8",
        "--tf",
        "eight.json",
    ]
    return subprocess.Popen(
        [sys.executable, "-m", "isosample", *words, "--memory", f"{BUDGET}MiB", "--cache", cache],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    )


def finish(process: subprocess.Popen[bytes]) -> tuple[dict[str, str], float]:
    """Wait for the end of a run; return the fields it told and the most memory it held [MiB].

    That is the kernel's figure for the process (VmHWM); what wait4 gives counts the test's own memory, too.
    """
    text, errors = process.communicate()
    assert process.returncode == 0, errors
    pairs = [line.split("  ", 1) for line in text.decode().splitlines() if "  " in line]
    fields = {name: value.strip() for name, value in pairs}
    amount, unit = fields["peak memory"].split()
    assert unit == "MiB"
    return fields, float(amount)


def count_chunks(folder: Path) -> int:
    return sum(1 for _ in folder.glob("chunks/*/*.chunk"))


def test_a_run_killed_in_the_middle_goes_on_and_leaves_what_an_unbroken_one_leaves(folder: Path) -> None:
    """SIGKILL: nothing is cleaned up. Budget and result of both runs are measured from outside."""
    blobs().tofile(folder / "blobs.raw")
    surfaces = [{"value": value, "color": [1, 1, 1], "opacity": 0.2} for value in LEVELS]
    (folder / "eight.json").write_text(json.dumps({"isosurfaces": surfaces}))
    whole, peak = finish(start(folder, "whole"))
    assert 50 < peak <= BUDGET
    wanted = count_chunks(folder / "whole")
    killed = start(folder, "killed")
    deadline = time.monotonic() + PATIENCE
    while count_chunks(folder / "killed") < wanted // 3:
        assert killed.poll() is None, "the run ended before it was killed"
        assert time.monotonic() < deadline
        time.sleep(0.005)
    killed.send_signal(signal.SIGKILL)
    killed.communicate()
    assert killed.returncode == -signal.SIGKILL
    kept = count_chunks(folder / "killed")
    assert wanted // 3 <= kept < wanted
    assert not (folder / "killed" / "scene.json").exists()
    fields, peak = finish(start(folder, "killed"))
    assert peak <= BUDGET
    assert fields["pieces"] == f"{wanted} ({kept} reused)"
    assert fields["triangles"] == whole["triangles"]
    expected, found = content(folder / "whole"), content(folder / "killed")
    leftovers = {name for name in found if Path(name).name.startswith(".") and name.endswith(".tmp")}
    same = {name for name in expected if name.endswith((".chunk", ".npz", ".json"))}
    assert found.keys() - leftovers == expected.keys()
    assert {name for name in same if found[name] != expected[name]} == set()
    shutil.rmtree(folder / "killed")

"""Volumes larger than memory: throughput, peak memory, going on after kill -9.

python -m benchmarks.bench_scale [--full]
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from benchmarks.machine import table

QUICK_EDGE, FULL_EDGE = 256, 1024
MEMORY = {QUICK_EDGE: "512MiB", FULL_EDGE: "2GiB"}
CHUNK = 64
SLAB = 64
LEVELS = (30, 55, 80, 105, 130, 155, 180, 205)
POLL_SECONDS = 0.02


@dataclass(frozen=True, slots=True, kw_only=True)
class Outcome:
    """What one run took: seconds, those of all cores together, bytes at the peak, and the lines it wrote."""

    seconds: float
    core_seconds: float
    peak: int
    fields: dict[str, str]


def slab(edge: int, z: int, depth: int) -> npt.NDArray[np.uint8]:
    """(depth, edge, edge) samples from slice z on: four blobs and long waves, 0 to 255."""
    step = 2.0 / (edge - 1)
    zs, ys, xs = (
        (np.arange(first, first + count, dtype=np.float32) * step - 1.0)
        for first, count in ((z, depth), (0, edge), (0, edge))
    )
    field = np.zeros((depth, edge, edge), dtype=np.float32)
    for cx, cy, cz, width, height in (
        (-0.3, 0.1, 0.0, 0.3, 200),
        (0.35, -0.2, 0.2, 0.22, 170),
        (0.1, 0.5, -0.4, 0.18, 150),
        (-0.2, -0.5, 0.5, 0.12, 230),
    ):
        x, y, w = (np.exp(-(((axis - c) / width) ** 2)) for axis, c in ((xs, cx), (ys, cy), (zs, cz)))
        field += height * w[:, None, None] * y[None, :, None] * x[None, None, :]
    field += (
        6.0 * np.sin(9 * zs)[:, None, None] * np.sin(7 * ys)[None, :, None] * np.sin(8 * xs)[None, None, :]
    )
    samples: npt.NDArray[np.uint8] = np.clip(np.rint(field + 6.0), 0, 255).astype(np.uint8)
    return samples


def make(folder: Path, edge: int) -> tuple[Path, Path, Path]:
    """Write the volume as raw samples and as Zarr, slab by slab, and a transfer function of eight isovalues."""
    import zarr

    raw, chunked, tf = folder / "volume.raw", folder / "volume.zarr", folder / "tf.json"
    array = zarr.create_array(chunked, shape=(edge,) * 3, chunks=(CHUNK,) * 3, dtype="uint8")
    with raw.open("wb") as file:
        for z in range(0, edge, SLAB):
            samples = slab(edge, z, SLAB)
            file.write(samples.tobytes())
            array[z : z + SLAB] = samples
    surfaces = [{"value": value, "color": [1, 1, 1], "opacity": 0.2} for value in LEVELS]
    tf.write_text(json.dumps({"isosurfaces": surfaces}), encoding="utf-8")
    return raw, chunked, tf


def command(source: Path, tf: Path, cache: Path, edge: int) -> list[str]:
    """Words of one `precompute`."""
    words = [sys.executable, "-m", "isosample", "precompute", str(source), "--tf", str(tf)]
    if source.suffix == ".raw":
        words += ["--shape", f"{edge},{edge},{edge}", "--dtype", "uint8"]
    return [*words, "--cache", str(cache), "--memory", MEMORY[edge]]


def run(words: list[str], *, kill_at: int | None = None, cache: Path | None = None) -> Outcome:
    """Run a command to its end, or kill it as soon as the cache holds so many chunks.

    The peak is the kernel's own figure (VmHWM), looked at every few milliseconds; ru_maxrss would not do, since a
    process inherits that of the one that starts it.
    """
    start = time.perf_counter()
    peak = 0
    with tempfile.TemporaryFile() as out, tempfile.TemporaryFile() as err:
        process = subprocess.Popen(words, stdout=out, stderr=err)
        while True:
            ended, status, usage = os.wait4(process.pid, os.WNOHANG)
            if ended:
                break
            peak = max(peak, high_water(process.pid))
            if kill_at is not None and cache is not None and count_chunks(cache) >= kill_at:
                os.kill(process.pid, signal.SIGKILL)
            time.sleep(POLL_SECONDS)
        process.returncode = os.waitstatus_to_exitcode(status)
        texts = []
        for file in (out, err):
            file.seek(0)
            texts.append(file.read().decode())
    if process.returncode not in (0, -signal.SIGKILL):
        raise RuntimeError(f"{words} ended with {process.returncode}: {texts[1]}")
    pairs = [line.split("  ", 1) for line in texts[0].splitlines() if "  " in line]
    return Outcome(
        seconds=time.perf_counter() - start,
        core_seconds=usage.ru_utime + usage.ru_stime,
        peak=peak,
        fields={name: value.strip() for name, value in pairs},
    )


def high_water(process: int) -> int:
    """Most memory that a process ever held [bytes]; 0 where it is gone."""
    try:
        lines = Path(f"/proc/{process}/status").read_text(encoding="utf-8").splitlines()
    except OSError:
        return 0
    return next((int(line.split()[1]) * 1024 for line in lines if line.startswith("VmHWM:")), 0)


def count_chunks(cache: Path) -> int:
    """Chunks that are whole in a cache folder."""
    return sum(1 for _ in cache.glob("chunks/*/*.chunk"))


def content(cache: Path) -> dict[str, str]:
    """Digest of every chunk and list of a cache folder."""
    files = [*cache.glob("chunks/*/*.chunk"), *cache.glob("surfaces/*.npz"), cache / "scene.json"]
    return {str(path.relative_to(cache)): hashlib.sha256(path.read_bytes()).hexdigest() for path in files}


def measure(folder: Path, edge: int) -> str:
    """Extract from raw and from Zarr; kill and go on; render; return the tables."""
    raw, chunked, tf = make(folder, edge)
    rows: list[tuple[object, ...]] = []

    def add(what: str, outcome: Outcome) -> None:
        voxels = edge**3 / outcome.core_seconds / 1e6
        triangles = int(outcome.fields.get("triangles", "0").replace(" ", ""))
        rate = triangles / outcome.core_seconds / 1e6
        rows.append(
            (
                what,
                f"{outcome.seconds:.1f} s",
                f"{outcome.core_seconds:.1f} s",
                f"{outcome.peak / 2**20:.0f} MiB",
                outcome.fields.get("pieces", "–"),
                f"{triangles:,}" if triangles else "–",
                outcome.fields.get("size", "–"),
                f"{voxels:.0f}",
                f"{rate:.2f}" if triangles else "–",
            )
        )

    caches = {name: folder / name for name in ("from_raw", "from_zarr", "killed")}
    add("raw", run(command(raw, tf, caches["from_raw"], edge)))
    add("Zarr", run(command(chunked, tf, caches["from_zarr"], edge)))
    add("Zarr, again", run(command(chunked, tf, caches["from_zarr"], edge)))
    words = command(chunked, tf, caches["killed"], edge)
    add("killed with -9", run(words, kill_at=count_chunks(caches["from_zarr"]) // 2, cache=caches["killed"]))
    kept = count_chunks(caches["killed"])
    add("going on", run(words))
    same = content(caches["killed"]) == content(caches["from_zarr"]) == content(caches["from_raw"])
    render = [sys.executable, "-m", "isosample", "render", str(caches["from_zarr"]), "--size", "512x512"]
    add("render from the cache alone", run([*render, "-o", str(folder / "picture.npy")]))
    heads = (
        "run",
        "time",
        "of all cores",
        "peak memory",
        "pieces",
        "triangles",
        "cache",
        "Mvoxels per core second",
        "Mtriangles per core second",
    )
    title = f"## Larger than memory with {edge}³ samples: uint8, {len(LEVELS)} isovalues, --memory {MEMORY[edge]}\n\n"
    told = (
        f"\nThe killed run left {kept:,} whole chunks. Chunks, lists and scene of the resumed run, of the run from "
        f"Zarr and of the run from raw are {'identical' if same else 'DIFFERENT'}, byte for byte.\n"
    )
    return title + table(heads, rows) + told


def report(*, quick: bool, full: bool = False) -> str:
    """Tables of the small volume, and of the large one where it is asked for."""
    del quick  # the small volume is quick
    parts = []
    for edge in (QUICK_EDGE, *([FULL_EDGE] if full else [])):
        folder = Path(tempfile.mkdtemp(prefix="isosample-scale-"))
        try:
            parts.append(measure(folder, edge))
        finally:
            shutil.rmtree(folder)
    return "\n".join(parts)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(prog="python -m benchmarks.bench_scale", description=__doc__)
    parser.add_argument(
        "--full", action="store_true", help="also 1024³: 1 GiB as raw and as Zarr, minutes, some GiB of disk"
    )
    print(report(quick=True, full=parser.parse_args().full))

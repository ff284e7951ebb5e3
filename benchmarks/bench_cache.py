"""The mesh cache: bytes per triangle, loading against extraction, and what an edit of the transfer function costs."""

from __future__ import annotations

import tempfile
import time
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from benchmarks.bench_extract import noise, smooth, waves
from benchmarks.machine import median, table
from isosample.surfaces.cache import extract_with_cache, load_surface_set
from isosample.surfaces.chunk_decoding import decode
from isosample.surfaces.chunk_encoding import encode
from isosample.surfaces.extract import extract_surfaces
from isosample.surfaces.plain_chunks import decode_plain, encode_plain
from isosample.surfaces.settings import ExtractionSettings
from isosample.surfaces.store import MeshStore
from isosample.transfer.isovalues import plan_isovalues
from isosample.transfer.transfer_function import ControlPoint, TransferFunction

if TYPE_CHECKING:
    from collections.abc import Callable

    from isosample.surfaces.surface_set import SurfaceSet
    from isosample.volume.grid import F64, Volume

LEVELS = 26
WHO = """
`precompute`, and `render` with a cache folder, an error map or a tolerance, extract with residuals. Without them
extraction takes about as long as loading: there a cache spares the volume, not the time.
"""


def report(*, quick: bool) -> str:
    """Both tables."""
    edge = 64 if quick else 128
    volumes = {
        "two Gaussians": smooth(edge),
        "Marschner-Lobb": waves(edge),
        "noise, half the edge": noise(edge // 2),
    }
    repeats = 2 if quick else 5
    rows = [row for name, volume in volumes.items() for row in _load_rows(name, volume, repeats)]
    heads = (
        "field",
        "triangles",
        "chunks",
        "bytes per triangle",
        "extract",
        "extract and keep",
        "load",
        "extract / load",
        "encode, one thread",
        "decode, one thread",
    )
    return (
        f"## Mesh cache, {LEVELS} isovalues\n\n"
        + table(heads, rows)
        + WHO
        + "\n## Edits of a transfer function, with a cache folder\n\n"
        + table(
            ("edit", "seconds", "(isovalue, brick) pairs extracted", "pairs read"),
            _edit_rows(volumes["two Gaussians"], repeats),
        )
    )


def _load_rows(name: str, volume: Volume, repeats: int) -> list[tuple[object, ...]]:
    """One row without and one with residuals, and one of plain chunks; the three ways interleaved."""
    low, high = volume.value_range
    levels = low + (high - low) * (np.arange(LEVELS) + 0.5) / LEVELS
    kinds = ((False, False), (True, False), (False, True))
    return [_load_row(name, volume, levels, repeats, *kind) for kind in kinds]


def _load_row(
    name: str, volume: Volume, levels: F64, repeats: int, residuals: bool, plain: bool
) -> tuple[object, ...]:
    times: dict[str, list[float]] = {"extract": [], "keep": [], "load": []}
    for _ in range(repeats):
        with tempfile.TemporaryDirectory() as folder:
            surfaces = _timed(times["extract"], lambda: extract_surfaces(volume, levels, residuals=residuals))
            _timed(
                times["keep"],
                lambda: extract_with_cache(
                    volume, levels, folder, settings=ExtractionSettings(residuals=residuals), plain=plain
                ),
            )
            _timed(
                times["load"],
                lambda: load_surface_set(folder, levels, ExtractionSettings(residuals=residuals)),
            )
            chunks = MeshStore(Path(folder)).chunks()
    triangles = sum(surfaces.statistics.triangles)
    encoding, decoding = _codec_seconds(surfaces, repeats, plain=plain)
    return (
        f"{name}{', with residuals' * residuals}{', plain chunks' * plain}",
        f"{triangles:,}",
        f"{len(chunks):,}",
        f"{sum(chunk.size_bytes for chunk in chunks) / triangles:.2f}",
        median(times["extract"]),
        median(times["keep"]),
        median(times["load"]),
        f"{np.median(times['extract']) / np.median(times['load']):.2f}",
        f"{triangles / encoding / 1e6:.1f} M/s",
        f"{triangles / decoding / 1e6:.1f} M/s",
    )


def _timed(seconds: list[float], work: Callable[[], SurfaceSet]) -> SurfaceSet:
    start = time.perf_counter()
    found = work()
    seconds.append(time.perf_counter() - start)
    return found


def _codec_seconds(surfaces: SurfaceSet, repeats: int, *, plain: bool) -> tuple[float, float]:
    """Seconds of this thread to encode and to decode all meshes, the best of some."""
    write, read = (encode_plain, decode_plain) if plain else (encode, decode)
    encoding, decoding = [], []
    for _ in range(repeats):
        start = time.thread_time()
        chunks = [write(mesh) for mesh in surfaces.meshes]
        middle = time.thread_time()
        for chunk in chunks:
            read(chunk)
        encoding.append(middle - start)
        decoding.append(time.thread_time() - middle)
    return min(encoding), min(decoding)


def _edit_rows(volume: Volume, repeats: int) -> list[tuple[object, ...]]:
    """First extraction, other colours, other opacities, a moved peak; each edit follows the first in its own folder."""
    low, high = volume.value_range

    def transfer(peak: float, colour: tuple[float, float, float], extinction: float) -> TransferFunction:
        heights = ((0.1, 0.0), (0.2, 1.0), (0.3, 0.0), (0.5, 0.0), (peak, extinction), (0.9, 0.0))
        return TransferFunction(
            [ControlPoint(value=low + (high - low) * at, color=colour, extinction=x) for at, x in heights]
        )

    edits = {
        "none: the first extraction": None,
        "other colours": transfer(0.7, (0.0, 0.5, 1.0), 2.0),
        "another opacity": transfer(0.7, (1.0, 0.5, 0.0), 0.5),
        "a moved peak": transfer(0.72, (1.0, 0.5, 0.0), 2.0),
    }
    first = transfer(0.7, (1.0, 0.5, 0.0), 2.0)
    rows: list[tuple[object, ...]] = []
    for name, edited in edits.items():
        seconds: list[float] = []
        for _ in range(repeats):
            with tempfile.TemporaryDirectory() as folder:
                for tf in (first, edited) if edited is not None else (first,):
                    plan = plan_isovalues(tf, volume.value_range, per_slope=5)
                    start = time.perf_counter()
                    found = extract_with_cache(volume, plan.isovalues, folder).statistics
                seconds.append(time.perf_counter() - start)
        rows.append((name, median(seconds), f"{found.brick_visits:,}", f"{found.chunks_reused:,}"))
    return rows


if __name__ == "__main__":
    print(report(quick=True))

"""Extraction: 26 isovalues of three fields, against scikit-image called once per isovalue."""

from __future__ import annotations

import time

import numpy as np
from skimage.measure import marching_cubes

from benchmarks.machine import median, table
from isosample.surfaces.extract import extract_surfaces
from isosample.volume.analytic import GaussianMixture, MarschnerLobb, sample_field
from isosample.volume.grid import Volume

LEVELS = 26


def fields(edge: int) -> dict[str, Volume]:
    """A smooth field, one full of surface, and noise."""
    two = GaussianMixture(centres=((-0.4, 0, 0), (0.4, 0.1, 0)), widths=(0.25, 0.2), amplitudes=(1.0, 0.8))
    size, lower, upper = (edge, edge, edge), (-1.0, -1.0, -1.0), (1.0, 1.0, 1.0)
    waves = MarschnerLobb()
    noise = np.random.default_rng(5).random((edge // 2,) * 3, dtype=np.float32)
    return {
        "two Gaussians": sample_field(two, size, lower=lower, upper=upper, name="two Gaussians"),
        "Marschner-Lobb": sample_field(waves, size, lower=lower, upper=upper, name="Marschner-Lobb"),
        "noise, half the edge": Volume(noise, name="noise"),
    }


def report(*, quick: bool) -> str:
    """Seconds, interleaved, and triangles; ours with gradients, scikit-image's with its normals."""
    rows = []
    for name, volume in fields(64 if quick else 128).items():
        low, high = volume.value_range
        levels = low + (high - low) * (np.arange(LEVELS) + 0.5) / LEVELS
        ours: list[float] = []
        theirs: list[float] = []
        triangles = 0
        for _ in range(1 if quick else 5):
            start = time.perf_counter()
            surfaces = extract_surfaces(volume, levels)
            ours.append(time.perf_counter() - start)
            triangles = sum(surfaces.statistics.triangles)
            start = time.perf_counter()
            for level in levels:
                marching_cubes(volume.array, float(level))  # type: ignore[no-untyped-call]
            theirs.append(time.perf_counter() - start)
        ratio = float(np.median(theirs) / np.median(ours))
        size = "×".join(str(n) for n in volume.size_xyz)
        rows.append((name, size, f"{triangles:,}", median(ours), median(theirs), f"{ratio:.2f}"))
    heads = ("field", "samples", "triangles", "isosample", "scikit-image, 26 calls", "ratio")
    return f"## Extraction of {LEVELS} isovalues\n\n" + table(heads, rows)

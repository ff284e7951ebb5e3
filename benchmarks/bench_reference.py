"""The float64 reference: seconds for 512² rays through 128³ samples under two tents, compilation left out."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

import numpy as np

from benchmarks.machine import median, table
from isosample.compare.study_scenes import TwoTents
from isosample.integral.reference import integrate_rays

if TYPE_CHECKING:
    from isosample.volume.grid import F64, Volume


def report(*, quick: bool) -> str:
    """Wall time per picture, smooth field and noise."""
    scene = TwoTents()
    smooth = scene.sampled(64 if quick else 128)
    rng = np.random.default_rng(2)
    noise = type(smooth)(
        rng.random(smooth.array.shape, dtype=np.float32) * np.float32(scene.scale),
        spacing=smooth.spacing,
        name="noise",
    )
    pixels = 128 if quick else 512
    origins, directions = scene.rays(pixels)
    integrate_rays(smooth, scene.transfer_function, origins[:4], directions[:4])  # compiles
    rows = [
        row(name, volume, scene, (origins, directions), quick=quick) for name, volume in fields(smooth, noise)
    ]
    return f"## Float64 reference, {pixels}² rays, tolerance 1e-10\n\n" + table(
        ("field", "samples", "wall time"), rows
    )


def fields(smooth: Volume, noise: Volume) -> list[tuple[str, Volume]]:
    """A smooth field and one in which every cell is visible."""
    return [("nucleon-like", smooth), ("noise", noise)]


def row(
    name: str, volume: Volume, scene: TwoTents, rays: tuple[F64, F64], *, quick: bool
) -> tuple[str, str, str]:
    """One line of the table."""
    samples = []
    for _ in range(1 if quick else 5):
        start = time.perf_counter()
        integrate_rays(volume, scene.transfer_function, *rays)
        samples.append(time.perf_counter() - start)
    return name, "×".join(str(n) for n in volume.size_xyz), median(samples)

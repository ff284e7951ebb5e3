"""Extraction of 26 isovalues with gradients, against scikit-image and VTK; cost against size and number."""

from __future__ import annotations

import gc
import os
import time
from functools import partial
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from skimage.measure import marching_cubes

from benchmarks.machine import median, table
from isosample.surfaces.extract import extract_surfaces
from isosample.volume.analytic import GaussianMixture, MarschnerLobb, sample_field
from isosample.volume.grid import Volume

if TYPE_CHECKING:
    from collections.abc import Callable

    import numpy.typing as npt

    F64 = npt.NDArray[np.float64]

LEVELS = 26
EDGE, QUICK_EDGE = 256, 128
LARGEST_EDGE = 512  # of the smooth field alone: the other one has 240 million triangles there
# Noise crosses every cell many times: 256³ with 26 isovalues is 850 million triangles, 30 GB.
NOISE_EDGE, QUICK_NOISE_EDGE = 96, 48
REPETITIONS, QUICK_REPETITIONS = 5, 2
COUNTS = (1, 2, 4, 8, 16, 32, 64)
HEADS = (
    "field",
    "program",
    "triangles",
    "time",
    "processor time",
    "triangles/s",
    "voxels × isovalues/s",
    "time / ours",
    "per triangle / ours",
)


def smooth(edge: int) -> Volume:
    """Two Gaussians."""
    two = GaussianMixture(centres=((-0.4, 0, 0), (0.4, 0.1, 0)), widths=(0.25, 0.2), amplitudes=(1.0, 0.8))
    return sample_field(two, (edge,) * 3, lower=(-1.0,) * 3, upper=(1.0,) * 3, name="two Gaussians")


def waves(edge: int) -> Volume:
    """The field of Marschner and Lobb, full of surface."""
    return sample_field(
        MarschnerLobb(), (edge,) * 3, lower=(-1.0,) * 3, upper=(1.0,) * 3, name="Marschner-Lobb"
    )


def noise(edge: int) -> Volume:
    """Independent samples."""
    return Volume(np.random.default_rng(5).random((edge,) * 3, dtype=np.float32), name="noise")


def levels_of(volume: Volume, count: int = LEVELS) -> F64:
    """Isovalues in the middle of equal parts of the range."""
    low, high = volume.value_range
    levels: F64 = low + (high - low) * (np.arange(count) + 0.5) / count
    return levels


def ours(volume: Volume, levels: F64) -> int:
    """Extract with gradients, from an array that was not looked at before; returns the number of triangles."""
    return sum(extract_surfaces(Volume(volume.array), levels).statistics.triangles)


def scikit_image(volume: Volume, levels: F64) -> int:
    """Call scikit-image once per isovalue; it always makes normals."""
    total = 0
    for level in levels.tolist():
        _, faces, _, _ = marching_cubes(volume.array, level)  # type: ignore[no-untyped-call]
        total += len(faces)
    return total


def flying_edges(volume: Volume, levels: F64, *, gradients: bool, backend: str = "STDThread") -> int:
    """Give VTK's flying edges all isovalues at once; the wheel's own backend is Sequential, one thread."""
    import vtk
    from vtk.util import numpy_support

    if not vtk.vtkSMPTools.SetBackend(backend):
        raise RuntimeError(f"this VTK was built without {backend}")
    image = vtk.vtkImageData()
    image.SetDimensions(*volume.size_xyz)
    samples = numpy_support.numpy_to_vtk(volume.array.reshape(-1), deep=False)
    image.GetPointData().SetScalars(samples)
    contour = vtk.vtkFlyingEdges3D()
    contour.SetInputData(image)
    contour.ComputeScalarsOff()
    contour.SetComputeGradients(gradients)
    contour.SetComputeNormals(gradients)
    contour.SetNumberOfContours(len(levels))
    for row, level in enumerate(levels.tolist()):
        contour.SetValue(row, level)
    contour.Update()
    return int(contour.GetOutput().GetNumberOfPolys())


def programs() -> dict[str, Callable[[Volume, F64], int]]:
    """Return what is compared; VTK only where it is installed."""
    found: dict[str, Callable[[Volume, F64], int]] = {"isosample": ours}
    try:
        import vtk  # noqa: F401
    except ImportError:
        pass
    else:
        found["flying edges, threads"] = partial(flying_edges, gradients=True)
        found["flying edges, as installed"] = partial(flying_edges, gradients=True, backend="Sequential")
        found["flying edges, threads, no normals"] = partial(flying_edges, gradients=False)
    found["scikit-image"] = scikit_image
    return found


class Run(NamedTuple):
    """Seconds on the wall and of the processor, and triangles."""

    seconds: float
    processor: float
    triangles: int


def timed(program: Callable[[Volume, F64], int], volume: Volume, levels: F64) -> Run:
    """Measure one run."""
    gc.collect()
    start, processor = time.perf_counter(), time.process_time()
    triangles = program(volume, levels)
    return Run(time.perf_counter() - start, time.process_time() - processor, triangles)


def fields(*, quick: bool) -> list[Volume]:
    """A smooth field, one full of surface, and noise."""
    edge = QUICK_EDGE if quick else EDGE
    return [smooth(edge), waves(edge), noise(QUICK_NOISE_EDGE if quick else NOISE_EDGE)]


def compare(volume: Volume, *, quick: bool) -> list[tuple[str, ...]]:
    """Rows of one field: time of each program, interleaved, and how many times longer than ours."""
    ours(smooth(16), np.array([0.5]))  # machine code is loaded, or made
    levels = levels_of(volume)
    runs: dict[str, list[Run]] = {name: [] for name in programs()}
    for _ in range(QUICK_REPETITIONS if quick else REPETITIONS):
        for name, program in programs().items():
            runs[name].append(timed(program, volume, levels))
    own = float(np.median([run.seconds for run in runs["isosample"]]))
    own_rate = own / runs["isosample"][0].triangles
    rows: list[tuple[str, ...]] = []
    for name, found in runs.items():
        middle, triangles = float(np.median([run.seconds for run in found])), found[0].triangles
        rows.append(
            (
                f"{volume.name} {volume.size_xyz[0]}³",
                name,
                f"{triangles:,}",
                median([run.seconds for run in found]),
                median([run.processor for run in found]),
                f"{triangles / middle / 1e6:.1f} M",
                f"{volume.array.size * LEVELS / middle / 1e6:.0f} M",
                f"{middle / own:.1f}",
                f"{middle / triangles / own_rate:.1f}",
            )
        )
    return rows


def growth(*, quick: bool) -> str:
    """Cost against isovalues and samples, with the exponents of power laws fitted to the medians."""
    repetitions = QUICK_REPETITIONS if quick else REPETITIONS
    edges = (32, 64, 128) if quick else (64, 128, 256)
    rows: list[tuple[str, ...]] = []
    for make in (smooth, waves):
        by_count, by_edge = [], []
        fixed = make(edges[-2] if make is waves else edges[-1])
        for count in COUNTS:
            levels = levels_of(fixed, count)
            runs = [timed(ours, fixed, levels) for _ in range(repetitions)]
            by_count.append((float(np.median([run.seconds for run in runs])), runs[0].triangles))
        sizes = edges if make is waves or quick else (*edges, LARGEST_EDGE)
        for edge in sizes:
            volume = make(edge)
            levels = levels_of(volume)
            runs = [timed(ours, volume, levels) for _ in range(repetitions)]
            by_edge.append((float(np.median([run.seconds for run in runs])), runs[0].triangles))
        size = fixed.size_xyz[0]
        rows.append((f"{fixed.name} {size}³", "isovalues", *cells(COUNTS, by_count)))
        rows.append((f"{fixed.name}, {LEVELS} isovalues", "samples per axis", *cells(sizes, by_edge)))
    return table(("field", "against", "milliseconds", "exponent of time", "exponent of triangles"), rows)


def cells(places: tuple[int, ...], found: list[tuple[float, int]]) -> tuple[str, str, str]:
    """Milliseconds at each place, and the exponents of time and of triangles."""
    times, triangles = np.array(found).T
    listed = ", ".join(f"{place}: {1e3 * taken:.0f}" for place, taken in zip(places, times, strict=True))
    steepness = [np.polyfit(np.log(places), np.log(values), 1)[0] for values in (times, triangles)]
    return listed, f"{steepness[0]:.2f}", f"{steepness[1]:.2f}"


def report(*, quick: bool) -> str:
    """Both tables, and the load of the machine while they were made."""
    before = os.getloadavg()[0]
    rows = [row for volume in fields(quick=quick) for row in compare(volume, quick=quick)]
    parts = [table(HEADS, rows), growth(quick=quick)]
    load = f"Load average {before:.1f} before and {os.getloadavg()[0]:.1f} after, {os.cpu_count()} cores.\n"
    return f"## Extraction of {LEVELS} isovalues with gradients\n\n" + "\n".join([*parts, load])


if __name__ == "__main__":
    import sys

    print(report(quick="--quick" in sys.argv[1:]))

"""Coarser details: triangles, distances and seconds, beside quadric edge collapse; frames with and without them.

python -m benchmarks.bench_details [--quick]
"""

from __future__ import annotations

import argparse
import time
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from benchmarks.machine import describe_machine, median, table
from benchmarks.raycast_scenes import nucleon_tents, scans
from isosample.gl.context import shared_context
from isosample.rendering.abuffer import ABuffer
from isosample.rendering.preparation import prepare_surfaces
from isosample.rendering.quality import Quality
from isosample.rendering.scene import Scene
from isosample.rendering.settings import RenderSettings
from isosample.surfaces.brick_samples import gradients_at, load_brick
from isosample.surfaces.chunk_encoding import encode
from isosample.surfaces.detail import MOST_DETAILS, detail_tolerance
from isosample.surfaces.mesh_error import MeshError, combined, measure
from isosample.volume.bricks import bricks_of

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy.typing as npt

    from benchmarks.raycast_scenes import RaycastScene
    from isosample.rendering.preparation import PreparedSurfaces
    from isosample.surfaces.mesh import BrickMesh
    from isosample.surfaces.surface_set import SurfaceSet
    from isosample.volume.grid import Volume

REPETITIONS = 5
SIZE, QUICK_SIZE = 512, 128
SCREEN_ERRORS = (0.0, 0.125, 0.25, 0.5, 1.0)
BORDER_WEIGHT = 1000.0  # MeshLab's: borders stay
HEADS = (
    "scene",
    "meshes",
    "triangles",
    "share",
    "distance, flat: rms / largest [voxel]",
    "curved: rms [voxel]",
    "µs of one core per triangle as extracted",
    "cache, bytes per triangle as extracted",
)
FRAME_HEADS = (
    "scene",
    "screen error [pixel]",
    "triangles drawn",
    "RMSE against the reference",
    "99.9 % against the finest",
    "build",
    "resolve",
    "frame",
)


class Collapsed(NamedTuple):
    """What MeshLab made of some meshes, and its processor time."""

    triangles: int
    error: MeshError
    seconds: float


def scene_list(*, quick: bool) -> list[tuple[RaycastScene, int]]:
    """Scenes, and isovalues per slope."""
    found = [(nucleon_tents(), 1)]
    return found if quick else [*found, *((scan, 1) for scan in scans("engine", "embryo (noisy)"))]


def prepared(scene: RaycastScene, per_slope: int) -> PreparedSurfaces:
    """Surfaces with all details, and how far they are from the isosurfaces."""
    quality = Quality(per_slope=per_slope, details=MOST_DETAILS)
    return prepare_surfaces(scene.volume, scene.transfer_function, quality, residuals=True)


def detail_rows(scene: RaycastScene, surfaces: SurfaceSet, *, peer: bool) -> list[tuple[object, ...]]:
    """One row per detail, and one of MeshLab's collapse to about as many triangles as detail 2."""
    whole = sum(surfaces.statistics.triangles)
    rows: list[tuple[object, ...]] = []
    for one in surfaces.by_detail:
        detail = one.settings.detail
        name = f"detail {detail}, {detail_tolerance(detail):g} voxel" if detail else "as extracted"
        seconds = processor_seconds(scene.volume, surfaces, detail)
        size = sum(len(encode(mesh)) for mesh in one.meshes) / whole
        error = combined([mesh.error for mesh in one.meshes if mesh.error])
        count = sum(one.statistics.triangles)
        rows.append(row(scene, name, count, whole, error, (seconds, f"{size:.2f}")))
    if peer and (found := collapsed_by_meshlab(scene.volume, surfaces)) is not None:
        name = "MeshLab's quadric collapse, borders kept"
        rows.append(row(scene, name, found.triangles, whole, found.error, (found.seconds, "")))
    return rows


def row(
    scene: RaycastScene, name: str, count: int, whole: int, error: MeshError, costs: tuple[float, str]
) -> tuple[object, ...]:
    """One row of the first table."""
    seconds, size = costs
    distances = f"{error.flat_rms:.4f} / {error.flat_largest:.3f}"
    each = f"{1e6 * seconds / whole:.2f}"
    return (
        scene.name,
        name,
        f"{count:,}",
        f"{100 * count / whole:.1f} %",
        distances,
        f"{error.curved_rms:.4f}",
        each,
        size,
    )


def processor_seconds(volume: Volume, surfaces: SurfaceSet, detail: int) -> float:
    """Of an extraction without residuals."""
    from isosample.surfaces.extract import extract_surfaces

    before = time.process_time()
    extract_surfaces(volume, surfaces.isovalues, detail=detail)
    return time.process_time() - before


def collapsed_by_meshlab(volume: Volume, surfaces: SurfaceSet) -> Collapsed | None:
    """Every piece of detail 2 as MeshLab collapses it to as many triangles; None without pymeshlab."""
    try:
        import pymeshlab
    except ImportError:
        return None
    bricks = {brick.index: brick for brick in bricks_of(volume.size_xyz, surfaces.settings.brick_cells)}
    wanted = {(mesh.isovalue, mesh.brick): len(mesh.triangles) for mesh in surfaces.details[1].meshes}
    pieces = [mesh for mesh in surfaces.meshes if (mesh.isovalue, mesh.brick) in wanted]
    seconds, count = 0.0, 0
    errors: list[MeshError] = []
    for mesh in pieces:
        before = time.process_time()
        work = pymeshlab.MeshSet(verbose=False)
        work.add_mesh(pymeshlab.Mesh(mesh.positions.astype(np.float64), mesh.triangles))
        work.meshing_decimation_quadric_edge_collapse(
            targetfacenum=wanted[mesh.isovalue, mesh.brick],
            preserveboundary=True,
            boundaryweight=BORDER_WEIGHT,
            preservenormal=True,
        )
        seconds += time.process_time() - before
        shape = work.current_mesh()
        count += shape.face_number()
        errors.append(distance(volume, mesh, bricks, shape))
    return Collapsed(count, combined(errors), seconds)


def distance(volume: Volume, mesh: BrickMesh, bricks: dict[Any, Any], shape: Any) -> MeshError:
    """How far MeshLab's mesh of a piece is from the isosurface."""
    samples = load_brick(volume, bricks[mesh.brick])
    places: npt.NDArray[np.float64] = np.clip(
        shape.vertex_matrix(), mesh.positions.min(axis=0), mesh.positions.max(axis=0)
    )
    gradients = gradients_at(samples, places).astype(np.float32)
    return measure(samples, mesh.isovalue, places, gradients, shape.face_matrix().astype(np.int32))[1]


def frame_rows(
    scene: RaycastScene, found: PreparedSurfaces, size: int, repetitions: int
) -> list[tuple[object, ...]]:
    """One row per screen error; frames in turn."""
    reference = scene.reference(size).astype(np.float64)
    times: dict[float, list[dict[str, float]]] = {error: [] for error in SCREEN_ERRORS}
    pictures, drawn = {}, {}
    with ABuffer(shared_context(), Scene.build(found.surfaces, found.plan)) as abuffer:
        for repetition in range(repetitions + 1):
            for error in SCREEN_ERRORS:
                abuffer.timer.seconds.clear()
                begun = time.perf_counter()
                picture, told = abuffer.render(scene.camera, (size, size), RenderSettings(screen_error=error))
                stages = abuffer.timer.seconds | {"frame": time.perf_counter() - begun}
                pictures[error], drawn[error] = picture.astype(np.float64), told.triangles_drawn
                if repetition:
                    times[error].append(stages)
    return [
        (
            scene.name,
            f"{error:g}",
            f"{drawn[error]:,}",
            f"{np.sqrt(np.mean((pictures[error] - reference) ** 2)):.2e}",
            f"{np.quantile(np.abs(pictures[error] - pictures[0.0]).max(axis=-1), 0.999):.3f}",
            *(median([stages[name] for stages in times[error]]) for name in ("build", "resolve", "frame")),
        )
        for error in SCREEN_ERRORS
    ]


def report(*, quick: bool) -> str:
    """Both tables."""
    size, repetitions = (QUICK_SIZE, 1) if quick else (SIZE, REPETITIONS)
    details: list[tuple[object, ...]] = []
    frames: list[tuple[object, ...]] = []
    for number, (scene, per_slope) in enumerate(scene_list(quick=quick)):
        found = prepared(scene, per_slope)
        finest = [sum(one.statistics.triangles) for one in found.surfaces.by_detail]
        print(f"{scene.name}: {finest}", flush=True)
        details += detail_rows(scene, found.surfaces, peer=number == 0)
        frames += frame_rows(scene, found, size, repetitions)
    told = (
        "One isovalue per slope. Distances at the seven points of every triangle, of details by whole pieces; pieces "
        "that hardly get coarser have no detail, so that shares are of what is left of all. MeshLab's mesh has as many "
        "triangles, piece by piece, as detail 2."
    )
    tables = f"{table(HEADS, details)}\n\n### Frames, {size}²\n\n{table(FRAME_HEADS, frames)}\n"
    return f"## Coarser details\n\n{told}\n\n{tables}"


def main(words: Sequence[str] | None = None) -> None:
    """Run this benchmark alone."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.bench_details", description=__doc__)
    parser.add_argument("--quick", action="store_true", help="one scene, small, few repetitions")
    arguments = parser.parse_args(words)
    print(describe_machine())
    print(report(quick=arguments.quick))


if __name__ == "__main__":
    main()

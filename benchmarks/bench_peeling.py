"""26 nested surfaces in exact order: the A-buffer beside VTK's dual depth peeling of the same triangles."""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from benchmarks.bench_raycast import has_vtk
from benchmarks.machine import describe_machine, table
from benchmarks.raycast_curves import measure
from benchmarks.surface_frames import SurfaceFrames
from isosample.rendering.camera import Camera
from isosample.rendering.image import Image
from isosample.surfaces.extract import extract_surfaces
from isosample.transfer.control_points import Isosurface
from isosample.transfer.isovalues import plan_isovalues
from isosample.transfer.transfer_function import TransferFunction
from isosample.volume.analytic import SphereDistance, nucleon_like, sample_field

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from benchmarks.raycast_curves import Curve, Frames
    from isosample.surfaces.surface_set import SurfaceSet
    from isosample.transfer.isovalue_plan import IsovaluePlan
    from isosample.volume.field import Field

COUNT = 26
OPACITY = 0.08
SIZE, QUICK_SIZE = 800, 256
REPETITIONS = 5  # three of frames that take longer than SLOW
SLOW = 3.0  # [s]
OURS, PEELING = "A-buffer", "VTK, dual depth peeling"


@dataclass(frozen=True)
class NestedField:
    """A field in a box of 40³, the values of its outermost and innermost surface, and two sizes of its grid."""

    name: str
    field: Field
    outer: float
    inner: float
    edges: tuple[int, int]  # about 184 thousand and 1.8 million triangles


FIELDS = (
    NestedField("nested spheres", SphereDistance((20.0, 20.0, 20.0), 0.0), 19.0, 4.0, (45, 142)),
    NestedField("nucleon-like", nucleon_like(), 0.1, 0.92, (51, 158)),
)


@dataclass(frozen=True, eq=False)
class NestedSurfaces:
    """What every program draws."""

    name: str
    surfaces: SurfaceSet
    plan: IsovaluePlan
    looks: Sequence[Isosurface]
    camera: Camera

    @property
    def triangles(self) -> int:
        """Of all levels."""
        return sum(self.surfaces.statistics.triangles)


def nested(of: NestedField, edge: int) -> NestedSurfaces:
    """26 surfaces of a field, from blue outside to red inside."""
    volume = sample_field(of.field, (edge,) * 3, lower=(0.0,) * 3, upper=(40.0,) * 3, name=of.name)
    shares = np.linspace(0.0, 1.0, COUNT).tolist()
    looks = [
        Isosurface(of.outer + share * (of.inner - of.outer), (share, 0.5, 1.0 - share), OPACITY)
        for share in shares
    ]
    looks.sort(key=lambda look: look.value)
    plan = plan_isovalues(TransferFunction([], looks), volume.value_range)
    surfaces = extract_surfaces(volume, plan.isovalues)
    camera = Camera.orbit(volume.box, azimuth=31, elevation=23, zoom=1.5)
    return NestedSurfaces(f"{of.name} {edge}³", surfaces, plan, looks, camera)


def programs(scene: NestedSurfaces, size: int) -> dict[str, Callable[[], Frames]]:
    """Ours, and VTK's if it is there."""
    found: dict[str, Callable[[], Frames]] = {
        OURS: partial(SurfaceFrames, scene.surfaces, scene.plan, scene.camera, size)
    }
    if has_vtk():
        from benchmarks.peer_vtk_surfaces import VtkPeeledSurfaces

        found[PEELING] = partial(VtkPeeledSurfaces, scene.surfaces, scene.looks, scene.camera, size)
    return found


def rows_of(
    scene: NestedSurfaces, size: int, repetitions: int, pictures: Path | None
) -> list[tuple[str, ...]]:
    """Times of every program, and how far its picture is from the A-buffer's."""
    own = SurfaceFrames(scene.surfaces, scene.plan, scene.camera, size)
    reference, stats = own.render(), own.stats
    own.release()
    layers = f"{stats['samples_per_ray']['mean']:.1f} / {stats['samples_per_ray']['max']}"
    makers = {name: ((lambda _, make=make: make()), (0.0,)) for name, make in programs(scene, size).items()}
    if pictures is not None:
        _keep_pictures(scene, size, pictures)
    curves = measure(makers, reference, repetitions=repetitions, slow_frame=SLOW)
    return [(scene.name, f"{scene.triangles:,}", layers, *_cells(name, curves)) for name in curves]


def _cells(name: str, curves: dict[str, Curve]) -> tuple[str, ...]:
    point, own = curves[name].points[0], curves[OURS].points[0]
    return (
        name,
        f"{1e3 * point.seconds:.0f} ms",
        f"{1e3 * point.processor:.0f} ms",
        f"{point.seconds / own.seconds:.1f}",
        f"{point.processor / own.processor:.1f}",
        f"{point.error:.1e} / {point.largest_error:.1e}",
    )


def _keep_pictures(scene: NestedSurfaces, size: int, folder: Path) -> None:
    """One file per program, to look at."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, make in programs(scene, size).items():
        frames = make()
        try:
            Image(frames.render()).save(folder / f"{scene.name}, {name}.png".replace(" ", "_"))
        finally:
            frames.release()


def report(*, quick: bool, pictures: Path | None = None) -> str:
    """Table of two fields with two meshes each; one small one if quick."""
    size = QUICK_SIZE if quick else SIZE
    rows = []
    for field in FIELDS[:1] if quick else FIELDS:
        for edge in field.edges[:1] if quick else field.edges:
            scene = nested(field, edge)
            print(f"  {scene.name}: {scene.triangles:,} triangles", flush=True)
            rows += rows_of(scene, size, 2 if quick else REPETITIONS, pictures)
    told = (
        f"{COUNT} isosurfaces of opacity {OPACITY}, unlit, {size}², with reading the picture back; the programs in "
        f"turn, medians of {REPETITIONS} frames (3 of those above {SLOW:g} s). VTK peels until nothing is left "
        "(occlusion ratio 0; with a largest number of peels of 0, documented as no limit, VTK 9.7 peels once and "
        "blends the rest in any order, so the number is set beyond all lists) and accumulates in 8 bits, ours in "
        "float32: hence the RMSE against the A-buffer's picture.\n"
    )
    heads = (
        "surfaces", "triangles", "layers per pixel: mean / most", "program", "frame", "of all cores", "time / ours",
        "of all cores / ours", "RMSE / largest difference",
    )  # fmt: skip
    return (
        f"## {COUNT} nested surfaces, and VTK's dual depth peeling of the same triangles\n\n{told}\n"
        + table(heads, rows)
    )


def main() -> None:
    """Run this benchmark alone."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.bench_peeling", description=__doc__)
    parser.add_argument("--quick", action="store_true", help="one field, a small picture, few repetitions")
    parser.add_argument("--pictures", type=Path, help="folder to keep the pictures in, to look at")
    arguments = parser.parse_args()
    print(describe_machine())
    print(report(quick=arguments.quick, pictures=arguments.pictures))


if __name__ == "__main__":
    main()

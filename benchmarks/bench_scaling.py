"""How the time of a frame grows with pixels, layers, voxels and isovalues; fitted exponents and figures.

python -m benchmarks.bench_scaling [--quick] [--figures FOLDER] [sweep …]
"""

from __future__ import annotations

import argparse
import math
import sys
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from benchmarks import accuracy_scenes
from benchmarks.bench_abuffer import planes
from benchmarks.machine import describe_machine, table
from benchmarks.raycast_curves import OurFrames
from benchmarks.raycast_scenes import TENTS, RaycastScene
from benchmarks.scaling_curves import DATA_CENTRIC, HEADS, Sweep, figure, measured, rows
from benchmarks.surface_frames import SurfaceFrames
from isosample.rendering.preparation import prepare_surfaces
from isosample.rendering.quality import Quality
from isosample.rendering.raycast_settings import Classification, RaycastSettings
from isosample.rendering.settings import RenderSettings
from isosample.surfaces.detail import MOST_DETAILS
from isosample.transfer.control_points import Isosurface
from isosample.transfer.transfer_function import TransferFunction

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from benchmarks.raycast_curves import Frames

FIGURES = Path(__file__).parents[1] / "docs" / "images"
REPETITIONS = 5
PER_SLOPE = 1  # isovalues inside a slope of the two tents: an RMSE of 0.001 on 128³
EDGE, SIZE, QUICK_SIZE = 128, 512, 128
STEP = 1.0 / EDGE  # of the ray caster, as a share of the box's edge; the same for every volume
RAY_CASTER = "ray caster, pre-integrated"

# What every scene is drawn with by the data-centric renderer: a name, and what makes its frames of surfaces, plan,
# camera and size. Another way of drawing (such as levels of detail) is one more entry; the page then also tells how far
# its picture is from that of the first.
COARSER = "data-centric, coarser details"
VARIANTS: dict[str, Callable[..., Frames]] = {
    DATA_CENTRIC: partial(SurfaceFrames, settings=RenderSettings(screen_error=0.0)),
    COARSER: SurfaceFrames,
}


def surfaces_of(scene: RaycastScene, size: int, per_slope: int) -> dict[str, Callable[[], Frames]]:
    """The data-centric renderer in all its variants, over the same surfaces."""
    quality = Quality(per_slope=per_slope, details=MOST_DETAILS)
    surfaces, plan, _, _ = prepare_surfaces(scene.volume, scene.transfer_function, quality)
    return {name: partial(variant, surfaces, plan, scene.camera, size) for name, variant in VARIANTS.items()}


def rays_of(scene: RaycastScene, size: int) -> dict[str, Callable[[], Frames]]:
    """The ray caster with steps of a fixed length in world units."""
    voxels = STEP * scene.volume.size_xyz[0]
    settings = RaycastSettings(classification=Classification.PRE_INTEGRATED, step=voxels)
    return {RAY_CASTER: partial(OurFrames, scene, size, settings)}


def two_tents(edge: int) -> RaycastScene:
    """The nucleon-like field on a grid of edge³, always the same two tents."""
    found = accuracy_scenes.nucleon(edge)
    return RaycastScene(found.name, found.volume, found.transfer_function(TENTS, "translucent"), found.camera)


def isosurfaces(count: int) -> RaycastScene:
    """So many isosurfaces of the nucleon-like field, from its foot to its peaks."""
    found = accuracy_scenes.nucleon(EDGE)
    shares = ((np.arange(count) + 0.5) / count).tolist()
    looks = [
        Isosurface(0.05 + 0.85 * share, (share, 0.5, 1.0 - share), 0.5 / (count**0.5 + 1.0))
        for share in shares
    ]
    return RaycastScene(found.name, found.volume, TransferFunction([], looks), found.camera)


# -- the sweeps -----------------------------------------------------------------------------------


def edge_text(pixels: float) -> str:
    """A number of pixels as the square that it is."""
    return f"{math.isqrt(round(pixels))}²"


def by_pixels(scene: RaycastScene, pixels: float) -> Mapping[str, Callable[[], Frames]]:
    """Every method at one size of the picture."""
    edge = math.isqrt(round(pixels))
    return surfaces_of(scene, edge, PER_SLOPE) | rays_of(scene, edge)


def by_layers(size: int, count: float) -> Mapping[str, Callable[[], Frames]]:
    """Planes that cover the picture: so many fragments per pixel. The ray caster's time does not depend on them."""
    return surfaces_of(RaycastScene("planes", *planes(int(count))), size, 0)


def by_voxels(size: int, edge: float) -> Mapping[str, Callable[[], Frames]]:
    """Every method for one grid."""
    scene = two_tents(int(edge))
    return surfaces_of(scene, size, PER_SLOPE) | rays_of(scene, size)


def by_isovalues(size: int, count: float) -> Mapping[str, Callable[[], Frames]]:
    """Every method for so many isosurfaces."""
    scene = isosurfaces(int(count))
    return surfaces_of(scene, size, 0) | rays_of(scene, size)


def sweeps(*, quick: bool) -> list[Sweep]:
    """All of them."""
    size = QUICK_SIZE if quick else SIZE
    tents = two_tents(41 if quick else EDGE)
    return [
        Sweep(
            "pixels",
            "pixels",
            "pixels",
            f"two tents, {tents.name}, {PER_SLOPE} isovalue per slope",
            [edge**2 for edge in ((64, 128, 256) if quick else (256, 512, 1024, 2048))],
            partial(by_pixels, tents),
            label=edge_text,
        ),
        Sweep(
            "layers",
            "fragments per pixel",
            "fragments per pixel",
            f"{size}² pixels, planes that cover them",
            (1, 4, 16) if quick else (1, 2, 4, 8, 16, 32, 64, 128),
            partial(by_layers, size),
        ),
        Sweep(
            "volume",
            "samples along an edge of the volume",
            "samples along an edge of the volume",
            f"{size}² pixels, two tents, the same isovalues ({PER_SLOPE} per slope) and world step",
            (32, 64, 96) if quick else (64, 128, 256, 512),
            partial(by_voxels, size),
        ),
        Sweep(
            "isovalues",
            "number of isovalues",
            "isovalues",
            f"{size}² pixels, nucleon-like {EDGE}³, isosurfaces",
            (1, 4, 16) if quick else (1, 2, 4, 8, 16, 32, 64),
            partial(by_isovalues, size),
        ),
    ]


def report(*, quick: bool, figures: Path | None = FIGURES, only: Sequence[str] = ()) -> str:
    """The table; the figures are written beside those of the documentation unless quick."""
    lines: list[tuple[str, ...]] = []
    names = []
    for sweep in sweeps(quick=quick):
        if only and sweep.name not in only:
            continue
        courses = measured(sweep, sweep.places, 2 if quick else REPETITIONS)
        lines += rows(sweep, courses)
        if figures is not None and not quick:
            figures.mkdir(parents=True, exist_ok=True)
            file = figures / f"scaling-{sweep.name}.svg"
            file.write_text(figure(sweep, courses), encoding="utf-8")
            names.append(f"[{sweep.title}](../docs/images/{file.name})")
    told = "\n".join(f"- {sweep.title}: {sweep.fixed}." for sweep in sweeps(quick=quick))
    seen = f"\n\nFigures: {', '.join(names)}." if names else ""
    return (
        "## Scaling\n\nTime of a frame with reading back, all methods in turn; exponents of power laws with the least "
        f"squares in log-log, over all sizes unless said. Fixed:\n\n{told}\n\n{table(HEADS, lines)}{seen}\n"
    )


def main() -> None:
    """Run this benchmark alone."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.bench_scaling", description=__doc__)
    parser.add_argument("--quick", action="store_true", help="small sizes, few repetitions, no figures")
    parser.add_argument(
        "--figures", type=Path, default=FIGURES, help="folder of the figures (default: %(default)s)"
    )
    parser.add_argument("sweeps", nargs="*", help="some of pixels, layers, volume, isovalues; all by default")
    arguments = parser.parse_args()
    unknown = sorted(set(arguments.sweeps) - {sweep.name for sweep in sweeps(quick=True)})
    if unknown:
        sys.exit(f"no sweep {', '.join(unknown)}; there are pixels, layers, volume, isovalues")
    print(describe_machine())
    print(report(quick=arguments.quick, figures=arguments.figures, only=arguments.sweeps))


if __name__ == "__main__":
    main()

"""The ray caster: error against time beside VTK's, sampling, macrocells, and 128 isosurfaces."""

from __future__ import annotations

import argparse
import sys
from typing import TYPE_CHECKING

import numpy as np

from benchmarks import raycast_closeups, raycast_tables
from benchmarks.machine import describe_machine, table
from benchmarks.raycast_curves import Curve, OurFrames, measure, timed_frame
from benchmarks.raycast_scenes import RaycastScene, impulses, nucleon_tents, ramp_impulses, scans
from isosample.rendering.raycast_settings import (
    Classification,
    Crossings,
    Integration,
    PeakWeight,
    Quadrature,
    RaycastSettings,
    TransferLookup,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence

    from benchmarks.raycast_curves import Frames

ERRORS = (0.005, 0.001)
SIZES, QUICK_SIZES = (512, 1024), (256,)
VTK_STEPS = (8.0, 4.0, 2.0, 1.0, 0.5, 0.25, 0.125, 0.0625)
STEPS = (16.0, 8.0, 4.0, 2.0, 1.0, 0.5, 0.25, 0.125)
SAME_ERROR = 0.5 / 255.0

POST = {"classification": Classification.POST_CLASSIFIED, "quadrature": Quadrature.TRAPEZOID}
PRE = {"classification": Classification.PRE_INTEGRATED}
PEAKS = {
    "classification": Classification.PEAK_FINDING,
    "peak_weight": PeakWeight.INTEGRAL,
    "crossings": Crossings.EXACT,
}
OURS: dict[str, dict[str, object]] = {
    "post-classified, Riemann, sampled TF": {
        **POST,
        "quadrature": Quadrature.RIEMANN,
        "transfer_lookup": TransferLookup.TEXTURE,
    },
    "post-classified, trapezoid": {**POST},
    "pre-integrated, exact": {**PRE},
    "pre-integrated, exact, adaptive": {**PRE, "adaptive": True},
    "pre-integrated, integrals of the TF": {**PRE, "integration": Integration.TABLE_1D},
    "pre-integrated, table 256²": {**PRE, "integration": Integration.TABLE_2D},
    "peak finding, integral weights, secant": {**PEAKS, "crossings": Crossings.SECANT, "peaks": 4},
    "peak finding, integral weights, exact crossings": {**PEAKS},
}
EXACT_STEPS = (4.0,)  # its picture does not depend on the step


def settings_of(options: Mapping[str, object], step: float) -> RaycastSettings:
    """Ray caster settings of a method and a step."""
    return RaycastSettings(**options, step=step)  # type: ignore[arg-type]


def report(*, quick: bool) -> str:
    """All tables of the ray caster."""
    parts = ["## Ray caster\n"]
    parts += against_vtk(quick=quick)
    parts += raycast_tables.macrocells(quick=quick)
    parts += raycast_tables.performance(quick=quick)
    parts += raycast_tables.differential(quick=quick)
    parts += raycast_closeups.close_ups(quick=quick)
    parts += many_isosurfaces(quick=quick)
    return "\n".join(parts)


def has_vtk() -> bool:
    """Whether VTK is installed."""
    try:
        import vtk  # noqa: F401
    except ImportError:
        return False
    return True


# -- error against time, beside VTK ---------------------------------------------------------------


def against_vtk(
    *, quick: bool, scenes: Sequence[str] = (), sizes: Sequence[int] = (), methods: Sequence[str] = ()
) -> Iterator[str]:
    """Curves of every scene and size, and the times at equal errors."""
    yield "### Error against time, and VTK's GPU volume mapper under the same driver\n"
    if has_vtk():
        yield (
            f"VTK on {vtk_driver()}: same camera, control points and extinction, no shading, jitter or automatic "
            "steps; float32 framebuffer and tables of 16000 entries (its own 8 bits and 1024 entries end at an "
            "error of 1e-3). Error: RMSE of premultiplied linear RGBA over all pixels against the float64 "
            "reference. Times include reading the picture back. Steps in voxels.\n"
        )
    rows: list[tuple[str, ...]] = []
    points: list[tuple[str, ...]] = []
    chosen = [name for name in OURS if not methods or any(part in name for part in methods)]
    for scene in [nucleon_tents(), *scans("engine", "vessels (MRA)")]:
        if scenes and not any(part in scene.name for part in scenes):
            continue
        for size in sizes or (QUICK_SIZES if quick else SIZES):
            curves = curves_of(scene, size, chosen, repetitions=3 if quick else 5)
            rows += equal_error_rows(scene, size, curves)
            points += point_rows(scene, size, curves)
    heads = ["scene", "size", "method"]
    for error in ERRORS:
        heads += [f"time at {error}", "VTK / ours", "of all cores: VTK / ours"]
    yield table(heads, rows)
    yield table(("scene", "size", "method", "step: RMSE in time (samples per ray)"), points)


def vtk_driver() -> str:
    """What draws VTK's pictures."""
    from benchmarks.peer_vtk import VtkRayCaster

    scene = nucleon_tents()
    caster = VtkRayCaster(scene.volume, scene.transfer_function, scene.camera, 32, step=4.0)
    try:
        caster.render()
        return caster.driver()
    finally:
        caster.release()


def vtk_frames(scene: RaycastScene, size: int, step: float, *, as_stored: bool = False) -> Frames:
    """VTK's ray caster for a scene."""
    from benchmarks.peer_vtk import VtkRayCaster

    return VtkRayCaster(
        scene.volume, scene.transfer_function, scene.camera, size, step=step, as_stored=as_stored
    )


def curves_of(scene: RaycastScene, size: int, names: Sequence[str], *, repetitions: int) -> dict[str, Curve]:
    """Those of ours with the names, and VTK's, step by step, until the smaller error is reached."""
    makers: dict[str, tuple[Callable[[float], Frames], Sequence[float]]] = {}
    if has_vtk():
        makers["VTK"] = (lambda step: vtk_frames(scene, size, step), VTK_STEPS)
        if scene.volume.array.dtype != np.float32:
            makers["VTK, samples of 8 bits"] = (
                lambda step: vtk_frames(scene, size, step, as_stored=True),
                VTK_STEPS,
            )
    for name in names:
        options = OURS[name]
        exact = options.get("crossings") is Crossings.EXACT
        makers[name] = (_ours(scene, size, options), EXACT_STEPS if exact else STEPS)
    return measure(makers, scene.reference(size), repetitions=repetitions, stop_error=ERRORS[-1])


def _ours(scene: RaycastScene, size: int, options: Mapping[str, object]) -> Callable[[float], Frames]:
    return lambda step: OurFrames(scene, size, settings_of(options, step))


def equal_error_rows(
    scene: RaycastScene, size: int, curves: Mapping[str, Curve]
) -> Iterator[tuple[str, ...]]:
    """Time of each method at the errors, and how many times longer VTK takes."""
    for name, curve in curves.items():
        row = [scene.name, f"{size}²", name]
        for error in ERRORS:
            seconds = curve.seconds_at_error(error)
            bound = "≤ " if curve.reached_by_coarsest(error) else ""
            row.append("not reached" if seconds is None else f"{bound}{1e3 * seconds:.0f} ms")
            row.append(_ratio(vtk_least(curves, Curve.seconds_at_error, error), seconds))
            row.append(
                _ratio(vtk_least(curves, Curve.processor_at_error, error), curve.processor_at_error(error))
            )
        yield tuple(row)


def _ratio(peer: float | None, own: float | None) -> str:
    return "–" if peer is None or own is None else f"{peer / own:.2f}"


def vtk_least(
    curves: Mapping[str, Curve], cost: Callable[[Curve, float], float | None], error: float
) -> float | None:
    """What an error costs VTK, by samples of the type with which that is less."""
    found = [cost(curve, error) for name, curve in curves.items() if name.startswith("VTK")]
    return min((each for each in found if each is not None), default=None)


def point_rows(scene: RaycastScene, size: int, curves: Mapping[str, Curve]) -> Iterator[tuple[str, ...]]:
    """What was measured, step by step."""
    for name, curve in curves.items():
        steps = [
            f"{point.step:g}: {point.error:.2g} in {1e3 * point.seconds:.0f} ms"
            + (f" ({point.evaluations:.0f})" if point.samples else "")
            for point in curve.points
        ]
        yield (scene.name, f"{size}²", name, "; ".join(steps))


# -- many isosurfaces -----------------------------------------------------------------------------


def many_isosurfaces(*, quick: bool) -> Iterator[str]:
    """128 isosurfaces at steps of one voxel: errors in 1/255, ours and VTK's isosurface mode."""
    size = 128 if quick else 512
    yield f"### 128 isosurfaces, steps of one voxel, {size}²\n"
    rows = []
    for scene in (ramp_impulses(), impulses()):
        reference = scene.reference(size).astype(np.float64)
        for name, frames in isosurface_programs(scene, size).items():
            try:
                errors = _error_row(frames, reference)
            finally:
                frames.release()
            rows.append((scene.name, name, *errors))
    yield table(
        ("scene", "method", "largest error × 255", "RMSE × 255", "pixels above 0.5/255", "time"), rows
    )


def isosurface_programs(scene: RaycastScene, size: int) -> dict[str, Frames]:
    """Peak finding with each way of finding crossings, and VTK at two steps."""
    found: dict[str, Frames] = {
        "peak finding, exact crossings": OurFrames(scene, size, settings_of(PEAKS, 1.0)),
        "peak finding, secant, 4 peaks, 1024 bins": OurFrames(
            scene,
            size,
            settings_of({**PEAKS, "crossings": Crossings.SECANT, "peaks": 4, "peak_bins": 1024}, 1.0),
        ),
        "pre-integrated, exact": OurFrames(scene, size, settings_of(PRE, 1.0)),
    }
    if has_vtk():
        found["VTK, isosurface mode"] = vtk_frames(scene, size, 1.0)
        found["VTK, isosurface mode, steps of 1/4"] = vtk_frames(scene, size, 0.25)
    return found


def _error_row(frames: Frames, reference: np.ndarray[tuple[int, ...], np.dtype[np.float64]]) -> list[str]:
    picture, seconds = timed_frame(frames, repetitions=3)
    error = np.abs(picture.astype(np.float64) - reference)
    return [
        f"{255 * error.max():.2f}",
        f"{255 * np.sqrt(np.mean(error**2)):.3f}",
        f"{100 * np.mean(error.max(axis=-1) > SAME_ERROR):.2f} %",
        f"{1e3 * seconds:.0f} ms",
    ]


def main() -> None:
    """Run this benchmark alone: `python -m benchmarks.bench_raycast [--quick] [part …]`; `--help` tells of the rest."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.bench_raycast", description=__doc__)
    parser.add_argument("--quick", action="store_true", help="small pictures and few repetitions")
    parts: dict[str, Callable[..., Iterator[str]]] = {
        "vtk": against_vtk,
        "macrocells": raycast_tables.macrocells,
        "performance": raycast_tables.performance,
        "differential": raycast_tables.differential,
        "closeups": raycast_closeups.close_ups,
        "isosurfaces": many_isosurfaces,
    }
    parser.add_argument("parts", nargs="*", help=f"some of {', '.join(parts)}; all by default")
    for option, kind in (("scenes", str), ("sizes", int), ("methods", str)):
        parser.add_argument(
            f"--{option}", type=kind, action="append", default=[], help="of the part vtk; parts of names"
        )
    arguments = parser.parse_args()
    unknown = sorted(set(arguments.parts) - set(parts))
    if unknown:
        sys.exit(f"no part {', '.join(unknown)}; there are {', '.join(parts)}")
    print(describe_machine())
    chosen = {name: getattr(arguments, name) for name in ("scenes", "sizes", "methods")}
    for name in arguments.parts or parts:
        for text in parts[name](quick=arguments.quick, **(chosen if name == "vtk" else {})):
            print(text, flush=True)


if __name__ == "__main__":
    main()

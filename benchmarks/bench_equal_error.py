"""Times at equal errors: the data-centric renderer, the ray caster of this project, and VTK's mappers.

python -m benchmarks.bench_equal_error [--quick | --full] [--pictures FOLDER]
"""

from __future__ import annotations

import argparse
import math
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from benchmarks import equal_error_scenes
from benchmarks.bench_raycast import OURS as RAY_CASTERS
from benchmarks.bench_raycast import has_vtk, vtk_driver
from benchmarks.equal_error_methods import (
    DATA_CENTRIC,
    VTK_FIXED,
    VTK_GPU,
    VTK_ISO,
    label,
    makers_of,
)
from benchmarks.machine import describe_machine, table
from benchmarks.raycast_curves import Curve, measure
from isosample.rendering.image import Image

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence

    from benchmarks.raycast_curves import Point
    from benchmarks.raycast_scenes import RaycastScene

ERRORS = (0.005, 0.002, 0.001)
SIZE, LARGE_SIZE, QUICK_SIZE = 512, 1024, 128
REPETITIONS, QUICK_REPETITIONS = 5, 1
SLOW = 0.5  # [s]; of longer frames three are enough
# After a frame that takes more seconds of all cores together a method's finer settings are left out.
STOP_SECONDS = {QUICK_SIZE: 1.0, SIZE: 12.0, LARGE_SIZE: 12.0}


# -- tables ---------------------------------------------------------------------------------------


class Least(NamedTuple):
    """The least time with which methods of a kind reach an error; infinite if none does."""

    seconds: float = math.inf
    method: str = ""
    coarsest: bool = False  # already the coarsest setting is good enough

    def text(self) -> str:
        """In words."""
        if math.isinf(self.seconds):
            return "not reached"
        return f"{'≤ ' if self.coarsest else ''}{1e3 * self.seconds:.0f} ms"


def least(
    curves: Mapping[str, Curve], error: float, kind: Callable[[str], bool], *, processor: bool = False
) -> Least | None:
    """Least time of a kind of methods: by interpolation, or that of a setting that was drawn; None without any."""
    chosen = {name: curve for name, curve in curves.items() if kind(name)}
    cost = Curve.processor_at_error if processor else Curve.seconds_at_error
    found = []
    for name, curve in chosen.items():
        between = cost(curve, error)
        drawn = [p.processor if processor else p.seconds for p in curve.points if p.error <= error]
        times = [*drawn, *([] if between is None else [between])]
        found.append(Least(min(times, default=math.inf), name, curve.reached_by_coarsest(error)))
    return min(found, default=None)


def is_ours(name: str) -> bool:
    """Whether a method is the data-centric one."""
    return name.startswith(DATA_CENTRIC)


def is_gpu_peer(name: str) -> bool:
    """Whether a method is VTK's shader."""
    return name in (VTK_GPU, VTK_ISO)


def is_caster(name: str) -> bool:
    """Whether a method is this project's ray caster."""
    return name in RAY_CASTERS


def is_fixed_peer(name: str) -> bool:
    """Whether a method is VTK's ray caster on the processor."""
    return name == VTK_FIXED


def verdict_rows(scene: RaycastScene, size: int, curves: Mapping[str, Curve]) -> Iterator[tuple[str, ...]]:
    """One row per error: the least time of every kind of method, and the ratios to the data-centric one."""
    kinds = (is_ours, is_caster, is_gpu_peer, is_fixed_peer)
    for error in ERRORS:
        found = [least(curves, error, kind) for kind in kinds]
        spent = [least(curves, error, kind, processor=True) for kind in kinds]
        times = ["–" if one is None else one.text() for one in found]
        if found[1] is not None and found[1].seconds < math.inf:
            times[1] += f" ({found[1].method})"
        ratios = [
            "–" if found[other] is None else f"{_ratio(found, other)} ({_ratio(spent, other)})"
            for other in (1, 2, 3)
        ]
        drawn = _cheapest_measured(scene, curves, error)
        yield (f"{scene.name}, {size}²", f"{error:g}", times[0], drawn, *times[1:], *ratios)


def _ratio(found: Sequence[Least | None], other: int) -> str:
    own, peer = found[0], found[other]
    if own is None or peer is None or (math.isinf(own.seconds) and math.isinf(peer.seconds)):
        return "–"
    if math.isinf(peer.seconds):
        return "∞"
    if math.isinf(own.seconds):
        return "0"
    return f"{peer.seconds / own.seconds:.2f}"


def _cheapest_measured(scene: RaycastScene, curves: Mapping[str, Curve], error: float) -> str:
    """The cheapest setting of the data-centric renderer that was drawn and meets the error."""
    good: list[tuple[float, str, Point]] = [
        (point.seconds, name, point)
        for name, curve in curves.items()
        if is_ours(name)
        for point in curve.points
        if point.error <= error
    ]
    if not good:
        return "–"
    seconds, name, point = min(good, key=lambda one: one[0])
    variant = name.removeprefix(DATA_CENTRIC)
    return f"{1e3 * seconds:.0f} ms: {label(scene, name, point.step)}{variant}"


def point_rows(scene: RaycastScene, size: int, curves: Mapping[str, Curve]) -> Iterator[tuple[str, ...]]:
    """What was measured, setting by setting."""
    for name, curve in curves.items():
        listed = "; ".join(
            f"{label(scene, name, point.step)}: {point.error:.2g} in {1e3 * point.seconds:.0f} ms"
            + (f" ({point.evaluations:.1f})" if point.samples else "")
            for point in curve.points
        )
        yield (f"{scene.name}, {size}²", name, listed)


# -- the benchmark --------------------------------------------------------------------------------


def pairs(*, quick: bool, full: bool) -> Iterator[tuple[RaycastScene, int]]:
    """Scenes and sizes: 1024² for two tents over the nucleon-like field alone unless `full`."""
    if quick:
        yield from ((scene, QUICK_SIZE) for scene in (*equal_error_scenes.tents_and_peaks(), _isosurfaces()))
        return
    scans: tuple[str, ...] = (equal_error_scenes.CLEAN, equal_error_scenes.NOISY)
    if full:
        scans = (*scans, equal_error_scenes.THIN)
    yield from ((scene, SIZE) for scene in equal_error_scenes.tents_and_peaks(*scans))
    yield _isosurfaces(), SIZE
    large = equal_error_scenes.tents_and_peaks(*scans) if full else [equal_error_scenes.tents()]
    yield from ((scene, LARGE_SIZE) for scene in large)


def _isosurfaces() -> RaycastScene:
    return equal_error_scenes.isosurfaces()


def report(*, quick: bool, full: bool = False, only: str = "", repetitions: int = REPETITIONS) -> str:
    """Both tables: times at equal errors, and all that was measured."""
    verdicts: list[tuple[str, ...]] = []
    points: list[tuple[str, ...]] = []
    for scene, size in pairs(quick=quick, full=full):
        if only not in f"{scene.name}, {size}²":
            continue
        curves = measure(
            makers_of(scene, size),
            scene.reference(size),
            repetitions=QUICK_REPETITIONS if quick else repetitions,
            stop_error=min(ERRORS),
            stop_processor=STOP_SECONDS[size],
            slow_frame=SLOW,
        )
        rows = list(verdict_rows(scene, size, curves))
        for row in rows:
            print("  " + "; ".join(row), flush=True)
        verdicts += rows
        points += point_rows(scene, size, curves)
    heads = (
        "scene", "RMSE", "data-centric", "cheapest that was drawn and meets it", "best ray caster of this project",
        "VTK, GPU", "VTK, fixed-point", "best ray caster / data-centric", "VTK, GPU / data-centric",
        "VTK, fixed-point / data-centric",
    )  # fmt: skip
    parts = [
        "## Data-centric frames, ray casters and VTK at equal errors\n",
        _told(repetitions),
        table(heads, verdicts),
        table(("scene", "method", "setting: RMSE in time (field evaluations or fragments per ray)"), points),
    ]
    return "\n".join(parts)


def _told(repetitions: int) -> str:
    """The conditions, in words."""
    driver = f" VTK on {vtk_driver()}." if has_vtk() else " VTK is not installed."
    return (
        "Frame times (with reading back, without the preparation) at which the RMSE of premultiplied linear RGBA "
        "against the float64 reference of the trilinear field is reached, between measured settings by straight lines "
        "in log-log, or with the cheapest setting that was drawn and errs less; medians of "
        f"{repetitions} frames in turn (3 of those above {SLOW:g} s). A method is swept from "
        "coarse to fine until it errs less than the smallest of these, a frame takes more than "
        f"{STOP_SECONDS[SIZE]:g} s of all cores together, or its settings end (data-centric: 8 per slope, of scans 2; "
        "triangles divided only where that shows: 1 and 2); "
        "≤: already its coarsest setting is good enough; ∞: the other one does not get there, 0: the data-centric "
        "one does not; in brackets the same ratio of the time of all cores."
        f"{driver} VTK gets float32 samples and framebuffer and tables of 16000 entries, since with 8 bits it errs "
        "more and takes no less time for the same error (see the ray caster). Near-Dirac: a peak whose foot is 1e-4 of "
        "the range wide, less than two entries of that table; steps from 2 to 1/8.\n"
    )


# -- pictures -------------------------------------------------------------------------------------


def keep_pictures(folder: Path, *, quick: bool, full: bool, only: str) -> None:
    """A picture per scene and method at a middling setting, and the reference, to look at."""
    folder.mkdir(parents=True, exist_ok=True)
    for scene, size in pairs(quick=quick, full=full):
        if only not in f"{scene.name}, {size}²":
            continue
        start = f"{scene.name} {size}".replace(" ", "_")
        Image(scene.reference(size)).save(folder / f"{start}.reference.png")
        for name, (make, settings) in makers_of(scene, size).items():
            frames = make(settings[math.ceil((len(settings) - 1) / 2)])
            try:
                Image(frames.render()).save(folder / f"{start}.{name.replace(' ', '_')}.png")
            finally:
                frames.release()


def main() -> None:
    """Run this benchmark alone."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.bench_equal_error", description=__doc__)
    parser.add_argument("--quick", action="store_true", help="no scans, small pictures, single frames")
    parser.add_argument("--full", action="store_true", help="a third scan, and scans at 1024² too: an hour")
    parser.add_argument(
        "--only", default="", help="scenes whose name and size contain this, such as 'engine'"
    )
    parser.add_argument("--pictures", type=Path, help="instead keep a picture of every method, to look at")
    parser.add_argument(
        "--repetitions", type=int, default=REPETITIONS, help="frames of which the median counts, %(default)s"
    )
    arguments = parser.parse_args()
    choice = {"quick": arguments.quick, "full": arguments.full, "only": arguments.only}
    if arguments.pictures:
        keep_pictures(arguments.pictures, **choice)
        return
    print(describe_machine())
    print(report(**choice, repetitions=arguments.repetitions))


if __name__ == "__main__":
    main()

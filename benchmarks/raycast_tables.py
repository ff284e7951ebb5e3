"""Tables of the ray caster alone: macrocells, the layouts of tables 1 and 2 of Knoll et al. 2009."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from benchmarks.machine import table
from benchmarks.raycast_curves import Curve, OurFrames, measure, timed_frame
from benchmarks.raycast_scenes import RaycastScene, close_up, far_view, nucleon_tents, scans
from isosample.rendering.raycast_settings import (
    Classification,
    Crossings,
    PeakMode,
    PeakWeight,
    RaycastSettings,
    Sampling,
)
from isosample.volume.reconstruction import Reconstruction

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from benchmarks.raycast_curves import Frames

UNIFORM_STEPS = (8.0, 4.0, 2.0, 1.0, 0.5, 0.25)
PIXEL_SCALES = (256.0, 64.0, 32.0, 16.0, 8.0, 4.0, 2.0, 1.0)
PIXEL_SCALE = 4.0
METHODS: dict[str, dict[str, Any]] = {
    "peak finding": {
        "classification": Classification.PEAK_FINDING,
        "peak_mode": PeakMode.BOTH,
        "peak_weight": PeakWeight.INTEGRAL,
        "crossings": Crossings.SECANT,
        "peaks": 4,
        "peak_bins": 1024,
    },
    "post-classified": {"classification": Classification.POST_CLASSIFIED},
    "pre-integrated": {"classification": Classification.PRE_INTEGRATED},
}
FILTERS = {"trilinear": Reconstruction.TRILINEAR, "B-spline": Reconstruction.BSPLINE}


# -- macrocells -----------------------------------------------------------------------------------


def macrocells(*, quick: bool) -> Iterator[str]:
    """Frames with and without skipping; the pictures are the same."""
    size = 128 if quick else 512
    yield f"### Macrocells, steps of 1/2 voxel, pre-integrated, {size}²\n"
    rows = [_macrocell_row(scene, size, quick=quick) for scene in [nucleon_tents(), *scans()]]
    yield table(
        (
            "scene", "occupied", "samples per ray: all / skipping", "time: all / skipping", "ratio",
            "largest difference",
        ),
        rows,
    )  # fmt: skip


def _macrocell_row(scene: RaycastScene, size: int, *, quick: bool) -> tuple[str, ...]:
    seconds, samples, pictures = [], [], []
    for skipping in (False, True):
        frames = OurFrames(scene, size, RaycastSettings(skipping=skipping))
        try:
            picture, spent = timed_frame(frames, repetitions=1 if quick else 5)
            seconds.append(spent)
            samples.append(frames.samples)
            pictures.append(picture)
            occupied = frames.occupied
        finally:
            frames.release()
    return (
        scene.name,
        f"{100 * occupied:.1f} %",
        f"{samples[0]:.0f} / {samples[1]:.0f}",
        f"{1e3 * seconds[0]:.0f} / {1e3 * seconds[1]:.0f} ms",
        f"{seconds[0] / seconds[1]:.2f}",
        f"{np.abs(pictures[0] - pictures[1]).max():.1e}",
    )


# -- table 1: all volumes -------------------------------------------------------------------------


def performance(*, quick: bool) -> Iterator[str]:
    """Samples per ray and frame times of the three methods with differential sampling."""
    size = 128 if quick else 512
    yield f"### Differential sampling with s_k = {PIXEL_SCALE:g}, {size}² (layout of Knoll 2009, table 1)\n"
    rows = [_performance_row(scene, size, quick=quick) for scene in _perspective_scenes()]
    yield table(
        (
            "volume", "samples", "field evaluations per ray, peak finding", "samples per ray, no peaks",
            "time: peak finding / post-classified / pre-integrated", "RMSE of these",
        ),
        rows,
    )  # fmt: skip


def _perspective_scenes() -> Iterator[RaycastScene]:
    for scene in [nucleon_tents(), *scans()]:
        yield scene.looked_at("far", far_view(scene))
        if scene.name in ("aneurism", "vessels (MRA)"):
            yield scene.looked_at("close-up", close_up(scene))


def _performance_row(scene: RaycastScene, size: int, *, quick: bool) -> tuple[str, ...]:
    reference = scene.reference(size)
    makers: dict[str, tuple[Callable[[float], Frames], Sequence[float]]] = {
        name: (_frames(scene, size, differential=True, **options), (PIXEL_SCALE,))
        for name, options in METHODS.items()
    }
    curves = measure(makers, reference, repetitions=1 if quick else 5)
    points = {name: curve.points[0] for name, curve in curves.items()}
    peaks = points["peak finding"]
    return (
        scene.name,
        "×".join(str(n) for n in scene.volume.size_xyz),
        f"{peaks.evaluations:.0f}",
        f"{points['post-classified'].samples:.0f}",
        " / ".join(f"{1e3 * points[name].seconds:.0f}" for name in METHODS) + " ms",
        " / ".join(f"{points[name].error:.1e}" for name in METHODS),
    )


def _frames(
    scene: RaycastScene, size: int, *, differential: bool, **options: Any
) -> Callable[[float], Frames]:
    """Frames by a step, or by a scale of the pixels."""

    def make(step: float) -> Frames:
        sampling: dict[str, Any] = (
            {"sampling": Sampling.DIFFERENTIAL, "pixel_scale": step} if differential else {"step": step}
        )
        return OurFrames(
            scene, size, RaycastSettings(**options, **sampling, reconstruction=scene.reconstruction)
        )

    return make


# -- table 2: differential against uniform sampling -----------------------------------------------


def differential(*, quick: bool) -> Iterator[str]:
    """Differential sampling, s_k = 4, beside uniform steps that take as long, and that err as much."""
    size = 96 if quick else 256
    yield f"### Differential against uniform sampling, {size}² (layout of Knoll 2009, table 2)\n"
    yield (
        f"Differential sampling with s_k = {PIXEL_SCALE:g}; uniform sampling at the same time and at the same RMSE, "
        "between measured steps by straight lines in log-log. Samples: field evaluations per ray, those of root "
        "finding included.\n"
    )
    names = ("aneurism",) if quick else ("aneurism", "vessels (MRA)", "embryo (noisy)")
    rows = [
        row
        for scene in ([] if quick else [nucleon_tents()]) + list(scans(*names))
        for view, camera in (("close-up", close_up(scene)), ("far", far_view(scene)))
        for filter_name, reconstruction in FILTERS.items()
        for row in _differential_rows(
            scene.looked_at(view, camera).reconstructed(reconstruction), filter_name, size, quick=quick
        )
    ]
    yield table(
        (
            "scene", "filter", "method", "differential: samples, time, RMSE", "uniform, same time: samples, RMSE",
            "uniform, same RMSE: samples, time", "samples at the same RMSE: differential / uniform",
        ),
        rows,
    )  # fmt: skip


def _differential_rows(
    scene: RaycastScene, filter_name: str, size: int, *, quick: bool
) -> Iterator[tuple[str, ...]]:
    reference = scene.reference(size)
    for name in ("post-classified", "peak finding"):
        makers: dict[str, tuple[Callable[[float], Frames], Sequence[float]]] = {
            "uniform": (_frames(scene, size, differential=False, **METHODS[name]), UNIFORM_STEPS),
            "differential": (_frames(scene, size, differential=True, **METHODS[name]), PIXEL_SCALES),
        }
        curves = measure(makers, reference, repetitions=1 if quick else 3)
        yield (scene.name, filter_name, name, *_equal_cells(curves["uniform"], curves["differential"]))


def _equal_cells(uniform: Curve, grown: Curve) -> Iterator[str]:
    """What uniform sampling costs at the time, and at the error, of differential sampling."""
    chosen = next(point for point in grown.points if point.step == PIXEL_SCALE)
    own = chosen.evaluations
    yield f"{own:.0f}, {1e3 * chosen.seconds:.0f} ms, {chosen.error:.1e}"
    error = uniform.error_at_seconds(chosen.seconds)
    taken = uniform.evaluations_at_seconds(chosen.seconds)
    yield "beyond its steps" if error is None or taken is None else f"{taken:.0f}, {error:.1e}"
    samples = uniform.evaluations_at_error(chosen.error)
    seconds = uniform.seconds_at_error(chosen.error)
    if samples is None or seconds is None:
        finest = uniform.points[-1]
        yield f"> {finest.evaluations:.0f}, > {1e3 * finest.seconds:.0f} ms"
        yield f"< {own / finest.evaluations:.2f}"
    else:
        yield f"{samples:.0f}, {1e3 * seconds:.0f} ms"
        yield f"{own / samples:.2f}"

"""The ray caster's convergence studies: steps refined, peaks narrowed, and where its errors end."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from isosample.compare.differences import rmse
from isosample.compare.raycast_scenes import near_dirac, ramp, ramp_bound
from isosample.compare.study import Study
from isosample.rendering.raycast_settings import (
    Classification,
    Crossings,
    PeakWeight,
    Quadrature,
    RaycastSettings,
    Sampling,
)

if TYPE_CHECKING:
    from collections.abc import Callable

    import numpy.typing as npt

    from isosample.compare.raycast_scenes import RaycastScene

    F64 = npt.NDArray[np.float64]

RIEMANN = RaycastSettings(classification=Classification.POST_CLASSIFIED, quadrature=Quadrature.RIEMANN)
TRAPEZOID = replace(RIEMANN, quadrature=Quadrature.TRAPEZOID)
PRE_INTEGRATED = RaycastSettings(classification=Classification.PRE_INTEGRATED)
PAPER = RaycastSettings(classification=Classification.PEAK_FINDING)
SHARE = replace(PAPER, peak_weight=PeakWeight.INTEGRAL)
EXACT = replace(SHARE, crossings=Crossings.EXACT)
STEPS = np.array([2.0, 4.0, 8.0, 16.0, 32.0])  # per voxel
PIXEL_SCALES = np.array([4.0, 1.0, 1 / 4, 1 / 16, 1 / 64])  # s_k
WIDTH = 1e-4  # of the near-Dirac peak, share of the largest value
EIGHT_BITS = 0.5 / 255.0


def raycast_programs(*, quick: bool) -> dict[str, Callable[[], Study]]:
    """The studies by name, each a callable that runs it."""
    return {
        "ray caster, post-classified, Riemann": lambda: riemann_study(quick=quick),
        "ray caster, post-classified, trapezoid": lambda: trapezoid_study(quick=quick),
        "ray caster, pre-integrated": lambda: pre_integrated_study(quick=quick),
        "ray caster, differential": lambda: differential_study(quick=quick),
        "ray caster, limits": lambda: limit_study(quick=quick),
        "ray caster, narrower peaks": lambda: narrow_peak_study(quick=quick),
        "ray caster, shares of a peak": lambda: peak_share_study(quick=quick),
        "ray caster, the paper's weights": lambda: paper_weight_study(quick=quick),
    }


def riemann_study(*, quick: bool) -> Study:
    """Post-classification, every step with the colour and extinction of its front."""
    return _step_study(
        "raycast_riemann",
        "Post-classified, Riemann sums: smaller steps under a ramp; against the trilinear reference.",
        RIEMANN,
        expected=(0.85, 1.15),
        reason="the value at the front of a step errs by f' h / 2, and where the ends of a ray differ the sum too",
        quick=quick,
    )


def trapezoid_study(*, quick: bool) -> Study:
    """Post-classification, straight from the front of a step to its back."""
    return _step_study(
        "raycast_trapezoid",
        "Post-classified, trapezoid rule: smaller steps under a ramp; against the trilinear reference.",
        TRAPEZOID,
        expected=(1.8, 2.3),
        reason="a chord errs by h² f'' / 12, and by O(h²) at each face of a cell, where the slope jumps",
        quick=quick,
    )


def pre_integrated_study(*, quick: bool) -> Study:
    """Pre-integration, piece by piece of the transfer function."""
    return _step_study(
        "raycast_pre-integrated",
        "Pre-integrated, exactly: smaller steps under a ramp; against the trilinear reference.",
        PRE_INTEGRATED,
        expected=(1.8, 2.3),
        reason="the transfer function is integrated exactly, the data are chords: as the trapezoid rule",
        quick=quick,
    )


def limit_study(*, quick: bool) -> Study:
    """Every method against the reference, to what chords and float32 can make."""
    scene, steps = ramp(_pixels(quick=quick)), _steps(quick=quick)
    errors = [
        max(
            _largest(scene, replace(method, step=1.0 / n))
            for method in (TRAPEZOID, PRE_INTEGRATED, SHARE, EXACT)
        )
        for n in steps
    ]
    return Study(
        name="raycast_limits",
        question="Post-classified (trapezoid), pre-integrated, peak finding: the largest error of any of them.",
        parameter="steps per voxel",
        refinement=steps,
        errors=np.array(errors),
        measure="largest error",
        bounds=np.array([ramp_bound(scene, 1.0 / n) for n in steps]),
        reason="chords are off by derivatives of the interpolant that its samples bound, and float32 by its roundings",
    )


def differential_study(*, quick: bool) -> Study:
    """Differential sampling in perspective, down to very small s_k."""
    scene = ramp(24 if quick else 96, perspective=True)
    scales = PIXEL_SCALES[-3:] if quick else PIXEL_SCALES
    differential = replace(TRAPEZOID, sampling=Sampling.DIFFERENTIAL)
    return Study(
        name="raycast_differential",
        question="Differential sampling: smaller s_k under a ramp; against the trilinear reference.",
        parameter="1 / s_k",
        refinement=1.0 / scales,
        errors=np.array([_rmse(scene, replace(differential, pixel_scale=s)) for s in scales]),
        measure="RMSE",
        expected=(0.85, 1.15),
        reason="the steps grow evenly from sample to sample: at a distance D they are √(b² + 2 a D), of O(√s_k), and "
        "chords err by their squares",
    )


def narrow_peak_study(*, quick: bool) -> Study:
    """Peak finding with exact crossings and exact shares: ever narrower peaks of the same area."""
    widths = np.array([1e-2, 1e-3, 1e-4] if quick else [1e-2, 1e-3, 1e-4, 1e-5])
    errors = [_largest(near_dirac(_pixels(quick=quick), width), replace(EXACT, step=2.0)) for width in widths]
    return Study(
        name="raycast_narrow_peaks",
        question="Peak finding, exact crossings, weights by integral, steps of 2 voxels: narrower peaks.",
        parameter="1 / half width of the peak",
        refinement=1.0 / widths,
        errors=np.array(errors),
        measure="largest error",
        bounds=np.full(len(widths), EIGHT_BITS),
        reason="every crossing is found and has its share of the integral: half a step of 8 bits, however narrow the "
        "peak; float32 reads the value where a ray is nearly tangent only to so many digits",
    )


def peak_share_study(*, quick: bool) -> Study:
    """Peak finding by secants with exact shares: smaller steps on a near-Dirac peak."""
    return _step_study(
        "raycast_peak_shares",
        f"Peak finding by secants, weights by integral: smaller steps, a peak of half width {WIDTH:g}.",
        SHARE,
        scene=near_dirac(_pixels(quick=quick), WIDTH),
        error=_mean,
        measure="mean absolute error",
        expected=(0.75, 1.5),
        reason="the chord's slope stands for that at the crossing and errs by O(h); O(h²) of all rays cross twice "
        "within a step",
        quick=quick,
    )


def paper_weight_study(*, quick: bool) -> Study:
    """Peak finding with the paper's weights: smaller steps change nothing."""
    return _step_study(
        "raycast_paper_weights",
        f"Peak finding as in the paper: smaller steps, a peak of half width {WIDTH:g}.",
        PAPER,
        scene=near_dirac(_pixels(quick=quick), WIDTH),
        error=_mean,
        measure="mean absolute error",
        expected=(-0.1, 0.1),
        reason="a crossing has the opacity of the peak's extinction over a length of 1, whatever the step and slope: "
        "not the integral, and nothing to converge",
        quick=quick,
    )


def _step_study(
    name: str,
    question: str,
    raycast: RaycastSettings,
    *,
    expected: tuple[float, float],
    reason: str,
    quick: bool,
    scene: RaycastScene | None = None,
    error: Callable[[RaycastScene, RaycastSettings], float] | None = None,
    measure: str = "RMSE",
) -> Study:
    """Smaller steps, all else kept."""
    scene, steps = scene or ramp(_pixels(quick=quick)), _steps(quick=quick)
    error = error or _rmse
    return Study(
        name=name,
        question=question,
        parameter="steps per voxel",
        refinement=steps,
        errors=np.array([error(scene, replace(raycast, step=1.0 / n)) for n in steps]),
        measure=measure,
        expected=expected,
        reason=reason,
    )


def _pixels(*, quick: bool) -> int:
    return 24 if quick else 48


def _steps(*, quick: bool) -> F64:
    return STEPS[:3] if quick else STEPS


def _rmse(scene: RaycastScene, raycast: RaycastSettings) -> float:
    return rmse(scene.picture(raycast)[None], scene.truth[None])  # a picture of one row


def _mean(scene: RaycastScene, raycast: RaycastSettings) -> float:
    return float(np.abs(scene.picture(raycast) - scene.truth).mean())


def _largest(scene: RaycastScene, raycast: RaycastSettings) -> float:
    return float(np.abs(scene.picture(raycast) - scene.truth).max())

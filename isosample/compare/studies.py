"""The convergence studies of `isosample verify`: one parameter refined at a time, on closed-form scenes."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from isosample.compare.differences import rmse
from isosample.compare.exact_crossings import integrate_exact_crossings
from isosample.compare.raycast_studies import raycast_programs
from isosample.compare.study import Study
from isosample.compare.study_scenes import EDGE, TwoTents, draw, layers, smooth_window
from isosample.integral.field_reference import integrate_field_rays
from isosample.integral.optics import opacity_from_depth, segment_weights
from isosample.integral.reference import integrate_rays
from isosample.integral.segment_rule import SegmentRule
from isosample.rendering.settings import RenderSettings
from isosample.transfer.control_points import ControlPoint, Isosurface
from isosample.transfer.transfer_function import TransferFunction
from isosample.volume.analytic import nucleon_like
from isosample.volume.grid import Volume

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

F64 = npt.NDArray[np.float64]

U = 2.0**-24  # unit roundoff of float32
REFERENCE_BOUND = 1e-10
LINEAR = RenderSettings(segment=SegmentRule.LINEAR)

RULE_ORDERS = {
    SegmentRule.CONSTANT: ((1.0, 1.75), "the front value is first order; missed extrema alone give 1.5"),
    SegmentRule.CONSTANT_FIRST_ORDER: ((0.7, 1.3), "1 − τ h errs by (τ h)² / 2 per segment: first order"),
    SegmentRule.LINEAR: (
        (1.25, 1.85),
        "a ray turns between two isovalues: the height missed is O(dv) over a length O(√dv), 1.5 in all",
    ),
    SegmentRule.CUBIC: (
        (1.9, 2.8),
        "where a ray turns, the cubic misses h⁴ f⁗ over a length h = O(√dv), 2.5 in all; less where it is limited",
    ),
}
RULE_RAYS = {SegmentRule.CUBIC: 20}  # along an edge, quick: fewer hardly meet a turn close to an isovalue


def run_studies(*, quick: bool = False, progress: Callable[[str], None] | None = None) -> Iterator[Study]:
    """Run every study, one after the other.

    Parameters
    ----------
    quick : bool
        Fewer refinements and rays: for the test suite.
    progress : callable, optional
        Called with the name of each study before it runs.

    Yields
    ------
    study : Study
    """
    programs: dict[str, Callable[[], Study]] = {}
    for rule in SegmentRule:
        programs[f"isovalues, {rule.value}"] = lambda rule=rule: isovalue_study(rule, quick=quick)  # type: ignore[misc]
    programs["grid"] = lambda: grid_study(quick=quick)
    programs["isovalues on a grid"] = lambda: surface_count_study(quick=quick)
    programs["pixels"] = lambda: pixel_study(quick=quick)
    programs["layers"] = lambda: layer_study(quick=quick)
    programs |= raycast_programs(quick=quick)
    programs["reference, slabs"] = reference_slab_study
    programs["reference, panels"] = lambda: reference_panel_study(quick=quick)
    for name, program in programs.items():
        if progress is not None:
            progress(name)
        yield program()


def isovalue_study(rule: SegmentRule, *, quick: bool) -> Study:
    """Exact crossings, more isovalues per slope: the segment rule alone."""
    scene = TwoTents()
    origins, directions = scene.rays(RULE_RAYS.get(rule, 14) if quick else 28)
    truth = integrate_field_rays(nucleon_like(), scene.transfer_function, scene.box, origins, directions)
    counts = np.array([3, 7, 15] if quick else [3, 7, 15, 31])
    errors = []
    for count in counts:
        plan = scene.plan(int(count))
        found = integrate_exact_crossings(nucleon_like(), plan, scene.box, origins, directions, rule)
        errors.append(rmse(found[None], truth[None]))  # a picture of one row
    expected, reason = RULE_ORDERS[rule]
    return Study(
        name=f"isovalues_{rule.value}",
        question=f"More isovalues per slope, exact crossings, segments {rule.value}; against the analytic field.",
        parameter="isovalues per slope + 1",
        refinement=counts + 1.0,
        errors=np.array(errors),
        measure="RMSE",
        expected=expected,
        reason=reason,
    )


def grid_study(*, quick: bool) -> Study:
    """Finer grids, the same isovalues: the flat mesh alone."""
    scene, per_slope = TwoTents(), 5
    pixels = 24 if quick else 48
    origins, directions = scene.rays(pixels)
    truth = integrate_exact_crossings(
        nucleon_like(), scene.plan(per_slope), scene.box, origins, directions, SegmentRule.LINEAR
    )
    edges = np.array([17, 33, 65] if quick else [17, 33, 65, 129])
    pictures = (scene.picture(int(edge), pixels, per_slope, LINEAR) for edge in edges)
    errors = [np.abs(picture - truth).mean() for picture in pictures]
    return Study(
        name="grid",
        question="Finer grids, the same isovalues, linear segments; against exact crossings of the analytic field.",
        parameter="cells along an edge",
        refinement=edges - 1.0,
        errors=np.array(errors),
        measure="mean absolute error",
        expected=(1.7, 2.4),
        reason="the chord of a cell is off by O(h²), and rays that miss a silhouette are O(h²) of all rays",
    )


def surface_count_study(*, quick: bool) -> Study:
    """More isovalues on one fine grid, by the GPU: the pipeline as a whole against the trilinear reference."""
    scene = TwoTents()
    samples, pixels = (49, 32) if quick else (129, 64)
    origins, directions = scene.rays(pixels)
    truth = integrate_rays(scene.sampled(samples), scene.transfer_function, origins, directions)
    counts = np.array([1, 3, 7] if quick else [1, 3, 7, 15])
    pictures = (scene.picture(samples, pixels, int(count), LINEAR) for count in counts)
    errors = [rmse(picture[None], truth[None]) for picture in pictures]  # a picture of one row
    return Study(
        name="isovalues_on_a_grid",
        question=f"More isovalues per slope on a grid of {samples}³, linear segments; against the trilinear reference.",
        parameter="isovalues per slope + 1",
        refinement=counts + 1.0,
        errors=np.array(errors),
        measure="RMSE",
        expected=(1.2, 2.0),
        reason="as with exact crossings, 1.5, before the mesh's own error is reached",
    )


def pixel_study(*, quick: bool) -> Study:
    """Smaller pixels: the mean of a smooth picture against its closed form."""
    edges = np.array([2, 4, 8] if quick else [2, 4, 8, 16, 32])
    scene, camera, mean = smooth_window()
    errors = [np.abs(draw(scene, camera, (int(n), int(n)))[0].mean(axis=(0, 1)) - mean).max() for n in edges]
    return Study(
        name="pixels",
        question="More pixels of one window, by the GPU; the picture's mean against its closed form.",
        parameter="pixels along an edge",
        refinement=edges.astype(np.float64),
        errors=np.array(errors),
        measure="error of the mean",
        expected=(1.9, 2.1),
        reason="one ray through the middle of each pixel is the midpoint rule: order 2 for a smooth picture",
    )


def layer_study(*, quick: bool) -> Study:
    """More layers: the composite of the A-buffer against the analytic product."""
    counts = np.array([1, 4, 16, 64] if quick else [1, 4, 16, 64, 256, 1024])
    errors = []
    for count in counts:
        scene, camera, expected = layers(int(count), 0.05)
        rgba, _ = draw(scene, camera, (16, 16), RenderSettings(min_transmittance=0.0))
        errors.append(np.abs(rgba - expected).max())
    return Study(
        name="layers",
        question="More translucent layers, by the GPU; against the analytic product.",
        parameter="layers",
        refinement=counts.astype(np.float64),
        errors=np.maximum(errors, U / 64),
        measure="largest error",
        bounds=3.0 * np.minimum(counts, 1.0 / 0.05 + 3.0) * U + 2.0 * U,
        reason="3 roundings per layer, weighted by transmittances that sum to 1 / opacity: flat in float32",
    )


def reference_slab_study() -> Study:
    """The float64 reference against closed forms: constant, rising and falling slabs and impulses of any depth."""
    depths = np.array([1e-3, 1e-2, 0.1, 1.0, 10.0, 100.0])
    errors = [max(_slab_errors(float(depth))) for depth in depths]
    return Study(
        name="reference_closed_forms",
        question="The float64 reference against closed forms: constant and linear slabs and impulses.",
        parameter="optical depth",
        refinement=depths,
        errors=np.maximum(errors, 1e-17),
        measure="largest error",
        bounds=np.full(len(depths), REFERENCE_BOUND),
        reason="the reference promises 1e-10",
    )


def _slab_errors(depth: float) -> Iterator[float]:
    """Errors of the reference on slabs of world length 2 with so much optical depth."""
    z = np.linspace(0.0, 1.0, 5)
    volume = Volume(np.broadcast_to(z[:, None, None], (5, 3, 3)), spacing=(1.0, 1.0, 0.5), name="slab")
    red, blue = np.array([1.0, 0.25, 0.0]), np.array([0.0, 0.5, 1.0])
    origins, directions = np.array([[0.7, 1.2, 5.0]]), np.array([[0.0, 0.0, -1.0]])
    tau = depth / 2.0
    for low, high in ((tau, tau), (0.0, 2.0 * tau), (2.0 * tau, 0.0), (0.5 * tau, 1.5 * tau)):
        points = [ControlPoint(0.0, tuple(red), low), ControlPoint(1.0, tuple(blue), high)]
        found = integrate_rays(volume, TransferFunction(points), origins, directions)[0]
        front, back = segment_weights(high * 2.0, low * 2.0)
        yield np.abs(found - [*(front * blue + back * red), opacity_from_depth(low + high)]).max()
    impulses = [Isosurface(0.25, tuple(red), 0.5), Isosurface(0.6, tuple(blue), 0.3)]
    flat = [ControlPoint(0.0, (1.0, 1.0, 1.0), tau), ControlPoint(1.0, (1.0, 1.0, 1.0), tau)]
    found = integrate_rays(volume, TransferFunction(flat, impulses), origins, directions)[0]
    expected, transmittance = np.zeros(3), 1.0
    for length, color, opacity in ((0.8, blue, 0.3), (0.7, red, 0.5), (0.5, red, 0.0)):
        alpha = float(opacity_from_depth(tau * length))
        expected = expected + transmittance * (alpha + (1.0 - alpha) * opacity * color)
        transmittance *= (1.0 - alpha) * (1.0 - opacity)
    yield np.abs(found - [*expected, 1.0 - transmittance]).max()


def reference_panel_study(*, quick: bool) -> Study:
    """The reference against itself with twice the panels, on a grid."""
    scene = TwoTents()
    edges = np.array([17, 33] if quick else [17, 33, 65])
    origins, directions = scene.rays(16)
    # Where the colour is constant the reference is in closed form: here it is not, so that there is quadrature.
    colors = {0.15: ((0.1, 0.3, 1.0), 0.0), 0.45: ((1.0, 0.7, 0.1), 0.8), 0.8: ((1.0, 0.1, 0.3), 0.0)}
    tf = TransferFunction([ControlPoint(scene.scale * v, color, e) for v, (color, e) in colors.items()])
    errors = []
    for edge in edges:
        volume = scene.sampled(int(edge))
        once, twice = (integrate_rays(volume, tf, origins, directions, panels=panels) for panels in (1, 2))
        errors.append(np.abs(once - twice).max())
    return Study(
        name="reference_halving",
        question=f"The float64 reference on grids of a box of {EDGE:g} units, against itself with every panel halved.",
        parameter="samples along an edge",
        refinement=edges.astype(np.float64),
        errors=np.maximum(errors, 1e-17),
        measure="largest difference",
        bounds=np.full(len(edges), REFERENCE_BOUND),
        reason="the reference promises 1e-10",
    )

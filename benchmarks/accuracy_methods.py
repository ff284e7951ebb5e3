"""The pictures that the accuracy benchmark compares, and how far they are apart."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from benchmarks.accuracy_scenes import squared
from isosample.compare.exact_crossings import exact_crossing_lists
from isosample.compare.metrics import Pixels, percentile_error, rmse, tangent_step
from isosample.integral.data_centric import integrate_lists
from isosample.integral.field_reference import integrate_field_rays
from isosample.integral.grid_crossings import grid_crossings
from isosample.integral.reference import integrate_rays
from isosample.integral.segment_rule import SegmentRule
from isosample.rendering.picture_lists import least_sheet_slope
from isosample.rendering.pipeline import Renderer
from isosample.surfaces.extract import extract_surfaces
from isosample.volume.field import Field

if TYPE_CHECKING:
    from benchmarks.accuracy_scenes import AccuracyScene
    from isosample.integral.crossing_lists import CrossingLists
    from isosample.rendering.settings import RenderSettings
    from isosample.surfaces.extract import SurfaceSet
    from isosample.transfer.isovalue_plan import IsovaluePlan
    from isosample.transfer.transfer_function import TransferFunction
    from isosample.volume.grid import F64
    from isosample.volume.reconstruction import Reconstruction

RULES = (SegmentRule.CONSTANT, SegmentRule.LINEAR, SegmentRule.CUBIC)
TRUTH_TOLERANCE = 1e-6
# The extinction of the near-Dirac peak makes the promised tolerance pessimistic by the share of the ray that
# lies in the peak: 1e-2 is then within 5e-9 of 1e-4, measured on 24² rays of each field.
PEAK_EXTINCTION = 100.0
PEAK_TOLERANCE = 1e-2


@dataclass(frozen=True)
class _Unbounded(Field):
    """A field that keeps the bound of its slope to itself: the reference then verifies it at points."""

    field: Field

    def value(self, points: F64) -> F64:
        return self.field.value(points)

    def gradient(self, points: F64) -> F64:
        return self.field.gradient(points)


def field_truth(scene: AccuracyScene, field: Field, tf: TransferFunction, rays: tuple[F64, F64]) -> F64:
    """What the analytic field shows."""
    narrow = max(point.extinction for point in tf.points) > PEAK_EXTINCTION
    shown: Field = _Unbounded(field) if narrow else field
    tolerance = PEAK_TOLERANCE if narrow else TRUTH_TOLERANCE
    return integrate_field_rays(shown, tf, scene.volume.box, *rays, tolerance=tolerance)


def grid_truth(
    scene: AccuracyScene, tf: TransferFunction, rays: tuple[F64, F64], reconstruction: Reconstruction
) -> F64:
    """What a perfect ray caster of the samples shows."""
    return integrate_rays(scene.volume, tf, *rays, reconstruction=reconstruction, tolerance=TRUTH_TOLERANCE)


def exact_lists(scene: AccuracyScene, isovalues: F64, rays: tuple[F64, F64]) -> CrossingLists:
    """Crossings of the analytic field, or of the trilinear interpolant where there is none."""
    if scene.field is None:
        return grid_crossings(scene.volume, isovalues, *rays)
    return exact_crossing_lists(scene.field, isovalues, scene.volume.box, *rays)


def list_picture(scene: AccuracyScene, lists: CrossingLists, plan: IsovaluePlan, rule: SegmentRule) -> F64:
    """Picture of exact crossings, (N, 4)."""
    least = least_sheet_slope(plan.value_range, scene.volume.box)
    return integrate_lists(lists, plan, rule=rule, reach=0.0, least_slope=least).rgba


def mesh_surfaces(
    scene: AccuracyScene, isovalues: F64, reconstruction: Reconstruction, refine: int = 1
) -> SurfaceSet:
    """Meshes of a scene."""
    return extract_surfaces(scene.volume, isovalues, reconstruction=reconstruction, refine=refine)


def mesh_pictures(
    scene: AccuracyScene,
    surfaces: SurfaceSet,
    plan: IsovaluePlan,
    pixels: int,
    settings: dict[str, RenderSettings],
) -> dict[str, F64]:
    """Pictures by OpenGL under several settings, (N, 4) each."""
    with Renderer(surfaces, plan) as renderer:
        return {
            name: renderer.render(camera=scene.camera, size=(pixels, pixels), settings=chosen)
            .rgba.astype(np.float64)
            .reshape(-1, 4)
            for name, chosen in settings.items()
        }


def errors(picture: F64, truth: F64) -> dict[str, float]:
    """The three measures over visible pixels, to three digits; None of a picture that shows nothing."""
    found, expected = squared(picture), squared(truth)
    measures = {
        "rmse": rmse(found, expected, pixels=Pixels.VISIBLE),
        "p999": percentile_error(found, expected, 99.9, pixels=Pixels.VISIBLE),
        "step": tangent_step(found, expected, pixels=Pixels.VISIBLE),
    }
    return {name: float(f"{error:.3g}") for name, error in measures.items()}

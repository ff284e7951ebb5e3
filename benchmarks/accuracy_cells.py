"""The rows of the accuracy table: every scene, transfer function, number of isovalues and method."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Any

from benchmarks.accuracy_methods import (
    RULES,
    errors,
    exact_lists,
    field_truth,
    grid_truth,
    list_picture,
    mesh_pictures,
    mesh_surfaces,
)
from benchmarks.accuracy_scenes import OPACITIES, SHAPES, scenes
from isosample.integral.grid_crossings import grid_crossings
from isosample.integral.segment_rule import SegmentRule
from isosample.rendering.settings import RenderSettings
from isosample.volume.reconstruction import Reconstruction

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from benchmarks.accuracy_scenes import AccuracyScene
    from isosample.surfaces.extract import SurfaceSet
    from isosample.transfer.isovalue_plan import IsovaluePlan
    from isosample.volume.field import Field
    from isosample.volume.grid import F64

    Row = dict[str, Any]
    Truths = dict[tuple[str, str], F64]  # by opacity and reference

COUNTS = (1, 3, 5, 9, 17, 33)
QUICK_COUNTS = (1, 5, 17)
LARGE_COUNTS = (1, 5, 17)  # of meshes of larger grids
LARGE_SAMPLES = 500_000
PIXELS, QUICK_PIXELS = 64, 48
MAX_TRIANGLES = 1_500_000  # of one scene: more would measure this machine's patience
MAX_REFINED_TRIANGLES = 2_000_000
FIRST_GROWTH = 10.0  # of the triangles by refine 4, before it was seen

FIELD, TRILINEAR, SPLINE = "field", "trilinear", "spline"


class Table:
    """Rows of all cells; analytic truths and crossings are kept for grids of the same field."""

    def __init__(self, *, quick: bool, keep: Callable[[list[Row]], None] | None = None) -> None:
        self.pixels = QUICK_PIXELS if quick else PIXELS
        self.quick = quick
        self.rows: list[Row] = []
        self._keep = keep
        self._truths: dict[tuple[object, ...], F64] = {}
        self._exact_rows: dict[tuple[object, ...], list[Row]] = {}

    def run(self) -> list[Row]:
        """All cells, with a line of progress each."""
        for scene in scenes(quick=self.quick):
            for shape in SHAPES:
                started = time.perf_counter()
                self.rows += self._cells(scene, shape)
                print(f"{scene.name}, {shape}: {time.perf_counter() - started:.0f} s", flush=True)
                if self._keep is not None:
                    self._keep(self.rows)
        return self.rows

    def _cells(self, scene: AccuracyScene, shape: str) -> Iterator[Row]:
        rays = scene.rays(self.pixels)
        truths = {
            (opacity, name): truth
            for opacity in OPACITIES
            for name, truth in self._all_truths(scene, shape, opacity, rays)
        }
        common = {"scene": scene.name, "tf": shape}
        for opacity in OPACITIES if scene.field else ():
            measured = errors(truths[opacity, TRILINEAR], truths[opacity, FIELD])
            yield common | _row(opacity, 0, "perfect trilinear", FIELD) | measured
            measured = errors(truths[opacity, SPLINE], truths[opacity, FIELD])
            yield common | _row(opacity, 0, "perfect spline", FIELD) | measured
        counts = QUICK_COUNTS if self.quick else COUNTS
        large = scene.volume.array.size > LARGE_SAMPLES
        growth = FIRST_GROWTH
        for count in counts:
            plans = {opacity: scene.plan(shape, opacity, count) for opacity in OPACITIES}
            for row in self._exact(scene, shape, count, plans, truths):
                yield common | row
            if large and count not in LARGE_COUNTS:
                continue
            for row in grid_rows(scene, plans, rays, truths, count):
                yield common | row
            triangles = 0
            for row in self._flat(scene, plans, truths, count):
                triangles = row["triangles"]
                yield common | row
            for row in self._smooth(scene, plans, truths, count, triangles):
                yield common | row
            if triangles and growth * triangles <= MAX_REFINED_TRIANGLES:
                for row in self._refined(scene, plans, truths, count):
                    growth = row["triangles"] / triangles
                    yield common | row

    def _all_truths(
        self, scene: AccuracyScene, shape: str, opacity: str, rays: tuple[F64, F64]
    ) -> Iterator[tuple[str, F64]]:
        tf = scene.transfer_function(shape, opacity)
        yield TRILINEAR, grid_truth(scene, tf, rays, Reconstruction.TRILINEAR)
        yield SPLINE, grid_truth(scene, tf, rays, Reconstruction.CUBIC)
        if scene.field is not None:
            key = (scene.field, shape, opacity)
            if key not in self._truths:
                self._truths[key] = field_truth(scene, scene.field, tf, rays)
            yield FIELD, self._truths[key]

    def _exact(
        self,
        scene: AccuracyScene,
        shape: str,
        count: int,
        plans: dict[str, IsovaluePlan],
        truths: Truths,
    ) -> list[Row]:
        """Crossings of the analytic field; a sheet's place in the plan may differ by the grid."""
        field: Field | None = scene.field
        if field is None:
            return []
        isovalues = next(iter(plans.values())).isovalues
        key = (field, shape, count, isovalues.tobytes())
        if key not in self._exact_rows:
            lists = exact_lists(scene, isovalues, scene.rays(self.pixels))
            self._exact_rows[key] = [
                _row(opacity, count, f"exact {rule.value}", FIELD)
                | {"isovalues": len(isovalues)}
                | errors(list_picture(scene, lists, plan, rule), truths[opacity, FIELD])
                for opacity, plan in plans.items()
                for rule in RULES
            ]
        return self._exact_rows[key]

    def _flat(
        self, scene: AccuracyScene, plans: dict[str, IsovaluePlan], truths: Truths, count: int
    ) -> Iterator[Row]:
        isovalues = next(iter(plans.values())).isovalues
        surfaces = mesh_surfaces(scene, isovalues, Reconstruction.TRILINEAR)
        if sum(surfaces.statistics.triangles) > MAX_TRIANGLES:
            return
        settings = {f"mesh {rule.value}": RenderSettings(segment=rule) for rule in RULES}
        yield from self._pictures(scene, surfaces, plans, truths, count, settings, (TRILINEAR,))

    def _refined(
        self, scene: AccuracyScene, plans: dict[str, IsovaluePlan], truths: Truths, count: int
    ) -> Iterator[Row]:
        isovalues = next(iter(plans.values())).isovalues
        surfaces = mesh_surfaces(scene, isovalues, Reconstruction.TRILINEAR, refine=4)
        settings = {"mesh cubic, refine 4": RenderSettings(segment=SegmentRule.CUBIC)}
        yield from self._pictures(scene, surfaces, plans, truths, count, settings, (TRILINEAR,))

    def _smooth(
        self,
        scene: AccuracyScene,
        plans: dict[str, IsovaluePlan],
        truths: Truths,
        count: int,
        triangles: int,
    ) -> Iterator[Row]:
        if not triangles:
            return
        isovalues = next(iter(plans.values())).isovalues
        surfaces = mesh_surfaces(scene, isovalues, Reconstruction.CUBIC)
        settings = {"spline curved cubic": RenderSettings(segment=SegmentRule.CUBIC, curved=True)}
        against = (SPLINE,) if scene.field is None else (SPLINE, FIELD)
        yield from self._pictures(scene, surfaces, plans, truths, count, settings, against)

    def _pictures(
        self,
        scene: AccuracyScene,
        surfaces: SurfaceSet,
        plans: dict[str, IsovaluePlan],
        truths: Truths,
        count: int,
        settings: dict[str, RenderSettings],
        against: tuple[str, ...],
    ) -> Iterator[Row]:
        triangles = sum(surfaces.statistics.triangles)
        if not triangles:
            return
        for opacity, plan in plans.items():
            pictures = mesh_pictures(scene, surfaces, plan, self.pixels, settings)
            for name, picture in pictures.items():
                for reference in against:
                    row = _row(opacity, count, name, reference)
                    row |= {"isovalues": len(plan.isovalues), "triangles": triangles}
                    yield row | errors(picture, truths[opacity, reference])


def grid_rows(
    scene: AccuracyScene,
    plans: dict[str, IsovaluePlan],
    rays: tuple[F64, F64],
    truths: Truths,
    count: int,
) -> Iterator[Row]:
    """Exact crossings of the trilinear interpolant: what a mesh without any error would show."""
    isovalues = next(iter(plans.values())).isovalues
    lists = grid_crossings(scene.volume, isovalues, *rays)
    for opacity, plan in plans.items():
        for rule in RULES:
            row = _row(opacity, count, f"grid {rule.value}", TRILINEAR) | {"isovalues": len(isovalues)}
            yield row | errors(list_picture(scene, lists, plan, rule), truths[opacity, TRILINEAR])


def _row(opacity: str, count: int, method: str, against: str) -> Row:
    return {"opacity": opacity, "K": count, "method": method, "against": against}

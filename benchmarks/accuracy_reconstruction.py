"""The cubic spline on meshes against a perfect trilinear ray caster of the same samples."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Any

import numpy as np

from benchmarks.accuracy_methods import (
    errors,
    field_truth,
    grid_truth,
    list_picture,
    mesh_pictures,
    mesh_surfaces,
)
from benchmarks.accuracy_scenes import SHAPES, marschner_lobb, nucleon, shell
from benchmarks.machine import table
from isosample.integral.grid_crossings import grid_crossings
from isosample.integral.segment_rule import SegmentRule
from isosample.rendering.settings import RenderSettings
from isosample.volume.reconstruction import Reconstruction

if TYPE_CHECKING:
    from collections.abc import Iterator

    from benchmarks.accuracy_scenes import AccuracyScene
    from isosample.volume.grid import F64

    Row = dict[str, Any]

OPACITY = "translucent"
COUNTS = (5, 17, 65)  # isovalues per slope
REFINEMENTS = (1, 2, 4)
PIXELS, QUICK_PIXELS = 64, 32
MAX_TRIANGLES = 6_000_000
FIRST_GROWTH = 3.5  # of the triangles by the first refinement, before it was seen
WORST = 4  # pixels whose share of the squared error is told: outlines
GOAL = 2.0


def rows(*, quick: bool) -> list[Row]:
    """One row per scene, transfer function, number of isovalues and kind of crossings; quick: of one scene."""
    found: list[Row] = []
    scenes = [nucleon(41)] if quick else [nucleon(41), nucleon(81), shell(81), marschner_lobb(81)]
    for scene in scenes:
        for shape in SHAPES:
            started = time.perf_counter()
            found += _cells(scene, shape, QUICK_PIXELS if quick else PIXELS)
            print(f"{scene.name}, {shape}: {time.perf_counter() - started:.0f} s", flush=True)
    return found


def _cells(scene: AccuracyScene, shape: str, pixels: int) -> Iterator[Row]:
    assert scene.field is not None
    rays, tf = scene.rays(pixels), scene.transfer_function(shape, OPACITY)
    truth = field_truth(scene, scene.field, tf, rays)
    common: Row = {"scene": scene.name, "tf": shape}
    for name, kind in (("trilinear", Reconstruction.TRILINEAR), ("spline", Reconstruction.CUBIC)):
        yield common | {"K": 0, "way": f"perfect {name}"} | errors(grid_truth(scene, tf, rays, kind), truth)
    for count in COUNTS:
        plan = scene.plan(shape, OPACITY, count)
        cell = common | {"K": count, "isovalues": len(plan.isovalues)}
        lists = grid_crossings(scene.volume, plan.isovalues, *rays, reconstruction=Reconstruction.CUBIC)
        yield cell | {"way": "exact"} | errors(list_picture(scene, lists, plan, SegmentRule.CUBIC), truth)
        triangles, growth = 0, FIRST_GROWTH
        for refine in REFINEMENTS:
            if growth * triangles > MAX_TRIANGLES:
                break
            surfaces = mesh_surfaces(scene, plan.isovalues, Reconstruction.CUBIC, refine)
            before, triangles = triangles, sum(surfaces.statistics.triangles)
            if triangles > MAX_TRIANGLES:
                break
            growth = triangles / before if before else FIRST_GROWTH
            settings = {"": RenderSettings(segment=SegmentRule.CUBIC, curved=True)}
            picture = mesh_pictures(scene, surfaces, plan, pixels, settings)[""]
            told = {"way": f"refine {refine}", "triangles": triangles, "worst": _worst_share(picture, truth)}
            yield cell | told | errors(picture, truth)


def _worst_share(picture: F64, truth: F64) -> float:
    """Share of the worst pixels in the squared error of all."""
    squares = ((picture - truth) ** 2).sum(axis=1)
    return float(f"{np.sort(squares)[-WORST:].sum() / max(squares.sum(), 1e-300):.2g}")


def page(rows: list[Row]) -> str:
    """The section of the page, and all cells folded."""
    ways = ["exact", *(f"refine {refine}" for refine in REFINEMENTS)]
    lines, missed, cells = [], [], 0
    for scene, shape in dict.fromkeys((row["scene"], row["tf"]) for row in rows):
        here = [row for row in rows if (row["scene"], row["tf"]) == (scene, shape)]
        base, ceiling = (
            next(row["rmse"] for row in here if row["way"] == f"perfect {name}")
            for name in ("trilinear", "spline")
        )
        factors = []
        for way in ways:
            best = min((row for row in here if row["way"] == way), key=lambda row: row["rmse"], default=None)
            factors.append((base / best["rmse"], best["K"]) if best else None)
        reached = max(factor[0] for factor in factors[1:] if factor)
        cells += 1
        if reached < GOAL:
            missed.append(f"{scene}, {shape} ({reached:.2g})")
        shown = [f"{factor[0]:.2g} (K = {factor[1]})" if factor else "–" for factor in factors]
        lines.append((scene, shape, base, f"{base / ceiling:.2g}", *shown))
    heads = (
        "scene",
        "transfer function",
        "perfect trilinear",
        "perfect spline",
        "spline, exact crossings",
        *ways[1:],
    )
    verdict = f"A factor of {GOAL:g} or more is reached in {cells - len(missed)} of {cells} cells" + (
        f"; not in: {'; '.join(missed)}." if missed else "."
    )
    return (
        "## The same samples: a perfect trilinear ray caster and curved triangles of the cubic spline\n\n"
        "RMSE of the perfect trilinear ray caster against the analytic field, translucent transfer functions, and by "
        "what factor others are nearer to it: a perfect ray caster of the spline (the ceiling), cubic segments between "
        "exact crossings of the spline (what the isovalues leave), and curved triangles of the spline. Of K = "
        f"{', '.join(map(str, COUNTS))} isovalues per slope the best is shown; meshes of more than "
        f"{MAX_TRIANGLES / 1e6:g} million triangles are left out. {verdict}\n\n"
        + table(heads, lines)
        + "\n"
        + _all_cells(rows)
    )


def _all_cells(rows: list[Row]) -> str:
    heads = (
        "scene",
        "transfer function",
        "K",
        "crossings",
        "isovalues",
        "triangles",
        "RMSE",
        "99.9 %",
        "step",
    )
    lines = [
        (
            row["scene"],
            row["tf"],
            row["K"] or "–",
            row["way"],
            row.get("isovalues", "–"),
            f"{row['triangles']:,}" if "triangles" in row else "–",
            *(f"{row[name]:.2g}" for name in ("rmse", "p999", "step")),
            f"{100 * row['worst']:.0f} %" if "worst" in row else "–",
        )
        for row in rows
    ]
    told = f"the {WORST} worst pixels' share of the squared error"
    return (
        f"<details><summary>All {len(rows)} cells</summary>\n\n"
        + table((*heads, told), lines)
        + "\n</details>\n"
    )

"""The A-buffer: frame time by stage over picture sizes, levels and layers."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from benchmarks.machine import median, table
from isosample.gl.context import shared_context
from isosample.integral.segment_rule import SegmentRule
from isosample.rendering.abuffer import ABuffer
from isosample.rendering.camera import Camera, Projection
from isosample.rendering.scene import Scene
from isosample.rendering.settings import BuildStage, RenderSettings, ResolveStage
from isosample.surfaces.extract import extract_surfaces
from isosample.transfer.control_points import ControlPoint, Isosurface
from isosample.transfer.isovalues import plan_isovalues
from isosample.transfer.transfer_function import TransferFunction
from isosample.volume.analytic import nucleon_like, sample_field
from isosample.volume.grid import Volume

if TYPE_CHECKING:
    from collections.abc import Iterator

    from isosample.rendering.frame_statistics import FrameStatistics


@dataclass(frozen=True)
class Case:
    """One row of the table."""

    name: str
    scene: Scene
    camera: Camera
    edge: int
    settings: RenderSettings = RenderSettings()  # noqa: RUF009  # frozen


def two_tents(edge: int, per_slope: int) -> tuple[Scene, Camera]:
    """The paper's figure 4: a nucleon-like field under two narrow tents."""
    volume = sample_field(
        nucleon_like(), (edge,) * 3, lower=(0.0,) * 3, upper=(40.0,) * 3, name="nucleon-like"
    )
    low, high = volume.value_range
    at = [low + (high - low) * part for part in (0.15, 0.2, 0.25, 0.6, 0.65, 0.7)]
    colors = [(0.1, 0.3, 1.0)] * 3 + [(1.0, 0.7, 0.1)] * 3
    points = [ControlPoint(v, c, e) for v, c, e in zip(at, colors, [0, 0.3, 0, 0, 2.0, 0], strict=True)]
    plan = plan_isovalues(TransferFunction(points), volume.value_range, per_slope=per_slope)
    scene = Scene.build(extract_surfaces(volume, plan.isovalues), plan)
    return scene, Camera.orbit(volume.box, azimuth=30, elevation=20)


def planes(count: int) -> tuple[Volume, TransferFunction, Camera]:
    """Isosurfaces of a ramp that cover the whole picture."""
    volume = Volume(np.broadcast_to(np.array([0.0, 1.0])[:, None, None], (2, 2, 2)))
    values = ((np.arange(count) + 1.0) / (count + 1.0)).tolist()
    tf = TransferFunction([], [Isosurface(v, (v, 1.0 - v, 0.5), 0.02) for v in values])
    eye, target = (0.5, 0.5, 3.0), (0.5, 0.5, 0.5)
    return volume, tf, Camera(projection=Projection.ORTHOGRAPHIC, eye=eye, target=target, height=0.5)


def layers(count: int) -> tuple[Scene, Camera]:
    """The scene of so many planes."""
    volume, tf, camera = planes(count)
    plan = plan_isovalues(tf, volume.value_range)
    return Scene.build(extract_surfaces(volume, plan.isovalues), plan), camera


def cases(*, quick: bool) -> list[Case]:
    """Sizes, levels, stages, rules, layers."""
    tents, camera = two_tents(41, 5)
    rows = [Case(f"two tents 41³, {edge}²", tents, camera, edge) for edge in (256, 512, 1024)]
    variants = {f"512², {rule.value}": RenderSettings(segment=rule) for rule in SegmentRule}
    for stage in (ResolveStage.FRAGMENT, ResolveStage.COMPUTE):
        variants[f"512², {stage.value} stage"] = RenderSettings(stage=stage)
    rows += [Case(name, tents, camera, 512, settings) for name, settings in variants.items()]
    rows += _by_both([Case(f"41³, 5 per slope, {edge}²", tents, camera, edge) for edge in (512, 1024)])
    for per_slope in (1, 17):
        scene, view = two_tents(41, per_slope)
        rows.append(Case(f"512², {per_slope} per slope", scene, view, 512))
    if not quick:
        rows.append(Case("two tents 128³, 512²", *two_tents(128, 5), 512))
        rows += _by_both([Case("128³, 0 per slope, 512²", *two_tents(128, 0), 512)])
        rows.append(Case("30 layers, 1024²", *layers(30), 1024))
        rows.append(Case("200 layers, 512²", *layers(200), 512))
    return rows


def _by_both(cases: list[Case]) -> Iterator[Case]:
    """Cases whose triangles the graphics pipeline rasterises, and compute shaders."""
    for case in cases:
        for stage in (BuildStage.FRAGMENT, BuildStage.COMPUTE):
            words = "pipeline" if stage is BuildStage.FRAGMENT else "compute shaders"
            settings = RenderSettings(build_stage=stage)
            yield replace(case, name=f"{case.name}, rasterised by {words}", settings=settings)


def report(*, quick: bool) -> str:
    """Milliseconds by stage, the cases interleaved, the first frame of each left out."""
    ctx = shared_context()
    found = cases(quick=quick)
    buffers = [ABuffer(ctx, case.scene) for case in found]
    samples: list[list[dict[str, float]]] = [[] for _ in found]
    statistics: list[FrameStatistics | None] = [None] * len(found)
    for repeat in range(3 if quick else 8):
        for i, (case, abuffer) in enumerate(zip(found, buffers, strict=True)):
            abuffer.timer.seconds.clear()
            _, statistics[i] = abuffer.render(case.camera, (case.edge, case.edge), case.settings)
            if repeat:
                samples[i].append(dict(abuffer.timer.seconds))
    rows = []
    for case, frames, frame in zip(found, samples, statistics, strict=True):
        assert frame is not None
        build, resolve = ([part[stage] for part in frames] for stage in ("build", "resolve"))
        total = [sum(part.values()) for part in frames]
        mean = frame.fragments / case.edge**2
        rows.append(
            (
                case.name,
                f"{case.scene.triangle_count:,}",
                f"{frame.fragments:,}",
                f"{mean:.1f} / {frame.max_depth_complexity}",
                frame.tiles,
                median(build),
                median(resolve),
                median(total),
            )
        )
    for abuffer in buffers:
        abuffer.release()
    heads = ("scene", "triangles", "fragments", "per pixel: mean / max", "tiles", "build", "resolve", "frame")
    return "## A-buffer frames\n\n" + table(heads, rows)

"""`isosample demo`: built-in volumes through the whole pipeline, with pictures and a summary."""

from __future__ import annotations

import importlib.util
import math
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

from isosample.cli import values
from isosample.cli.arguments import SIZE_TEXT
from isosample.cli.console import progress_bars, say, say_table, seconds
from isosample.cli.demo_subjects import SAMPLES, SUBJECTS, Subject, sampled, transfer_function, view
from isosample.cli.outputs import make_folder, write_json
from isosample.cli.parser import add_command
from isosample.defaults import DEFAULT_SIZE
from isosample.wording import thousands

if TYPE_CHECKING:
    import argparse
    from collections.abc import Callable

    from isosample.cli.console import Progress
    from isosample.cli.parser import Commands
    from isosample.rendering.image import Image
    from isosample.rendering.pipeline import Renderer
    from isosample.surfaces.cache import CachedScene
    from isosample.transfer.transfer_function import TransferFunction
    from isosample.volume.grid import Volume

CUT_TURN = 55.0  # degrees between the view and the cut, which is upright
STAGES = ("sample", "extract", "write cache", "load cache", "merge", "upload", "measure", "build", "resolve")
EXAMPLE = """\
isosample demo
isosample demo -o pictures --size 400x400"""


def add_parser(commands: Commands) -> None:
    """Add the command and its options."""
    parser = add_command(
        commands,
        "demo",
        run,
        summary="Render built-in volumes through the whole pipeline, and tell what it took.",
        example=EXAMPLE,
    )
    parser.add_argument(
        "-o",
        "--output",
        type=Path,
        default=Path("demo"),
        metavar="DIR",
        help="folder for it all (default demo)",
    )
    parser.add_argument(
        "--size",
        type=values.picture_size,
        default=DEFAULT_SIZE,
        metavar="WxH",
        help=f"width and height of the pictures [pixel] (default {SIZE_TEXT})",
    )


def run(args: argparse.Namespace) -> int:
    """Make every picture, write the statistics, and sum up."""
    from isosample.gl.context import shared_context

    renderer = shared_context().info["GL_RENDERER"]
    folder = make_folder(args.output)
    start = time.perf_counter()
    with progress_bars() as progress:
        reports = [make(one, folder, args.size, _named(progress, one.name)) for one in SUBJECTS]
    stats = {subject.name: report[0] for subject, report in zip(SUBJECTS, reports, strict=True)}
    write_json(folder / "stats.json", stats)
    summarise(reports, folder, renderer, time.perf_counter() - start)
    return 0


def make(
    subject: Subject, folder: Path, size: tuple[int, int], progress: Progress
) -> tuple[dict[str, Any], list[Path]]:
    """Sample, extract into a cache folder, and render from that folder alone; statistics and pictures."""
    from isosample.rendering.pipeline import Renderer
    from isosample.surfaces.cache import load_cache

    took: dict[str, float] = {}
    start = time.perf_counter()
    volume = sampled(subject)
    took["sample"] = time.perf_counter() - start
    tf = transfer_function(subject, volume)
    cache = folder / f"{subject.name}_meshes"
    extraction = precompute(volume, tf, subject.per_slope, cache, took, progress)
    start = time.perf_counter()
    scene = load_cache(cache)  # from here on the volume is not needed
    took["load cache"] = time.perf_counter() - start
    with Renderer(scene.surfaces, scene.plan, seconds=took) as renderer:
        images = pictures(subject, renderer, scene, size, progress)
    paths = [image.save(folder / f"{name}.png") for name, image in images.items()]
    if importlib.util.find_spec("matplotlib") is not None:
        from isosample.transfer.plot import plot_histogram

        paths.append(folder / f"{subject.name}_transfer_function.png")
        plot_histogram(volume, tf, path=paths[-1], plan=scene.plan)
    stats = images[subject.name].stats | {
        "title": subject.title,
        "samples": SAMPLES**3,
        **extraction,
    }
    return stats, paths


def precompute(
    volume: Volume,
    tf: TransferFunction,
    per_slope: int,
    cache: Path,
    took: dict[str, float],
    progress: Progress,
) -> dict[str, int]:
    """Extract what the cache folder lacks and write the scene; return what was visited, skipped and written."""
    from isosample.rendering.framing import visible_span
    from isosample.rendering.preparation import prepare_surfaces
    from isosample.rendering.quality import Quality
    from isosample.surfaces.cache import content_hash, write_cache
    from isosample.surfaces.cache_folders import folder_bytes
    from isosample.volume.shown_cells import Shown

    surfaces, plan, seconds, _ = prepare_surfaces(
        volume, tf, Quality(per_slope=per_slope, lit=True), cache=cache, progress=progress
    )
    took |= seconds
    start = time.perf_counter()
    write_cache(
        cache,
        surfaces,
        content_hash=content_hash(volume),
        transfer_function=tf,
        plan=plan,
        name=volume.name,
        visible=Shown(visible_span(volume, tf)),
    )
    took["write cache"] = time.perf_counter() - start
    found = surfaces.statistics
    return {
        "levels_reused": found.levels_reused,
        "brick_visits": found.brick_visits,
        "brick_visits_skipped": found.brick_visits_skipped,
        "cache_bytes": folder_bytes(cache),
    }


def pictures(
    subject: Subject, renderer: Renderer, scene: CachedScene, size: tuple[int, int], progress: Progress
) -> dict[str, Image]:
    """One picture of the whole, lit, and one that is cut open, in its own colours."""
    from isosample.rendering.settings import ClipPlane, Material, RenderSettings

    camera = view(subject, scene.surfaces.geometry.box, size)
    background = (0.01, 0.01, 0.015, 1.0)
    away = math.radians(subject.azimuth + CUT_TURN)
    x, z = -math.sin(away), -math.cos(away)
    cut = ClipPlane(x, 0.0, z, -(x * camera.target[0] + z * camera.target[2]))
    whole = RenderSettings(background=background, material=Material())
    opened = RenderSettings(background=background, clip_planes=(cut,))
    return {
        name: renderer.render(camera=camera, size=size, settings=settings, progress=progress)
        for name, settings in ((subject.name, whole), (f"{subject.name}_cut", opened))
    }


def summarise(
    reports: list[tuple[dict[str, Any], list[Path]]], folder: Path, renderer: str, duration: float
) -> None:
    """Write what was extracted, drawn and skipped, the seconds of every stage, and where the pictures are."""
    all_stats = [stats for stats, _ in reports]
    say_table(
        ("", *(stats["title"] for stats in all_stats)),
        [[name, *(row(stats) for stats in all_stats)] for name, row in FACTS.items()],
        numeric=range(1, 1 + len(all_stats)),
        title="What was extracted, drawn and skipped",
    )
    say()
    taken = [[stage, *(seconds(s["seconds"].get(stage, 0.0)) for s in all_stats)] for stage in STAGES]
    say_table(
        ("stage", *(stats["title"] for stats in all_stats)), taken, numeric=range(1, 1 + len(all_stats))
    )
    say()
    say(
        f"Rendered by {renderer} in {seconds(duration)}. Pictures, statistics and mesh caches are in {folder}:"
    )
    for _, paths in reports:
        for path in paths:
            say(f"  {path}")
    say(
        f"Render one again from its meshes:  isosample render {folder / SUBJECTS[0].name}_meshes -o again.png"
    )


FACTS: dict[str, Callable[[dict[str, Any]], str]] = {
    "samples of the volume": lambda s: thousands(s["samples"]),
    "isovalues": lambda s: str(len(s["isovalues"])),
    "triangles extracted": lambda s: thousands(s["triangles"]["extracted"]),
    "mesh cache, bytes": lambda s: thousands(s["cache_bytes"]),
    "fragments": lambda s: thousands(s["fragments"]),
    "fragments per pixel: mean": lambda s: f"{s['samples_per_ray']['mean']:.1f}",
    "fragments per pixel: most": lambda s: str(s["max_depth_complexity"]),
    "fragments lost": lambda s: str(s["lost_fragments"]),
    "skipped: levels already in the cache": lambda s: str(s["levels_reused"]),
    "skipped: bricks that miss a level": lambda s: (
        f"{s['brick_visits_skipped']} of {s['brick_visits'] + s['brick_visits_skipped']}"
    ),
    "skipped: rays ended behind an opaque front": lambda s: thousands(s["skipped"]["rays_ended_early"]),
}


def _named(progress: Progress, name: str) -> Progress:
    """Progress whose stages carry the volume's name."""
    return lambda stage, done, total: progress(f"{name}: {stage}", done, total)

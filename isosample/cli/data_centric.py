"""`isosample render --method data-centric`: the meshes of a volume, or of a cache folder, by the A-buffer."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any

from isosample.cli.cameras import VISIBLE, framed_scene_box, orbit, search_visible
from isosample.cli.console import note, progress_bars
from isosample.cli.methods import choice_statistics
from isosample.cli.outputs import check_driver, write_json
from isosample.cli.summary import (
    check_strict,
    is_refined,
    lit_words,
    note_if_empty,
    say_if_coarse,
    say_if_nothing_is_seen,
    scene_fields,
    shows_something,
    summarise,
)
from isosample.cli.turntable import cameras_of, run_turntable

if TYPE_CHECKING:
    import argparse

    from isosample.cli.auto import Opened
    from isosample.cli.console import Progress
    from isosample.cli.scenes import PreparedScene
    from isosample.rendering.camera import Camera
    from isosample.rendering.image import Image
    from isosample.rendering.pipeline import Renderer
    from isosample.rendering.settings import RenderSettings
    from isosample.rendering.turntable import FrameLog

VIEWS = 4  # of a film, that are looked at for a tolerance
MESH_OPTIONS = (
    "cache",
    "reconstruction",
    "tolerance",
    "max_isovalues",
    "details",
    "refine",
)  # of a volume, not of a cache folder


def run_data_centric(
    args: argparse.Namespace,
    settings: RenderSettings,
    camera: Camera | None,
    log: FrameLog,
    opened: Opened | None = None,
) -> int:
    """Extract or load the meshes, render one picture or a film, write it, and sum up."""
    scene = _prepare(args, opened)
    box = framed_scene_box(args, scene)
    if args.screen_error is not None and not scene.surfaces.details:
        note(
            f"--screen-error {args.screen_error:g} changes nothing: {args.source} has no coarser meshes; --details "
            "makes them"
        )
    if args.shading and scene.plan.report:
        note(f"the tolerance was measured without light; {lit_words(scene.plan.report)}")
    if args.plan:
        from isosample.cli.plan_table import say_plan

        say_plan(scene.plan)
    if args.turntable is not None:
        return _film(args, scene, settings, cameras_of(args, camera, box), log)
    errors = None
    with progress_bars() as progress, renderer(scene) as picture:
        place = {"camera": camera or orbit(args, box), "size": args.size}
        place["settings"] = _within_tolerance(args, scene, picture, [place["camera"]], settings, progress)
        image = picture.render(**place, progress=progress)
        if args.strict:
            check_strict(image.stats)
        if _wants_errors(args, scene):
            errors = picture.error_map(**place, progress=progress)
    percentiles = None if errors is None else errors.percentiles()
    image.save(args.output)
    if errors is not None and args.error_map:
        errors.save(args.error_map)
    if args.stats:
        write_json(args.stats, statistics(image, scene, args, percentiles))
    summarise(image, scene, args.output, log.elapsed, percentiles)
    if shows_something(scene.plan):
        say_if_nothing_is_seen(image, scene.surfaces.geometry.box, place["camera"], place["settings"])
    return 0


def _film(
    args: argparse.Namespace,
    scene: PreparedScene,
    settings: RenderSettings,
    cameras: list[Camera],
    log: FrameLog,
) -> int:
    """Turn about the scene, with its meshes uploaded once."""
    with renderer(scene) as picture:
        with progress_bars() as progress:
            settings = _within_tolerance(args, scene, picture, spread(cameras), settings, progress)
        empty = run_turntable(
            args,
            cameras,
            lambda one, progress: picture.render(
                camera=one, size=args.size, settings=settings, progress=progress
            ),
            log,
            settings=settings,
            more=scene_statistics(scene, args),
            fields=scene_fields(scene, settings.screen_error),
            refined=is_refined(scene),
        )
    say_if_coarse(scene)
    if shows_something(scene.plan):
        empty.say_why(scene.surfaces.geometry.box)
    return 0


def spread(cameras: list[Camera]) -> list[Camera]:
    """Return `VIEWS` of the cameras at even distances, or all where there are no more."""
    count = min(VIEWS, len(cameras))
    return [cameras[place * len(cameras) // count] for place in range(count)]


def _within_tolerance(
    args: argparse.Namespace,
    scene: PreparedScene,
    picture: Renderer,
    cameras: list[Camera],
    settings: RenderSettings,
    progress: Progress,
) -> RenderSettings:
    """Let meshes be as coarse as the scene's tolerance allows, where nothing is said about it."""
    if args.screen_error is not None:
        return settings
    from isosample.rendering.screen_error import settings_within

    return settings_within(
        picture,
        scene.surfaces,
        scene.plan,
        cameras=cameras,
        size=args.size,
        settings=settings,
        progress=partial(progress, "details"),
    )


def _wants_errors(args: argparse.Namespace, scene: PreparedScene) -> bool:
    """Whether the picture's errors are asked for, or a tolerance has to be held against them."""
    return args.error_map is not None or bool(scene.plan.report and scene.surfaces.settings.residuals)


def renderer(scene: PreparedScene) -> Renderer:
    """Upload a prepared scene."""
    from isosample.rendering.pipeline import Renderer

    return Renderer(scene.surfaces, scene.plan, seconds=scene.seconds)


def statistics(
    image: Image, scene: PreparedScene, args: argparse.Namespace, errors: dict[str, float] | None
) -> dict[str, Any]:
    """Return the picture's statistics with what it shows, JSON-ready."""
    more = {} if errors is None else {"error_99.9_percent": errors}
    return image.stats | more | scene_statistics(scene, args)


def scene_statistics(scene: PreparedScene, args: argparse.Namespace) -> dict[str, Any]:
    """Return what the statistics of all pictures of a scene say about it, JSON-ready."""
    more = {} if scene.mesh_distance is None else {"mesh_distance": scene.mesh_distance}
    return {
        **more,
        "source": str(args.source),
        "transfer_function": scene.tf_origin,
        "levels_reused": scene.surfaces.statistics.levels_reused,
        **choice_statistics(args),
    }


def _prepare(args: argparse.Namespace, opened: Opened | None) -> PreparedScene:
    """Return the scene of the source; a missing driver is told before the long work."""
    from isosample.cli import sources
    from isosample.cli.auto import Opened
    from isosample.cli.cached_scenes import scene_from_cache

    if opened is not None:
        return _extract(args, opened)
    transfer_function = sources.load_transfer_function(args.tf)
    if sources.is_cache_folder(args.source):
        sources.refuse_volume_options(args, args.source, MESH_OPTIONS)
        check_driver(args.size)
        scene = scene_from_cache(
            args.source,
            transfer_function,
            tf_path=args.tf,
            per_slope=args.per_slope,
            nan_masked=args.nan == "masked",
            lit=args.shading,
        )
        note_if_empty(scene.plan, scene.transfer_function)
        return scene
    volume = sources.open_source_volume(args, args.source)
    check_driver(args.size)
    tf, origin = sources.transfer_function_of(
        volume, transfer_function, args.tf, nan_masked=args.nan == "masked"
    )
    return _extract(args, Opened(volume, tf, origin, volume.box))


def _extract(args: argparse.Namespace, opened: Opened) -> PreparedScene:
    """Plan and extract, with the cache folder where one is given; its first scene is kept in it."""
    from isosample.cli.scenes import scene_from_volume
    from isosample.cli.sources import quality_of
    from isosample.surfaces.cache import content_hash, write_cache
    from isosample.volume.scan import scan_volume

    quality, volume = quality_of(args), opened.volume
    is_first = args.cache is not None and not (args.cache / "scene.json").exists()
    scan = scan_volume(volume) if is_first else None
    if scan is not None:
        scan.tell(volume)
    visible = opened.visible
    if visible is None and (
        is_first or args.fit == VISIBLE
    ):  # before the long work: there may be nothing to fit
        visible = search_visible(args, volume, opened.transfer_function, scan)
    residuals = args.error_map is not None or args.tolerance is not None or args.cache is not None
    with progress_bars() as progress:
        scene = scene_from_volume(
            args,
            volume,
            opened.transfer_function,
            quality=quality,
            residuals=residuals,
            cache=args.cache,
            progress=progress,
        )
    if is_first:
        write_cache(
            args.cache,
            scene.surfaces,
            content_hash=content_hash(volume, scan),
            transfer_function=scene.transfer_function,
            plan=scene.plan,
            name=volume.name,
            mesh_distance=scene.mesh_distance,
            visible=visible,
        )
    return replace(scene, tf_origin=opened.tf_origin, visible=visible)

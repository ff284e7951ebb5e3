"""`isosample render`: a picture of a volume, or of the meshes in a cache folder."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from isosample.cli import arguments, values
from isosample.cli.cameras import camera_of, orbit
from isosample.cli.console import note, progress_bars
from isosample.cli.methods import (
    AUTO,
    METHODS,
    check_method,
    choice_statistics,
)
from isosample.cli.outputs import (
    check_driver,
    check_suffix,
    check_writable,
    nearest_existing,
    probe_folder,
    write_json,
)
from isosample.cli.parser import add_command
from isosample.cli.raycast_arguments import add_raycast_options
from isosample.cli.summary import check_strict, say_if_empty, scene_fields, summarise
from isosample.cli.turntable import cameras_of, check_turntable, outputs_of, run_turntable
from isosample.defaults import (
    DATA_CENTRIC,
    DEFAULT_FRAME_RATE,
    DEFAULT_MESH_BUDGET_BYTES,
    DEFAULT_SCREEN_ERROR,
    FILM_SUFFIXES,
    IMAGE_SUFFIXES,
    LARGEST_GIF_RATE,
    RAYCAST_METHODS,
    REFERENCE,
)
from isosample.errors import InputError
from isosample.wording import byte_size

if TYPE_CHECKING:
    import argparse

    from isosample.cli.auto import Opened
    from isosample.cli.console import Progress
    from isosample.cli.parser import Commands
    from isosample.cli.sources import PreparedScene
    from isosample.rendering.camera import Camera
    from isosample.rendering.image import Image
    from isosample.rendering.pipeline import Renderer
    from isosample.rendering.settings import RenderSettings
    from isosample.rendering.turntable import FrameLog
    from isosample.transfer.transfer_function import TransferFunction
    from isosample.volume.grid import Volume

VIEWS = 4  # of a film, that are looked at for a tolerance
MESH_OPTIONS = (
    "cache",
    "reconstruction",
    "tolerance",
    "max_isovalues",
    "details",
)  # of a volume, not of a cache folder
EXAMPLE = """\
isosample render head.nrrd -o head.png
isosample render head.nrrd --tf bone.json --up z --azimuth 30 --shading --background 1,1,1 -o head.png
isosample render head.raw --shape 256,256,128 --dtype uint16 --clip -1,0,0,60 -o half.npy
isosample render head.nrrd --reconstruction cubic --tolerance 1/255 --error-map errors.png -o head.png
isosample render meshes_cache/head-1f3a9c07 --size 1200x900 --stats head.json -o head.png
isosample render head.nrrd --method post-classified --step 1/4 -o head.png
isosample render head.nrrd --method pre-integrated --sampling differential --stats head.json -o head.png
isosample render head.nrrd --method peak-finding --peak-weight integral --crossings exact -o head.png
isosample render head.nrrd --method reference --size 200x200 -o head.npy
isosample render head.nrrd --tf bone.json --method auto -o head.png
isosample render head.nrrd --elevation 20 --turntable 72 --background 1,1,1 -o head.mp4
isosample render head_meshes --screen-error 1/2 --turntable 360 -o head.mp4"""


def add_parser(commands: Commands) -> None:
    """Add the command and its options."""
    parser = add_command(
        commands,
        "render",
        run,
        summary="Render a volume, or the meshes of a cache folder, into a picture.",
        example=EXAMPLE,
    )
    parser.add_argument(
        "source", type=Path, metavar="SOURCE", help="volume file, DICOM folder or cache folder"
    )
    parser.add_argument(
        "-o",
        "--output",
        type=Path,
        required=True,
        metavar="FILE",
        help=".png (sRGB, 8 bits) or .npy (float32 (H, W, 4), premultiplied linear RGBA); films: see --turntable",
    )
    parser.add_argument(
        "--turntable",
        type=values.count,
        metavar="N",
        help="a film of N frames that turns once about the volume, from --azimuth on (--camera: about its target and "
        "up): .mp4 (extra video), .gif, or .png and .npy, numbered; all but the view is made once",
    )
    parser.add_argument(
        "--frame-rate",
        type=values.positive,
        metavar="F",
        help=f"frames per second of .mp4 and .gif (default {DEFAULT_FRAME_RATE:g}); "
        f"a .gif takes up to {LARGEST_GIF_RATE:g}",
    )
    parser.add_argument(
        "--stats",
        type=Path,
        metavar="FILE",
        help="JSON file for what was extracted, drawn and skipped, and the seconds of every stage",
    )
    parser.add_argument(
        "--error-map",
        type=Path,
        metavar="FILE",
        help="how far every pixel may be off: .png (false colours) or .npy (float32 (H, W, 3): |cubic - linear|, half "
        "the guaranteed interval, estimate of the mesh's error)",
    )
    parser.add_argument(
        "--strict",
        action="store_true",
        help="fail where a pixel lacks a crossing whose place nothing tells (default: draw it by a guess, and say so)",
    )
    parser.add_argument(
        "--method",
        choices=(*METHODS, AUTO),
        default=DATA_CENTRIC,
        help="data-centric: through isosurfaces, by OpenGL (default); post-classified, pre-integrated, peak-finding: "
        "through samples of the volume, by the ray caster; reference: the field itself in float64 to 1e-10, without "
        "OpenGL, for comparison; auto: of data-centric, pre-integrated and peak-finding the one that is estimated to "
        "be the fastest, with the preparation and all frames",
    )
    parser.set_defaults(choice=None)
    arguments.add_plan_options(
        parser, without="the cache folder's own; for a volume, one suggested from the histogram"
    )
    arguments.add_quality_options(parser)
    arguments.add_details_option(parser)
    parser.add_argument("--plan", action="store_true", help="print the isovalues and why each is there")
    parser.add_argument(
        "--cache",
        type=Path,
        metavar="DIR",
        help="folder whose meshes of this volume are used again and added to (default: none is used)",
    )
    parser.add_argument(
        "--mesh-budget",
        type=values.byte_count,
        metavar="SIZE",
        help="most memory for meshes on the GPU, such as 512MiB; where there are more, they are loaded in batches, "
        f"anew for every frame; the picture is the same (default {byte_size(DEFAULT_MESH_BUDGET_BYTES)})",
    )
    arguments.add_nan_option(parser)
    arguments.add_picture_options(parser)
    add_raycast_options(parser)
    arguments.add_camera_options(parser)
    arguments.add_volume_options(parser)


def run(args: argparse.Namespace) -> int:
    """Check all that can be checked, then open, extract, render, write, and sum up."""
    from isosample.rendering.turntable import FrameLog

    log = FrameLog()
    check_method(args)
    check_turntable(args)
    settings = settings_of(args)
    _check_outputs(args)
    camera = camera_of(args)
    opened = None
    if args.method == AUTO:
        from isosample.cli.auto import choose

        opened = choose(args, settings, camera)
    if args.method == REFERENCE:
        from isosample.cli.reference import run_reference

        return run_reference(args, settings, camera, log)
    if args.method in RAYCAST_METHODS:
        from isosample.cli.raycast import run_raycast

        return run_raycast(args, settings, camera, log, opened)
    scene = _prepare(args, opened)
    if args.screen_error is not None and not scene.surfaces.details:
        note(
            f"--screen-error {args.screen_error:g} changes nothing: {args.source} has no coarser meshes; --details "
            "makes them"
        )
    if args.plan:
        from isosample.cli.plan_table import say_plan

        say_plan(scene.plan)
    if args.turntable is not None:
        return _film(args, scene, settings, camera, log)
    errors = None
    with progress_bars() as progress, renderer(scene) as picture:
        place = {"camera": camera or orbit(args, scene.surfaces.geometry.box), "size": args.size}
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
    return 0


def _film(
    args: argparse.Namespace,
    scene: PreparedScene,
    settings: RenderSettings,
    camera: Camera | None,
    log: FrameLog,
) -> int:
    """Turn about the scene, with its meshes uploaded once."""
    cameras = cameras_of(args, camera, scene.surfaces.geometry.box)
    with renderer(scene) as picture:
        with progress_bars() as progress:
            settings = _within_tolerance(args, scene, picture, spread(cameras), settings, progress)
        run_turntable(
            args,
            cameras,
            lambda one, progress: picture.render(
                camera=one, size=args.size, settings=settings, progress=progress
            ),
            log,
            more=scene_statistics(scene, args),
            fields=scene_fields(scene, settings.screen_error),
        )
    say_if_empty(scene.plan, scene.transfer_function)
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
    report = scene.plan.report
    judged = report and scene.surfaces.details and scene.surfaces.settings.residuals
    if not judged or args.screen_error is not None:
        return settings
    from isosample.rendering.screen_error import screen_error_within

    told = partial(progress, "details")
    allowed = screen_error_within(picture, report, cameras, args.size, settings, told)
    return replace(settings, screen_error=allowed)


def _wants_errors(args: argparse.Namespace, scene: PreparedScene) -> bool:
    """Whether the picture's errors are asked for, or a tolerance has to be held against them."""
    return args.error_map is not None or bool(scene.plan.report and scene.surfaces.settings.residuals)


def renderer(scene: PreparedScene) -> Renderer:
    """Upload a prepared scene."""
    from isosample.rendering.pipeline import Renderer

    return Renderer(scene.surfaces, scene.plan, seconds=scene.seconds)


def settings_of(args: argparse.Namespace) -> RenderSettings:
    """Return the settings of the picture from the arguments, checked."""
    from isosample.rendering.settings import ClipPlane, Material, RenderSettings, ResolveStage, SegmentRule

    if args.segment_opacity is not None and args.segment != "constant":
        raise InputError(
            f"--segment-opacity {args.segment_opacity} goes with --segment constant, not {args.segment}; "
            "leave it out, or add --segment constant."
        )
    rule = SegmentRule(args.segment)
    if args.segment_opacity == "first-order":
        rule = SegmentRule.CONSTANT_FIRST_ORDER
    return RenderSettings(
        segment=rule,
        curved=args.curved,
        screen_error=DEFAULT_SCREEN_ERROR if args.screen_error is None else args.screen_error,
        material=Material() if args.shading else None,
        background=args.background,
        clip_planes=tuple(ClipPlane(*plane) for plane in args.clip),
        stage=ResolveStage(args.stage),
        mesh_budget_bytes=DEFAULT_MESH_BUDGET_BYTES if args.mesh_budget is None else args.mesh_budget,
    )


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


def _check_outputs(args: argparse.Namespace) -> None:
    """Raise unless both outputs and the cache folder can be written."""
    if args.turntable is None:
        if args.output.suffix.lower() in FILM_SUFFIXES and args.output.suffix.lower() not in IMAGE_SUFFIXES:
            raise InputError(
                f"{args.output} is a film, and one picture is asked for; add --turntable N, or name a .png or .npy."
            )
        check_suffix(args.output, IMAGE_SUFFIXES, "a picture")
    if args.stats:
        check_suffix(args.stats, (".json",), "a file of statistics")
    if args.error_map:
        check_suffix(args.error_map, IMAGE_SUFFIXES, "an error map")
        if args.error_map.suffix.lower() == ".png":
            from isosample.rendering.error_map import check_matplotlib

            check_matplotlib()
    inputs = [path for path in (args.source, args.tf, args.camera) if path is not None]
    check_writable({**outputs_of(args), "--stats": args.stats, "--error-map": args.error_map}, inputs)
    if args.cache is not None:
        probe_folder(nearest_existing(args.cache))


def _prepare(args: argparse.Namespace, opened: Opened | None) -> PreparedScene:
    """Return the scene of the source; a missing driver is told before the long work."""
    from isosample.cli import sources

    if opened is not None:
        scene = _extract(args, opened.volume, opened.transfer_function)
        return replace(scene, tf_origin=opened.tf_origin)
    transfer_function = sources.load_transfer_function(args.tf)
    if sources.is_cache_folder(args.source):
        sources.refuse_volume_options(args, args.source, MESH_OPTIONS)
        if args.refine != arguments.UNSET:
            raise InputError(
                f"--refine belongs to a volume file, and {args.source} is a mesh cache; its meshes are what they are. "
                "Leave out --refine, or name the volume."
            )
        check_driver(args.size)
        return sources.scene_from_cache(
            args.source,
            transfer_function,
            tf_path=args.tf,
            per_slope=args.per_slope,
            nan_masked=args.nan == "masked",
        )
    volume = sources.open_source_volume(args, args.source)
    check_driver(args.size)
    return _extract(args, volume, transfer_function)


def _extract(
    args: argparse.Namespace, volume: Volume, transfer_function: TransferFunction | None
) -> PreparedScene:
    """Plan and extract, with the cache folder where one is given; its first scene is kept in it."""
    from isosample.cli.sources import quality_of, scene_from_volume
    from isosample.surfaces.cache import content_hash, write_cache

    quality = quality_of(args)
    residuals = args.error_map is not None or args.tolerance is not None or args.cache is not None
    with progress_bars() as progress:
        scene = scene_from_volume(
            args,
            volume,
            transfer_function,
            quality=quality,
            residuals=residuals,
            cache=args.cache,
            progress=progress,
        )
    if args.cache is not None and not (args.cache / "scene.json").exists():
        write_cache(
            args.cache,
            scene.surfaces,
            content_hash=content_hash(volume),
            transfer_function=scene.transfer_function,
            plan=scene.plan,
            name=volume.name,
        )
    return scene

"""`isosample render`: a picture of a volume, or of the meshes in a cache folder."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

from isosample.cli import arguments
from isosample.cli.console import progress_bars, say, say_fields, seconds, thousands
from isosample.cli.outputs import check_suffix, check_writable, nearest_existing, probe_folder, write_json
from isosample.cli.parser import add_command
from isosample.defaults import IMAGE_SUFFIXES
from isosample.errors import InputError

if TYPE_CHECKING:
    import argparse

    from isosample.cli.console import Progress
    from isosample.cli.parser import Commands
    from isosample.cli.sources import PreparedScene
    from isosample.rendering.camera import Camera
    from isosample.rendering.image import Image
    from isosample.rendering.settings import RenderSettings
    from isosample.surfaces.extract import SurfaceSet
    from isosample.transfer.transfer_function import TransferFunction
    from isosample.volume.grid import F64, Box, Volume

SURFACE_OPTIONS = {  # with their defaults
    "cache": None,
    "per_slope": None,
    "plan": False,
    "segment": "linear",
    "stage": "auto",
}
FLAWS = {  # statistics that are 0 in a picture without flaws, and what more means
    "band_violations": "{} crossings did not continue the course of the data on their rays; what was missing was put "
    "in between, and the picture may be slightly off there",
    "saturated_segments": "{} segments have an opacity above 1 by the first-order formula, which was cut to 1; more "
    "isovalues per slope (--per-slope) make them shorter",
}
ORBIT_OPTIONS = ("azimuth", "elevation", "up", "zoom", "projection")
EXAMPLE = """\
isosample render head.nrrd -o head.png
isosample render head.nrrd --tf bone.json --up z --azimuth 30 --shading --background 1,1,1 -o head.png
isosample render head.raw --shape 256,256,128 --dtype uint16 --clip -1,0,0,60 -o half.npy
isosample render meshes_cache/head-1f3a9c07 --size 1200x900 --stats head.json -o head.png"""


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
        help=".png (sRGB, 8 bits) or .npy (float32 (H, W, 4), premultiplied linear RGBA)",
    )
    parser.add_argument(
        "--stats",
        type=Path,
        metavar="FILE",
        help="JSON file for what was extracted, drawn and skipped, and the seconds of every stage",
    )
    parser.add_argument(
        "--method",
        choices=("data-centric", "reference"),
        default="data-centric",
        help="data-centric: through isosurfaces, by OpenGL (default); reference: the trilinear field in float64 to "
        "1e-10, without OpenGL, for comparison",
    )
    arguments.add_plan_options(parser)
    parser.add_argument("--plan", action="store_true", help="print the isovalues and why each is there")
    parser.add_argument(
        "--cache",
        type=Path,
        metavar="DIR",
        help="folder whose meshes of this volume are used again and added to (default: none is used)",
    )
    arguments.add_nan_option(parser)
    arguments.add_picture_options(parser)
    arguments.add_camera_options(parser)
    arguments.add_volume_options(parser)


def run(args: argparse.Namespace) -> int:
    """Check all that can be checked, then open, extract, render, write, and sum up."""
    start = time.perf_counter()
    settings = settings_of(args)
    _check_outputs(args)
    camera = camera_of(args)
    if args.method == "reference":
        return _run_reference(args, settings, camera, start)
    scene = _prepare(args)
    if args.plan:
        from isosample.cli.plan_table import say_plan

        say_plan(scene.plan)
    with progress_bars() as progress:
        image = draw(scene, camera or orbit(args, scene.surfaces.geometry.box), args.size, settings, progress)
    image.save(args.output)
    if args.stats:
        write_json(args.stats, statistics(image, scene, args))
    summarise(image, scene, args.output, time.perf_counter() - start)
    return 0


def _run_reference(
    args: argparse.Namespace, settings: RenderSettings, camera: Camera | None, start: float
) -> int:
    """Integrate the volume itself; options that are about surfaces are refused."""
    from isosample.cli.sources import (
        is_cache_folder,
        load_transfer_function,
        open_source_volume,
        transfer_function_of,
    )
    from isosample.rendering.reference_image import render_reference

    for name, default in SURFACE_OPTIONS.items():
        if getattr(args, name) != default:
            option = name.replace("_", "-")
            raise InputError(
                f"--{option} is about isosurfaces, and --method reference has none; leave it out."
            )
    if is_cache_folder(args.source):
        raise InputError(
            f"{args.source} is a mesh cache, and --method reference integrates the volume itself; name the volume "
            "file."
        )
    given = load_transfer_function(args.tf)
    volume = open_source_volume(args, args.source)
    masked = args.nan == "masked"
    tf, origin = transfer_function_of(volume, given, args.tf, nan_masked=masked)
    with progress_bars() as progress:
        image = render_reference(
            volume,
            tf,
            camera=camera or orbit(args, volume.box),
            size=args.size,
            settings=settings,
            nan_masked=masked,
            progress=progress,
        )
    image.save(args.output)
    if args.stats:
        write_json(args.stats, image.stats | {"source": str(args.source), "transfer_function": origin})
    width, height = args.size
    say_fields(
        {
            "picture": f"{args.output} ({width} x {height} pixels), float64 reference",
            "cells visited": thousands(image.stats["cells_visited"]),
            "seconds": seconds(time.perf_counter() - start),
        }
    )
    return 0


def draw(
    scene: PreparedScene,
    camera: Camera,
    size: tuple[int, int],
    settings: RenderSettings,
    progress: Progress | None = None,
) -> Image:
    """Render a prepared scene."""
    from isosample.rendering.pipeline import render_surfaces

    return render_surfaces(
        scene.surfaces,
        scene.plan,
        camera=camera,
        size=size,
        settings=settings,
        progress=progress,
        seconds=scene.seconds,
    )


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
        material=Material() if args.shading else None,
        background=args.background,
        clip_planes=tuple(ClipPlane(*plane) for plane in args.clip),
        stage=ResolveStage(args.stage),
    )


def camera_of(args: argparse.Namespace) -> Camera | None:
    """Return the camera of the file that the arguments name; None where the camera orbits the box."""
    from isosample.rendering.camera import Camera

    if args.camera is None:
        return None
    given = [name for name in ORBIT_OPTIONS if getattr(args, name) is not None]
    if given:
        raise InputError(
            f"--{given[0]} and --camera {args.camera} both place the camera; leave out one of them."
        )
    return Camera.load(args.camera)


def orbit(args: argparse.Namespace, box: Box) -> Camera:
    """Return a camera about a box, from those of the four options that are given."""
    from isosample.rendering.camera import Camera, Projection, UpAxis

    width, height = args.size
    given: dict[str, Any] = {
        name: getattr(args, name) for name in ORBIT_OPTIONS if getattr(args, name) is not None
    }
    if "projection" in given:
        given["projection"] = Projection(given["projection"])
    if "up" in given:
        given["up_axis"] = UpAxis(given.pop("up"))
    return Camera.orbit(box, aspect=width / height, **given)


def statistics(image: Image, scene: PreparedScene, args: argparse.Namespace) -> dict[str, Any]:
    """Return the picture's statistics with what it shows, JSON-ready."""
    found = scene.surfaces.statistics
    return image.stats | {
        "source": str(args.source),
        "transfer_function": scene.tf_origin,
        "levels_reused": found.levels_reused,
    }


def summarise(image: Image, scene: PreparedScene, path: Path, duration: float) -> None:
    """Write the picture's path and what it took."""
    stats = image.stats
    width, height = stats["size"]
    reused = scene.surfaces.statistics.levels_reused
    say_fields(
        {
            "picture": f"{path} ({width} x {height} pixels)",
            "isovalues": f"{len(stats['isovalues'])}" + (f" ({reused} from the cache)" if reused else ""),
            "triangles": thousands(stats["triangles"]["drawn"]),
            "fragments": f"{thousands(stats['fragments'])} (at most {stats['max_depth_complexity']} per pixel, "
            f"lost {stats['lost_fragments']})",
            "seconds": seconds(duration),
        }
    )
    if not stats["isovalues"] and not scene.plan.band_visible.any():
        say("nothing is visible: the transfer function has no extinction inside the volume's range")
    for name, meaning in FLAWS.items():
        if stats[name]:
            say(meaning.format(thousands(stats[name])))


def _check_outputs(args: argparse.Namespace) -> None:
    """Raise unless both outputs and the cache folder can be written."""
    check_suffix(args.output, IMAGE_SUFFIXES, "a picture")
    if args.stats:
        check_suffix(args.stats, (".json",), "a file of statistics")
    inputs = [path for path in (args.source, args.tf, args.camera) if path is not None]
    check_writable({"--output": args.output, "--stats": args.stats}, inputs)
    if args.cache is not None:
        probe_folder(nearest_existing(args.cache))


def _prepare(args: argparse.Namespace) -> PreparedScene:
    """Return the scene of the source; a missing driver is told before the long work."""
    from isosample.cli import sources
    from isosample.gl.context import shared_context

    transfer_function = sources.load_transfer_function(args.tf)
    if sources.is_cache_folder(args.source):
        sources.refuse_volume_options(args, args.source, ("cache",))
        shared_context()
        return sources.scene_from_cache(
            args.source,
            transfer_function,
            tf_path=args.tf,
            per_slope=args.per_slope,
            nan_masked=args.nan == "masked",
        )
    volume = sources.open_source_volume(args, args.source)
    shared_context()
    return _extract(args, volume, transfer_function)


def _extract(
    args: argparse.Namespace, volume: Volume, transfer_function: TransferFunction | None
) -> PreparedScene:
    """Plan and extract, with the cache folder where one is given; its first scene is kept in it."""
    from isosample.cli.sources import scene_from_volume
    from isosample.surfaces.cache import content_hash, extract_with_cache, write_cache
    from isosample.surfaces.extract import extract_surfaces

    masked = args.nan == "masked"
    with progress_bars() as progress:

        def extract(volume: Volume, isovalues: F64) -> SurfaceSet:
            def report(done: int, total: int) -> None:
                progress("extract", done, total)

            if args.cache is None:
                return extract_surfaces(volume, isovalues, nan_masked=masked, progress=report)
            return extract_with_cache(volume, isovalues, args.cache, nan_masked=masked, progress=report)

        scene = scene_from_volume(args, volume, transfer_function, extract)
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

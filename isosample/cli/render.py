"""`isosample render`: a picture of a volume, or of the meshes in a cache folder."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from isosample.cli import arguments, values
from isosample.cli.cameras import camera_of
from isosample.cli.methods import (
    AUTO,
    METHODS,
    check_method,
)
from isosample.cli.outputs import (
    check_suffix,
    check_writable,
    nearest_existing,
    probe_folder,
)
from isosample.cli.parser import add_command
from isosample.cli.raycast_arguments import add_raycast_options
from isosample.cli.turntable import check_turntable, outputs_of
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

    from isosample.cli.parser import Commands
    from isosample.rendering.settings import RenderSettings

EXAMPLE = """\
isosample render head.nrrd --method auto -o head.png
isosample render head.nrrd --tf bone.json --up z --azimuth 30 --shading --background 1,1,1 -o head.png
isosample render head.raw --shape 256,256,128 --dtype uint16 --clip -1,0,0,60 -o half.npy
isosample render head.nrrd --reconstruction cubic --tolerance 1/255 --error-map errors.png -o head.png
isosample render meshes_cache/head-1f3a9c07 --size 1200x900 --stats head.json -o head.png
isosample render head.nrrd --method post-classified --step 1/4 -o head.png
isosample render head.nrrd --method pre-integrated --sampling differential --stats head.json -o head.png
isosample render head.nrrd --method peak-finding --peak-weight integral --crossings exact -o head.png
isosample render head.nrrd --method reference --size 200x200 -o head.npy
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
        help="data-centric: through isosurfaces, by OpenGL (default); post-classified, pre-integrated, peak-finding: "
        "through samples of the volume, by the ray caster; reference: the field itself in float64 to 1e-10, without "
        "OpenGL, for comparison; auto: of data-centric, pre-integrated and peak-finding the one that is estimated to "
        "be the fastest, with the preparation and all frames",
    )
    parser.set_defaults(choice=None)
    arguments.add_plan_options(
        parser, without="the cache folder's own; for a volume, one suggested from the histogram"
    )
    arguments.add_quality_options(
        parser, searched="refinement, or the ray caster's step in place of --step, are"
    )
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
    named, args.method = args.method is not None, args.method or DATA_CENTRIC
    check_method(args)
    check_turntable(args)
    settings = settings_of(args)
    _check_outputs(args)
    camera = camera_of(args)
    opened = None
    if args.method == AUTO:
        from isosample.cli.auto import choose

        opened = choose(args, settings, camera)
    elif not named:
        from isosample.cli.auto import note_if_slow

        opened = note_if_slow(args, settings, camera)
    if args.method == REFERENCE:
        from isosample.cli.reference import run_reference

        return run_reference(args, settings, camera, log)
    if args.method in RAYCAST_METHODS:
        from isosample.cli.raycast import run_raycast

        return run_raycast(args, settings, camera, log, opened)
    from isosample.cli.data_centric import run_data_centric

    return run_data_centric(args, settings, camera, log, opened)


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

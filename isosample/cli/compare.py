"""`isosample compare`: what each method costs on a volume, and how far it is from the truth."""

from __future__ import annotations

import time
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from isosample.cli import arguments
from isosample.cli.cameras import azimuths, camera_of, framed_box, orbit
from isosample.cli.compare_arguments import QUICK_SIZE, SIZE, add_picture_options, add_sweep_options
from isosample.cli.compare_commands import render_command
from isosample.cli.console import progress_bars, say, say_table, seconds
from isosample.cli.methods import RAYCAST_OPTIONS, option
from isosample.cli.outputs import check_driver, make_folder
from isosample.cli.parser import add_command
from isosample.defaults import (
    DATA_CENTRIC,
    DEFAULT_REPEAT,
    DEFAULT_SCREEN_ERROR,
    EXACT_PEAKS,
    RAYCAST_METHODS,
)
from isosample.errors import InputError, MissingDependencyError

if TYPE_CHECKING:
    import argparse

    from isosample.cli.parser import Commands
    from isosample.compare.contenders import ComparedScene
    from isosample.compare.experiment import Experiment
    from isosample.compare.sweep import Sweep
    from isosample.rendering.camera import Camera
    from isosample.transfer.transfer_function import TransferFunction
    from isosample.volume.geometry import Box
    from isosample.volume.grid import Volume

QUICK_REPEAT = 3
MODULES = {"jinja2": "Jinja2", "skimage": "scikit-image", "flip_evaluator": "flip-evaluator"}
SWEEPS = ("steps", "pixel_scales", "per_slopes", "tolerances")
SWEPT_BY = {"steps": "uniform", "pixel_scales": "differential"}  # with which --sampling a list says something
OWNERS = {  # None unless given; the methods that each belongs to
    **dict.fromkeys(("per_slopes", "tolerances", "details"), (DATA_CENTRIC,)),
    **dict.fromkeys(("steps", "pixel_scales"), RAYCAST_METHODS),
    **{name: RAYCAST_OPTIONS[name] for name in ("sampling", "adaptive", "peak_weight", "crossings")},
}
EXAMPLE = """\
isosample compare head.nrrd --tf bone.json -o head_report
isosample compare head.nrrd --tf bone.json --quick -o head_report
isosample compare head.nrrd --methods data-centric,pre-integrated --cameras 3 --size 800x800 -o head_report
isosample compare head.nrrd --tf bone.json --shading -o lit_report
isosample compare head.nrrd --steps 1,1/2,1/4 --per-slopes 1,3,9 --tolerances 1/255 --repeat 11 -o head_report"""


def add_parser(commands: Commands) -> None:
    """Add the command and its options."""
    parser = add_command(
        commands,
        "compare",
        run,
        summary="Render a volume by several methods, each from coarse to fine, hold time and error against the float64 "
        "reference, and write a report.",
        example=EXAMPLE,
    )
    parser.add_argument("source", type=Path, metavar="VOLUME", help="volume file or DICOM folder")
    parser.add_argument(
        "-o",
        "--output",
        type=Path,
        required=True,
        metavar="DIR",
        help="folder for report.html, results.json, results.csv, the plots (SVG) and the pictures (PNG)",
    )
    parser.add_argument(
        "--tf",
        type=Path,
        metavar="FILE",
        help="transfer function, JSON of isosample, 3D Slicer (.vp.json) or ParaView (default: one suggested from the "
        "histogram)",
    )
    parser.add_argument(
        "--quick",
        action="store_true",
        help="two settings per method, {} frames, {}x{} pixels, where nothing else is asked for".format(
            QUICK_REPEAT, *QUICK_SIZE
        ),
    )
    add_sweep_options(parser)
    add_picture_options(parser)
    arguments.add_reconstruction_option(parser)
    arguments.add_details_option(
        parser,
        within=f"that are less than {DEFAULT_SCREEN_ERROR:g} pixel off (with --tolerances: as much of it as the "
        "tolerance allows)",
    )
    arguments.add_nan_option(parser)
    arguments.add_camera_options(parser)
    arguments.add_volume_options(parser)


def run(args: argparse.Namespace) -> int:
    """Check, compare, write the report, and say its verdict."""
    from isosample.cli.sources import load_transfer_function, open_source_volume, transfer_function_of
    from isosample.compare.experiment import run_experiment
    from isosample.compare.report import write_report

    start = time.perf_counter()
    _check_modules()
    sweep = sweep_of(args)
    fixed = _fixed_camera(args)
    given = load_transfer_function(args.tf)
    volume = open_source_volume(args, args.source)
    folder = make_folder(args.output)
    size = _size_of(args)
    check_driver(size)
    tf, origin = transfer_function_of(volume, given, args.tf, nan_masked=args.nan == "masked")
    scene = _scene(args, volume.in_memory(), tf, size)
    experiment = _experiment(
        args, scene, sweep, [fixed] if fixed else _around(args, framed_box(args, scene.volume, tf), size)
    )
    with progress_bars(begins=True) as progress:
        outcome = run_experiment(experiment, progress)
    document = write_report(
        outcome,
        folder,
        source=str(args.source),
        transfer_function=origin,
        command=partial(render_command, args, size),
    )
    _summarise(document, folder, time.perf_counter() - start)
    return 0


def sweep_of(args: argparse.Namespace) -> Sweep:
    """Return the settings of every method from the arguments, checked.

    Raises
    ------
    InputError
        If an option is about a method or a sampling that is left out.
    """
    from isosample.compare.sweep import QUICK, Sweep

    _check_parts(args)
    given = {name: tuple(getattr(args, name)) for name in SWEEPS if getattr(args, name) is not None}
    if {"per_slopes", "tolerances"} & set(given):  # one of the two lists alone is the whole sweep
        given = {"per_slopes": (), "tolerances": ()} | given
    template: Any = QUICK if args.quick else Sweep()
    chosen = {name: given.get(name, getattr(template, name)) for name in SWEEPS}
    return Sweep(methods=tuple(args.methods), **chosen)


def _check_parts(args: argparse.Namespace) -> None:
    """Raise where an option is about a method, or a sampling, that is not compared."""
    sampling = args.sampling or "uniform"
    for name, owners in OWNERS.items():
        if getattr(args, name) is None:
            continue
        if not set(owners) & set(args.methods):
            raise InputError(
                f"{option(name)} has no part in a comparison of {', '.join(args.methods)}: it belongs to "
                f"{' and '.join(owners)}. Leave it out, or add one to --methods."
            )
        if name in SWEPT_BY and sampling != SWEPT_BY[name]:
            raise InputError(
                f"{option(name)} has no part in a comparison with --sampling {sampling}: it goes with --sampling "
                f"{SWEPT_BY[name]}. Leave out one of them."
            )


def _scene(
    args: argparse.Namespace, volume: Volume, transfer_function: TransferFunction, size: tuple[int, int]
) -> ComparedScene:
    from isosample.compare.contenders import ComparedScene
    from isosample.rendering.raycast_settings import Crossings, PeakWeight, RaycastSettings, Sampling
    from isosample.rendering.settings import ClipPlane, Material, RenderSettings, ResolveStage
    from isosample.volume.reconstruction import Reconstruction

    return ComparedScene(
        volume=volume,
        transfer_function=transfer_function,
        size=size,
        render=RenderSettings(
            material=Material() if args.shading else None,
            background=args.background,
            clip_planes=tuple(ClipPlane(*plane) for plane in args.clip),
            stage=ResolveStage(args.stage),
        ),
        raycast=RaycastSettings(
            sampling=Sampling(args.sampling or "uniform"),
            adaptive=bool(args.adaptive),
            peak_weight=PeakWeight(args.peak_weight or EXACT_PEAKS["peak_weight"]),
            crossings=Crossings(args.crossings or EXACT_PEAKS["crossings"]),
            reconstruction=Reconstruction(args.reconstruction or "trilinear"),
        ),
        nan_masked=args.nan == "masked",
        details=args.details or 0,
    )


def _experiment(
    args: argparse.Namespace, scene: ComparedScene, sweep: Sweep, cameras: list[Camera]
) -> Experiment:
    from isosample.compare.experiment import Experiment

    default = QUICK_REPEAT if args.quick else DEFAULT_REPEAT
    return Experiment(scene=scene, cameras=tuple(cameras), sweep=sweep, repeat=args.repeat or default)


def _size_of(args: argparse.Namespace) -> tuple[int, int]:
    from isosample.compare.perceptual import SSIM_RADIUS

    size: tuple[int, int] = args.size or (QUICK_SIZE if args.quick else SIZE)
    least = 2 * SSIM_RADIUS + 1
    if min(size) < least:
        raise InputError(
            f"--size {size[0]}x{size[1]} is too small to be judged; give {least}x{least} or more."
        )
    return size


def _fixed_camera(args: argparse.Namespace) -> Camera | None:
    """The camera of a file, which excludes several."""
    if args.camera is not None and args.cameras is not None:
        raise InputError(
            f"--camera {args.camera} and --cameras {args.cameras} both place the camera; leave out one of them."
        )
    return camera_of(args)


def _around(args: argparse.Namespace, box: Box, size: tuple[int, int]) -> list[Camera]:
    """Views at equal angles, the first one where the orbit options put it."""
    return [orbit(args, box, size=size, azimuth=azimuth) for azimuth in azimuths(args)]


def _check_modules() -> None:
    """Raise before the long work where a package of the extra `compare` is missing."""
    import importlib.util

    missing = [package for module, package in MODULES.items() if importlib.util.find_spec(module) is None]
    if missing:
        raise MissingDependencyError(
            f'a comparison needs {" and ".join(missing)}: pip install "isosample[compare]".'
        )


def _summarise(document: dict[str, Any], folder: Path, duration: float) -> None:
    """Say the verdict, the figures behind it, and where the report is."""
    for sentence in document["verdict"]["sentences"]:
        say(sentence)
    say()
    rows = [
        [
            entry["method"],
            entry["label"],
            f"{entry['setup_seconds']:.3f}",
            f"{1e3 * entry['summary']['frame_seconds']:.1f}",
            f"{entry['summary']['rmse']:.2e}",
            f"{entry['summary']['evaluations_per_ray']:.1f}",
        ]
        for entry in document["entries"]
    ]
    columns = ("method", "setting", "setup [s]", "frame [ms]", "RMSE", "per ray")
    say_table(columns, rows, numeric=(2, 3, 4, 5))
    say()
    say(f"{folder / 'report.html'} ({seconds(duration)})")

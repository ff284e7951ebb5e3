"""`isosample render --method post-classified | pre-integrated | peak-finding`: the volume by the ray caster."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any

from isosample.cli.cameras import framed_box, orbit
from isosample.cli.console import progress_bars, say, say_fields, seconds
from isosample.cli.methods import (
    NEEDS,
    RAYCAST_OPTIONS,
    check_volume_is_named,
    choice_statistics,
)
from isosample.cli.outputs import check_driver, write_json
from isosample.cli.summary import note_if_volume_is_empty, say_if_nothing_is_seen
from isosample.cli.turntable import cameras_of, run_turntable
from isosample.defaults import EXACT_PEAKS, PEAK_FINDING
from isosample.wording import thousands

if TYPE_CHECKING:
    import argparse

    from isosample.cli.auto import Opened
    from isosample.rendering.camera import Camera
    from isosample.rendering.image import Image
    from isosample.rendering.raycast_settings import RaycastSettings
    from isosample.rendering.settings import RenderSettings
    from isosample.rendering.turntable import FrameLog
    from isosample.transfer.transfer_function import TransferFunction
    from isosample.volume.grid import Volume


def run_raycast(
    args: argparse.Namespace,
    settings: RenderSettings,
    camera: Camera | None,
    log: FrameLog,
    opened: Opened | None = None,
) -> int:
    """Cast the rays of one picture, or of a film, write it, and sum up."""
    from isosample.cli.sources import load_transfer_function, open_source_volume, transfer_function_of
    from isosample.rendering.raycaster import RayCaster

    raycast = raycast_settings_of(args, args.method)
    check_volume_is_named(args)
    masked, macrocells = args.nan == "masked", None
    if opened is None:
        given = load_transfer_function(args.tf)
        volume = open_source_volume(args, args.source)
        check_driver(args.size)
        tf, origin = transfer_function_of(volume, given, args.tf, nan_masked=masked)
        box = framed_box(args, volume, tf)
    else:
        volume, tf, origin = opened.volume, opened.transfer_function, opened.tf_origin
        box, macrocells = opened.box, opened.macrocells
    empty_range = note_if_volume_is_empty(volume, tf, raycast.reconstruction)
    more: dict[str, Any] = {"source": str(args.source), "transfer_function": origin} | choice_statistics(args)
    fields: dict[str, str] = {}
    if args.tolerance is not None:
        raycast, report = _step_for(args, volume, tf, raycast)
        more["tolerance"], fields["tolerance"] = report, step_line(report)
    prepared = partial(RayCaster, volume, tf, raycast=raycast, nan_masked=masked, macrocells=macrocells)
    if args.turntable is not None:
        with prepared() as caster:
            empty = run_turntable(
                args,
                cameras_of(args, camera, box),
                lambda one, progress: caster.render(
                    camera=one, size=args.size, settings=settings, progress=progress
                ),
                log,
                settings=settings,
                more=more,
                fields=fields,
            )
        if not empty_range:
            empty.say_why(volume.box)
        return 0
    camera = camera or orbit(args, box)
    with progress_bars() as progress, prepared() as caster:
        image = caster.render(camera=camera, size=args.size, settings=settings, progress=progress)
    image.save(args.output)
    if args.stats:
        write_json(args.stats, image.stats | more)
    _summarise(image, args, log.elapsed, fields)
    if not empty_range:
        say_if_nothing_is_seen(image, volume.box, camera, settings)
    return 0


def raycast_settings_of(args: argparse.Namespace, method: str) -> RaycastSettings:
    """Return the settings of one of the ray caster's methods from the arguments, checked."""
    from isosample.rendering.raycast_settings import (
        Classification,
        Crossings,
        Filtering,
        Integration,
        PeakMode,
        PeakWeight,
        Quadrature,
        RaycastSettings,
        Sampling,
        TableDtype,
        TransferLookup,
    )
    from isosample.volume.reconstruction import Reconstruction

    kinds = {
        "sampling": Sampling,
        "filtering": Filtering,
        "transfer_lookup": TransferLookup,
        "quadrature": Quadrature,
        "integration": Integration,
        "table_dtype": TableDtype,
        "peak_mode": PeakMode,
        "peak_weight": PeakWeight,
        "crossings": Crossings,
    }
    given = {name: getattr(args, name) for name in RAYCAST_OPTIONS if getattr(args, name) is not None}
    if args.choice is not None and method == PEAK_FINDING:
        given = exact_peaks(args) | given
    chosen: dict[str, Any] = {
        name: kinds[name](value) if name in kinds else value for name, value in given.items()
    }
    return RaycastSettings(
        classification=Classification(method),
        reconstruction=Reconstruction(args.reconstruction or "trilinear"),
        **chosen,
    )


def exact_peaks(args: argparse.Namespace) -> dict[str, str]:
    """What an automatic choice means by peak finding, where no option says otherwise.

    Options of a table leave out the crossings, and ``--peak-mode xor`` the weight, with which it cannot be.
    """
    by_table = any(getattr(args, name) is not None for name in NEEDS if NEEDS[name][0] == "crossings")
    left_out = {"crossings": by_table, "peak_weight": args.peak_mode == "xor"}
    return {name: value for name, value in EXACT_PEAKS.items() if not left_out[name]}


def _step_for(
    args: argparse.Namespace, volume: Volume, tf: TransferFunction, raycast: RaycastSettings
) -> tuple[RaycastSettings, dict[str, Any]]:
    """Search for the step that a tolerance needs."""
    from isosample.rendering.step_search import step_for_tolerance

    with progress_bars() as progress:
        found = step_for_tolerance(
            volume, tf, args.tolerance, raycast=raycast, nan_masked=args.nan == "masked", progress=progress
        )
    return replace(raycast, step=found.step), found.report


def step_line(report: dict[str, Any]) -> str:
    """What a search for a step found."""
    if report["missed"] is None:
        verdict = "reached"
    else:
        tried = [one["step"] for one in report["rounds"]]
        verdict = f"NOT reached with any of {len(tried)} steps of {max(tried):.3g} to {min(tried):.3g} voxels"
    return (
        f"{report['tolerance']:.3g}: {verdict}; with steps of {report['step']:.3g} voxels all but 0.1 % of the pixels "
        f"of {len(report['views'])} views, unlit, err less than {report['reached']:.2g}, measured against the reference"
    )


def _summarise(image: Image, args: argparse.Namespace, duration: float, more: dict[str, str]) -> None:
    """Write the picture's path and what it took."""
    stats = image.stats
    width, height = stats["size"]
    samples, macrocells = stats["samples_per_ray"], stats["macrocells"]
    fields = {
        "picture": f"{args.output} ({width} x {height} pixels), {args.method}, {stats['sampling']} sampling",
        "samples per ray": f"{samples['mean']:.1f} (at most {thousands(samples['max'])})",
        "macrocells per ray": f"{macrocells['visited_per_ray']:.1f} visited, {macrocells['skipped_per_ray']:.1f} "
        f"skipped; {thousands(macrocells['occupied'])} of {thousands(macrocells['of'])} are occupied",
    }
    if args.method == PEAK_FINDING:
        fields["root evaluations per ray"] = f"{stats['root_evaluations_per_ray']:.1f}"
    say_fields(fields | more | {"seconds": seconds(duration)})
    hidden = stats["not_shown"].get("isosurfaces", 0)
    if hidden:
        say(
            f"not shown: {hidden} of the transfer function's isosurfaces, which samples and integrals do not meet; "
            "--method pre-integrated --integration exact and --method peak-finding show them"
        )

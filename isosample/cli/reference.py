"""`isosample render --method reference`: the field itself in float64."""

from __future__ import annotations

from typing import TYPE_CHECKING

from isosample.cli.cameras import framed_box, orbit
from isosample.cli.console import progress_bars, say_fields, seconds
from isosample.cli.methods import check_volume_is_named
from isosample.cli.outputs import write_json
from isosample.cli.summary import note_if_volume_is_empty, say_if_nothing_is_seen
from isosample.cli.turntable import cameras_of, run_turntable
from isosample.wording import thousands

if TYPE_CHECKING:
    import argparse

    from isosample.rendering.camera import Camera
    from isosample.rendering.settings import RenderSettings
    from isosample.rendering.turntable import FrameLog


def run_reference(
    args: argparse.Namespace, settings: RenderSettings, camera: Camera | None, log: FrameLog
) -> int:
    """Integrate the volume itself."""
    from isosample.cli.sources import load_transfer_function, open_source_volume, transfer_function_of
    from isosample.rendering.reference_image import ReferenceRenderer
    from isosample.volume.reconstruction import Reconstruction

    check_volume_is_named(args)
    given = load_transfer_function(args.tf)
    volume = open_source_volume(args, args.source)
    masked = args.nan == "masked"
    tf, origin = transfer_function_of(volume, given, args.tf, nan_masked=masked)
    box = framed_box(args, volume, tf)
    reconstruction = Reconstruction(args.reconstruction or "trilinear")
    empty_range = note_if_volume_is_empty(volume, tf, reconstruction)
    renderer = ReferenceRenderer(
        volume, tf, reconstruction=reconstruction, nan_masked=masked, material=settings.material
    )
    if args.turntable is not None:
        empty = run_turntable(
            args,
            cameras_of(args, camera, box),
            lambda one, progress: renderer.render(
                camera=one, size=args.size, settings=settings, progress=progress
            ),
            log,
            settings=settings,
            more={"source": str(args.source), "transfer_function": origin},
            fields={},
        )
        if not empty_range:
            empty.say_why(volume.box)
        return 0
    camera = camera or orbit(args, box)
    with progress_bars() as progress:
        image = renderer.render(camera=camera, size=args.size, settings=settings, progress=progress)
    image.save(args.output)
    if args.stats:
        write_json(args.stats, image.stats | {"source": str(args.source), "transfer_function": origin})
    width, height = args.size
    say_fields(
        {
            "picture": f"{args.output} ({width} x {height} pixels), float64 reference",
            "cells visited": thousands(image.stats["cells_visited"]),
            "seconds": seconds(log.elapsed),
        }
    )
    if not empty_range:
        say_if_nothing_is_seen(image, volume.box, camera, settings)
    return 0

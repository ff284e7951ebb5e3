"""`isosample render --method reference`: the field itself in float64."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

from isosample.cli.cameras import orbit
from isosample.cli.console import progress_bars, say_fields, seconds, thousands
from isosample.cli.methods import check_volume_is_named
from isosample.cli.outputs import write_json

if TYPE_CHECKING:
    import argparse

    from isosample.rendering.camera import Camera
    from isosample.rendering.settings import RenderSettings


def run_reference(
    args: argparse.Namespace, settings: RenderSettings, camera: Camera | None, start: float
) -> int:
    """Integrate the volume itself."""
    from isosample.cli.sources import load_transfer_function, open_source_volume, transfer_function_of
    from isosample.rendering.reference_image import render_reference
    from isosample.volume.reconstruction import Reconstruction

    check_volume_is_named(args)
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
            reconstruction=Reconstruction(args.reconstruction or "trilinear"),
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

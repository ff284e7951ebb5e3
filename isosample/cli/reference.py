"""`isosample render --method reference`: the field itself in float64."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

from isosample.cli import arguments
from isosample.cli.cameras import orbit
from isosample.cli.console import progress_bars, say_fields, seconds, thousands
from isosample.cli.outputs import write_json
from isosample.errors import InputError

if TYPE_CHECKING:
    import argparse

    from isosample.rendering.camera import Camera
    from isosample.rendering.settings import RenderSettings

SURFACE_OPTIONS = {  # with their defaults
    "cache": None,
    "per_slope": None,
    "tolerance": None,
    "max_isovalues": None,
    "refine": arguments.UNSET,
    "plan": False,
    "segment": "cubic",
    "curved": None,
    "strict": False,
    "error_map": None,
    "stage": "auto",
}


def run_reference(
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
    from isosample.volume.reconstruction import Reconstruction

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

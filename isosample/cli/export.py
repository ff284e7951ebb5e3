"""`isosample export`: one isosurface as a mesh file for other programs."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from isosample.cli import arguments, values
from isosample.cli.console import byte_size, progress_bars, say_fields, thousands
from isosample.cli.outputs import check_suffix, check_writable
from isosample.cli.parser import add_command
from isosample.defaults import MESH_SUFFIXES

if TYPE_CHECKING:
    import argparse

    from isosample.cli.parser import Commands
    from isosample.surfaces.extract import SurfaceSet

EXAMPLE = """\
isosample export head.nrrd --isovalue 1200 -o skull.ply
isosample export meshes_cache/head-1f3a9c07 --isovalue 1200 -o skull.glb"""


def add_parser(commands: Commands) -> None:
    """Add the command and its options."""
    parser = add_command(
        commands,
        "export",
        run,
        summary="Write one isosurface as a mesh file, in world units.",
        example=EXAMPLE,
    )
    parser.add_argument(
        "source", type=Path, metavar="SOURCE", help="volume file, DICOM folder or cache folder"
    )
    parser.add_argument(
        "--isovalue", type=values.finite, required=True, metavar="V", help="value of the surface [data unit]"
    )
    parser.add_argument(
        "-o",
        "--output",
        type=Path,
        required=True,
        metavar="FILE",
        help=f"mesh file: {', '.join(MESH_SUFFIXES)}",
    )
    arguments.add_nan_option(parser)
    arguments.add_volume_options(parser)


def run(args: argparse.Namespace) -> int:
    """Check the output, get the surface, write it."""
    check_suffix(args.output, MESH_SUFFIXES, "a mesh file")
    check_writable({"--output": args.output}, [args.source])
    from isosample.surfaces.export import export_mesh

    mesh = _surface(args).mesh(0)
    export_mesh(mesh, args.output)
    say_fields(
        {
            "mesh": f"{args.output} ({byte_size(args.output.stat().st_size)})",
            "isovalue": f"{args.isovalue:.9g}",
            "vertices": thousands(len(mesh.vertices)),
            "triangles": thousands(len(mesh.triangles)),
        }
    )
    return 0


def _surface(args: argparse.Namespace) -> SurfaceSet:
    """Return the one surface, read from a cache folder or extracted from a volume."""
    from isosample.cli import sources
    from isosample.surfaces.extract import extract_surfaces

    masked = args.nan == "masked"
    if not sources.is_cache_folder(args.source):
        volume = sources.open_source_volume(args, args.source)
        with progress_bars() as progress:
            return extract_surfaces(
                volume,
                [args.isovalue],
                nan_masked=masked,
                progress=lambda done, total: progress("extract", done, total),
            )
    sources.refuse_volume_options(args, args.source)
    return sources.cached_surface(args.source, args.isovalue, nan_masked=masked)

"""`isosample export`: one isosurface as a mesh file for other programs."""

from __future__ import annotations

import argparse
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from isosample.cli import arguments, values
from isosample.cli.console import progress_bars, say_fields, say_json
from isosample.cli.outputs import check_suffix, check_writable
from isosample.cli.parser import add_command
from isosample.defaults import MESH_SUFFIXES
from isosample.errors import InputError
from isosample.wording import byte_size, thousands

if TYPE_CHECKING:
    from isosample.cli.parser import Commands
    from isosample.surfaces.extract import SurfaceSet
    from isosample.surfaces.mesh import Mesh
    from isosample.surfaces.simplify import Simplified

EXAMPLE = """\
isosample export head.nrrd --isovalue 1200 -o skull.ply
isosample export meshes_cache/head-1f3a9c07 --isovalue 1200 -o skull.glb
isosample export head.nrrd --isovalue 1200 --max-deviation 0.1 -o skull.vtp"""


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
    fewer = parser.add_mutually_exclusive_group()
    fewer.add_argument(
        "--simplify",
        type=_share,
        metavar="RATIO",
        help="keep this share of the triangles, such as 0.25; needs pymeshlab",
    )
    fewer.add_argument(
        "--max-deviation",
        type=values.positive,
        metavar="D",
        help="keep as few triangles as a search finds within this Hausdorff distance [voxel]; needs pymeshlab",
    )
    parser.add_argument("--json", action="store_true", help="write JSON (default: a table)")
    arguments.add_nan_option(parser)
    arguments.add_volume_options(parser)


def run(args: argparse.Namespace) -> int:
    """Check the output, get the surface, simplify it where that is asked for, write it."""
    check_suffix(args.output, MESH_SUFFIXES, "a mesh file")
    check_writable({"--output": args.output}, [args.source])
    from isosample.surfaces.export import export_mesh, open_edge_count

    asked = args.simplify is not None or args.max_deviation is not None
    if asked:
        from isosample.surfaces.simplify import check_available

        check_available()  # told before the long work
    surfaces = _surface(args)
    mesh = surfaces.mesh(0)
    if not len(mesh.triangles):
        low, high = surfaces.value_range
        raise InputError(
            f"the isosurface at {args.isovalue:g} has no triangles, and nothing is written to {args.output}: the "
            f"values of {args.source} go from {low:g} to {high:g}. Choose --isovalue between them."
        )
    found = _simplified(mesh, surfaces, args) if asked else None
    mesh = mesh if found is None else found.mesh
    export_mesh(mesh, args.output)
    report: dict[str, Any] = {
        "mesh": str(args.output),
        "bytes": args.output.stat().st_size,
        "isovalue": args.isovalue,
        "vertices": len(mesh.vertices),
        "triangles": len(mesh.triangles),
        "open_edges": open_edge_count(mesh.triangles),
    }
    if found is not None:
        report["simplification"] = {
            "triangles_before": found.triangles_before,
            "ratio": found.ratio,
            "hausdorff_voxels": found.deviation.hausdorff,
            "rms_voxels": found.deviation.rms,
            "points_measured": found.deviation.points,
        }
    if args.json:
        say_json(report)
    else:
        say_fields(_fields(report))
    return 0


def _fields(report: dict[str, Any]) -> dict[str, str]:
    """Return the lines of the table."""
    fields = {
        "mesh": f"{report['mesh']} ({byte_size(report['bytes'])})",
        "isovalue": f"{report['isovalue']:.9g}",
        "vertices": thousands(report["vertices"]),
        "triangles": thousands(report["triangles"]),
        "open edges": thousands(report["open_edges"]),
    }
    if "simplification" in report:
        done = report["simplification"]
        fields["kept"] = f"{done['ratio']:.3%} of {thousands(done['triangles_before'])} triangles"
        fields["Hausdorff distance"] = f"{done['hausdorff_voxels']:.3g} voxel (rms {done['rms_voxels']:.3g})"
    return fields


def _simplified(mesh: Mesh, surfaces: SurfaceSet, args: argparse.Namespace) -> Simplified:
    """Return the mesh with as few triangles as asked for."""
    from isosample.surfaces.simplify import simplify

    with progress_bars() as progress:
        return simplify(
            mesh,
            surfaces.geometry,
            ratio=args.simplify,
            max_deviation=args.max_deviation,
            progress=partial(progress, "simplify"),
        )


def _share(text: str) -> float:
    """Return a number above 0 and below 1."""
    number = values.positive(text)
    if number >= 1:
        raise argparse.ArgumentTypeError(f"{text!r} must be below 1: the share of the triangles to keep")
    return number


def _surface(args: argparse.Namespace) -> SurfaceSet:
    """Return the one surface, read from a cache folder or extracted from a volume."""
    from isosample.cli import sources
    from isosample.cli.cached_scenes import cached_surface
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
    return cached_surface(args.source, args.isovalue, nan_masked=masked)

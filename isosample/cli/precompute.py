"""`isosample precompute`: the meshes of a volume into a cache folder."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING

from isosample.cli import arguments, values
from isosample.cli.console import note, progress_bars, say_fields, seconds
from isosample.cli.outputs import nearest_existing, probe_folder
from isosample.cli.parser import add_command
from isosample.cli.summary import details_field, say_if_coarse, tolerance_fields
from isosample.wording import byte_size, thousands

if TYPE_CHECKING:
    import argparse

    from isosample.cli.parser import Commands
    from isosample.cli.scenes import PreparedScene
    from isosample.transfer.transfer_function import TransferFunction
    from isosample.volume.grid import Volume

EXAMPLE = """\
isosample precompute head.nrrd --tf bone.json --per-slope 8 --cache head_meshes
isosample precompute head.nrrd --tf bone.json --tolerance 1/255 --cache head_meshes
isosample precompute head.nrrd --tf bone.json --shading --cache lit_meshes
isosample precompute head.nrrd --tf bone.json --details 5 --cache head_meshes
isosample precompute head.nrrd --tf bone.json --plain --cache-budget 2GiB --cache head_meshes
isosample precompute huge.zarr --tf bone.json --memory 2GiB --cache huge_meshes
isosample render head_meshes -o head.png"""


def add_parser(commands: Commands) -> None:
    """Add the command and its options."""
    parser = add_command(
        commands,
        "precompute",
        run,
        summary="Extract the isosurfaces that a transfer function needs, for pictures without the volume.",
        example=EXAMPLE,
    )
    parser.add_argument(
        "volume", type=Path, metavar="VOLUME", help="volume file, DICOM folder or Zarr folder"
    )
    arguments.add_plan_options(parser)
    arguments.add_quality_options(parser)
    arguments.add_details_option(parser)
    arguments.add_shading_option(
        parser,
        does="for pictures with light (`render --shading`): slopes of constant extinction and colour get isovalues "
        "too, which pictures without light do not need (default: without)",
    )
    parser.add_argument(
        "--cache",
        type=Path,
        metavar="DIR",
        help=f"folder for the meshes (default {arguments.CACHE_DEFAULT})",
    )
    parser.add_argument(
        "--plain",
        action="store_true",
        help="write meshes that need no decoding: four to six times as large on disk, read in a quarter of the time "
        "(default: packed, without loss); what the folder holds already stays as it is, and both kinds go together",
    )
    parser.add_argument(
        "--cache-budget",
        type=values.byte_count,
        metavar="SIZE",
        help="most that the meshes of the folder may take, such as 2GiB: those of other scenes that were used longest "
        "ago make room, never those of this scene (default: without limit)",
    )
    arguments.add_memory_option(parser)
    arguments.add_nan_option(parser)
    arguments.add_volume_options(parser)


def run(args: argparse.Namespace) -> int:
    """Plan, extract what the folder lacks, write the scene, and tell where it is."""
    from isosample.cli.sources import load_transfer_function, open_source_volume
    from isosample.cli.within_memory import memory_of, precompute_within

    start = time.perf_counter()
    if args.cache is not None:
        probe_folder(nearest_existing(args.cache))
    transfer_function = load_transfer_function(args.tf)
    volume = open_source_volume(args, args.volume)
    memory = memory_of(args, volume)
    try:
        if memory is not None:
            folder, scene = precompute_within(args, volume, transfer_function, memory)
        else:
            folder, scene = precompute(args, volume, transfer_function)
    except KeyboardInterrupt:
        if args.tolerance is None:  # whose search begins anew
            note("what was extracted is kept; the same command goes on from there")
        raise
    more = {} if args.cache_budget is None else keep_to_budget(folder, args.cache_budget)
    if memory is not None:
        from isosample.surfaces.memory import peak_bytes

        more["peak memory"] = byte_size(peak_bytes())
    summarise(folder, scene, time.perf_counter() - start, more)
    return 0


def precompute(
    args: argparse.Namespace, volume: Volume, transfer_function: TransferFunction | None
) -> tuple[Path, PreparedScene]:
    """Write the scene of a volume into its cache folder; return the folder and the scene."""
    from isosample.cli.cache_names import default_cache_folder
    from isosample.cli.scenes import scene_from_volume
    from isosample.cli.sources import quality_of
    from isosample.rendering.framing import visible_span
    from isosample.surfaces.cache import content_hash, write_cache
    from isosample.volume.scan import scan_volume
    from isosample.volume.shown_cells import Shown

    quality = quality_of(args)
    scan = scan_volume(volume)
    volume_hash = content_hash(volume, scan)
    folder = args.cache
    if folder is None:
        folder = default_cache_folder(volume, volume_hash)
        probe_folder(nearest_existing(folder))
    # Room for the finest might cost its own details of an earlier run: with details, room is made at the end.
    budget = None if args.details else args.cache_budget
    with progress_bars() as progress:
        scene = scene_from_volume(
            args,
            volume,
            transfer_function,
            quality=quality,
            residuals=True,
            cache=folder,
            progress=progress,
            plain=args.plain,
            budget_bytes=budget,
        )
    write_cache(
        folder,
        scene.surfaces,
        content_hash=volume_hash,
        transfer_function=scene.transfer_function,
        plan=scene.plan,
        name=volume.name,
        mesh_distance=scene.mesh_distance,
        visible=Shown(
            visible_span(volume, scene.transfer_function, reconstruction=quality.reconstruction, scan=scan)
        ),
    )
    return folder, scene


def keep_to_budget(folder: Path, budget: int) -> dict[str, str]:
    """Remove meshes of other scenes from a cache folder until its meshes take at most so many bytes.

    Parameters
    ----------
    folder : Path
        With a scene, whose meshes stay, whatever the budget.
    budget : int
        [bytes]

    Returns
    -------
    row : dict of str to str
        For the summary.

    Raises
    ------
    CacheError
        If a file cannot be removed.
    """
    from isosample.surfaces.cache import open_cache
    from isosample.surfaces.store import MeshStore

    surfaces = open_cache(folder).surfaces
    tables = (one.chunk_table for one in surfaces.by_detail)
    own = {key.decode() for table in tables for key in table["key"].tolist()}
    left = MeshStore(folder).prune(budget, keep=own).bytes_left
    if left > budget:
        note(
            f"the meshes of this scene alone take {byte_size(left)}, more than the budget of {byte_size(budget)}; they "
            "stay"
        )
    return {"meshes": f"{byte_size(left)} (budget {byte_size(budget)})"}


def summarise(folder: Path, scene: PreparedScene, duration: float, more: dict[str, str]) -> None:
    """Write where the meshes are, what they hold and `more` rows, and whether they are near enough."""
    from isosample.surfaces.cache_folders import folder_bytes

    found = scene.surfaces.statistics
    pieces = found.brick_visits + found.chunks_reused
    say_fields(
        {
            "cache": str(folder),
            "transfer function": scene.tf_origin,
            "levels": f"{len(scene.plan.isovalues)} ({found.levels_reused} reused)",
            "pieces": f"{thousands(pieces)} ({thousands(found.chunks_reused)} reused)",
            "triangles": thousands(sum(found.triangles)),
            **details_field(scene.surfaces),
            **tolerance_fields(scene.plan),
            "size": byte_size(folder_bytes(folder)),
            **more,
            "seconds": seconds(duration),
        }
    )
    say_if_coarse(scene)

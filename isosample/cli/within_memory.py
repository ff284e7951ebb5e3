"""`isosample precompute` with a memory budget: the volume is read piece by piece, the meshes stay in their folder."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

from isosample.cli.cache_names import default_cache_folder, likely_cache_folders
from isosample.cli.cameras import FRAMING
from isosample.cli.console import progress_bars
from isosample.cli.outputs import nearest_existing, probe_folder
from isosample.cli.scenes import PreparedScene
from isosample.cli.sources import quality_of, transfer_function_of
from isosample.cli.summary import note_if_volume_is_empty

if TYPE_CHECKING:
    import argparse
    from pathlib import Path

    from isosample.cli.console import Progress
    from isosample.transfer.transfer_function import TransferFunction
    from isosample.volume.grid import Volume
    from isosample.volume.scan import BrickScan


def memory_of(args: argparse.Namespace, volume: Volume) -> int | None:
    """Return the memory budget; None where the volume is in memory, or mapped, and none is asked for."""
    from isosample.surfaces.memory import DEFAULT_MEMORY

    if args.memory is not None:
        return int(args.memory)
    local = args.tolerance is None and args.reconstruction in (None, "trilinear")
    return DEFAULT_MEMORY if volume.stays_in_file and local else None


def precompute_within(
    args: argparse.Namespace, volume: Volume, given: TransferFunction | None, memory: int
) -> tuple[Path, PreparedScene]:
    """Write the scene of a volume into its cache folder with a memory budget; return the folder and the scene."""
    from isosample.rendering.framing import visible_span
    from isosample.rendering.stored_preparation import prepare_stored_surfaces
    from isosample.surfaces.cache import claim_folder, content_hash, known_visible, write_cache
    from isosample.surfaces.memory import MemoryPlan
    from isosample.surfaces.out_of_core import SurfaceLists
    from isosample.volume.shown_cells import Shown

    quality = quality_of(args)
    masked = args.nan == "masked"
    with progress_bars() as progress:
        scan, folder = scanned(volume, args.cache, memory=memory, progress=progress)
        volume_hash = content_hash(volume, scan)
        claim_folder(folder, volume.geometry, volume_hash, volume.name)
        scan.tell(volume)
        remember(volume, scan, folder)
        tf, origin = transfer_function_of(volume, given, args.tf, nan_masked=masked)
        note_if_volume_is_empty(volume, tf, quality.reconstruction)
        visible = known_visible(folder, volume_hash, tf) or Shown(
            visible_span(
                volume,
                tf,
                scan=scan,
                budget_bytes=MemoryPlan.of(memory).sample_bytes,
                progress=partial(progress, FRAMING),
            )
        )
        surfaces, plan, durations, distance = prepare_stored_surfaces(
            volume,
            tf,
            quality,
            SurfaceLists(folder=folder, content_hash=volume_hash),
            memory=memory,
            scan=scan,
            nan_masked=masked,
            residuals=True,
            plain=args.plain,
            progress=progress,
        )
    write_cache(
        folder,
        surfaces,
        content_hash=volume_hash,
        transfer_function=tf,
        plan=plan,
        name=volume.name,
        mesh_distance=distance,
        visible=visible,
    )
    scene = PreparedScene(
        surfaces=surfaces,
        plan=plan,
        transfer_function=tf,
        name=volume.name,
        tf_origin=origin,
        seconds=durations,
        mesh_distance=distance,
    )
    return folder, scene


def scanned(
    volume: Volume, folder: Path | None, *, memory: int, progress: Progress
) -> tuple[BrickScan, Path]:
    """Return the scan of a volume and its cache folder; a file that has not changed is not looked through again.

    Parameters
    ----------
    volume : Volume
    folder : Path or None
        None: the default folder, which is named after the content.
    memory : int
        Bytes that the whole process may take.
    progress : callable
        Called with "scan", bricks done and bricks in all.

    Raises
    ------
    InputError
        If the budget is too small, or the folder cannot be written.
    """
    from isosample.surfaces.cache import content_hash
    from isosample.surfaces.memory import MemoryPlan
    from isosample.surfaces.scan_files import read_scan
    from isosample.volume.bricks import BRICK_CELLS
    from isosample.volume.lazy import identity_of
    from isosample.volume.scan import scan_volume

    budget = MemoryPlan.of(memory).sample_bytes
    identity = identity_of(volume.array)
    candidates = [folder] if folder is not None else likely_cache_folders(volume)
    stored = (read_scan(candidate, identity, BRICK_CELLS) for candidate in candidates)
    scan = next((found for found in stored if found is not None), None)
    if scan is None:
        scan = scan_volume(volume, budget_bytes=budget, progress=partial(progress, "scan"))
    if folder is None:
        folder = default_cache_folder(volume, content_hash(volume, scan))
        probe_folder(nearest_existing(folder))
    return scan, folder


def remember(volume: Volume, scan: BrickScan, folder: Path) -> None:
    """Keep the scan of a file in a cache folder, unless it is there."""
    from isosample.surfaces.scan_files import read_scan, write_scan
    from isosample.volume.lazy import identity_of

    identity = identity_of(volume.array)
    if identity is not None and read_scan(folder, identity, scan.brick_cells) is None:
        write_scan(folder, identity, scan)

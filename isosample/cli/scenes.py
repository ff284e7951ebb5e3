"""The surfaces that a command works with, of a volume: what they look like, and how long it took to get them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from isosample.cli import sources
from isosample.cli.summary import note_if_volume_is_empty

if TYPE_CHECKING:
    import argparse
    from pathlib import Path

    from isosample.cli.console import Progress
    from isosample.rendering.quality import Quality
    from isosample.surfaces.stored_surfaces import StoredSurfaces
    from isosample.surfaces.surface_set import SurfaceSet
    from isosample.transfer.isovalues import IsovaluePlan
    from isosample.transfer.transfer_function import TransferFunction
    from isosample.volume.grid import Volume
    from isosample.volume.shown_cells import Shown


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PreparedScene:
    """Surfaces, what they look like, and how long it took to get them.

    Attributes
    ----------
    surfaces : SurfaceSet or StoredSurfaces
    plan : IsovaluePlan
    transfer_function : TransferFunction
    name : str
        Name of the volume.
    tf_origin : str
        Where the transfer function comes from.
    seconds : dict of str to float
        By stage.
    mesh_distance : float or None
        Of an automatic refinement: largest rms distance of a level from its isosurface [voxel].
    visible : Shown or None
        Where the transfer function shows something of the volume; None: not known.
    """

    surfaces: SurfaceSet | StoredSurfaces
    plan: IsovaluePlan
    transfer_function: TransferFunction
    name: str
    tf_origin: str
    seconds: dict[str, float]
    mesh_distance: float | None = None
    visible: Shown | None = None


def scene_from_volume(
    args: argparse.Namespace,
    volume: Volume,
    given: TransferFunction | None,
    *,
    quality: Quality,
    residuals: bool,
    cache: Path | None,
    progress: Progress,
    **kept: Any,
) -> PreparedScene:
    """Plan and extract the surfaces that a picture of a volume needs; tell before where it will show nothing.

    Parameters
    ----------
    args : Namespace
        With `tf` and `nan`.
    volume : Volume
    given : TransferFunction or None
        None: one is suggested.
    quality, residuals, cache, progress
        As for `prepare_surfaces`.
    kept : optional
        `plain` and `budget_bytes` of `prepare_surfaces`.
    """
    from isosample.rendering.preparation import prepare_surfaces

    masked = args.nan == "masked"
    tf, origin = sources.transfer_function_of(volume, given, args.tf, nan_masked=masked)
    note_if_volume_is_empty(volume, tf, quality.reconstruction)
    surfaces, plan, seconds, distance = prepare_surfaces(
        volume, tf, quality, nan_masked=masked, residuals=residuals, cache=cache, progress=progress, **kept
    )
    return PreparedScene(
        surfaces=surfaces,
        plan=plan,
        transfer_function=tf,
        name=volume.name,
        tf_origin=origin,
        seconds=seconds,
        mesh_distance=distance,
    )

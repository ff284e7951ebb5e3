"""What a command works on: a volume file, or a cache folder that stands for one, with a transfer function."""

from __future__ import annotations

from typing import TYPE_CHECKING

from isosample.cli.console import note
from isosample.defaults import DEFAULT_PER_SLOPE
from isosample.errors import InputError

if TYPE_CHECKING:
    import argparse
    from collections.abc import Sequence
    from pathlib import Path

    from isosample.rendering.quality import Quality
    from isosample.transfer.isovalues import IsovaluePlan
    from isosample.transfer.sample_shares import SampleShares
    from isosample.transfer.sheets import Gradients
    from isosample.transfer.transfer_function import TransferFunction
    from isosample.volume.grid import Volume

VOLUME_OPTIONS = ("shape", "dtype", "spacing", "channel", "time", "dataset", "frame")
CACHE_FILES = ("volume.json", "scene.json")


def is_cache_folder(path: Path) -> bool:
    """Tell whether a path is a mesh cache, or what is left of one; a folder `surfaces` alone proves nothing."""
    if not path.is_dir():
        return False
    return any((path / name).exists() for name in CACHE_FILES) or any(path.glob("surfaces/*.npz"))


def open_source_volume(args: argparse.Namespace, path: Path) -> Volume:
    """Open the volume that the arguments describe.

    Raises
    ------
    InputError
        If it cannot be read, or is a cache folder.
    """
    from isosample.volume.readers import open_volume

    if is_cache_folder(path):
        raise InputError(f"{path} is a mesh cache, not a volume. Render or export it, or name a volume file.")
    volume = open_volume(
        path,
        shape=args.shape,
        dtype=args.dtype,
        spacing=args.spacing,
        channel=args.channel,
        time=args.time,
        dataset=args.dataset,
    )
    return volume.in_index_frame() if args.frame == "index" else volume


def refuse_volume_options(args: argparse.Namespace, folder: Path, more: Sequence[str] = ()) -> None:
    """Raise `InputError` where options that describe a volume are given for a cache folder."""
    names = (*VOLUME_OPTIONS, *more)
    given = [name.replace("_", "-") for name in names if getattr(args, name) is not None]
    if given:
        raise InputError(
            f"--{given[0]} belongs to a volume file, and {folder} is a mesh cache; its meshes are what they "
            f"are. Leave out --{given[0]}, or name the volume."
        )


def load_transfer_function(path: Path | None) -> TransferFunction | None:
    """Return the transfer function of a file, or None without one."""
    from isosample.transfer.transfer_function import TransferFunction

    return None if path is None else TransferFunction.load(path)


def plan_for(
    transfer_function: TransferFunction,
    value_range: tuple[float, float],
    per_slope: int | None,
    gradients: Gradients | None,
    *,
    lit: bool,
    shares: SampleShares | None,
) -> IsovaluePlan:
    """Return the isovalues with K = `per_slope`, or the default for None; `lit`: for pictures with light."""
    from isosample.transfer.isovalues import plan_isovalues

    chosen = DEFAULT_PER_SLOPE if per_slope is None else per_slope
    return plan_isovalues(
        transfer_function, value_range, per_slope=chosen, gradients=gradients, lit=lit, shares=shares
    )


def transfer_function_of(
    volume: Volume, given: TransferFunction | None, path: Path | None, *, nan_masked: bool
) -> tuple[TransferFunction, str]:
    """Return the given transfer function or a suggested one, and where it comes from.

    Raises
    ------
    InputError
        If the volume can have no surfaces, or is constant and none is given.
    """
    from isosample.surfaces.extract import ExtractionSettings, check_volume
    from isosample.transfer.transfer_function import TransferFunction

    check_volume(volume, ExtractionSettings(nan_masked=nan_masked))
    if given is not None:
        return given, str(path)
    suggested = TransferFunction.suggest(volume)
    note("no --tf is given; using a transfer function suggested from the histogram")
    return suggested, "suggested from the histogram"


def quality_of(args: argparse.Namespace) -> Quality:
    """Return how many isovalues and how fine meshes the arguments ask for.

    Raises
    ------
    InputError
        If two options contradict each other.
    """
    from isosample.defaults import DEFAULT_MAX_ISOVALUES
    from isosample.rendering.quality import Quality
    from isosample.volume.reconstruction import Reconstruction

    if args.tolerance is not None and args.per_slope is not None:
        raise InputError(
            f"--tolerance {args.tolerance:g} and --per-slope {args.per_slope} both decide about the isovalues; "
            "leave out one of them."
        )
    if args.max_isovalues is not None and args.tolerance is None:
        raise InputError(
            f"--max-isovalues {args.max_isovalues} limits what --tolerance chooses; add --tolerance, or leave it out."
        )
    if args.tolerance is not None and getattr(args, "segment", "cubic") != "cubic":
        raise InputError(
            f"--tolerance {args.tolerance:g} is searched for with cubic segments, and --segment {args.segment} makes "
            "another picture; leave out one of them."
        )
    if args.tolerance is not None and getattr(args, "curved", None) is not None:
        raise InputError(
            "--tolerance is searched for with the crossings that its reconstruction asks for; leave out --curved and "
            "--no-curved."
        )
    return Quality(
        per_slope=args.per_slope,
        tolerance=args.tolerance,
        max_isovalues=DEFAULT_MAX_ISOVALUES if args.max_isovalues is None else args.max_isovalues,
        reconstruction=Reconstruction(args.reconstruction or "trilinear"),
        refine=args.refine,
        details=getattr(args, "details", None) or 0,
        lit=args.shading,
    )

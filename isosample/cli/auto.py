"""The method that is expected to take the least time: chosen by `isosample render --method auto`, or only told."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from isosample.cli.cameras import VISIBLE, box_of, orbit, search_visible
from isosample.cli.console import note, say_fields
from isosample.cli.methods import methods_left
from isosample.cli.outputs import check_driver
from isosample.cli.turntable import cameras_of
from isosample.defaults import DATA_CENTRIC
from isosample.wording import duration

if TYPE_CHECKING:
    import argparse

    from isosample.rendering.camera import Camera
    from isosample.rendering.settings import RenderSettings
    from isosample.transfer.transfer_function import TransferFunction
    from isosample.volume.geometry import Box
    from isosample.volume.grid import Volume
    from isosample.volume.macrocells import MacrocellGrid
    from isosample.volume.shown_cells import Shown


FEWEST_SAMPLES = (
    1 << 20
)  # of a volume for which isosurfaces may be slow; fewer take less than an estimate is worth
WORTH_SECONDS, WORTH_FACTOR = 5.0, 3.0  # so much quicker another method must be to be named


@dataclass(frozen=True, slots=True)
class Opened:
    """A volume that was opened to choose a method for it, its transfer function and where that is from.

    With the box that fills the picture, where no file places the camera, what it is around if it is not the volume's
    own, and bounds of the volume's field, where it was
    chosen by an estimate.
    """

    volume: Volume
    transfer_function: TransferFunction
    tf_origin: str
    box: Box
    visible: Shown | None = None
    macrocells: MacrocellGrid | None = None


def choose(args: argparse.Namespace, settings: RenderSettings, camera: Camera | None) -> Opened | None:
    """Put the chosen method into the arguments, and say which and why.

    Parameters
    ----------
    args : Namespace
        Of `isosample render`, with ``method`` "auto"; ``method`` and ``choice`` are replaced.
    settings : RenderSettings
    camera : Camera or None
        Of a file.

    Returns
    -------
    opened : Opened or None
        What was opened for it; None where the choice needs no volume.

    Raises
    ------
    InputError
        If no method has all the options that are given.
    """
    from isosample.cli.sources import is_cache_folder, quality_of

    left = methods_left(args)
    if DATA_CENTRIC in left:
        quality_of(args)  # its options may contradict each other
    if is_cache_folder(args.source) and DATA_CENTRIC in left:
        _tell(args, {"method": DATA_CENTRIC, "reason": "a cache folder has meshes and no volume"})
        return None
    if len(left) == 1:
        _tell(args, {"method": left[0], "reason": "the other methods lack an option that is given"})
        return None
    return _estimate(args, settings, camera, left)


def _estimate(
    args: argparse.Namespace, settings: RenderSettings, camera: Camera | None, left: list[str]
) -> Opened:
    """Choose by the estimated seconds."""
    from isosample.cli.methods import check_volume_is_named
    from isosample.cli.raycast import raycast_settings_of
    from isosample.cli.sources import quality_of
    from isosample.rendering.method_choice import choose_method

    check_volume_is_named(args)
    opened = _open(args)
    box = opened.box
    quality = quality_of(args)
    found = choose_method(
        opened.volume,
        opened.transfer_function,
        cameras=[camera or orbit(args, box)] if args.turntable is None else cameras_of(args, camera, box),
        size=args.size,
        settings=settings,
        quality=quality,
        raycast=raycast_settings_of(args, left[-1]),  # of the ray caster
        among=left,
        spent_seconds=time.process_time(),
    )
    _tell(args, found.to_dict())
    return replace(opened, macrocells=found.macrocells)


def note_if_slow(args: argparse.Namespace, settings: RenderSettings, camera: Camera | None) -> Opened | None:
    """Tell before the work where nobody asked for isosurfaces and the ray caster would be far quicker.

    Parameters
    ----------
    args : Namespace
        Of `isosample render` without a method.
    settings : RenderSettings
    camera : Camera or None
        Of a file.

    Returns
    -------
    opened : Opened or None
        What was opened for it. None where nothing can be told cheaply, or an option asks for isosurfaces: a cache
        folder, a film, a tolerance, a smooth reconstruction, or what the ray caster does not have.
    """
    from isosample.cli.sources import is_cache_folder, quality_of
    from isosample.rendering.method_choice import choose_method

    smooth = args.reconstruction not in (None, "trilinear")
    if args.turntable is not None or args.tolerance is not None or smooth or len(methods_left(args)) == 1:
        return None
    if is_cache_folder(args.source):
        return None
    quality = quality_of(args)
    opened = _open(args)
    volume = opened.volume
    if volume.stays_in_file or volume.array.size < FEWEST_SAMPLES:
        return opened
    found = choose_method(
        volume,
        opened.transfer_function,
        cameras=[camera or orbit(args, opened.box)],
        size=args.size,
        settings=settings,
        quality=quality,
    )
    quick, slow = found.estimates[0].total_seconds, found.estimates[-1].total_seconds
    if found.method != DATA_CENTRIC and slow > max(quick + WORTH_SECONDS, WORTH_FACTOR * quick):
        note(
            f"about {duration(slow)} are estimated, most of them for isosurfaces, and {duration(quick)} for the ray "
            "caster, which --method auto would choose"
        )
    return opened


def _open(args: argparse.Namespace) -> Opened:
    """Open the volume and its transfer function; a missing driver is told before the long work."""
    from isosample.cli.sources import load_transfer_function, open_source_volume, transfer_function_of

    given = load_transfer_function(args.tf)
    volume = open_source_volume(args, args.source)
    check_driver(args.size)
    tf, origin = transfer_function_of(volume, given, args.tf, nan_masked=args.nan == "masked")
    if args.fit != VISIBLE:
        return Opened(volume, tf, origin, volume.box)
    visible = search_visible(args, volume, tf)
    return Opened(volume, tf, origin, box_of(volume, visible), visible)


def _tell(args: argparse.Namespace, choice: dict[str, object]) -> None:
    args.method, args.choice = choice["method"], choice
    say_fields({"method": f"{choice['method']}, chosen: {choice['reason']}"})

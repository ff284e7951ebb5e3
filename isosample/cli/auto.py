"""`isosample render --method auto`: the method that is expected to take the least time."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import TYPE_CHECKING

from isosample.cli.cameras import orbit
from isosample.cli.console import say_fields
from isosample.cli.methods import methods_left
from isosample.cli.outputs import check_driver
from isosample.cli.turntable import cameras_of
from isosample.defaults import DATA_CENTRIC

if TYPE_CHECKING:
    import argparse

    from isosample.rendering.camera import Camera
    from isosample.rendering.settings import RenderSettings
    from isosample.transfer.transfer_function import TransferFunction
    from isosample.volume.grid import Volume
    from isosample.volume.macrocells import MacrocellGrid


@dataclass(frozen=True, slots=True)
class Opened:
    """A volume that was opened to choose a method for it, its transfer function and where that is from, and bounds."""

    volume: Volume
    transfer_function: TransferFunction
    tf_origin: str
    macrocells: MacrocellGrid


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
    from isosample.cli.sources import (
        load_transfer_function,
        open_source_volume,
        quality_of,
        transfer_function_of,
    )
    from isosample.rendering.method_choice import choose_method

    check_volume_is_named(args)
    given = load_transfer_function(args.tf)
    volume = open_source_volume(args, args.source)
    check_driver(args.size)
    tf, origin = transfer_function_of(volume, given, args.tf, nan_masked=args.nan == "masked")
    one = camera or orbit(args, volume.box)
    quality = quality_of(args)
    found = choose_method(
        volume,
        tf,
        cameras=[one] if args.turntable is None else cameras_of(args, camera, volume.box),
        size=args.size,
        settings=settings,
        quality=quality,
        raycast=raycast_settings_of(args, left[-1]),  # of the ray caster
        among=left,
        spent_seconds=time.process_time(),
    )
    _tell(args, found.to_dict())
    return Opened(volume, tf, origin, found.macrocells)


def _tell(args: argparse.Namespace, choice: dict[str, object]) -> None:
    args.method, args.choice = choice["method"], choice
    say_fields({"method": f"{choice['method']}, chosen: {choice['reason']}"})

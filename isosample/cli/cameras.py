"""The camera that the arguments describe."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any

from isosample.cli.console import progress_bars
from isosample.errors import InputError

if TYPE_CHECKING:
    import argparse

    from isosample.cli.scenes import PreparedScene
    from isosample.rendering.camera import Camera
    from isosample.transfer.transfer_function import TransferFunction
    from isosample.volume.geometry import Box
    from isosample.volume.grid import Volume
    from isosample.volume.scan import BrickScan
    from isosample.volume.shown_cells import Shown

ORBIT_OPTIONS = ("azimuth", "elevation", "up", "zoom", "projection")
VISIBLE = "visible"
FRAMING = "frame"  # what the search for that is called in the progress
PLACING_OPTIONS = (*ORBIT_OPTIONS, "fit")  # none of them goes with a camera file


def camera_of(args: argparse.Namespace) -> Camera | None:
    """Return the camera of the file that the arguments name; None where the camera orbits the box."""
    from isosample.rendering.camera import Camera

    if args.camera is None:
        return None
    given = [name for name in PLACING_OPTIONS if getattr(args, name) is not None]
    if given:
        raise InputError(
            f"--{given[0]} and --camera {args.camera} both place the camera; leave out one of them."
        )
    return Camera.load(args.camera)


def azimuths(args: argparse.Namespace) -> list[float]:
    """Return the angles of ``--cameras`` views, evenly around the volume from ``--azimuth`` on [degree]."""
    count, first = args.cameras or 1, args.azimuth or 0.0
    return [first + 360.0 * number / count for number in range(count)]


def search_visible(
    args: argparse.Namespace,
    volume: Volume,
    transfer_function: TransferFunction,
    scan: BrickScan | None = None,
) -> Shown:
    """Look where a transfer function shows something of a volume; `scan` as for `visible_span`.

    Raises
    ------
    InputError
        If ``--fit`` asks for the box of what is visible, and nothing is.
    """
    from isosample.rendering.framing import nothing_to_fit, visible_span
    from isosample.volume.reconstruction import Reconstruction
    from isosample.volume.shown_cells import Shown

    reconstruction = Reconstruction(args.reconstruction or "trilinear")
    with progress_bars() as progress:
        span = visible_span(
            volume,
            transfer_function,
            reconstruction=reconstruction,
            scan=scan,
            progress=partial(progress, FRAMING),
        )
    if span is None and args.fit == VISIBLE:
        raise nothing_to_fit(volume.name, volume.value_range)
    return Shown(span)


def framed_box(args: argparse.Namespace, volume: Volume, transfer_function: TransferFunction) -> Box:
    """Return the box that ``--fit`` asks for.

    Raises
    ------
    InputError
        If it is that of what is visible, and nothing is.
    """
    if args.fit != VISIBLE:
        return volume.box
    return box_of(volume, search_visible(args, volume, transfer_function))


def box_of(volume: Volume, shown: Shown) -> Box:
    """Return the box of what is shown, which is not nothing."""
    assert shown.span is not None
    return volume.geometry.box_of(*shown.span)


def framed_scene_box(args: argparse.Namespace, scene: PreparedScene) -> Box:
    """Return the box that ``--fit`` asks for, of meshes.

    Raises
    ------
    InputError
        If it is that of what is visible, and nothing is, or the scene does not tell.
    """
    from isosample.rendering.framing import nothing_to_fit

    geometry = scene.surfaces.geometry
    if args.fit != VISIBLE:
        return geometry.box
    if scene.visible is None:
        raise InputError(
            f"--fit visible: {args.source} does not tell where this transfer function shows something; `isosample "
            "precompute` with the same volume, options and --cache, and with this transfer function, adds that. Or "
            "name the volume in place of the folder, or leave out --fit."
        )
    if scene.visible.span is None:
        raise nothing_to_fit(scene.name, scene.surfaces.value_range)
    return geometry.box_of(*scene.visible.span)


def orbit(
    args: argparse.Namespace, box: Box, *, size: tuple[int, int] | None = None, **instead: float
) -> Camera:
    """Return a camera about a box, from those of the options that are given, or what stands `instead` of them.

    Parameters
    ----------
    args : Namespace
    box : Box
    size : (width, height), optional
        Of the picture [pixel]; that of the options by default.
    **instead : float
        In place of options.
    """
    from isosample.rendering.camera import Camera, Projection, UpAxis

    width, height = size or args.size
    given: dict[str, Any] = {
        name: getattr(args, name) for name in ORBIT_OPTIONS if getattr(args, name) is not None
    }
    given |= instead
    if "projection" in given:
        given["projection"] = Projection(given["projection"])
    if "up" in given:
        given["up_axis"] = UpAxis(given.pop("up"))
    return Camera.orbit(box, aspect=width / height, **given)

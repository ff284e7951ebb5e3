"""Which three axes of an array with more are the volume's, and which channel and time step of the others."""

from __future__ import annotations

from typing import TYPE_CHECKING

from isosample.errors import InputError
from isosample.volume.readers.samples import choose

if TYPE_CHECKING:
    from collections.abc import Sequence

    from isosample.volume.readers.samples import ReadOptions

SPACE = ("z", "y", "x")
AXES_BY_COUNT = {3: SPACE, 4: ("c", *SPACE), 5: ("t", "c", *SPACE)}  # the order of OME-Zarr


def choose_axes(
    name: str, shape: Sequence[int], axes: Sequence[str] | None, options: ReadOptions
) -> tuple[tuple[int, ...], tuple[int, ...]]:
    """Return the indices before and behind the axes z, y, x of an array.

    Parameters
    ----------
    name : str
        The file, for messages.
    shape : sequence of int
    axes : sequence of str, optional
        Names of the axes: t, c, z, y, x. None: those of OME-Zarr, by their number; of four, the first is the
        channel, or the time where one is chosen and no channel is.
    options : ReadOptions

    Raises
    ------
    InputError
        If the array has no three neighbouring axes z, y, x, or a choice is missing or out of range.
    """
    if axes is None:
        axes = AXES_BY_COUNT.get(len(shape), ())
        if len(shape) == 4 and options.time is not None and options.channel is None:
            axes = ("t", *SPACE)
    names = tuple(axes)
    at = next((place for place in range(len(names)) if names[place : place + 3] == SPACE), None)
    if at is None or len(names) != len(shape):
        raise InputError(
            f"{name} has shape {tuple(shape)} with the axes {names or 'unnamed'}; a volume has the axes z, y, x in "
            "this order, and may have t and c besides. Choose another array with --dataset NAME."
        )
    chosen: list[int] = []
    seen = {"time": False, "channel": False}
    for axis, count in zip(names, shape, strict=True):
        if axis in SPACE:
            continue
        option = "time" if axis in ("t", "time") else "channel"
        seen[option] = True
        chosen.append(choose(name, option, count, options.time if option == "time" else options.channel))
    if not seen["time"]:
        choose(name, "time", 1, options.time)
    if not seen["channel"]:
        choose(name, "channel", 1, options.channel)
    return tuple(chosen[:at]), tuple(chosen[at:])

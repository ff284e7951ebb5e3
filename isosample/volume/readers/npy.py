"""NumPy .npy files, mapped into memory."""

from __future__ import annotations

import tokenize
from typing import TYPE_CHECKING

import numpy as np

from isosample.errors import InputError
from isosample.volume.grid import Volume
from isosample.volume.readers.samples import ReadOptions, choose, native

if TYPE_CHECKING:
    from pathlib import Path

    from isosample.volume.grid import SampleArray


def read_npy(path: Path, options: ReadOptions) -> Volume:
    """Read an array of shape (Z, Y, X), or choose from (T, Z, Y, X) or (Z, Y, X, C).

    Parameters
    ----------
    path : Path
    options : ReadOptions
        With four axes, `time` chooses along the first or `channel` along the last; with five,
        (T, Z, Y, X, C), both are needed.

    Raises
    ------
    InputError
        If the file is damaged or incomplete, holds objects, or has more axes than are chosen from.
    """
    try:
        array: SampleArray = np.load(path, mmap_mode="r", allow_pickle=False)
    except (ValueError, EOFError, SyntaxError, tokenize.TokenError) as error:
        reason = " ".join(str(error).split())
        raise InputError(f"{path.name} is no readable .npy file ({reason}). It may be incomplete.") from error
    return Volume(native(_chosen(path.name, array, options)), name=path.name)


def _chosen(name: str, array: SampleArray, options: ReadOptions) -> SampleArray:
    """Return the one time step and channel asked for."""
    if array.ndim == 4 and options.time is None and options.channel is None:
        raise InputError(
            f"{name} has shape {array.shape}; a volume has three axes [z, y, x]. Choose along the first axis "
            f"with --time N (0 to {array.shape[0] - 1}), or along the last with --channel N "
            f"(0 to {array.shape[3] - 1})."
        )
    has_time = array.ndim == 5 or (array.ndim == 4 and options.time is not None)
    has_channel = array.ndim == 5 or (array.ndim == 4 and not has_time)
    time = choose(name, "time", array.shape[0] if has_time else 1, options.time)
    channel = choose(name, "channel", array.shape[-1] if has_channel else 1, options.channel)
    if has_time:
        array = array[time]
    return array[..., channel] if has_channel else array

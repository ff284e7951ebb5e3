"""TIFF stacks: pages or z slices in one file, with the spacing that ImageJ or OME wrote."""

from __future__ import annotations

import contextlib
import logging
import math
import struct
import zlib
from typing import TYPE_CHECKING, Any
from xml.etree import ElementTree

import numpy as np

from isosample.errors import InputError, MissingDependencyError
from isosample.volume.grid import Volume
from isosample.volume.readers.samples import ReadOptions, choose, native, positive_steps

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from isosample.volume.grid import F64, SampleArray

MICROMETRES = {"nm": 1e-3, "µm": 1.0, "um": 1.0, "mm": 1e3, "cm": 1e4, "m": 1e6}
TIFF_FAILURES = (  # what tifffile lets through on damaged files, found by damaging some
    ArithmeticError,
    AssertionError,
    IndexError,
    KeyError,
    RuntimeError,
    TypeError,
    ValueError,
    struct.error,
    zlib.error,
)
PAGE_AXES = "ZIQ"  # z, image sequence, other: each page is a slice


def read_tiff(path: Path, options: ReadOptions) -> Volume:
    """Read the one image stack in a TIFF file.

    Parameters
    ----------
    path : Path
        Uncompressed stacks are mapped into memory.
    options : ReadOptions
        `channel` and `time` choose from stacks with several.

    Returns
    -------
    volume : Volume
        Spacing from ImageJ's or OME's entries (in their unit; OME in micrometres where the units differ);
        plain resolution tags say nothing about z: only their ratio of y to x is used; 1 where none is given.

    Raises
    ------
    MissingDependencyError
        If the compression needs the package imagecodecs.
    InputError
        If the file is damaged or incomplete, or has no z axis, or several image series.
    """
    import tifffile

    with _tiff_failures(path.name) as complaints, tifffile.TiffFile(path) as tiff:
        if len(tiff.series) != 1:
            shapes = ", ".join(str(series.shape) for series in tiff.series)
            raise InputError(
                f"{path.name} has {len(tiff.series)} image series of shapes {shapes}; a volume has one. "
                "Save the wanted series in a file of its own."
            )
        series = tiff.series[0]
        complaints.refuse_damage()
        array = _mapped(path, tiff, series) if series.dataoffset is not None else series.asarray()
        samples = _slices_of_one_channel(path.name, series.axes, array, options)
        stated = np.ones(3) if options.spacing is not None else _spacing(path.name, tiff)
        spacing, direction = positive_steps(stated, np.eye(3))
    return Volume(native(samples), spacing=spacing, direction=direction, name=path.name)


@contextlib.contextmanager
def _tiff_failures(name: str) -> Iterator[_Complaints]:
    """Turn tifffile's many errors, and the damage that it only logs, into one clear line."""
    import tifffile

    complaints = _Complaints()
    logger = logging.getLogger("tifffile")
    propagated, logger.propagate = logger.propagate, False
    logger.addHandler(complaints)
    try:
        yield complaints
    except InputError:
        raise
    except (tifffile.TiffFileError, *TIFF_FAILURES) as error:
        reason = " ".join(str(error).split())
        if "imagecodecs" in reason:
            raise MissingDependencyError(
                f"{name} is compressed in a way that needs imagecodecs: pip install imagecodecs ({reason})."
            ) from error
        raise InputError(
            f"{name} could not be read as TIFF ({reason}). It may be damaged or incomplete."
        ) from error
    finally:
        logger.removeHandler(complaints)
        logger.propagate = propagated


class _Complaints(logging.Handler):
    """Collects what tifffile logs; a page whose offset is invalid is dropped by it without an error."""

    def __init__(self) -> None:
        super().__init__(logging.WARNING)
        self.lines: list[str] = []

    def emit(self, record: logging.LogRecord) -> None:
        self.lines.append(" ".join(record.getMessage().split()))

    def refuse_damage(self) -> None:
        """Raise where a page or its entries lie outside the file."""
        for line in self.lines:
            if "offset" in line:
                raise ValueError(line)


def _mapped(path: Path, tiff: Any, series: Any) -> SampleArray:
    """Map an uncompressed, contiguous stack."""
    dtype = np.dtype(series.dtype).newbyteorder(tiff.byteorder)
    return np.memmap(path, dtype=dtype, mode="r", offset=series.dataoffset, shape=series.shape)


def _slices_of_one_channel(name: str, axes: str, array: SampleArray, options: ReadOptions) -> SampleArray:
    """Return the (Z, Y, X) samples of the chosen channel and time step."""
    slices = [axis for axis in PAGE_AXES if axis in axes]
    counts = dict(zip(axes, array.shape, strict=True))
    if len(slices) > 1:
        slices = [axis for axis in slices if counts[axis] > 1]
    unknown = [axis for axis in axes if axis not in "TCSYX" and axis not in slices and counts[axis] > 1]
    if len(slices) != 1 or unknown:
        raise InputError(
            f"{name} has the axes {axes} of lengths {array.shape}; a volume needs one z axis "
            "(Z, or plain pages). Save it again with its slices as Z."
        )
    channel_axes = [axis for axis in "CS" if counts.get(axis, 1) > 1]
    lengths = [counts[axis] for axis in channel_axes]
    channel = choose(name, "channel", math.prod(lengths), options.channel)
    places = dict.fromkeys(axes, 0) | dict(
        zip(channel_axes, np.unravel_index(channel, lengths) if lengths else (), strict=True)
    )
    places["T"] = choose(name, "time", counts.get("T", 1), options.time)
    kept = (slices[0], "Y", "X")
    selected = array[tuple(slice(None) if axis in kept else int(places[axis]) for axis in axes)]
    left = [axis for axis in axes if axis in kept]
    return selected.transpose([left.index(axis) for axis in kept])


def _spacing(name: str, tiff: Any) -> F64:
    """Spacing (x, y, z) from OME, ImageJ or resolution tags; 1 where they say nothing."""
    if tiff.is_ome:
        return _ome_spacing(name, tiff.ome_metadata)
    across = np.array([_pixel_size(tiff.pages[0], key) for key in ("XResolution", "YResolution")])
    if tiff.is_imagej:
        return np.array([*across, float(tiff.imagej_metadata.get("spacing", 1.0))])
    return np.array([1.0, across[1] / across[0], 1.0])


def _pixel_size(page: Any, key: str) -> float:
    """Size of a pixel in the file's own unit: one over the resolution tag; 1 where it is absent or zero."""
    tag = page.tags.get(key)
    if tag is None:
        return 1.0
    pixels, units = tag.value
    return float(units / pixels) if pixels > 0 and units > 0 else 1.0


def _ome_spacing(name: str, xml: str) -> F64:
    """Spacing from OME's PhysicalSize entries, in their common unit, else in micrometres."""
    pixels = ElementTree.fromstring(xml).find(".//{*}Pixels")
    entries = {} if pixels is None else pixels.attrib
    keys = [f"PhysicalSize{axis}" for axis in "XYZ"]
    sizes = np.array([float(entries.get(key, 1.0)) for key in keys])
    units = [entries.get(key + "Unit", "µm") for key in keys]
    if len(set(units)) == 1:
        return sizes
    unknown = [unit for unit in units if unit not in MICROMETRES]
    if unknown:
        raise InputError(f"{name} gives sizes in {units}; {unknown[0]!r} is unknown. Give --spacing X,Y,Z.")
    scaled: F64 = sizes * np.array([MICROMETRES[unit] for unit in units])
    return scaled

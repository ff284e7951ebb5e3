"""Headerless samples (.raw, gzipped or not), and the .dat headers of Inviwo and Voreen beside them."""

from __future__ import annotations

from typing import TYPE_CHECKING, TypeVar

import numpy as np

from isosample.errors import InputError
from isosample.volume.grid import Volume
from isosample.volume.readers.layouts import is_gzip
from isosample.volume.readers.samples import (
    ReadOptions,
    Triple,
    choose,
    inflate_samples,
    map_samples,
    parse_shape,
)

if TYPE_CHECKING:
    from pathlib import Path

    from isosample.volume.grid import SampleArray

Number = TypeVar("Number", int, float)

DAT_CODES = {
    "UCHAR": "u1",
    "BYTE": "u1",
    "UINT8": "u1",
    "CHAR": "i1",
    "INT8": "i1",
    "USHORT": "u2",
    "USHORT_12": "u2",
    "UINT16": "u2",
    "SHORT": "i2",
    "INT16": "i2",
    "UINT": "u4",
    "UINT32": "u4",
    "INT": "i4",
    "INT32": "i4",
    "FLOAT": "f4",
    "FLOAT32": "f4",
    "DOUBLE": "f8",
    "FLOAT64": "f8",
}
DAT_PLACEMENT = (
    "basisvector",
    "worldvector",
    "offset",
    "basis",
    "wtm",
)  # keys that would move or turn the grid


def read_raw(path: Path, options: ReadOptions) -> Volume:
    """Read a headerless file of known shape and type.

    Parameters
    ----------
    path : Path
        Mapped into memory, or inflated where it is gzipped.
    options : ReadOptions
        `shape` and `dtype` are required.

    Raises
    ------
    InputError
        If shape or type is missing, or the length of the file does not fit them.
    """
    if options.shape is None or options.dtype is None:
        raise InputError(
            f"{path.name} has no header; give its size and type, such as --shape 256,256,128 --dtype uint8."
        )
    choose(path.name, "channel", 1, options.channel)
    choose(path.name, "time", 1, options.time)
    samples = _bare_samples(path, options.dtype, options.shape, "Check --shape and --dtype.")
    return Volume(samples, name=path.name)


def _bare_samples(path: Path, dtype: np.dtype[np.generic], shape: Triple, cure: str) -> SampleArray:
    """Samples of a headerless file, inflated where it is gzipped."""
    load = inflate_samples if is_gzip(path) else map_samples
    return load(path, dtype, shape, cure=cure)


def read_dat(path: Path, options: ReadOptions) -> Volume:
    """Read a .dat header (`ObjectFileName`, `Resolution`, `SliceThickness`, `Format`, …) and its data.

    Raises
    ------
    InputError
        If an entry is missing or not understood, the data file is absent, or its length does not fit.
    """
    entries = _dat_entries(path)
    placed = [key for key in entries if key.startswith(DAT_PLACEMENT)]
    if placed:
        raise InputError(f"{path.name}: the entry {placed[0]!r} is not supported. Use SliceThickness alone.")
    named = _required(path, entries, ("objectfilename", "rawfile"))
    data = path.parent / named.replace("\\", "/")
    if not data.is_file():
        raise InputError(f"{path.name} names the data file {named!r}, which is not there. Put it in place.")
    shape = parse_shape(_numbers(path, "Resolution", _required(path, entries, ("resolution",)), int))
    stated = entries.get("slicethickness", entries.get("spacing", "1 1 1"))
    x, y, z = _numbers(path, "SliceThickness", stated, float)
    choose(path.name, "channel", 1, options.channel)
    choose(path.name, "time", 1, options.time)
    cure = f"Check Resolution and Format in {path.name}."
    samples = _bare_samples(data, _dat_dtype(path, entries), shape, cure)
    return Volume(samples, spacing=(x, y, z), name=path.name)


def _dat_entries(path: Path) -> dict[str, str]:
    """Lines `Key: value`; keys in lower case."""
    try:
        text = path.read_text(encoding="utf-8")
    except UnicodeDecodeError as error:
        raise InputError(
            f"{path.name} is no .dat header but binary. If it holds bare samples, give --shape and --dtype."
        ) from error
    entries = {}
    for line in text.splitlines():
        key, found, value = line.partition(":")
        if found and not line.lstrip().startswith("#"):
            entries[key.strip().lower()] = value.strip()
    return entries


def _required(path: Path, entries: dict[str, str], keys: tuple[str, ...]) -> str:
    for key in keys:
        if key in entries:
            return entries[key]
    raise InputError(f"{path.name} lacks the entry {' or '.join(keys)}; a .dat header needs it.")


def _dat_dtype(path: Path, entries: dict[str, str]) -> np.dtype[np.generic]:
    """Sample type of a .dat header, with its byte order."""
    named = _required(path, entries, ("format",))
    if named.upper() not in DAT_CODES:
        raise InputError(f"{path.name}: Format {named!r} is not supported; known are {', '.join(DAT_CODES)}.")
    order = entries.get("byteorder", "LittleEndian").lower()
    if order not in ("littleendian", "bigendian"):
        raise InputError(f"{path.name}: ByteOrder {order!r} must be LittleEndian or BigEndian.")
    return np.dtype((">" if order == "bigendian" else "<") + DAT_CODES[named.upper()])


def _numbers(path: Path, key: str, text: str, kind: type[Number]) -> tuple[Number, Number, Number]:
    """Return three numbers separated by blanks, or raise."""
    try:
        x, y, z = (kind(word) for word in text.split())
    except ValueError as error:
        raise InputError(f"{path.name}: {key} {text!r} must be three numbers (x y z).") from error
    return x, y, z

"""Where the samples lie in NRRD, MetaImage and NIfTI files, so that plain ones are mapped, not read."""

from __future__ import annotations

import gzip
import math
import re
import struct
import zlib
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from isosample.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

HEADER_BYTES = 1 << 20  # a text header longer than this is no header

NRRD_TYPES = {
    "i1": ("signed char", "int8", "int8_t"),
    "u1": ("uchar", "unsigned char", "uint8", "uint8_t"),
    "i2": ("short", "short int", "signed short", "signed short int", "int16", "int16_t"),
    "u2": ("ushort", "unsigned short", "unsigned short int", "uint16", "uint16_t"),
    "i4": ("int", "signed int", "int32", "int32_t"),
    "u4": ("uint", "unsigned int", "uint32", "uint32_t"),
    "i8": ("longlong", "long long", "long long int", "signed long long", "int64", "int64_t"),
    "u8": ("ulonglong", "unsigned long long", "unsigned long long int", "uint64", "uint64_t"),
    "f4": ("float",),
    "f8": ("double",),
}
NRRD_CODES = {name: code for code, names in NRRD_TYPES.items() for name in names}
META_CODES = {
    "MET_CHAR": "i1",
    "MET_UCHAR": "u1",
    "MET_SHORT": "i2",
    "MET_USHORT": "u2",
    "MET_INT": "i4",
    "MET_UINT": "u4",
    "MET_FLOAT": "f4",
    "MET_DOUBLE": "f8",
}
NIFTI_CODES = {
    2: "u1",
    4: "i2",
    8: "i4",
    16: "f4",
    64: "f8",
    256: "i1",
    512: "u2",
    768: "u4",
    1024: "i8",
    1280: "u8",
}


@dataclass(frozen=True, slots=True)
class Layout:
    """Samples that lie one after another, x fastest, as they are.

    Attributes
    ----------
    path : Path
        The file that holds them.
    offset : int
        Bytes before the first sample (of the inflated stream where `is_deflated`).
    dtype : numpy dtype
        With its byte order.
    is_deflated : bool
        Whether they are in a gzip or zlib stream.
    start : int
        Byte of the file at which that stream begins.
    """

    path: Path
    offset: int
    dtype: np.dtype[np.generic]
    is_deflated: bool = False
    start: int = 0


@dataclass(frozen=True, slots=True)
class NiftiHeader:
    """The part of a NIfTI-1 or NIfTI-2 header that says where the samples lie and how they are scaled."""

    sizes: tuple[int, ...]
    code: int
    bits: int
    offset: int
    slope: float
    intercept: float
    order: str
    single_file: bool

    @property
    def is_scaled(self) -> bool:
        """Whether values differ from stored samples (a slope of 0 means none, as the standard says)."""
        return self.slope not in (0.0, 1.0) or (self.slope != 0.0 and self.intercept != 0.0)

    @property
    def end(self) -> int:
        """Bytes up to the last sample of the last time step and channel."""
        count = int(np.prod(self.sizes, dtype=object))
        return self.offset + count * self.bits // 8


def nrrd_layout(path: Path) -> Layout | None:
    """Return the layout of a raw or gzipped NRRD file, or None where only the library can read it.

    Raises
    ------
    InputError
        If the header has no end or names an absent data file.
    """
    text, length = _text_header(path, rb"\r?\n\r?\n")
    fields = _fields(text, ":")
    named = fields.get("datafile")
    if named is not None and ("%" in named or named.upper().startswith("LIST")):
        return None
    data = path if named is None else _data_file(path, named)
    code = NRRD_CODES.get(fields.get("type", "").lower())
    skips = {fields.get("lineskip", "0"), fields.get("byteskip", "0")}
    encoding = fields.get("encoding", "").lower()
    if code is None or encoding not in ("raw", "gzip", "gz") or skips != {"0"}:
        return None
    order = ">" if fields.get("endian", "little").lower() == "big" else "<"
    begin = length if named is None else 0
    if encoding == "raw":
        return Layout(data, begin, np.dtype(order + code))
    return Layout(data, 0, np.dtype(order + code), is_deflated=True, start=begin)


def meta_layout(path: Path) -> Layout | None:
    """Return the layout of a binary MetaImage file, or None where only the library can read it.

    Raises
    ------
    InputError
        If the header does not name its data, or names an absent file.
    """
    text, length = _text_header(path, rb"ElementDataFile\s*=[^\n]*\n?")
    fields = _fields(text, "=")
    named = fields.get("elementdatafile", "")
    if not named:
        raise InputError(f"{path.name} names no ElementDataFile. It may be damaged or incomplete.")
    if "%" in named or named.upper().startswith("LIST"):
        return None
    is_local = named.upper() == "LOCAL"
    data = path if is_local else _data_file(path, named)
    code = META_CODES.get(fields.get("elementtype", "").upper())
    is_plain = (
        code is not None
        and fields.get("binarydata", "true").lower() == "true"
        and fields.get("headersize", "0") == "0"
        and "elementtointensityfunctionslope" not in fields
    )
    if not is_plain:
        return None
    big = fields.get("elementbyteordermsb", fields.get("binarydatabyteordermsb", "false")).lower() == "true"
    begin, dtype = length if is_local else 0, np.dtype((">" if big else "<") + str(code))
    if fields.get("compresseddata", "false").lower() == "true":  # the library ignores the checksum
        return Layout(data, 0, dtype, is_deflated=True, start=begin)
    return Layout(data, begin, dtype)


def nifti_layout(path: Path, header: NiftiHeader) -> Layout | None:
    """Return the layout of an unscaled one-file NIfTI, or None where only the library can read it."""
    code = NIFTI_CODES.get(header.code)
    if code is None or header.is_scaled or not header.single_file:
        return None
    return Layout(path, header.offset, np.dtype(header.order + code), is_deflated=is_gzip(path))


def nifti_header(path: Path) -> NiftiHeader:
    """Return the header of a NIfTI file, gzipped or not.

    Raises
    ------
    InputError
        If the file is no NIfTI-1 or NIfTI-2.
    """
    start = first_bytes(path, 540)
    for order in "<>":
        if len(start) >= 348 and struct.unpack_from(order + "i", start)[0] == 348:
            dim = struct.unpack_from(order + "8h", start, 40)
            code, bits = struct.unpack_from(order + "2h", start, 70)
            offset, slope, intercept = struct.unpack_from(order + "3f", start, 108)
            single = start[344:347] == b"n+1"
            break
        if len(start) == 540 and struct.unpack_from(order + "i", start)[0] == 540:
            dim = struct.unpack_from(order + "8q", start, 16)
            code, bits = struct.unpack_from(order + "2h", start, 12)
            (offset,) = struct.unpack_from(order + "q", start, 168)
            slope, intercept = struct.unpack_from(order + "2d", start, 176)
            single = start[4:7] == b"n+2"
            break
    else:
        raise InputError(f"{path.name} is no NIfTI file: its header is damaged. Fetch it again.")
    if not 1 <= dim[0] <= 7 or min(dim[1 : dim[0] + 1]) < 1:
        raise InputError(f"{path.name} has a damaged NIfTI header (dim {list(dim)}). Fetch it again.")
    if not math.isfinite(offset) or offset < 0:
        raise InputError(f"{path.name} has a damaged NIfTI header (vox_offset {offset:g}). Fetch it again.")
    if not np.isfinite([slope, intercept]).all():
        slope, intercept = 0.0, 0.0  # the reference library, too, takes a slope that is no number as none
    sizes = tuple(int(n) for n in dim[1 : dim[0] + 1])
    return NiftiHeader(sizes, code, bits, int(offset), slope, intercept, order, single)


def is_gzip(path: Path) -> bool:
    """Whether the file starts with gzip's magic number."""
    with path.open("rb") as stream:
        return stream.read(2) == b"\x1f\x8b"


def first_bytes(path: Path, count: int) -> bytes:
    """First bytes of a file, inflated where it is gzipped; fewer where the file ends or is damaged."""
    if not is_gzip(path):
        with path.open("rb") as stream:
            return stream.read(count)
    try:
        with gzip.open(path, "rb") as stream:
            return stream.read(count)
    except (EOFError, gzip.BadGzipFile, zlib.error):
        return b""


def _text_header(path: Path, end: bytes) -> tuple[str, int]:
    """Text of a header up to and with the match of `end` (or all of a detached one), and its length."""
    with path.open("rb") as stream:
        start = stream.read(HEADER_BYTES)
    match = re.search(end, start)
    if match is None and path.suffix.lower() != ".nhdr":
        raise InputError(f"{path.name} has a header without an end. The file is incomplete; fetch it again.")
    length = len(start) if match is None else match.end()
    return start[:length].decode("latin-1"), length


def _fields(text: str, separator: str) -> Mapping[str, str]:
    """Header lines `key <separator> value`; keys in lower case without blanks."""
    fields = {}
    for line in text.splitlines():
        key, found, value = line.partition(separator)
        if found and not line.startswith("#") and not value.startswith("="):  # NRRD: key:=value is a comment
            fields[key.replace(" ", "").lower()] = value.strip()
    return fields


def _data_file(header: Path, named: str) -> Path:
    """Path of the data file that a header names, relative to the header's folder."""
    data = header.parent / named.replace("\\", "/")
    if not data.is_file():
        raise InputError(f"{header.name} names the data file {named!r}, which is not there. Put it in place.")
    return data

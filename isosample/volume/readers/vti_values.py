"""The numbers of a VTK XML file: ascii, base64 and raw blocks, plain or zlib-compressed, of either byte order."""

from __future__ import annotations

import base64
import binascii
import re
import zlib
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from isosample.errors import InputError

if TYPE_CHECKING:
    from xml.etree.ElementTree import Element

    from isosample.volume.grid import SampleArray

ZLIB = "vtkZLibDataCompressor"


@dataclass(frozen=True, slots=True)
class VtiFile:
    """A VTK XML file: its elements, and the bytes of its appended section.

    Attributes
    ----------
    name : str
        For messages.
    root : Element
    appended : memoryview
        What follows the underscore of the AppendedData element; empty without one.
    is_base64 : bool
        Whether the appended section is base64 text.
    """

    name: str
    root: Element
    appended: memoryview
    is_base64: bool

    @property
    def order(self) -> str:
        """Byte order of samples and block headers, for numpy."""
        return ">" if self.root.get("byte_order", "LittleEndian") == "BigEndian" else "<"

    @property
    def header_dtype(self) -> np.dtype[np.generic]:
        """Type of the numbers in block headers."""
        return np.dtype(self.order + ("u8" if self.root.get("header_type", "UInt32") == "UInt64" else "u4"))


def values_of(file: VtiFile, array: Element, dtype: np.dtype[np.generic]) -> SampleArray:
    """Return all values of a DataArray, flat; appended raw ones without compression are not copied.

    Raises
    ------
    InputError
        If they are damaged, incomplete, or compressed by something other than zlib.
    """
    layout = array.get("format", "ascii")
    try:
        if layout == "ascii":
            return np.array((array.text or "").split(), dtype=dtype.newbyteorder("="))
        if layout == "binary":
            return _blocks(file, _Base64(b"".join((array.text or "").encode().split())), dtype)
        offset = int(array.get("offset", "0"))
        section = file.appended[offset:]
        if file.is_base64:
            text = re.match(rb"[A-Za-z0-9+/=]*", section)
            return _blocks(file, _Base64(text.group() if text else b""), dtype)
        return _blocks(file, _Raw(section), dtype)
    except (ValueError, OverflowError, zlib.error, binascii.Error) as error:
        reason = " ".join(str(error).split())
        raise InputError(
            f"{file.name}: its {layout} samples are damaged or incomplete ({reason})."
        ) from error


class _Raw:
    """Bytes taken one after another from an appended raw section."""

    def __init__(self, section: memoryview) -> None:
        self._section = section

    def take(self, count: int, *, ends_group: bool) -> memoryview:  # noqa: ARG002  (raw bytes have no groups)
        """Return the next `count` bytes."""
        if count > len(self._section):
            raise ValueError(f"{count} bytes wanted, {len(self._section)} there")
        taken, self._section = self._section[:count], self._section[count:]
        return taken


class _Base64:
    """Bytes taken one after another from base64 text, whose groups may be padded separately."""

    def __init__(self, text: bytes) -> None:
        self._text = text
        self._left = b""

    def take(self, count: int, *, ends_group: bool) -> memoryview:
        """Return the next `count` bytes; drop what is left of the last 4 characters where a group ends."""
        letters = 4 * -(-max(0, count - len(self._left)) // 3)
        chunk, self._text = self._text[:letters], self._text[letters:]
        decoded = self._left + base64.b64decode(chunk, validate=True)
        if len(decoded) < count:
            raise ValueError(f"{count} bytes wanted, {len(decoded)} there")
        self._left = b"" if ends_group else decoded[count:]
        return memoryview(decoded)[:count]


def _blocks(file: VtiFile, source: _Raw | _Base64, dtype: np.dtype[np.generic]) -> SampleArray:
    """Values behind a block header: [bytes] when plain; [blocks, size, last size, sizes…] when compressed."""
    compressor = file.root.get("compressor", "")
    word = file.header_dtype.itemsize
    if not compressor:
        (length,) = np.frombuffer(source.take(word, ends_group=False), file.header_dtype).tolist()
        return np.frombuffer(source.take(length, ends_group=True), dtype)
    if compressor != ZLIB:
        raise InputError(
            f"{file.name} is compressed by {compressor}, not by zlib. Save it with zlib compression."
        )
    count, _, _ = np.frombuffer(source.take(3 * word, ends_group=False), file.header_dtype).tolist()
    sizes = np.frombuffer(source.take(count * word, ends_group=True), file.header_dtype).tolist()
    return np.frombuffer(
        b"".join(zlib.decompress(source.take(size, ends_group=False)) for size in sizes), dtype
    )

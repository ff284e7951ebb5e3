"""VTK image files (.vti), whose pieces are put together."""

from __future__ import annotations

import math
import mmap
from typing import TYPE_CHECKING, NamedTuple
from xml.etree import ElementTree

import numpy as np

from isosample.errors import InputError
from isosample.volume.grid import Volume
from isosample.volume.readers.samples import ReadOptions, Triple, choose, native, positive_steps
from isosample.volume.readers.vti_values import VtiFile, values_of

if TYPE_CHECKING:
    from pathlib import Path
    from xml.etree.ElementTree import Element

    from isosample.volume.grid import F64, SampleArray

TYPES = {
    "Int8": "i1",
    "UInt8": "u1",
    "Int16": "i2",
    "UInt16": "u2",
    "Int32": "i4",
    "UInt32": "u4",
    "Int64": "i8",
    "UInt64": "u8",
    "Float32": "f4",
    "Float64": "f8",
}
LARGEST_INDEX = 2**31 - 1  # VTK's extents are numbers of 32 bits


def read_vti(path: Path, options: ReadOptions) -> Volume:
    """Read the point data of a VTK image file.

    Parameters
    ----------
    path : Path
        Appended raw blocks without compression are mapped into memory.
    options : ReadOptions
        `channel` chooses a component of a vector array.

    Raises
    ------
    InputError
        If the file is damaged, holds cell data or several arrays of which none is active, or is compressed
        by something other than zlib.
    """
    file = _open(path)
    image = file.root.find("ImageData")
    if image is None:
        raise InputError(
            f"{path.name} holds {file.root.get('type')!r}, not ImageData. Save it as a VTK image."
        )
    whole = _extent(file.name, image, "WholeExtent", "")
    spacing, direction = positive_steps(
        _numbers(file.name, image, "Spacing", "1 1 1", 3),
        _numbers(file.name, image, "Direction", "1 0 0 0 1 0 0 0 1", 9).reshape(3, 3),
    )
    origin = _numbers(file.name, image, "Origin", "0 0 0", 3)
    first = origin + direction @ (np.array(spacing) * whole.first)
    choose(path.name, "time", 1, options.time)
    samples = _assembled(file, image.findall("Piece"), whole, options)
    return Volume(samples, spacing=spacing, origin=tuple(first.tolist()), direction=direction, name=path.name)


def _open(path: Path) -> VtiFile:
    """Map the file, split the appended section off, and parse the rest."""
    with path.open("rb") as stream:
        mapped = mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ)
    start = mapped.find(b"<AppendedData")
    text = mapped[:start] + b"</VTKFile>" if start >= 0 else mapped[:]
    if b"<!DOCTYPE" in text[:4096] or b"<!ENTITY" in text:
        raise InputError(f"{path.name} declares XML entities, which no VTK file does; it is refused.")
    try:
        root = ElementTree.fromstring(text)
    except ElementTree.ParseError as error:
        raise InputError(f"{path.name} is no complete VTK XML file ({error}). Fetch it again.") from error
    if start < 0:
        return VtiFile(path.name, root, memoryview(b""), is_base64=False)
    underscore = mapped.find(b"_", mapped.find(b">", start))
    is_base64 = b'"base64"' in mapped[start : mapped.find(b">", start)]
    if underscore < 0:
        raise InputError(f"{path.name}: its appended data has no start. The file is incomplete.")
    return VtiFile(path.name, root, memoryview(mapped)[underscore + 1 :], is_base64)


def _numbers(name: str, element: Element, key: str, default: str, count: int) -> F64:
    """Numbers of an attribute, or raise."""
    text = element.get(key, default)
    try:
        numbers = np.array(text.split(), dtype=np.float64)
    except ValueError:
        numbers = np.empty(0)
    if numbers.size != count:
        raise InputError(f"{name}: {key} {text!r} must be {count} numbers.")
    return numbers


class _Extent(NamedTuple):
    """A box of samples."""

    text: str
    first: Triple  # (x, y, z)
    size: Triple

    def within(self, whole: _Extent) -> tuple[slice, slice, slice] | None:
        """Its place [z, y, x] in a whole, or None where it reaches outside."""
        starts = [own - other for own, other in zip(self.first, whole.first, strict=True)]
        ends = [start + count for start, count in zip(starts, self.size, strict=True)]
        if min(starts) < 0 or any(end > count for end, count in zip(ends, whole.size, strict=True)):
            return None
        x, y, z = (slice(start, end) for start, end in zip(starts, ends, strict=True))
        return z, y, x


def _extent(name: str, element: Element, key: str, default: str) -> _Extent:
    """Extent of an attribute, or raise where it is none."""
    text = element.get(key, default)
    numbers = _numbers(name, element, key, default, 6)
    if not (np.abs(numbers) <= LARGEST_INDEX).all() or (numbers != np.floor(numbers)).any():
        raise InputError(f"{name}: {key} {text!r} must be whole numbers of 32 bits.")
    x0, x1, y0, y1, z0, z1 = (int(number) for number in numbers)
    size = (x1 - x0 + 1, y1 - y0 + 1, z1 - z0 + 1)
    if min(size) < 1:
        raise InputError(f"{name}: {key} {text!r} is empty; every last index must be >= the first.")
    return _Extent(text, (x0, y0, z0), size)


def _assembled(file: VtiFile, pieces: list[Element], whole: _Extent, options: ReadOptions) -> SampleArray:
    """Put all pieces into one array; return the array of the piece itself where there is only one."""
    parts = []
    for piece in pieces:
        extent = _extent(file.name, piece, "Extent", whole.text)
        place = extent.within(whole)
        if place is None:
            raise InputError(
                f"{file.name}: its piece {extent.text!r} reaches outside the whole extent {whole.text!r}. It may be "
                "damaged; fetch it again."
            )
        parts.append((place, _piece_samples(file, piece, extent.size, options)))
    if len(parts) == 1 and parts[0][1].shape == whole.size[::-1]:
        return native(parts[0][1])
    count, held = math.prod(whole.size), sum(part.size for _, part in parts)
    if held < count:  # before memory is asked for
        raise InputError(f"{file.name}: its pieces leave {count - held} of {count} samples out.")
    covered = np.zeros(whole.size[::-1], dtype=bool)
    samples = np.zeros(covered.shape, dtype=parts[0][1].dtype)
    for place, part in parts:
        samples[place], covered[place] = part, True
    if not covered.all():
        missing = int(covered.size - np.count_nonzero(covered))
        raise InputError(f"{file.name}: its pieces leave {missing} of {covered.size} samples out.")
    return native(samples)


def _piece_samples(file: VtiFile, piece: Element, size: Triple, options: ReadOptions) -> SampleArray:
    """(Z, Y, X) samples of one piece, of the active array and the chosen component."""
    array = _active_array(file.name, piece)
    code = TYPES.get(array.get("type", ""))
    if code is None:
        raise InputError(f"{file.name}: samples of type {array.get('type')!r} are not supported.")
    dtype = np.dtype(file.order + code)
    components = _component_count(file.name, array)
    channel = choose(file.name, "channel", components, options.channel)
    values = values_of(file, array, dtype)
    expected = math.prod(size) * components
    if values.size != expected:
        x, y, z = size
        raise InputError(
            f"{file.name} has {values.size} values; {x} × {y} × {z} samples of {components} components need "
            f"{expected}. The file is incomplete."
        )
    shaped = values.reshape(*size[::-1], components)
    return shaped[..., channel]


def _component_count(name: str, array: Element) -> int:
    """Number of components of an array, or raise."""
    text = array.get("NumberOfComponents", "1")
    try:
        count = int(text)
    except ValueError:
        count = 0
    if count < 1:
        raise InputError(f"{name}: NumberOfComponents {text!r} must be a whole number >= 1.")
    return count


def _active_array(name: str, piece: Element) -> Element:
    """Return the point array that is marked as active, or the only one."""
    points = piece.find("PointData")
    arrays = [] if points is None else points.findall("DataArray")
    if points is None or not arrays:
        cells = piece.find("CellData/DataArray")
        hint = (
            "only cell data; convert it (in ParaView: Cell Data to Point Data)"
            if cells is not None
            else "none"
        )
        raise InputError(f"{name}: a volume needs samples at points (PointData); the file has {hint}.")
    active = points.get("Scalars")
    wanted = [array for array in arrays if array.get("Name") == active] if active else arrays
    if len(wanted) != 1:
        names = ", ".join(repr(array.get("Name")) for array in arrays)
        raise InputError(
            f"{name} has the arrays {names}, none marked by Scalars=. Save it with one active array."
        )
    return wanted[0]

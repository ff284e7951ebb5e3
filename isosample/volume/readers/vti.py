"""VTK image files (.vti), whose pieces are put together."""

from __future__ import annotations

import mmap
from typing import TYPE_CHECKING
from xml.etree import ElementTree

import numpy as np

from isosample.errors import InputError
from isosample.volume.grid import Volume
from isosample.volume.readers.samples import ReadOptions, choose, native, positive_steps
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
    whole = _numbers(file.name, image, "WholeExtent", "", 6).astype(np.int64).reshape(3, 2)
    size = whole[:, 1] - whole[:, 0] + 1
    if size.min() < 1:
        raise InputError(f"{path.name} has the empty extent {image.get('WholeExtent')!r}.")
    spacing, direction = positive_steps(
        _numbers(file.name, image, "Spacing", "1 1 1", 3),
        _numbers(file.name, image, "Direction", "1 0 0 0 1 0 0 0 1", 9).reshape(3, 3),
    )
    origin = _numbers(file.name, image, "Origin", "0 0 0", 3)
    first = origin + direction @ (np.array(spacing) * whole[:, 0])
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


def _assembled(file: VtiFile, pieces: list[Element], whole: np.ndarray, options: ReadOptions) -> SampleArray:
    """Put all pieces into one array; return the array of the piece itself where there is only one."""
    parts = []
    for piece in pieces:
        default = " ".join(str(n) for n in whole.ravel())
        extent = _numbers(file.name, piece, "Extent", default, 6).astype(np.int64).reshape(3, 2)
        size = extent[:, 1] - extent[:, 0] + 1
        parts.append((extent[:, 0] - whole[:, 0], size, _piece_samples(file, piece, size, options)))
    whole_size = whole[:, 1] - whole[:, 0] + 1
    if len(parts) == 1 and (parts[0][1] == whole_size).all():
        return native(parts[0][2])
    covered = np.zeros(whole_size[::-1], dtype=bool)
    dtype = parts[0][2].dtype if parts else np.dtype(np.uint8)
    samples = np.zeros(covered.shape, dtype=dtype)
    for (x, y, z), (nx, ny, nz), part in parts:
        place = (slice(z, z + nz), slice(y, y + ny), slice(x, x + nx))
        samples[place], covered[place] = part, True
    if not covered.all():
        missing = int(covered.size - np.count_nonzero(covered))
        raise InputError(f"{file.name}: its pieces leave {missing} of {covered.size} samples out.")
    return native(samples)


def _piece_samples(file: VtiFile, piece: Element, size: np.ndarray, options: ReadOptions) -> SampleArray:
    """(Z, Y, X) samples of one piece, of the active array and the chosen component."""
    array = _active_array(file.name, piece)
    code = TYPES.get(array.get("type", ""))
    if code is None:
        raise InputError(f"{file.name}: samples of type {array.get('type')!r} are not supported.")
    dtype = np.dtype(file.order + code)
    components = int(array.get("NumberOfComponents", "1"))
    channel = choose(file.name, "channel", components, options.channel)
    values = values_of(file, array, dtype)
    expected = int(size.prod()) * components
    if values.size != expected:
        x, y, z = size
        raise InputError(
            f"{file.name} has {values.size} values; {x} × {y} × {z} samples of {components} components need "
            f"{expected}. The file is incomplete."
        )
    shaped = values.reshape(*size[::-1], components)
    return shaped[..., channel]


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

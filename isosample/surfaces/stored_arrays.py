"""Arrays of an uncompressed NPZ file that is in memory, found in one walk through its directory.

`numpy.load` reads any such file; for a small one it takes longer than all that is done with the arrays.
"""

from __future__ import annotations

import math
import re
import struct
import zlib
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

if TYPE_CHECKING:
    from collections.abc import Iterator

_END = struct.Struct("<4s4H2IH")  # of the archive: signature, disks, entries, size and place of the directory
_ENTRY = struct.Struct("<4s6H3I5H2I")  # of the directory
_MEMBER = struct.Struct("<4s5H3I2H")  # before a file in the archive
_STORED = 0  # method of a file that is not compressed
_ENCRYPTED = 1
_MAGIC = b"\x93NUMPY\1\0"
_LAYOUT = re.compile(
    rb"\{'descr': '([<|][biuf][1248])', 'fortran_order': False, 'shape': \(([0-9, ]*)\), \} *\n"
)


def stored_arrays(data: bytes) -> dict[str, npt.NDArray[np.generic]] | None:
    """Return copies of the arrays of an NPZ file, by their names; None for anything unusual or damaged.

    Parameters
    ----------
    data : bytes
        Of the whole file. What `numpy.savez` writes for arrays of plain numbers in C order is understood.
    """
    try:
        return {name: _array(content) for name, content in _members(data)}
    except (struct.error, ValueError, TypeError):  # a field that is cut off, a wrong one, no type of numbers
        return None


def _members(data: bytes) -> Iterator[tuple[str, memoryview]]:
    """Yield names and contents of the files of an archive; raise `ValueError` where it is not as expected."""
    signature, disk, first_disk, here, count, size, at, comment = _END.unpack_from(
        data, len(data) - _END.size
    )
    _expect(signature == b"PK\5\6" and (disk, first_disk, comment) == (0, 0, 0) and here == count)
    _expect(at + size + _END.size == len(data))
    for _ in range(count):
        entry = _ENTRY.unpack_from(data, at)
        flags, method, checksum, packed, length = entry[3], entry[4], *entry[7:10]
        name_length, extra, remark, start = *entry[10:13], entry[16]
        _expect(entry[0] == b"PK\1\2" and method == _STORED and not flags & _ENCRYPTED and packed == length)
        name = data[at + _ENTRY.size : at + _ENTRY.size + name_length]
        at += _ENTRY.size + name_length + extra + remark
        member = _MEMBER.unpack_from(data, start)
        begin = start + _MEMBER.size + member[9] + member[10]
        own_name = data[start + _MEMBER.size : start + _MEMBER.size + member[9]]
        _expect(member[0] == b"PK\3\4" and own_name == name and name.endswith(b".npy"))
        content = memoryview(data)[begin : begin + length]
        _expect(len(content) == length and zlib.crc32(content) == checksum)
        yield name.decode("ascii").removesuffix(".npy"), content


def _array(content: memoryview) -> npt.NDArray[np.generic]:
    """Return a copy of the array of an NPY file; raise `ValueError` where it is not as expected."""
    _expect(content[: len(_MAGIC)] == _MAGIC)
    begin = len(_MAGIC) + 2 + int.from_bytes(content[len(_MAGIC) : len(_MAGIC) + 2], "little")
    layout = _LAYOUT.fullmatch(bytes(content[len(_MAGIC) + 2 : begin]))
    if layout is None:
        raise ValueError("an array of an unusual kind")
    dtype = np.dtype(layout[1].decode())
    shape = tuple(int(count) for count in layout[2].split(b",") if count.strip())
    _expect(math.prod(shape) * dtype.itemsize == len(content) - begin)
    found: npt.NDArray[np.generic] = np.frombuffer(content[begin:], dtype=dtype).reshape(shape).copy()
    return found


def _expect(holds: bool) -> None:
    """Raise `ValueError` where something does not hold."""
    if not holds:
        raise ValueError("an archive of an unusual kind")

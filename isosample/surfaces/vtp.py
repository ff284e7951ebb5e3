"""Meshes as VTK PolyData files (.vtp): XML with the arrays appended in base64, whole float64 positions."""

from __future__ import annotations

import base64
import struct
from typing import IO, TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    import numpy.typing as npt

    from isosample.surfaces.mesh import Mesh

BLOCK_BYTES = 3 << 20  # a multiple of 3: base64 of the blocks one after the other is that of the whole
TYPES = {"<f8": "Float64", "<f4": "Float32", "<i4": "Int32", "<i8": "Int64"}


def write_vtp(mesh: Mesh, file: IO[bytes]) -> None:
    """Write a mesh with its unit normals as point data, and its isovalue as field data.

    Notes
    -----
    VTK File Formats, "XML File Formats", PolyData with ``format="appended"`` and ``encoding="base64"``: each array is
    its length in bytes as UInt64 and its values, encoded together.
    """
    corners = 3 * np.arange(1, len(mesh.triangles) + 1, dtype="<i8")
    arrays = {
        "Normals": mesh.normals.astype("<f4"),
        "Points": mesh.vertices.astype("<f8"),
        "connectivity": mesh.triangles.astype("<i4"),
        "offsets": corners,
    }
    tags, offset = {}, 0
    for name, array in arrays.items():
        tags[name] = _tag(name, array, offset)
        offset += encoded_bytes(array.nbytes)
    file.write(_head(mesh, tags).encode())
    for array in arrays.values():
        _write_array(array, file)
    file.write(b"\n</AppendedData>\n</VTKFile>\n")


def encoded_bytes(size: int) -> int:
    """Length in base64 of an array of `size` bytes and its own length."""
    return 4 * -(-(size + 8) // 3)


def _tag(name: str, array: npt.NDArray[np.generic], offset: int) -> str:
    components = f' NumberOfComponents="{array.shape[1]}"' if name in ("Normals", "Points") else ""
    kind = TYPES[array.dtype.str]
    return f'<DataArray type="{kind}" Name="{name}"{components} format="appended" offset="{offset}"/>'


def _head(mesh: Mesh, tags: dict[str, str]) -> str:
    attributes = 'type="Float64" Name="isovalue" NumberOfTuples="1" format="ascii"'
    isovalue = f"<DataArray {attributes}>{mesh.isovalue!r}</DataArray>"
    return f"""<?xml version="1.0"?>
<VTKFile type="PolyData" version="1.0" byte_order="LittleEndian" header_type="UInt64">
<PolyData>
<FieldData>{isovalue}</FieldData>
<Piece NumberOfPoints="{len(mesh.vertices)}" NumberOfVerts="0" NumberOfLines="0" NumberOfStrips="0" \
NumberOfPolys="{len(mesh.triangles)}">
<PointData Normals="Normals">{tags["Normals"]}</PointData>
<Points>{tags["Points"]}</Points>
<Polys>{tags["connectivity"]}{tags["offsets"]}</Polys>
</Piece>
</PolyData>
<AppendedData encoding="base64">
_"""


def _write_array(array: npt.NDArray[np.generic], file: IO[bytes]) -> None:
    """Write the length and the values in base64, block by block."""
    content = np.ascontiguousarray(array).reshape(-1).view(np.uint8).data
    first = BLOCK_BYTES - 8
    file.write(base64.b64encode(struct.pack("<Q", array.nbytes) + bytes(content[:first])))
    for start in range(first, len(content), BLOCK_BYTES):
        file.write(base64.b64encode(content[start : start + BLOCK_BYTES]))

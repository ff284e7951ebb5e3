"""Exported meshes read back by another library."""

from __future__ import annotations

import base64
import json
import re
import struct
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from mesh_checks import F64, closed_noise, enclosed_volume, extract_mesh

from isosample.errors import InputError
from isosample.surfaces.export import export_mesh, open_edge_count
from isosample.volume.grid import Volume

if TYPE_CHECKING:
    from pathlib import Path

    from isosample.surfaces.mesh import Mesh


def noise_mesh() -> Mesh:
    return extract_mesh(
        Volume(closed_noise(0, size=5), spacing=(0.5, 1.0, 2.0), origin=(10.0, 0.0, -3.0)), 0.1
    )


@pytest.mark.parametrize("suffix", [".ply", ".glb", ".obj", ".STL"])
def test_an_exported_mesh_reads_back_with_its_surface(tmp_path: Path, suffix: str) -> None:
    trimesh = pytest.importorskip("trimesh")
    mesh, path = noise_mesh(), tmp_path / f"surface{suffix}"
    export_mesh(mesh, path)
    read: Any = trimesh.load_mesh(path, process=False)
    corners = mesh.vertices[mesh.triangles]
    # float32 (or 8 decimals in OBJ): half an ulp of the largest coordinate, 16, is 2**-21
    assert np.abs(np.asarray(read.triangles) - corners).max() <= 2.0**-21
    assert read.volume == pytest.approx(enclosed_volume(mesh), rel=1e-5)
    assert [file.name for file in tmp_path.iterdir()] == [path.name]


def test_a_ply_file_holds_position_and_normal_of_every_vertex(tmp_path: Path) -> None:
    mesh = noise_mesh()
    export_mesh(mesh, tmp_path / "surface.ply")
    head, body = (tmp_path / "surface.ply").read_bytes().split(b"end_header\n", 1)
    assert re.findall(rb"property float (\w+)", head) == [b"x", b"y", b"z", b"nx", b"ny", b"nz"]
    rows = np.frombuffer(body, dtype="<f4", count=6 * len(mesh.vertices)).reshape(-1, 6)
    assert np.array_equal(rows, np.hstack([mesh.vertices, mesh.normals]).astype(np.float32))


def test_an_obj_file_holds_the_normals(tmp_path: Path) -> None:
    mesh = noise_mesh()
    export_mesh(mesh, tmp_path / "surface.obj")
    lines = (tmp_path / "surface.obj").read_text().splitlines()
    normals = np.array([line.split()[1:] for line in lines if line.startswith("vn ")], dtype=np.float64)
    assert np.abs(normals - mesh.normals).max() <= 0.5e-8 + 2.0**-53  # 8 decimals


def test_a_glb_file_holds_the_normals(tmp_path: Path) -> None:
    mesh = noise_mesh()
    export_mesh(mesh, tmp_path / "surface.glb")
    content = (tmp_path / "surface.glb").read_bytes()
    (json_length,) = struct.unpack_from("<I", content, 12)
    document = json.loads(content[20 : 20 + json_length])
    accessor = document["accessors"][document["meshes"][0]["primitives"][0]["attributes"]["NORMAL"]]
    view = document["bufferViews"][accessor["bufferView"]]
    start = 20 + json_length + 8 + view.get("byteOffset", 0) + accessor.get("byteOffset", 0)
    normals = np.frombuffer(content, dtype="<f4", count=3 * accessor["count"], offset=start).reshape(-1, 3)
    assert np.abs(normals - mesh.normals).max() <= 2.0**-23  # unit vectors in float32, normalised again


def vtp_arrays(path: Path) -> dict[str, F64]:
    """Arrays of a .vtp file, read by its own description alone."""
    head, _, rest = path.read_bytes().partition(b'<AppendedData encoding="base64">\n_')
    appended = rest[: rest.index(b"\n</AppendedData>")]
    arrays = {}
    for kind, name, offset in re.findall(
        rb'type="(\w+)" Name="(\w+)"[^>]* format="appended" offset="(\d+)"', head
    ):
        place = int(offset)
        (size,) = struct.unpack("<Q", base64.b64decode(appended[place : place + 12])[:8])
        block = base64.b64decode(appended[place : place + 4 * -(-(size + 8) // 3)])
        dtype = np.dtype({b"Float64": "<f8", b"Float32": "<f4", b"Int32": "<i4", b"Int64": "<i8"}[kind])
        arrays[name.decode()] = np.frombuffer(block[8 : 8 + size], dtype=dtype).astype(np.float64)
    return arrays


@pytest.mark.parametrize("block", [24, 3 << 20])
def test_a_vtp_file_holds_the_mesh_bit_for_bit(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, block: int
) -> None:
    monkeypatch.setattr("isosample.surfaces.vtp.BLOCK_BYTES", block)
    mesh, path = noise_mesh(), tmp_path / "surface.vtp"
    export_mesh(mesh, path)
    arrays = vtp_arrays(path)
    assert np.array_equal(arrays["Points"].reshape(-1, 3), mesh.vertices)
    assert np.array_equal(arrays["Normals"].reshape(-1, 3), mesh.normals.astype(np.float32))
    assert np.array_equal(arrays["connectivity"].reshape(-1, 3), mesh.triangles)
    assert np.array_equal(arrays["offsets"], 3 * np.arange(1, len(mesh.triangles) + 1))


def test_vtk_reads_a_vtp_file(tmp_path: Path) -> None:
    reading = pytest.importorskip("vtkmodules.vtkIOXML")
    numpy_support = pytest.importorskip("vtkmodules.util.numpy_support")
    mesh, path = noise_mesh(), tmp_path / "surface.vtp"
    export_mesh(mesh, path)
    reader = reading.vtkXMLPolyDataReader()
    reader.SetFileName(str(path))
    reader.Update()
    read = reader.GetOutput()
    points = numpy_support.vtk_to_numpy(read.GetPoints().GetData())
    normals = numpy_support.vtk_to_numpy(read.GetPointData().GetNormals())
    corners = numpy_support.vtk_to_numpy(read.GetPolys().GetConnectivityArray())
    assert np.array_equal(points, mesh.vertices)
    assert np.array_equal(normals, mesh.normals.astype(np.float32))
    assert np.array_equal(corners.reshape(-1, 3), mesh.triangles)
    assert read.GetFieldData().GetArray("isovalue").GetValue(0) == mesh.isovalue


def test_open_edges_are_counted() -> None:
    mesh = noise_mesh()
    assert open_edge_count(mesh.triangles) == 0
    assert open_edge_count(mesh.triangles[1:]) == 3
    assert open_edge_count(mesh.triangles[:0]) == 0
    assert open_edge_count(np.array([[0, 1, 2], [0, 1, 3], [1, 0, 4]])) == 7  # one side in three triangles


@pytest.mark.parametrize("name", ["surface.xyz", "surface"])
def test_an_unknown_suffix_is_refused_with_the_list(tmp_path: Path, name: str) -> None:
    with pytest.raises(InputError, match=r"\.ply, \.glb, \.stl, \.obj, \.vtp"):
        export_mesh(noise_mesh(), tmp_path / name)
    assert not list(tmp_path.iterdir())


def test_an_empty_mesh_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"isosurface at 99\.0 has no triangles"):
        export_mesh(extract_mesh(Volume(closed_noise(0, size=2)), 99.0), tmp_path / "surface.ply")


def test_a_folder_that_does_not_exist_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="cannot be written"):
        export_mesh(noise_mesh(), tmp_path / "absent" / "surface.ply")

"""Exported meshes read back by another library."""

from __future__ import annotations

import json
import re
import struct
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from mesh_checks import closed_noise, enclosed_volume, extract_mesh

from isosample.errors import InputError
from isosample.surfaces.export import export_mesh
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


@pytest.mark.parametrize("name", ["surface.xyz", "surface"])
def test_an_unknown_suffix_is_refused_with_the_list(tmp_path: Path, name: str) -> None:
    with pytest.raises(InputError, match=r"\.ply, \.glb, \.stl, \.obj"):
        export_mesh(noise_mesh(), tmp_path / name)
    assert not list(tmp_path.iterdir())


def test_an_empty_mesh_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"isosurface at 99\.0 has no triangles"):
        export_mesh(extract_mesh(Volume(closed_noise(0, size=2)), 99.0), tmp_path / "surface.ply")


def test_a_folder_that_does_not_exist_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="cannot be written"):
        export_mesh(noise_mesh(), tmp_path / "absent" / "surface.ply")

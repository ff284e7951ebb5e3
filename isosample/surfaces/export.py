"""Welded meshes as files for other programs: PLY, GLB, STL, OBJ, VTP."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from isosample.defaults import MESH_SUFFIXES
from isosample.errors import InputError
from isosample.files import replacing
from isosample.surfaces.vtp import write_vtp

if TYPE_CHECKING:
    import numpy.typing as npt

    from isosample.surfaces.mesh import Mesh


def export_mesh(mesh: Mesh, path: str | Path) -> None:
    """Write a mesh with its normals in the format that the suffix names, whole or not at all.

    Parameters
    ----------
    mesh : Mesh
        Vertices in world units. Normals point towards falling values; STL has one per triangle, from the
        winding. PLY, GLB and STL hold float32, VTP float64.
    path : path
        Ends in .ply, .glb, .stl, .obj or .vtp.

    Raises
    ------
    InputError
        If the suffix is another one, the mesh is empty, or the file cannot be written.
    """
    path = Path(path)
    suffix = path.suffix.lower()
    if suffix not in MESH_SUFFIXES:
        raise InputError(
            f"{path}: {suffix or 'no suffix'} is not a mesh format; use {', '.join(MESH_SUFFIXES)}."
        )
    if len(mesh.triangles) == 0:
        raise InputError(
            f"the isosurface at {mesh.isovalue} has no triangles; there is nothing to write to {path}. "
            "Choose a value inside the volume's range."
        )
    if suffix == ".vtp":
        with replacing(path) as file:
            write_vtp(mesh, file)
        return
    content = _content(mesh, suffix)
    with replacing(path) as file:
        file.write(content)


def open_edge_count(triangles: npt.NDArray[np.integer[Any]]) -> int:
    """Number of sides that not exactly two triangles share; 0 for a closed mesh.

    Parameters
    ----------
    triangles : (T, 3) int
        Rows of vertices.
    """
    sides = np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2).astype(np.int64), axis=1)
    names = sides[:, 0] * (int(sides.max(initial=0)) + 1) + sides[:, 1]
    return int(np.count_nonzero(np.unique(names, return_counts=True)[1] != 2))


def _content(mesh: Mesh, suffix: str) -> bytes:
    """The mesh in one of trimesh's formats."""
    import trimesh

    shape = trimesh.Trimesh(
        vertices=mesh.vertices, faces=mesh.triangles, vertex_normals=mesh.normals, process=False
    )
    options: dict[str, Any] = {".ply": {"vertex_normal": True}, ".stl": {}}.get(
        suffix, {"include_normals": True}
    )
    content: Any = shape.export(file_type=suffix[1:], **options)
    return content.encode() if isinstance(content, str) else bytes(content)

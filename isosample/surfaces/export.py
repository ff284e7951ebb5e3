"""Welded meshes as files for other programs: PLY, GLB, STL, OBJ."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from isosample.defaults import MESH_SUFFIXES
from isosample.errors import InputError
from isosample.files import replacing

if TYPE_CHECKING:
    from isosample.surfaces.mesh import Mesh


def export_mesh(mesh: Mesh, path: str | Path) -> None:
    """Write a mesh with its normals in the format that the suffix names, whole or not at all.

    Parameters
    ----------
    mesh : Mesh
        Vertices in world units. Normals point towards falling values; STL has one per triangle, from the
        winding. PLY, GLB and STL hold float32.
    path : path
        Ends in .ply, .glb, .stl or .obj.

    Raises
    ------
    InputError
        If the suffix is another one, the mesh is empty, or the file cannot be written.
    """
    import trimesh

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
    shape = trimesh.Trimesh(
        vertices=mesh.vertices, faces=mesh.triangles, vertex_normals=mesh.normals, process=False
    )
    options: dict[str, Any] = {".ply": {"vertex_normal": True}, ".stl": {}}.get(
        suffix, {"include_normals": True}
    )
    content: Any = shape.export(file_type=suffix[1:], **options)
    with replacing(path) as file:
        file.write(content.encode() if isinstance(content, str) else content)

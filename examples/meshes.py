"""The meshes themselves: two isosurfaces with the field's gradients, one of them written as PLY."""

from pathlib import Path

import isosample
from isosample.surfaces.export import export_mesh
from isosample.volume.analytic import MarschnerLobb, sample_field

volume = sample_field(
    MarschnerLobb(), (41, 41, 41), lower=(-1, -1, -1), upper=(1, 1, 1), name="Marschner-Lobb"
)
for mesh in isosample.extract(volume, [0.4, 0.6]):
    print(f"f = {mesh.isovalue}: {len(mesh.vertices)} vertices, {len(mesh.triangles)} triangles")
export_mesh(mesh, Path("marschner_lobb.ply"))

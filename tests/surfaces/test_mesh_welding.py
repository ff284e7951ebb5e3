"""Welding pieces of one isosurface by the names of their vertices."""

from __future__ import annotations

import numpy as np
import pytest
from mesh_checks import closed_noise

from isosample.errors import InputError
from isosample.surfaces.extract import extract_surfaces
from isosample.surfaces.mesh import weld
from isosample.volume.geometry import GridGeometry
from isosample.volume.grid import Volume


def test_a_welded_mesh_has_every_named_vertex_once_and_every_triangle() -> None:
    surfaces = extract_surfaces(Volume(closed_noise(1)), [0.0], brick_cells=4)
    mesh = surfaces.mesh(0)
    names = {key for piece in surfaces.meshes for key in piece.edge_keys.tolist()}
    assert len(mesh.vertices) == len(names)
    assert len(mesh.triangles) == sum(len(piece.triangles) for piece in surfaces.meshes)
    assert len(names) < surfaces.statistics.vertices[0]


def test_vertices_are_merged_by_name_and_never_by_distance() -> None:
    samples = np.zeros((4, 3, 3))
    samples[:, 1, 1] = [1.0, 0.0, 0.0, 1.0]
    surfaces = extract_surfaces(Volume(samples), [1.0])
    piece = surfaces.meshes[0]
    distances = np.linalg.norm(piece.positions[:, None] - piece.positions, axis=2)
    np.fill_diagonal(distances, 1.0)
    assert distances.min() < 1e-3  # vertices crowd around the samples that equal the isovalue
    assert len(surfaces.mesh(0).vertices) == len(piece.positions)


def test_pieces_of_different_isovalues_cannot_be_welded() -> None:
    surfaces = extract_surfaces(Volume(closed_noise(1)), [0.0, 0.5])
    with pytest.raises(InputError, match=r"\[0.0, 0.5\]"):
        weld(surfaces.meshes, surfaces.geometry)


def test_no_pieces_weld_to_an_empty_mesh() -> None:
    mesh = weld([], GridGeometry(size_xyz=(2, 2, 2)), isovalue=3.0)
    assert (mesh.isovalue, mesh.vertices.shape, mesh.triangles.shape) == (3.0, (0, 3), (0, 3))
    assert mesh.normals.shape == (0, 3)
    with pytest.raises(InputError, match="isovalues"):
        weld([], GridGeometry(size_xyz=(2, 2, 2)))

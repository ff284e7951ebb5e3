"""Blinn–Phong on impulse surfaces: the closed form of a plane and of a sphere, two-sided."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from isosample.rendering.camera import Camera
from isosample.rendering.settings import Material
from isosample.transfer.control_points import Isosurface
from isosample.transfer.transfer_function import TransferFunction
from isosample.volume.grid import Volume
from rendering.scenes import picture
from rendering.test_closed_forms import sphere_volume

if TYPE_CHECKING:
    import moderngl

MATERIAL = Material(ambient=0.2, diffuse=0.5, specular=0.25, shininess=10.0)
NORMAL_ERROR = 6.8e-5  # shaders/lib/octahedral.glsl: angle of a packed normal [rad]


@pytest.mark.parametrize("falling", [False, True])
def test_a_tilted_plane_has_the_light_of_its_normal_from_both_sides(
    gl: moderngl.Context, *, falling: bool
) -> None:
    z, y, x = np.mgrid[0:6, 0:7, 0:8]
    gradient = np.array([0.3, -0.2, 1.0]) * (-1.0 if falling else 1.0)
    spacing = np.array([1.0, 0.5, 2.0])
    volume = Volume((np.stack([x, y, z], axis=-1) * spacing) @ gradient, spacing=tuple(spacing))
    middle = float(np.mean(volume.value_range))
    tf = TransferFunction([], [Isosurface(middle, (0.8, 0.4, 0.2), 1.0)])
    rgba, _ = picture(gl, volume, tf, Camera.orbit(volume.box, zoom=8), (16, 16), material=MATERIAL)
    cosine = 1.0 / np.linalg.norm([0.3, -0.2, 1.0])
    lit = np.array([0.8, 0.4, 0.2]) * (0.2 + 0.5 * cosine) + 0.25 * cosine**10
    # d cosine / d angle <= 1, times diffuse and 10 x specular; and roundings of gradients and of pow (1e-5).
    assert np.abs(rgba[..., :3] - lit).max() <= NORMAL_ERROR * (0.5 + 2.5) + 1e-5
    assert np.all(rgba[..., 3] == 1.0)


def test_a_sphere_darkens_towards_its_silhouette_under_any_spacing(gl: moderngl.Context) -> None:
    material = Material(ambient=0.0, diffuse=1.0, specular=0.0, shininess=1.0)
    volume = sphere_volume(0.0, (0.4, 0.4, 2.0))
    tf = TransferFunction([], [Isosurface(8.0, (1.0, 1.0, 1.0), 1.0)])
    camera = Camera.orbit(volume.box, azimuth=40, elevation=25)
    rgba, _ = picture(gl, volume, tf, camera, (64, 64), material=material)
    origins, directions = camera.rays(1.0).origins_and_directions(64, 64)
    along = (origins * directions).sum(axis=-1)
    miss = np.sqrt((origins**2).sum(axis=-1) - along**2)
    cosine = np.sqrt(np.maximum(1.0 - (miss / 8.0) ** 2, 0.0))
    inside = miss < 7.0
    # Central differences err by h² f''' / 6 with f''' <= 2 / r², so 0.021; between the vertices normals
    # differ from the surface's by up to (h / 2r)² / 2 = 0.008 more.
    assert np.abs(rgba[..., 0] - cosine)[inside].max() < 0.021 + 0.008

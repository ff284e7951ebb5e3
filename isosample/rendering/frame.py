"""The uniform block of one frame: camera, box and settings, as the shaders read them."""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from isosample.defaults import MAX_CLIP_PLANES
from isosample.errors import InputError, ShaderError
from isosample.gl.layouts import Packing, constants, struct_dtypes
from isosample.gl.shader_source import shader_root

if TYPE_CHECKING:
    from isosample.rendering.camera import Camera
    from isosample.rendering.rays import Rays
    from isosample.rendering.scene import Scene
    from isosample.rendering.settings import RenderSettings
    from isosample.rendering.tiles import Tile
    from isosample.volume.geometry import Box, GridGeometry

LAYOUTS = "lib/layouts.glsl"
FARTHEST_EYE = 1e4  # radii of the box: distances are then rounded to 1e4 · 2^-24 radii, a fraction of a cell
CURVED_LIMIT = 0.5 / 3.0**0.5  # of a cell's diagonal: half an edge of a cube


@cache
def shared_constants() -> dict[str, int]:
    """Bindings and limits of ``shaders/lib/layouts.glsl`` by name.

    Raises
    ------
    ShaderError
        If the shaders allow another number of clip planes than the settings.
    """
    found = {name: n for name, n in constants(_layouts_text()).items() if isinstance(n, int)}
    if found["MAX_CLIP_PLANES"] != MAX_CLIP_PLANES:
        raise ShaderError(
            f"{LAYOUTS} allows {found['MAX_CLIP_PLANES']} clip planes, the settings {MAX_CLIP_PLANES}."
        )
    return found


def shared_number(name: str) -> float:
    """A ``const float`` of ``shaders/lib/layouts.glsl``, as it is written there."""
    return float(constants(_layouts_text())[name])


@cache
def storage_dtype(name: str) -> np.dtype[np.void]:
    """Layout of a struct of ``shaders/lib/layouts.glsl`` in a storage buffer."""
    return struct_dtypes(_layouts_text(), Packing.STD430)[name]


@cache
def uniform_dtype(name: str) -> np.dtype[np.void]:
    """Layout of a struct of ``shaders/lib/layouts.glsl`` in a uniform block."""
    return struct_dtypes(_layouts_text(), Packing.STD140)[name]


def frame_block(
    scene: Scene, camera: Camera, size: tuple[int, int], settings: RenderSettings
) -> npt.NDArray[np.void]:
    """(1,) Frame for a picture of a scene of (width, height) pixels; the tile is filled in by `set_tile`."""
    block = camera_block(scene.geometry, camera, size, settings)
    frame = block[0]
    frame["level_count"] = len(scene.level_optics)
    diagonal = float(np.linalg.norm(scene.geometry.spacing))
    frame["reach"], frame["curved_limit"] = diagonal, CURVED_LIMIT * diagonal
    if scene.face_kernel is not None:
        frame["face_kernel"] = scene.face_kernel
    frame["box_faces"] = int(scene.mask is None)
    frame["longest_walked"] = shared_constants()["LINK_SORT_LIMIT"]
    return block


def camera_block(
    geometry: GridGeometry, camera: Camera, size: tuple[int, int], settings: RenderSettings
) -> npt.NDArray[np.void]:
    """(1,) Frame without surfaces: camera, box and look of a picture of (width, height) pixels."""
    block = np.zeros(1, dtype=uniform_dtype("Frame"))
    frame = block[0]
    width, height = size
    box = geometry.box
    rays = camera.rays(width / height)
    for name, vector in (
        ("forward", rays.forward),
        ("span_right", rays.span_right),
        ("span_up", rays.span_up),
    ):
        frame[name] = vector
    frame["eye"] = rays.eye + head_start(rays, box) * rays.forward - box.centre
    frame["perspective"] = float(rays.perspective)
    # Clip x = dot(p - eye, right) / half width, with right / half width = span / |span|².
    frame["inverse_span_right"] = 1.0 / float(rays.span_right @ rays.span_right)
    frame["inverse_span_up"] = 1.0 / float(rays.span_up @ rays.span_up)
    frame["box_radius"] = box.radius
    unit_from_local = np.linalg.inv(box.edges.T)
    for name, row in zip(("unit_row_x", "unit_row_y", "unit_row_z"), unit_from_local, strict=True):
        frame[name] = (*row, 0.5)
    matrix = geometry.world_from_index
    frame["first_sample"][:3] = matrix[:3, 3] - box.centre
    for name, column in zip(("step_x", "step_y", "step_z"), matrix[:3, :3].T, strict=True):
        frame[name][:3] = column
    _set_look(frame, settings, box.centre)
    frame["image_size"] = (width, height)
    frame["samples_xy"] = geometry.size_xyz[:2]
    frame["samples_z"] = geometry.size_xyz[2]
    return block


def head_start(rays: Rays, box: Box) -> float:
    """How far the origins of parallel rays are moved towards the box, to its bounding sphere [world].

    Distances are then small numbers, in which float32 is precise, however far away the eye is; 0 for perspective.

    Raises
    ------
    InputError
        If a perspective eye is so far away that float32 distances no longer tell the box's cells apart.
    """
    if not rays.perspective:
        return max(0.0, float((box.centre - rays.eye) @ rays.forward) - 1.01 * box.radius)
    away = float(np.linalg.norm(box.centre - rays.eye)) / box.radius
    if away > FARTHEST_EYE:
        raise InputError(
            f"the eye is {away:.3g} times the radius of the volume away; a perspective camera may be "
            f"{FARTHEST_EYE:g} times away. Move it closer, or use an orthographic camera."
        )
    return 0.0


def _set_look(frame: np.void, settings: RenderSettings, centre: npt.NDArray[np.float64]) -> None:
    frame["background"] = settings.background_premultiplied
    if settings.material is not None:
        frame["material"] = settings.material.factors
    frame["clip_plane_count"] = len(settings.clip_planes)
    for i, plane in enumerate(settings.clip_planes):
        frame["clip_planes"][i] = plane.about(centre)
    frame["min_transmittance"] = settings.min_transmittance


def set_tile(block: npt.NDArray[np.void], tile: Tile, node_capacity: int) -> None:
    """Fill in the tile that the next passes render and the number of nodes that fit the pool."""
    frame = block[0]
    frame["tile_origin"] = (tile.x, tile.y)
    frame["tile_size"] = (tile.width, tile.height)
    frame["node_capacity"] = node_capacity


def _layouts_text() -> str:
    return (shader_root() / LAYOUTS).read_text(encoding="utf-8")

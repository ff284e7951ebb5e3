"""How far apart the samples of a picture's rays lie, as the shaders take it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from isosample.rendering.raycast_settings import Sampling

if TYPE_CHECKING:
    from isosample.rendering.raycast_settings import RaycastSettings
    from isosample.rendering.rays import Rays
    from isosample.volume.geometry import GridGeometry


def first_step(settings: RaycastSettings, geometry: GridGeometry, rays: Rays, size: tuple[int, int]) -> float:
    """The first step of a ray [world]: b of Knoll et al. 2009, eq. 14; of uniform sampling every step.

    Notes
    -----
    Differential: s_k times the diagonal of a pixel (section 5.3), on an image plane one voxel in front of the eye.
    The paper leaves the unit of distances open; in voxels its numbers of samples come out. Of parallel rays the
    image plane has one scale, and the steps do not grow.
    """
    voxel = min(geometry.spacing)
    if settings.sampling is Sampling.UNIFORM:
        return settings.step * voxel
    diagonal = float(np.linalg.norm(2.0 * rays.span_right / size[0] + 2.0 * rays.span_up / size[1]))
    return settings.pixel_scale * diagonal * (voxel if rays.perspective else 1.0)


def fill_sampling(
    block: np.void, settings: RaycastSettings, geometry: GridGeometry, rays: Rays, size: tuple[int, int]
) -> None:
    """Fill in the members of a struct Raycast that say where samples lie."""
    block["step"] = first_step(settings, geometry, rays, size)
    block["differential"] = float(settings.sampling is Sampling.DIFFERENTIAL)
    block["jitter_seed"] = 0 if settings.jitter is None else settings.jitter + 1
    local_from_index = geometry.world_from_index
    index_from_local = np.linalg.inv(local_from_index[:3, :3])
    shift = index_from_local @ (geometry.box.centre - local_from_index[:3, 3])
    for axis, name in enumerate(("index_row_x", "index_row_y", "index_row_z")):
        block[name] = (*index_from_local[axis], shift[axis])

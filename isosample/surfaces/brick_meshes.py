"""The isosurfaces in one brick: marched, and where the settings ask for it refined, coarsened and measured."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from isosample.surfaces.detail import coarsened
from isosample.surfaces.marching_cubes import march_levels
from isosample.surfaces.mesh import BrickMesh, no_residuals
from isosample.surfaces.mesh_error import measure
from isosample.surfaces.refine import NamedMesh, refined, settle_centres

if TYPE_CHECKING:
    from isosample.surfaces.brick_samples import BrickSamples
    from isosample.surfaces.marching_cubes import LocalMesh
    from isosample.surfaces.mesh import I32
    from isosample.surfaces.settings import ExtractionSettings
    from isosample.volume.bricks import Brick
    from isosample.volume.grid import F64, Volume


def extract_brick(
    samples: BrickSamples, isovalues: F64, brick: Brick, volume: Volume, settings: ExtractionSettings
) -> list[BrickMesh]:
    """Return the isosurfaces in one brick that have triangles, in the order of the isovalues.

    Parameters
    ----------
    samples : BrickSamples
    isovalues : (L,) float64
        Strictly ascending.
    brick : Brick
    volume : Volume
        Names the vertices, and tells how triangles are wound in world space.
    settings : ExtractionSettings
    """
    mirrored = volume.geometry.left_handed
    found = zip(isovalues.tolist(), march_levels(samples, isovalues), strict=True)
    if samples.smooth or settings.rounds or settings.detail or settings.residuals:
        meshes = (
            _brick_mesh(samples, isovalue, local, brick, mirrored, settings)
            for isovalue, local in found
            if len(local.triangles)
        )
        return [mesh for mesh in meshes if mesh is not None]
    return [
        BrickMesh(
            isovalue=isovalue,
            brick=brick.index,
            start=brick.start,
            positions=local.positions,
            gradients=local.gradients,
            edge_keys=local.keys,
            triangles=_wound(local.triangles, mirrored),
            residuals=no_residuals(len(local.positions)),
        )
        for isovalue, local in found
        if len(local.triangles)
    ]


def _wound(triangles: I32, mirrored: bool) -> I32:
    """Return triangles wound for world space."""
    return np.ascontiguousarray(triangles[:, [0, 2, 1]]) if mirrored else triangles


def _brick_mesh(
    samples: BrickSamples,
    isovalue: float,
    local: LocalMesh,
    brick: Brick,
    mirrored: bool,
    settings: ExtractionSettings,
) -> BrickMesh | None:
    """Return one isosurface in one brick, vertices named in the whole volume, wound for world space.

    None where there is no such detail.
    """
    positions, gradients, keys, triangles = local.positions, local.gradients, local.keys, local.triangles
    if samples.smooth or settings.rounds or settings.detail:
        named = NamedMesh(positions.astype(np.float64), gradients.astype(np.float64), keys, triangles)
        if samples.smooth or settings.rounds:
            inner = np.flatnonzero(keys >= 3 * samples.sample_count)
            settled = settle_centres(named, samples, isovalue, inner)
            named = refined(settled, samples, isovalue, settings.rounds, settings.flatness)
        if settings.detail:
            coarser = coarsened(named, samples, isovalue, settings.detail)
            if coarser is None:
                return None
            named = coarser
        positions, gradients = named.positions.astype(np.float32), named.gradients.astype(np.float32)
        keys, triangles = named.keys, named.triangles
    residuals, error = no_residuals(len(positions)), None
    if settings.residuals:
        residuals, error = measure(samples, isovalue, positions.astype(np.float64), gradients, triangles)
    return BrickMesh(
        isovalue=isovalue,
        brick=brick.index,
        start=brick.start,
        positions=positions,
        gradients=gradients,
        edge_keys=keys,
        triangles=_wound(triangles, mirrored),
        residuals=residuals,
        error=error,
    )

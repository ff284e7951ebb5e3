"""What all methods of a comparison share, and what is written about it."""

from __future__ import annotations

from dataclasses import fields
from enum import Enum
from typing import TYPE_CHECKING, Any

import numpy as np

from isosample.compare.image_pair import Pixels
from isosample.compare.wood_grain import GRAIN_TILTS, grain_band_shown
from isosample.volume.statistics import histogram

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy.typing as npt

    from isosample.compare.contenders import ComparedScene
    from isosample.rendering.camera import Camera
    from isosample.rendering.settings import RenderSettings
    from isosample.volume.grid import Volume

SWEPT = (
    "classification",
    "step",
    "pixel_scale",
)  # of the ray caster's settings: what an entry has of its own


def grain_band_of(camera: Camera, size: tuple[int, int], volume: Volume) -> tuple[float, float] | None:
    """Frequencies at which steps of one voxel show, cut to what the picture can show [cycles/pixel].

    Parameters
    ----------
    camera : Camera
    size : (width, height)
        Of the picture [pixel].
    volume : Volume

    Returns
    -------
    band : (low, high) or None
        For `wood_grain_energy`: the same band for every method, whatever its step. None where the picture has no such
        frequency: it shows less than a voxel, or the volume is behind the eye.

    Notes
    -----
    In perspective the distance between rays is taken in the middle of the depths at which the volume's box lies in
    front of the eye; where the camera's target lies says nothing about it.
    """
    rays = camera.rays(1.0)
    pixel_size = 2.0 * float(np.linalg.norm(rays.span_up)) / size[1]
    if rays.perspective:
        depths = np.maximum((volume.box.corners() - rays.eye) @ rays.forward, 0.0)
        pixel_size *= float(depths.min() + depths.max()) / 2.0
    return grain_band_shown(step=min(volume.spacing), pixel_size=pixel_size, size=size)


def backdrop_of(background: Sequence[float]) -> tuple[float, float, float]:
    """Opaque linear RGB under the displayed pictures: the background over black."""
    red, green, blue, alpha = background
    return red * alpha, green * alpha, blue * alpha


def shown_share(truth: npt.NDArray[np.float32], render: RenderSettings) -> float:
    """Share of the pixels that show anything of the volume, in [0, 1].

    Parameters
    ----------
    truth : (H, W, 4) float32
        A picture of the reference, premultiplied linear RGBA.
    render : RenderSettings
        With which it was made: a pixel that shows nothing is its background, to the bit.
    """
    empty = np.array(render.background_premultiplied, dtype=np.float32)
    return float((truth != empty).any(axis=-1).mean())


def describe_scene(scene: ComparedScene) -> dict[str, Any]:
    """Volume, transfer function and histogram, JSON-ready."""
    volume = scene.volume
    counts, edges = histogram(volume)
    return {
        "volume": {
            "name": volume.name,
            "samples": list(volume.size_xyz),
            "spacing": list(volume.spacing),
            "dtype": str(volume.array.dtype),
            "bytes": int(volume.array.nbytes),
            "value_range": list(volume.value_range),
        },
        "transfer_function": scene.transfer_function.to_dict(),
        "histogram": {"counts": counts.tolist(), "edges": edges.tolist()},
    }


def describe_conventions(scene: ComparedScene, cameras: Sequence[Camera]) -> dict[str, Any]:
    """Everything that changes a picture and is the same for all methods, JSON-ready."""
    render, raycast = scene.render, scene.raycast
    shared = {field.name: getattr(raycast, field.name) for field in fields(raycast)}
    for name in SWEPT:
        del shared[name]
    return {name: one.value if isinstance(one, Enum) else one for name, one in shared.items()} | {
        "size": list(scene.size),
        "cameras": [camera.to_dict() for camera in cameras],
        "background": list(render.background),
        "backdrop": list(backdrop_of(render.background)),
        "material": None if render.material is None else list(render.material.factors),
        "clip_planes": [[plane.nx, plane.ny, plane.nz, plane.d] for plane in render.clip_planes],
        "stage": render.stage.value,
        "min_transmittance": render.min_transmittance,
        "segment": render.segment.value,
        "details": scene.details,
        "screen_error": render.screen_error,
        "nan_masked": scene.nan_masked,
        "grain_tilts": list(GRAIN_TILTS),
        "grain_bands": [grain_band_of(camera, scene.size, scene.volume) for camera in cameras],
        "pixels_counted": Pixels.ALL.value,
    }

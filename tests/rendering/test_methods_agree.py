"""In the limit all methods agree: many surfaces against the reference, within the sum of the derived errors."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from isosample.rendering.camera import Camera, Projection
from isosample.rendering.pipeline import render
from isosample.rendering.reference_image import render_reference
from isosample.rendering.settings import ClipPlane, RenderSettings
from isosample.transfer.control_points import ControlPoint
from isosample.transfer.transfer_function import TransferFunction
from isosample.volume.analytic import GaussianShell, MarschnerLobb, nucleon_like, sample_field
from rendering.scenes import box_interval

if TYPE_CHECKING:
    import moderngl
    import numpy.typing as npt

    F64 = npt.NDArray[np.float64]

    from isosample.volume.grid import Volume

SIZE = (48, 40)
EXTINCTION = 0.05


def scenes() -> dict[str, Volume]:
    """Three fields on 65³ samples."""
    upper = (40.0, 40.0, 40.0)
    shell = GaussianShell(centre=(20.0, 20.0, 20.0), radius=12.0, width=4.0)
    waves, half = MarschnerLobb(), (0.6, 0.6, 0.6)
    return {
        "nucleon-like": sample_field(
            nucleon_like(), (65,) * 3, lower=(0.0, 0.0, 0.0), upper=upper, name="nucleon"
        ),
        "shell": sample_field(shell, (65,) * 3, lower=(0.0, 0.0, 0.0), upper=upper, name="shell"),
        "Marschner-Lobb": sample_field(waves, (65,) * 3, lower=(-0.6, -0.6, -0.6), upper=half, name="waves"),
    }


def triangle_error(volume: Volume) -> F64:
    """Value by which the field on a triangle between the edges of a cell may miss the isovalue, per cell.

    f = linear + d_xy s t + d_yz t u + d_zx u s + d_xyz s t u in a cell, with mixed second and third differences d. On a
    triangle whose corners lie on the edges, each product misses its linear interpolant by 1/4 at most (s t between two
    corners: (Δs Δt) / 4), and it is three edges away from a corner at most.
    """
    f = volume.array.astype(np.float64)

    def largest(difference: F64) -> F64:
        """Largest of a cell's four parallel second differences."""
        for axis, (have, want) in enumerate(zip(difference.shape, np.array(f.shape) - 1, strict=True)):
            if have > want:
                low, high = (np.take(difference, range(k, have - 1 + k), axis=axis) for k in (0, 1))
                difference = np.maximum(low, high)
        return difference

    pairs = [largest(np.abs(np.diff(np.diff(f, axis=a), axis=b))) for a, b in ((0, 1), (1, 2), (0, 2))]
    triple = np.abs(np.diff(np.diff(np.diff(f, axis=0), axis=1), axis=2))
    return 0.25 * (pairs[0] + pairs[1] + pairs[2] + triple)


def mean_along_rays(cells: F64, volume: Volume, camera: Camera, steps: int = 400) -> tuple[F64, F64]:
    """Mean over each pixel's way through the box of a quantity given per cell, and the length of the way."""
    origins, directions = camera.rays(SIZE[0] / SIZE[1]).origins_and_directions(*SIZE)
    start, end = box_interval(volume.box, origins, directions)
    length = np.maximum(end - np.maximum(start, 0.0), 0.0)
    total = np.zeros(length.shape)
    index_from_world = np.linalg.inv(volume.world_from_index)
    for part in (np.arange(steps) + 0.5) / steps:
        points = origins + (np.maximum(start, 0.0) + part * length)[..., None] * directions
        index = points @ index_from_world[:3, :3].T + index_from_world[:3, 3]
        x, y, z = (
            np.clip(np.nan_to_num(index), 0, np.array(volume.size_xyz) - 2).astype(int).transpose(2, 0, 1)
        )
        total += np.where(length > 0, cells[z, y, x], 0.0)
    return total / steps, length


@pytest.mark.parametrize("name", ["nucleon-like", "shell", "Marschner-Lobb"])
def test_many_surfaces_agree_with_the_reference(gl: moderngl.Context, name: str) -> None:
    del gl
    volume = scenes()[name]
    low, high = volume.value_range
    thickness = volume.box.radius
    # A wide, translucent transfer function: the picture is then smooth in the crossings' places.
    peak = EXTINCTION * 40.0 / thickness
    tf = TransferFunction(
        [
            ControlPoint(low + 0.1 * (high - low), (0.2, 0.4, 1.0), 0.0),
            ControlPoint(high, (1.0, 0.6, 0.1), peak),
        ]
    )
    camera = Camera.orbit(volume.box, azimuth=35, elevation=25, projection=Projection.PERSPECTIVE)
    plane = ClipPlane(0.2, 1.0, 0.1, float(-np.array([0.2, 1.0, 0.1]) @ volume.box.centre + 0.3 * thickness))
    settings = RenderSettings(clip_planes=(plane,), background=(0.2, 0.1, 0.3, 1.0))
    truth = render_reference(volume, tf, camera=camera, size=SIZE, settings=settings).rgba
    band = 0.9 * (high - low) / 65
    picture = render(volume, tf, camera=camera, size=SIZE, per_slope=64, settings=settings)
    # Along a ray both methods see values inside the same band, so they differ by a band's width at most, plus the
    # value by which a flat triangle misses the trilinear field; that over the ray is an error of optical depth, and
    # of a colour in [0, 1] at most as much. Twice for rays through the neighbours of the sampled cells, and twice for
    # cells in which the corners allow two topologies: the mesh may then pass on the other side of the saddle.
    mesh, length = mean_along_rays(triangle_error(volume), volume, camera)
    slope = peak / (0.9 * (high - low))
    bound = slope * (band + 4.0 * mesh) * length + 2e-5
    error = np.abs(picture.rgba - truth).max(axis=-1)
    assert np.all(error <= bound), f"{error.max()}"
    assert np.median(bound[length > 0]) < 0.08
    wrong = TransferFunction([replace(point, extinction=1.5 * point.extinction) for point in tf.points])
    thicker = render(volume, wrong, camera=camera, size=SIZE, per_slope=64, settings=settings)
    assert np.any(np.abs(thicker.rgba - truth).max(axis=-1) > bound)  # the bound can be broken

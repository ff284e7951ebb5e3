"""In the limit all methods agree: many surfaces against the reference, within the sum of the derived errors."""

from __future__ import annotations

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

if TYPE_CHECKING:
    import moderngl

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


def triangle_error(volume: Volume) -> float:
    """Largest value by which the field on a triangle between the edges of a cell may miss the isovalue.

    f = linear + d_xy s t + d_yz t u + d_zx u s + d_xyz s t u in a cell, with mixed second and third differences d. On a
    triangle whose corners lie on the edges, each product misses its linear interpolant by 1/2 at most.
    """
    f = volume.array.astype(np.float64)
    pairs = [np.abs(np.diff(np.diff(f, axis=a), axis=b)).max() for a, b in ((0, 1), (1, 2), (0, 2))]
    triple = np.abs(np.diff(np.diff(np.diff(f, axis=0), axis=1), axis=2)).max()
    return 0.5 * float(sum(pairs) + triple)


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
            ControlPoint(low + 0.05 * (high - low), (0.2, 0.4, 1.0), 0.0),
            ControlPoint(low + 0.95 * (high - low), (1.0, 0.6, 0.1), peak),
        ]
    )
    camera = Camera.orbit(volume.box, azimuth=35, elevation=25, projection=Projection.PERSPECTIVE)
    plane = ClipPlane(0.2, 1.0, 0.1, float(-np.array([0.2, 1.0, 0.1]) @ volume.box.centre + 0.3 * thickness))
    settings = RenderSettings(clip_planes=(plane,), background=(0.2, 0.1, 0.3, 1.0))
    truth = render_reference(volume, tf, camera=camera, size=SIZE, settings=settings).rgba
    band = 0.9 * (high - low) / 65
    picture = render(volume, tf, camera=camera, size=SIZE, per_slope=64, settings=settings)
    error = np.abs(picture.rgba - truth).max()
    # Along a ray both methods see values inside the same band, so they differ by a band's width at most, plus the
    # value by which a flat triangle misses the trilinear field; that over the ray is an error of optical depth, and
    # of a colour in [0, 1] at most as much.
    slope = peak / (0.9 * (high - low))
    error_bound = slope * (band + triangle_error(volume)) * 2.0 * thickness
    assert error <= error_bound < 0.25
    # A bound on the worst pixel says little about the others: the mean is at the accuracy asked of pictures.
    assert np.abs(picture.rgba - truth).mean() < 1.0 / 255
    assert picture.rgba[..., :3].std() > 0.02

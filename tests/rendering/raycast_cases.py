"""What the tests of the ray caster share: its methods, a smooth field with tents, a linear one, and a picture."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from isosample.rendering.camera import Camera, Projection
from isosample.rendering.raycast_settings import (
    Classification,
    Crossings,
    Integration,
    PeakMode,
    PeakWeight,
    Quadrature,
    RaycastSettings,
    TransferLookup,
)
from isosample.rendering.raycaster import raycast
from isosample.transfer.control_points import ControlPoint
from isosample.transfer.transfer_function import TransferFunction
from isosample.volume.analytic import nucleon_like, sample_field
from isosample.volume.grid import Volume

if TYPE_CHECKING:
    from isosample.rendering.image import Image

SIZE = (48, 40)
ROUNDING = (
    2e-5  # of a picture whose rays take some 100 stretches: 100 compositions of 3 roundings of 2^-24 each
)
POST = RaycastSettings(classification=Classification.POST_CLASSIFIED)
PRE = RaycastSettings()
PEAKS = RaycastSettings(classification=Classification.PEAK_FINDING, peak_weight=PeakWeight.INTEGRAL)
METHODS = {
    "integrals over the value": replace(PRE, integration=Integration.TABLE_1D),
    "riemann": replace(POST, quadrature=Quadrature.RIEMANN),
    "trapezoid": POST,
    "pre-integrated": PRE,
    "peaks": PEAKS,
    "peaks, exact crossings": replace(PEAKS, crossings=Crossings.EXACT),
    "peaks alone": replace(PEAKS, peak_mode=PeakMode.PEAK_ONLY),
}
LOOKUPS = {  # show something up to a cell of their table beyond what is visible
    "integrals over the value": METHODS["integrals over the value"],
    "2d": replace(PRE, integration=Integration.TABLE_2D, table_size=12),
    "3d": replace(PRE, integration=Integration.TABLE_3D, table_size=12),
    "sampled": replace(POST, transfer_lookup=TransferLookup.TEXTURE),
    "peaks, sampled": replace(PEAKS, peak_weight=PeakWeight.PAPER, transfer_lookup=TransferLookup.TEXTURE),
}


def nucleon() -> Volume:
    """A smooth field on 33 samples along every axis, of which a tent shows little."""
    return sample_field(
        nucleon_like(), (33,) * 3, lower=(0.0, 0.0, 0.0), upper=(40.0, 40.0, 40.0), name="nucleon"
    )


def tents(volume: Volume, *places: float) -> TransferFunction:
    """Narrow tents at parts of the value range."""
    low, high = volume.value_range
    points = []
    for place, color in zip(places, ((1.0, 0.2, 0.1), (0.1, 0.4, 1.0), (0.2, 1.0, 0.3)), strict=False):
        for part, extinction in ((place - 0.04, 0.0), (place, 0.8), (place + 0.04, 0.0)):
            points.append(ControlPoint(low + part * (high - low), color, extinction))
    return TransferFunction(points)


def inside(volume: Volume) -> Camera:
    """A perspective camera inside the box."""
    eye = tuple(volume.box.centre + np.array([2.0, -3.0, 12.0]))
    return Camera(
        projection=Projection.PERSPECTIVE, eye=eye, target=tuple(volume.box.centre), fov_y_degrees=60.0
    )


def cast(volume: Volume, tf: TransferFunction, own: RaycastSettings, **more: Any) -> Image:
    """A picture of the size of these tests."""
    return raycast(volume, tf, size=SIZE, raycast=own, **more)


def linear_volume() -> Volume:
    """A field without curvature, on an oblique grid of uneven spacing."""
    z, y, x = np.meshgrid(np.arange(9.0), np.arange(12.0), np.arange(15.0), indexing="ij")
    turned = np.array([[0.8, -0.6, 0.0], [0.6, 0.8, 0.0], [0.0, 0.0, 1.0]])
    samples = (10.0 + x + 0.5 * y - 0.7 * z).astype(np.float32)
    return Volume(samples, spacing=(0.5, 1.0, 2.0), origin=(100.0, -20.0, 7.0), direction=turned)

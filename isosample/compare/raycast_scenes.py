"""Scenes of the ray caster's convergence studies, and what its error on them can be at most."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from isosample.compare.study_scenes import TwoTents
from isosample.integral.reference import integrate_rays
from isosample.rendering.camera import Camera, Projection
from isosample.rendering.raycaster import RayCaster
from isosample.rendering.settings import ClipPlane, RenderSettings
from isosample.transfer.control_points import ControlPoint
from isosample.transfer.transfer_function import TransferFunction

if TYPE_CHECKING:
    import numpy.typing as npt

    from isosample.rendering.raycast_settings import RaycastSettings
    from isosample.volume.grid import Volume

    F64 = npt.NDArray[np.float64]

U = 2.0**-24  # unit roundoff of float32
SAMPLES = 25  # along an edge of the grid
BLUE, GOLD = (0.1, 0.3, 1.0), (1.0, 0.7, 0.1)
RAMP_EXTINCTIONS = (0.01, 0.12)  # at the values 0 and the largest [1/world]
PEAK = 0.5  # share of the largest value
PEAK_AREA = (
    0.06  # extinction times share of the peak [1/world]: opacities around a half where the slope is usual
)
TENTS = TwoTents()  # the field, its box and the view of it


@dataclass(frozen=True)
class RaycastScene:
    """The nucleon-like field on a coarse grid, cut through its middle, under one transfer function.

    The cut is what tells a rule of order 1 from one of order 2: where the extinction is 0 at both ends of a ray,
    the sums of both are the same.
    """

    transfer_function: TransferFunction
    pixels: int
    perspective: bool = False

    @cached_property
    def volume(self) -> Volume:
        """The samples."""
        return TENTS.sampled(SAMPLES)

    @property
    def camera(self) -> Camera:
        """The view of the two tents, or the same in perspective."""
        kind = Projection.PERSPECTIVE if self.perspective else Projection.ORTHOGRAPHIC
        return Camera.orbit(TENTS.box, azimuth=31, elevation=23, zoom=TENTS.zoom, projection=kind)

    @cached_property
    def settings(self) -> RenderSettings:
        """The cut, and no ray that ends early."""
        forward = np.asarray(TENTS.camera.target) - np.asarray(TENTS.camera.eye)
        x, y, z = forward.tolist()
        plane = ClipPlane(x, y, z, float(-forward @ TENTS.box.centre))
        return RenderSettings(clip_planes=(plane,), min_transmittance=0.0)

    @cached_property
    def truth(self) -> F64:
        """The float64 reference, (N, 4)."""
        planes = [(plane.nx, plane.ny, plane.nz, plane.d) for plane in self.settings.clip_planes]
        rays = self.camera.rays(1.0).origins_and_directions(self.pixels, self.pixels)
        origins, directions = (part.reshape(-1, 3) for part in rays)
        return integrate_rays(self.volume, self.transfer_function, origins, directions, clip_planes=planes)

    def picture(self, raycast: RaycastSettings) -> F64:
        """The ray caster's picture, (N, 4)."""
        with RayCaster(self.volume, self.transfer_function, raycast=raycast) as caster:
            image = caster.render(camera=self.camera, size=(self.pixels, self.pixels), settings=self.settings)
        return image.rgba.reshape(-1, 4).astype(np.float64)


def ramp(pixels: int, *, perspective: bool = False) -> RaycastScene:
    """Extinction and colour linear in the value: nothing but the course of the data is sampled."""
    top = TENTS.scale
    low, high = RAMP_EXTINCTIONS
    return RaycastScene(
        TransferFunction([ControlPoint(0.0, BLUE, low), ControlPoint(1.05 * top, GOLD, high)]),
        pixels,
        perspective,
    )


def near_dirac(pixels: int, width: float) -> RaycastScene:
    """A peak of the given half width (share of the largest value) beside a wide tent of another colour.

    The peak's area, and with it its opacity, is the same for every width.
    """
    top = TENTS.scale
    rows = [
        (0.1, BLUE, 0.0),
        (0.2, BLUE, 0.05),
        (0.3, BLUE, 0.0),
        (PEAK - width, GOLD, 0.0),
        (PEAK, GOLD, PEAK_AREA / width),
        (PEAK + width, GOLD, 0.0),
    ]
    return RaycastScene(TransferFunction([ControlPoint(top * v, color, e) for v, color, e in rows]), pixels)


def ramp_bound(scene: RaycastScene, step: float) -> float:
    r"""Largest error that straight stretches of `step` voxels and float32 can make of the ramp's picture.

    Notes
    -----
    All methods take the data between two samples for a straight line there (post-classification by the trapezoid
    rule: extinction and colour too, which the ramp makes the same). Along a ray of unit direction the interpolant
    has :math:`|f''| \le 2 m` inside a cell (mixed differences at most m, and
    :math:`|d_x d_y| + |d_y d_z| + |d_z d_x| \le 1`), and its slope jumps by at most :math:`j |d_x|` at a face across
    x (second differences along an axis at most j), of which there are :math:`|d_x|` per voxel of the ray: by j per
    voxel in all, as :math:`d \cdot d = 1`, and by what three more faces at the ends add. Between the line and the
    data lie :math:`h^2 f'' / 12` per length, and :math:`h^2 / 8` times each jump. With :math:`\sigma = d\tau/dv` and
    :math:`\gamma = |dc/dv|` the integral changes by at most :math:`2 \sigma + \gamma \tau_{max}` per length and
    value. The cut leaves half of every chord of the box.

    Float32: a position is a sum of about 16 rounded products of numbers up to the distance from the eye, so that
    the data are read off by the field's largest slope times :math:`16 u \cdot distance`, and round themselves by
    16 u; compositing rounds radiance and transmittance four times per stretch each, weighted by what is left.
    """
    samples = np.asarray(scene.volume.array, np.float64)
    voxel = float(min(scene.volume.spacing))
    span = float(np.ptp(scene.volume.value_range))
    mixed = max(
        float(np.abs(np.diff(np.diff(samples, axis=a), axis=b)).max()) for a, b in ((0, 1), (1, 2), (0, 2))
    )
    jump = max(float(np.abs(np.diff(samples, n=2, axis=axis)).max()) for axis in range(3))
    slope = max(float(np.abs(np.diff(samples, axis=axis)).max()) for axis in range(3)) * 3**0.5 / voxel
    length = scene.volume.box.radius
    low, high = (point.extinction for point in scene.transfer_function.points)
    values = scene.transfer_function.points[-1].value - scene.transfer_function.points[0].value
    color = float(np.abs(np.subtract(GOLD, BLUE)).max())
    per_value = 2.0 * (high - low) / values + high * color / values
    h = step * voxel
    jumps = jump * (length / voxel**2 + 3.0 / voxel)
    straight = h * h * (length * 2.0 * mixed / voxel**2 / 12.0 + jumps / 8.0)
    eye = float(np.linalg.norm(np.subtract(TENTS.camera.eye, TENTS.box.centre)))
    read = length * (slope * 16 * U * (eye + length) + 16 * U * span)
    stretches = length / h + 1.0
    return per_value * (straight + read) + 8.0 * stretches * U

"""Closed-form scenes of the convergence studies."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from isosample.gl.context import shared_context
from isosample.rendering.abuffer import ABuffer
from isosample.rendering.camera import Camera, Projection
from isosample.rendering.scene import Scene
from isosample.rendering.settings import RenderSettings
from isosample.surfaces.extract import extract_surfaces
from isosample.transfer.control_points import ControlPoint, Isosurface
from isosample.transfer.isovalues import plan_isovalues
from isosample.transfer.transfer_function import TransferFunction
from isosample.volume.analytic import nucleon_like, sample_field
from isosample.volume.geometry import Box
from isosample.volume.grid import Volume

if TYPE_CHECKING:
    from isosample.rendering.frame_statistics import FrameStatistics
    from isosample.transfer.isovalue_plan import IsovaluePlan

F64 = npt.NDArray[np.float64]

EDGE = 40.0  # world units of the nucleon-like field's box
VALUE_RANGE = (0.0, 1.05)  # holds the field's values, and does not change with the grid


@dataclass(frozen=True)
class TwoTents:
    """A nucleon-like field under two tents, as figure 4 of Lindholm et al., seen obliquely."""

    zoom: float = 1.5

    @cached_property
    def box(self) -> Box:
        """The field's box."""
        return Box(corner=np.zeros(3), edges=EDGE * np.eye(3))

    @cached_property
    def scale(self) -> float:
        """Largest value of the field, from a fine grid."""
        return self.sampled(81).value_range[1]

    @cached_property
    def transfer_function(self) -> TransferFunction:
        """A wide translucent tent and a narrower, denser one."""
        blue, gold = (0.1, 0.3, 1.0), (1.0, 0.7, 0.1)
        rows = [(0.15, blue, 0.0), (0.3, blue, 0.3), (0.45, blue, 0.0)]
        rows += [(0.5, gold, 0.0), (0.65, gold, 0.8), (0.8, gold, 0.0)]
        return TransferFunction([ControlPoint(self.scale * v, color, e) for v, color, e in rows])

    @cached_property
    def camera(self) -> Camera:
        """Orthographic, so that the step between rays is the same everywhere."""
        return Camera.orbit(self.box, azimuth=31, elevation=23, zoom=self.zoom)

    def plan(self, per_slope: int) -> IsovaluePlan:
        """Isovalues with so many values inside each slope."""
        low, high = VALUE_RANGE
        return plan_isovalues(self.transfer_function, (low, high * self.scale), per_slope=per_slope)

    def sampled(self, edge: int) -> Volume:
        """The field on a grid of edge³ samples."""
        upper = (EDGE, EDGE, EDGE)
        return sample_field(
            nucleon_like(), (edge,) * 3, lower=(0.0, 0.0, 0.0), upper=upper, name="nucleon-like"
        )

    def rays(self, edge: int) -> tuple[F64, F64]:
        """Origins and directions of edge² rays, (N, 3) each."""
        origins, directions = self.camera.rays(1.0).origins_and_directions(edge, edge)
        return origins.reshape(-1, 3), directions.reshape(-1, 3)

    def picture(
        self, samples: int, pixels: int, per_slope: int, settings: RenderSettings | None = None
    ) -> F64:
        """Data-centric picture, (N, 4) float64, of the field on a grid of samples³."""
        plan = self.plan(per_slope)
        scene = Scene.build(extract_surfaces(self.sampled(samples), plan.isovalues), plan)
        return draw(scene, self.camera, (pixels, pixels), settings)[0].reshape(-1, 4)


def draw(
    scene: Scene, camera: Camera, size: tuple[int, int], settings: RenderSettings | None = None
) -> tuple[F64, FrameStatistics]:
    """Picture by the A-buffer, in float64."""
    with ABuffer(shared_context(), scene) as abuffer:
        rgba, statistics = abuffer.render(camera, size, settings or RenderSettings())
    return rgba.astype(np.float64), statistics


def layers(count: int, opacity: float) -> tuple[Scene, Camera, F64]:
    """So many impulse planes that cover the picture, the view of them, and the closed form of every pixel."""
    volume = Volume(np.broadcast_to(np.array([0.0, 1.0])[:, None, None], (2, 2, 2)), name="layers")
    values = (np.arange(count) + 1.0) / (count + 1.0)
    surfaces = [Isosurface(v, (v, 1.0 - v, 0.5), opacity) for v in values.tolist()]
    plan = plan_isovalues(TransferFunction([], surfaces), volume.value_range)
    eye, target = (0.5, 0.5, 3.0), (0.5, 0.5, 0.5)
    camera = Camera(projection=Projection.ORTHOGRAPHIC, eye=eye, target=target, height=0.5)
    weights = opacity * (1.0 - opacity) ** np.arange(count)
    color = weights @ np.stack([values, 1.0 - values, np.full(count, 0.5)], axis=1)[::-1]
    expected = np.array([*color, -np.expm1(count * np.log1p(-opacity))])
    return Scene.build(extract_surfaces(volume, plan.isovalues), plan), camera, expected


def smooth_window() -> tuple[Scene, Camera, F64]:
    """A window inside a slab whose extinction grows to the right, the view of it, and the picture's mean.

    The field is x on the unit cube, the extinction 4 x, the colour runs from red to blue: along the view the ray
    sees constant extinction, so a pixel at x is (1 − exp(−4 x)) c(x), and the mean over x is taken by 20 Gauss nodes.
    """
    x = np.linspace(0.0, 1.0, 3)
    volume = Volume(np.broadcast_to(x, (3, 3, 3)), spacing=(0.5, 0.5, 0.5), name="window")
    red, blue = (1.0, 0.25, 0.0), (0.0, 0.5, 1.0)
    plan = plan_isovalues(
        TransferFunction([ControlPoint(0.0, red, 0.0), ControlPoint(1.0, blue, 4.0)]), volume.value_range
    )
    eye, target = (0.5, 0.5, 3.0), (0.5, 0.5, 0.5)
    camera = Camera(projection=Projection.ORTHOGRAPHIC, eye=eye, target=target, height=0.5)
    nodes, weights = np.polynomial.legendre.leggauss(20)
    places = 0.5 + 0.25 * nodes
    color = (1.0 - places)[:, None] * red + places[:, None] * np.array(blue)
    alpha = -np.expm1(-4.0 * places)
    mean = 0.5 * weights @ (alpha[:, None] * np.concatenate([color, np.ones((20, 1))], axis=1))
    return Scene.build(extract_surfaces(volume, plan.isovalues), plan), camera, mean

"""What the pictures of docs/raycasting.md show: scenes, and the panels that compare methods on them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from benchmarks.accuracy_scenes import BLUE, GOLD, RED, SCANS, TEAL, WHITE
from isosample.compare.differences import rmse
from isosample.rendering.camera import Camera, Projection
from isosample.rendering.raycast_settings import (
    SMALLEST_PIXEL_SCALE,
    Classification,
    Crossings,
    Integration,
    PeakWeight,
    RaycastSettings,
    Sampling,
)
from isosample.rendering.raycaster import RayCaster
from isosample.rendering.reference_image import render_reference
from isosample.rendering.settings import Material, RenderSettings
from isosample.transfer.control_points import ControlPoint, Isosurface
from isosample.transfer.transfer_function import TransferFunction
from isosample.volume.analytic import nucleon_like, sample_field
from isosample.volume.readers import open_volume

if TYPE_CHECKING:
    from collections.abc import Callable

    from isosample.rendering.image import Image
    from isosample.volume.grid import F64, Volume

PIXELS = 260
REFERENCE_TOLERANCE = 1e-6  # far below what 8 bits show
HALF_WIDTH = 1e-4  # of the near-Dirac peak, as in the paper's figure 3
WARM_FRAMES = 3  # of which the fastest is told
HALVINGS = 10  # of the range of s_k: to 1 %
ANEURISM, ANEURISM_DISTANCE = (
    (110.0, 106.0, 160.0),
    45.0,
)  # its centre, and the eye's distance in the close-up

POST = RaycastSettings(classification=Classification.POST_CLASSIFIED, step=1.0)
TABLE = RaycastSettings(
    classification=Classification.PRE_INTEGRATED, integration=Integration.TABLE_2D, step=1.0
)
PIECES = replace(TABLE, integration=Integration.EXACT)
PAPER = RaycastSettings(classification=Classification.PEAK_FINDING, step=1.0)
SHARES = replace(PAPER, peak_weight=PeakWeight.INTEGRAL, crossings=Crossings.EXACT)
LIT = RenderSettings(material=Material())


def samples_per_ray(image: Image) -> float:
    """Field evaluations of the sampling, mean over the rays."""
    return float(image.stats["samples_per_ray"]["mean"])


@dataclass(frozen=True, eq=False)
class Panel:
    """A picture, its name, and a line of figures about it."""

    title: str
    figures: str
    rgba: F64


@dataclass(frozen=True, eq=False)
class PictureScene:
    """A volume, a transfer function, a view, and the reference's picture of them."""

    volume: Volume
    transfer_function: TransferFunction
    camera: Camera
    truth: F64

    @classmethod
    def of(cls, volume: Volume, tf: TransferFunction, camera: Camera) -> PictureScene:
        """The scene with its reference."""
        truth = render_reference(
            volume, tf, camera=camera, size=(PIXELS, PIXELS), tolerance=REFERENCE_TOLERANCE
        )
        return cls(volume, tf, camera, truth.rgba.astype(np.float64))

    def picture(self, raycast: RaycastSettings, *, frames: int = 1) -> Image:
        """The ray caster's picture; of several frames the fastest."""
        size = (PIXELS, PIXELS)
        with RayCaster(self.volume, self.transfer_function, raycast=raycast) as caster:
            images = [caster.render(camera=self.camera, size=size) for _ in range(frames)]
        return min(images, key=lambda image: image.stats["seconds"]["render"])

    def error(self, image: Image) -> float:
        """RMSE against the reference."""
        return rmse(image.rgba.astype(np.float64), self.truth)

    def panel(self, title: str, raycast: RaycastSettings) -> Panel:
        """A ray caster's picture and its RMSE."""
        image = self.picture(raycast)
        return Panel(title, f"RMSE {self.error(image):.2g}", image.rgba.astype(np.float64))

    def costed_panel(self, title: str, image: Image) -> Panel:
        """A picture with its RMSE, its samples and its seconds."""
        cost = f"{samples_per_ray(image):.1f} samples per ray, {image.stats['seconds']['render']:.2f} s"
        return Panel(title, f"RMSE {self.error(image):.2g}, {cost}", image.rgba.astype(np.float64))

    def matching_scale(self, measure: Callable[[Image], float], wanted: float) -> float:
        """The s_k of differential sampling at which a measure has the wanted value, by halving."""
        low, high = SMALLEST_PIXEL_SCALE, 64.0
        differential = replace(POST, sampling=Sampling.DIFFERENTIAL)
        rising = measure(self.picture(replace(differential, pixel_scale=high))) > wanted
        for _ in range(HALVINGS):
            middle = (low * high) ** 0.5
            above = measure(self.picture(replace(differential, pixel_scale=middle))) > wanted
            low, high = (low, middle) if above == rising else (middle, high)
        return high

    def reference_panel(self) -> Panel:
        """The reference."""
        return Panel("reference", "float64", self.truth)


def dirac_panels() -> list[Panel]:
    """A near-Dirac peak in gold and a wide tent in blue, one sample per voxel."""
    scene = PictureScene.of(_nucleon(), _dirac(opacity=0.5), _whole())
    return [
        scene.panel("post-classified", POST),
        scene.panel("pre-integrated, 2-D table of 256²", TABLE),
        scene.panel("pre-integrated, exactly", PIECES),
        scene.panel("peak finding as in the paper", PAPER),
        scene.panel("peak finding, integral, exact crossings", SHARES),
        scene.reference_panel(),
    ]


def moire_panels() -> list[Panel]:
    """The peak alone, lit, from near: shaded at the end of a segment, or at the crossing."""
    volume, tf = _nucleon(), TransferFunction([], [Isosurface(0.5, GOLD, 1.0)])
    camera = Camera.orbit(volume.box, azimuth=31, elevation=23, zoom=4.0)
    panels = []
    for title, raycast in {
        "pre-integrated, 2-D table of 256²": replace(TABLE, step=2.0),
        "peak finding, 3 secant steps": replace(PAPER, step=2.0),
        "peak finding, exact crossings": replace(SHARES, step=2.0),
    }.items():
        with RayCaster(volume, tf, raycast=raycast) as caster:
            image = caster.render(camera=camera, size=(PIXELS, PIXELS), settings=LIT)
        panels.append(Panel(title, "lit, steps of 2 voxels", image.rgba.astype(np.float64)))
    return panels


def neighbour_panels() -> list[Panel]:
    """Four isosurfaces within a tenth of the range, two voxels per step."""
    surfaces = [
        Isosurface(0.45 + 0.03 * place, color, 0.35) for place, color in enumerate((BLUE, TEAL, GOLD, RED))
    ]
    scene = PictureScene.of(_nucleon(), TransferFunction([], surfaces), _whole())
    steps = replace(PAPER, step=2.0)
    return [
        scene.panel("--peaks 1", steps),
        scene.panel("--peaks 4", replace(steps, peaks=4)),
        scene.panel("--crossings exact", replace(steps, crossings=Crossings.EXACT)),
        scene.reference_panel(),
    ]


def noise_panels() -> list[Panel]:
    """Two narrow peaks over the scan of an embryo, a sample every two voxels."""
    volume = open_volume(SCANS / "embryo.nrrd")
    rows = [(40.0, TEAL, 0.0), (44.0, TEAL, 0.15), (48.0, TEAL, 0.0)]
    rows += [(100.0 - 1.0, WHITE, 0.0), (100.0, WHITE, 4.0), (100.0 + 1.0, WHITE, 0.0)]
    tf = TransferFunction([ControlPoint(*row) for row in rows])
    camera = Camera.orbit(volume.box, azimuth=120, elevation=15, zoom=2.2)
    scene = PictureScene.of(volume, tf, camera)
    sparse = {
        name: replace(raycast, step=2.0)
        for name, raycast in {"post": POST, "table": TABLE, "paper": PAPER, "shares": SHARES}.items()
    }
    return [
        scene.panel("post-classified, steps of 2 voxels", sparse["post"]),
        scene.panel("pre-integrated, 2-D table of 256²", sparse["table"]),
        scene.panel("post-classified, steps of 1/8 voxel", replace(POST, step=0.125)),
        scene.panel("peak finding as in the paper, 4 peaks", replace(sparse["paper"], peaks=4)),
        scene.panel("peak finding, integral, exact crossings", sparse["shares"]),
        scene.reference_panel(),
    ]


def sampling_panels(*, near: bool) -> list[Panel]:
    """An aneurism: even steps, and differential ones for as many samples, and for the same error."""
    volume = open_volume(SCANS / "aneurism.raw.gz", shape=(256, 256, 256), dtype="uint8")
    rows = [(50.0, RED, 0.0), (70.0, RED, 0.5), (90.0, RED, 0.0)]
    rows += [(130.0, GOLD, 0.0), (150.0, GOLD, 1.5), (170.0, GOLD, 0.0)]
    tf = TransferFunction([ControlPoint(*row) for row in rows])
    camera = Camera.orbit(volume.box, azimuth=30, elevation=20, zoom=1.5, projection=Projection.PERSPECTIVE)
    if near:
        eye = np.array(ANEURISM) + ANEURISM_DISTANCE * np.array([-1.0, 1.0, 0.0]) / 2**0.5
        camera = Camera(
            projection=Projection.PERSPECTIVE, eye=tuple(eye.tolist()), target=ANEURISM, fov_y_degrees=60.0
        )
    scene = PictureScene.of(volume, tf, camera)
    uniform = scene.picture(POST, frames=WARM_FRAMES)
    where = "close up" if near else "from afar"
    panels = [scene.costed_panel(f"{where}: even steps of 1 voxel", uniform)]
    for same, measure in (("samples", samples_per_ray), ("RMSE", scene.error)):
        scale = scene.matching_scale(measure, measure(uniform))
        raycast = replace(POST, sampling=Sampling.DIFFERENTIAL, pixel_scale=scale)
        title = f"{where}: differential, same {same}: s_k = {scale:.2g}"
        panels.append(scene.costed_panel(title, scene.picture(raycast, frames=WARM_FRAMES)))
    return [*panels, scene.reference_panel()]


def weight_panels() -> list[Panel]:
    """The peak alone: the opacity of its height, of its share of the integral, and the integral."""
    scene = PictureScene.of(_nucleon(), _dirac(opacity=0.0), _whole())
    return [
        scene.panel("--peak-weight paper", PAPER),
        scene.panel("--peak-weight integral", replace(PAPER, peak_weight=PeakWeight.INTEGRAL)),
        scene.reference_panel(),
    ]


def _nucleon() -> Volume:
    return sample_field(nucleon_like(), (65,) * 3, lower=(0.0,) * 3, upper=(40.0,) * 3, name="nucleon-like")


def _whole() -> Camera:
    return Camera.orbit(_nucleon().box, azimuth=31, elevation=23, zoom=1.7)


def _dirac(*, opacity: float) -> TransferFunction:
    """A peak of half width 1e-4 at 0.5, and a wide tent with a multiple of the given extinction."""
    rows = [(0.5 - HALF_WIDTH, GOLD, 0.0), (0.5, GOLD, 0.04 / HALF_WIDTH), (0.5 + HALF_WIDTH, GOLD, 0.0)]
    wide = [(0.1, BLUE, 0.0), (0.2, BLUE, 0.2 * opacity), (0.3, BLUE, 0.0)]
    return TransferFunction([ControlPoint(*row) for row in [*(wide if opacity else []), *rows]])

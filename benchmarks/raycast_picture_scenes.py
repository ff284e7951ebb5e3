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
HALF_WIDTH, WIDE = 1e-4, 2e-2  # of the near-Dirac peak, as in the paper's figure 3, and of a wider one
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

    def picture(self, raycast: RaycastSettings) -> Image:
        """The ray caster's picture."""
        with RayCaster(self.volume, self.transfer_function, raycast=raycast) as caster:
            return caster.render(camera=self.camera, size=(PIXELS, PIXELS))

    def error(self, image: Image) -> float:
        """RMSE against the reference."""
        return rmse(image.rgba.astype(np.float64), self.truth)

    def panel(self, title: str, raycast: RaycastSettings) -> Panel:
        """A ray caster's picture and its RMSE."""
        image = self.picture(raycast)
        return Panel(title, f"RMSE {self.error(image):.2g}", image.rgba.astype(np.float64))

    def costed_panel(self, title: str, image: Image) -> Panel:
        """A picture with its RMSE and its samples."""
        figures = f"RMSE {self.error(image):.2g}, {samples_per_ray(image):.1f} samples per ray"
        return Panel(title, figures, image.rgba.astype(np.float64))

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
    scene = PictureScene.of(_nucleon(), _peak(HALF_WIDTH, 0.04, beside=True), _whole())
    secant = replace(PAPER, peak_weight=PeakWeight.INTEGRAL)
    return [
        scene.panel("post-classified", POST),
        scene.panel("pre-integrated, table of 256²", TABLE),
        scene.panel("the same, steps of 1/8 voxel", replace(TABLE, step=0.125)),
        scene.panel("pre-integrated, exactly", PIECES),
        scene.panel("peak finding as in the paper", PAPER),
        scene.panel("peak finding, integral", secant),
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
        Isosurface(0.45 + 0.03 * place, color, 0.6) for place, color in enumerate((BLUE, TEAL, GOLD, RED))
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
    """Tissue of an embryo: even steps, and differential ones for as many samples, and for the same error."""
    volume = open_volume(SCANS / "embryo.nrrd")
    rows = [(18.0, BLUE, 0.0), (30.0, TEAL, 0.15), (45.0, GOLD, 0.03), (60.0, RED, 0.3)]
    rows += [(80.0, WHITE, 0.075), (120.0, WHITE, 0.15)]
    tf = TransferFunction([ControlPoint(*row) for row in rows])
    middle = (128.0, 129.0, 130.0)
    camera = Camera(
        projection=Projection.PERSPECTIVE,
        eye=(128.0, 128.0, 10.0 if near else -700.0),
        target=middle,
        up=(1.0, 0.0, 0.0),
        fov_y_degrees=60.0 if near else 17.0,
    )
    scene = PictureScene.of(volume, tf, camera)
    even = replace(POST, step=2.0)
    uniform = scene.picture(even)
    where = "close up" if near else "from afar"
    panels = [scene.costed_panel(f"{where}: even steps of {even.step:g} voxels", uniform)]
    for same, measure in (("samples", samples_per_ray), ("RMSE", scene.error)):
        scale = scene.matching_scale(measure, measure(uniform))
        raycast = replace(POST, sampling=Sampling.DIFFERENTIAL, pixel_scale=scale)
        title = f"{where}: differential, same {same}: s_k = {scale:.2g}"
        panels.append(scene.costed_panel(title, scene.picture(raycast)))
    return [*panels, scene.reference_panel()]


def weight_panels(half_width: float) -> list[Panel]:
    """A peak alone: the opacity of its height, of its share of the integral, and the integral."""
    scene = PictureScene.of(_nucleon(), _peak(half_width, 0.02), _whole())
    return [
        scene.panel(f"half width {half_width:g}: --peak-weight paper", PAPER),
        scene.panel("--peak-weight integral", replace(PAPER, peak_weight=PeakWeight.INTEGRAL)),
        scene.reference_panel(),
    ]


def _nucleon() -> Volume:
    return sample_field(nucleon_like(), (65,) * 3, lower=(0.0,) * 3, upper=(40.0,) * 3, name="nucleon-like")


def _whole() -> Camera:
    return Camera.orbit(_nucleon().box, azimuth=31, elevation=23, zoom=1.7)


def _peak(half_width: float, area: float, *, beside: bool = False) -> TransferFunction:
    """A peak of a given area at 0.5 [value/world], and, with `beside`, a wide tent."""
    rows = [
        (0.5 - half_width, GOLD, 0.0),
        (0.5, GOLD, area / half_width),
        (0.5 + half_width, GOLD, 0.0),
    ]
    wide = [(0.1, BLUE, 0.0), (0.2, BLUE, 0.1), (0.3, BLUE, 0.0)]
    return TransferFunction([ControlPoint(*row) for row in [*(wide if beside else []), *rows]])

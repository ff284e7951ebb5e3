"""Differential against uniform sampling from inside volumes, judged by single rays and by what a pixel covers."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from benchmarks import accuracy_scenes
from benchmarks.machine import table
from benchmarks.raycast_curves import Curve, Point
from benchmarks.raycast_scenes import RaycastScene, close_up, nucleon_tents, scans
from isosample.rendering.camera import Camera, Projection
from isosample.rendering.raycast_settings import (
    Classification,
    Crossings,
    PeakWeight,
    RaycastSettings,
    Sampling,
)
from isosample.rendering.raycaster import RayCaster
from isosample.transfer.transfer_function import ControlPoint, TransferFunction
from isosample.volume.grid import Volume
from isosample.volume.readers import open_volume

if TYPE_CHECKING:
    from collections.abc import Iterator

    import numpy.typing as npt

    F64 = npt.NDArray[np.float64]

RAYS = 4  # per pixel and axis: of the reference of a pixel's footprint, and of the pictures that are averaged
PIXEL_SCALES = (4.0, 2.0, 1.0)  # s_k of the paper
STEPS = (8.0, 4.0, 2.0, 1.0, 0.5, 0.25, 0.125)
TENTS, HALF_WIDTH = 12, 0.01  # of the dense transfer function; part of the value range
DEPTH = 40.0  # of the way of the box's radius, if all values were as frequent
FOV = 90.0
TRUTH = RaycastSettings(
    classification=Classification.PEAK_FINDING,
    peak_weight=PeakWeight.INTEGRAL,
    crossings=Crossings.EXACT,
    step=4.0,
)
METHODS = {
    "post-classified": Classification.POST_CLASSIFIED,
    "pre-integrated": Classification.PRE_INTEGRATED,
}
MEASURES = ("by rays", "one ray by pixels", "16 rays by pixels")


@dataclass(frozen=True)
class Truths:
    """What pictures are compared with: the picture itself, ray by ray, and the mean over every pixel."""

    rays: F64
    pixels: F64

    @classmethod
    def of(cls, scene: RaycastScene, size: int) -> Truths:
        """By exact crossings, within 1e-6 of the float64 reference."""
        return cls(picture(scene, TRUTH, size)[0], averaged(picture(scene, TRUTH, RAYS * size)[0]))

    def errors(self, single: F64, many: F64) -> tuple[float, ...]:
        """RMSE by the measures, of a picture of one ray per pixel and of one with `RAYS` squared."""
        pairs = ((single, self.rays), (single, self.pixels), (averaged(many), self.pixels))
        return tuple(float(np.sqrt(np.mean((found - truth) ** 2))) for found, truth in pairs)


def close_ups(*, quick: bool) -> Iterator[str]:
    """Samples per ray for the same error, by three ways to take the error."""
    size = 64 if quick else 96
    yield f"### Differential sampling from inside a volume, {size}²\n"
    yield (
        "Uniform samples per ray at the error of differential sampling, between measured steps by straight lines in "
        "log-log, and the ratio of the samples. By rays: RMSE of the picture, a ray per pixel, against the same rays. "
        f"By pixels: against the mean of {RAYS}×{RAYS} rays per pixel, of a picture of one ray per pixel (whose error "
        f"ends at its aliasing) and of the mean of {RAYS}×{RAYS}. References by exact crossings. Dense: {TENTS} tents "
        f"of ± {100 * HALF_WIDTH:g} % of the range. Depth: mean of −log(1 − opacity), of which rays that end count "
        "13.8.\n"
    )
    rows = [row for scene in scenes() for row in _rows(scene, size)]
    heads = ["scene", "depth", "aliasing", "method", "s_k", "samples"]
    yield table([*heads, *(f"{measure}: RMSE, uniform, ratio" for measure in MEASURES)], rows)


def scenes() -> Iterator[RaycastScene]:
    """Dense ones, with detail at the eye and without; and a sparse one."""
    middle = (0.5, 0.5, 0.5)
    for scene in scans("embryo (noisy)", "engine"):
        yield inside(scene.name, scene.volume, middle, (0.6, 0.9, 0.55))
    yield inside("nucleon-like 128³", nucleon_tents().volume, (0.5, 0.3, 0.5), (0.5, 0.8, 0.5))
    path = accuracy_scenes.SCANS / "head_ct.nii.gz"
    if path.is_file():
        opened = open_volume(path)
        head = Volume(np.ascontiguousarray(opened.array), spacing=opened.spacing, name="head")
        yield inside("head CT (even at the eye)", head, middle, (0.5, 1.0, 0.6))
    for scene in scans("aneurism"):
        yield scene.looked_at("sparse, close-up", close_up(scene))


def inside(
    name: str, volume: Volume, eye: tuple[float, float, float], target: tuple[float, float, float]
) -> RaycastScene:
    """A dense scene; places in parts of the box's edges."""
    at, towards = (
        tuple((volume.box.centre + (np.array(place) - 0.5) @ volume.box.edges).tolist())
        for place in (eye, target)
    )
    camera = Camera(
        projection=Projection.PERSPECTIVE, eye=at, target=towards, up=(0.0, 0.0, 1.0), fov_y_degrees=FOV
    )
    return RaycastScene(f"{name}, dense", volume, dense(volume), camera)


def dense(volume: Volume) -> TransferFunction:
    """Narrow tents over the range of values, of two colours in turn."""
    low, high = volume.value_range
    peak = DEPTH / volume.box.radius / (TENTS * HALF_WIDTH)
    points = []
    for number in range(TENTS):
        centre = 0.03 + 0.97 * (number + 0.5) / TENTS
        color = accuracy_scenes.BLUE if number % 2 else accuracy_scenes.GOLD
        for part, extinction in ((-HALF_WIDTH, 0.0), (0.0, peak), (HALF_WIDTH, 0.0)):
            points.append(ControlPoint(low + (centre + part) * (high - low), color, extinction))
    return TransferFunction(points)


def picture(scene: RaycastScene, settings: RaycastSettings, size: int) -> tuple[F64, float]:
    """The picture (size, size, 4), and its samples per ray."""
    with RayCaster(scene.volume, scene.transfer_function, raycast=settings) as caster:
        image = caster.render(camera=scene.camera, size=(size, size))
    return image.rgba.astype(np.float64), image.stats["samples_per_ray"]["mean"]


def averaged(rays: F64) -> F64:
    """Means over the rays of every pixel."""
    edge = rays.shape[0] // RAYS
    means: F64 = rays.reshape(edge, RAYS, edge, RAYS, 4).mean(axis=(1, 3))
    return means


def _rows(scene: RaycastScene, size: int) -> Iterator[tuple[str, ...]]:
    truths = Truths.of(scene, size)
    depth = float(-np.log(np.maximum(1.0 - truths.rays[..., 3], 1e-6)).mean())
    aliasing = float(np.sqrt(np.mean((truths.rays - truths.pixels) ** 2)))
    for name, method in METHODS.items():
        curves = [Curve() for _ in MEASURES]
        for step in STEPS:
            settings = RaycastSettings(classification=method, step=step)
            samples, errors = _measured(scene, settings, settings, truths, size)
            for curve, error in zip(curves, errors, strict=True):
                curve.points.append(Point(step, 0.0, error, 0.0, samples=samples))
        for scale in PIXEL_SCALES:
            one, many = (
                RaycastSettings(
                    classification=method, sampling=Sampling.DIFFERENTIAL, pixel_scale=scale * rays
                )
                for rays in (1, RAYS)  # of as many rays the same distances
            )
            samples, errors = _measured(scene, one, many, truths, size)
            cells = [_cell(curve, error, samples) for curve, error in zip(curves, errors, strict=True)]
            head = (scene.name, f"{depth:.1f}", f"{aliasing:.1e}", name, f"{scale:g}", f"{samples:.0f}")
            yield (*head, *cells)


def _measured(
    scene: RaycastScene, one: RaycastSettings, many: RaycastSettings, truths: Truths, size: int
) -> tuple[float, tuple[float, ...]]:
    single, samples = picture(scene, one, size)
    return samples, truths.errors(single, picture(scene, many, RAYS * size)[0])


def _cell(curve: Curve, error: float, samples: float) -> str:
    """Error, and what it takes with uniform steps."""
    uniform = curve.evaluations_at_error(error)
    return f"{error:.1e}, " + (
        "beyond its steps" if uniform is None else f"{uniform:.0f}, {samples / uniform:.2f}"
    )

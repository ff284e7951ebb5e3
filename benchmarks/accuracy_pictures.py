"""The pictures of docs/accuracy.md: tangent steps, and what reconstructions make of 41³ samples."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from benchmarks.accuracy_methods import field_truth
from benchmarks.accuracy_scenes import nucleon
from isosample.compare.study_scenes import TwoTents
from isosample.integral.reference import integrate_rays
from isosample.integral.segment_rule import SegmentRule
from isosample.rendering.camera import Camera, Projection
from isosample.rendering.image import srgb_from_linear
from isosample.rendering.pipeline import Renderer
from isosample.rendering.settings import RenderSettings
from isosample.surfaces.extract import extract_surfaces
from isosample.volume.reconstruction import Reconstruction

if TYPE_CHECKING:
    from benchmarks.accuracy_scenes import AccuracyScene
    from isosample.transfer.isovalue_plan import IsovaluePlan
    from isosample.volume.grid import F64

IMAGES = Path(__file__).resolve().parents[1] / "docs" / "images"
BACKGROUND = 0.02  # linear grey under the pictures
TANGENT_PIXELS, RECONSTRUCTION_PIXELS = 320, 160
DPI = 100
LEAST_SHOWN = 1e-5  # of the errors in false colours
SHAPE = "T1 two narrow tents"


def draw_all() -> None:
    """Draw both pictures into docs/images."""
    draw_tangent_steps(IMAGES / "tangent-k3.png")
    draw_reconstructions(IMAGES / "reconstruction-41.png")


def draw_tangent_steps(path: Path) -> None:
    """Two tents over a grid of 81³, 3 isovalues per slope, near an outline: linear, cubic, reference."""
    tents = TwoTents()
    volume, plan = tents.sampled(81), tents.plan(3)
    camera = _close_up(tents)
    pixels = TANGENT_PIXELS
    with Renderer(extract_surfaces(volume, plan.isovalues), plan) as renderer:
        linear, cubic = (
            renderer.render(
                camera=camera, size=(pixels, pixels), settings=RenderSettings(segment=rule)
            ).rgba.astype(np.float64)
            for rule in (SegmentRule.LINEAR, SegmentRule.CUBIC)
        )
    origins, directions = (
        part.reshape(-1, 3) for part in camera.rays(1.0).origins_and_directions(pixels, pixels)
    )
    truth = integrate_rays(volume, tents.transfer_function, origins, directions, tolerance=1e-8)
    reference = truth.reshape(pixels, pixels, 4)
    figure, axes = _figure(2)
    pictures = {
        "linear segments": linear,
        "cubic segments": cubic,
        "reference (trilinear, 1e-8)": reference,
    }
    for place, (name, picture) in zip(axes[0], pictures.items(), strict=True):
        _show(place, picture, name)
    _show_errors(figure, axes[1][:2], [linear, cubic], reference, ["linear", "cubic"])
    profile = axes[1][2]
    row = pixels // 2
    for name, picture, style in (
        ("reference", reference, "k-"),
        ("linear", linear, "r-"),
        ("cubic", cubic, "c--"),
    ):
        profile.plot(picture[row, :, 3], style, label=name, linewidth=1.2)
    profile.set_title("opacity along the middle row", fontsize=11)
    profile.set_xlim(0.6 * pixels, 0.85 * pixels)
    profile.set_xlabel("pixel", fontsize=9)
    profile.legend(fontsize=9)
    figure.savefig(path, dpi=DPI)


def draw_reconstructions(path: Path) -> None:
    """The 41³ grid by a perfect trilinear ray caster and by curved triangles of its spline, and the field."""
    scene, pixels = nucleon(41), RECONSTRUCTION_PIXELS
    assert scene.field is not None
    camera = Camera.orbit(scene.volume.box, azimuth=31, elevation=23, zoom=2.2)
    origins, directions = camera.rays(1.0).origins_and_directions(pixels, pixels)
    tf, rays = (
        scene.transfer_function(SHAPE, "translucent"),
        (origins.reshape(-1, 3), directions.reshape(-1, 3)),
    )
    plan = scene.plan(SHAPE, "translucent", 17)
    curved, refined = (_curved(scene, plan, camera, refine) for refine in (1, 4))
    trilinear = integrate_rays(scene.volume, tf, *rays, tolerance=1e-6).reshape(pixels, pixels, 4)
    truth = field_truth(scene, scene.field, tf, rays).reshape(pixels, pixels, 4)
    figure, axes = _figure(2)
    pictures = {
        "perfect trilinear ray caster, 41³": trilinear,
        "cubic spline, curved triangles, 41³": curved,
        "analytic field": truth,
    }
    for place, (name, picture) in zip(axes[0], pictures.items(), strict=True):
        _show(place, picture, name)
    names = ["trilinear", "curved", "curved, refine 4"]
    _show_errors(figure, axes[1], [trilinear, curved, refined], truth, names)
    figure.savefig(path, dpi=DPI)


def _curved(scene: AccuracyScene, plan: IsovaluePlan, camera: Camera, refine: int) -> F64:
    """Picture of the spline's curved triangles."""
    surfaces = extract_surfaces(
        scene.volume, plan.isovalues, reconstruction=Reconstruction.CUBIC, refine=refine
    )
    size = (RECONSTRUCTION_PIXELS, RECONSTRUCTION_PIXELS)
    with Renderer(surfaces, plan) as renderer:
        return renderer.render(camera=camera, size=size).rgba.astype(np.float64)


def _close_up(tents: TwoTents) -> Camera:
    """The view of the scene, four times nearer, on the outline of a body and of the ring beside it."""
    whole = tents.camera
    rays = whole.rays(1.0)
    shift = 0.36 * rays.span_right + 0.3 * rays.span_up
    assert whole.height is not None
    return Camera(
        projection=Projection.ORTHOGRAPHIC,
        eye=tuple((np.asarray(whole.eye) + shift).tolist()),
        target=tuple((np.asarray(whole.target) + shift).tolist()),
        up=whole.up,
        height=0.3 * whole.height,
    )


def _figure(rows: int) -> tuple[Any, Any]:
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(12.0, 4.1 * rows), layout="constrained")
    FigureCanvasAgg(figure)
    return figure, figure.subplots(rows, 3)


def _show(place: Any, picture: F64, title: str) -> None:
    over = picture[..., :3] + (1.0 - picture[..., 3:]) * BACKGROUND
    place.imshow(srgb_from_linear(np.clip(over, 0.0, 1.0)), interpolation="nearest")
    place.set_title(title, fontsize=11)
    place.set_axis_off()


def _show_errors(figure: Any, places: Any, pictures: list[F64], truth: F64, names: list[str]) -> None:
    """Largest difference of a component in false colours over one logarithmic scale."""
    from matplotlib.colors import LogNorm

    norm = LogNorm(vmin=LEAST_SHOWN, vmax=0.3)
    for place, picture, name in zip(places, pictures, names, strict=True):
        error = np.abs(picture - truth).max(axis=-1)
        shown = place.imshow(np.maximum(error, LEAST_SHOWN), norm=norm, cmap="magma", interpolation="nearest")
        rms = float(np.sqrt(((picture - truth) ** 2).mean()))
        place.set_title(f"{name}: RMSE {rms:.1e}, largest {error.max():.1e}", fontsize=11)
        place.set_axis_off()
    figure.colorbar(shown, ax=list(places), shrink=0.9, pad=0.01)

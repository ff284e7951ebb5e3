"""The reference picture: its conventions are those of the A-buffer, whose pictures it equals where they are exact."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from isosample.errors import InputError
from isosample.integral.segment_rule import SegmentRule
from isosample.rendering.camera import Camera
from isosample.rendering.pipeline import render
from isosample.rendering.raycast_settings import Classification, Crossings, PeakWeight, RaycastSettings
from isosample.rendering.raycaster import raycast
from isosample.rendering.reference_image import ReferenceRenderer, render_reference
from isosample.rendering.settings import ClipPlane, Material, RenderSettings
from isosample.transfer.control_points import ControlPoint, Isosurface
from isosample.transfer.transfer_function import TransferFunction
from isosample.volume.grid import Volume
from isosample.volume.reconstruction import Reconstruction
from rendering.scenes import picture, ramp_tf
from rendering.test_closed_forms import (
    KINDS,
    SIZE,
    camera_of,
    gamma,
    ramp_picture,
    ramp_volume,
    sphere_volume,
)

if TYPE_CHECKING:
    import moderngl
    import numpy.typing as npt

    F32 = npt.NDArray[np.float32]

BACKGROUND = (0.5, 0.25, 0.125, 0.75)


@pytest.mark.parametrize("spacing", [(1.0, 1.0, 1.0), (1.0, 1.0, 10.0)], ids=["isotropic", "1:1:10"])
@pytest.mark.parametrize("kind", KINDS)
def test_a_linear_field_looks_as_in_the_data_centric_picture(
    gl: moderngl.Context, kind: str, spacing: tuple[float, float, float]
) -> None:
    volume, gradient = ramp_volume(spacing, 0.0)
    camera = camera_of(kind, volume)
    normal = np.array([1.0, 0.3, -0.2])
    plane = (*normal.tolist(), float(0.1 - normal @ volume.box.centre))
    tf = ramp_tf(*volume.value_range, (0.02, 0.3))
    for planes in ([], [plane]):
        cuts = tuple(ClipPlane(*numbers) for numbers in planes)
        settings = RenderSettings(background=BACKGROUND, clip_planes=cuts)
        exact = render_reference(volume, tf, camera=camera, size=SIZE, settings=settings).rgba
        _, tolerance = ramp_picture(volume, gradient, tf, camera, planes)
        rgba, _ = picture(gl, volume, tf, camera, SIZE, background=BACKGROUND, clip_planes=cuts)
        error = np.abs(rgba - exact).max(axis=-1)
        assert np.all(error <= 2.0 * tolerance + gamma(4)), f"{error.max():.1e}"  # and the background behind
        assert exact[..., 3].max() > 0.8


def test_impulse_surfaces_cover_the_pixels_of_the_data_centric_picture(gl: moderngl.Context) -> None:
    """Meshes and trilinear isosurfaces of a sphere differ by a sag of e² / 8r: only in pixels at silhouettes."""
    volume = sphere_volume(0.0, (1.0, 1.0, 1.0))
    surfaces = [Isosurface(4.0, (1.0, 0.0, 0.0), 0.5), Isosurface(9.0, (0.0, 0.0, 1.0), 0.3)]
    tf = TransferFunction([], surfaces)
    for kind in ("orthographic", "perspective", "inside"):
        camera = camera_of(kind, volume)
        exact = render_reference(volume, tf, camera=camera, size=(64, 64)).rgba
        rgba, _ = picture(gl, volume, tf, camera, (64, 64))
        differs = np.abs(rgba - exact).max(axis=-1) > gamma(18)
        # A sag of 3 / 32 of the inner sphere, 3 / 72 of the outer, on circles of radius 4 and 9 in a window of
        # 2 · 20.8: 64 · 64 · 2π (4 · 0.094 + 9 · 0.042) / 41.6² = 11 pixels; twice that in perspective.
        assert differs.sum() <= 25, kind
        assert exact[..., 3].max() > 0.6


def test_a_hole_of_nan_looks_as_in_the_data_centric_picture(gl: moderngl.Context) -> None:
    whole, _ = ramp_volume((1.0, 1.0, 2.0), 0.0)
    samples = whole.array.copy()
    samples[5, 3, 4] = np.nan
    volume = Volume(samples, spacing=whole.spacing, origin=whole.origin)
    tf = ramp_tf(*volume.value_range, (0.05, 0.3))
    camera = camera_of("perspective", volume)
    exact = render_reference(volume, tf, camera=camera, size=SIZE, nan_masked=True)
    rgba = render(volume, tf, camera=camera, size=SIZE, nan_masked=True).rgba
    # As in test_masked: float32 distances, and pixels whose centre is at the hole's edge.
    _, directions = camera.rays(SIZE[0] / SIZE[1]).origins_and_directions(*SIZE)
    reach = float(np.linalg.norm(np.asarray(camera.eye) - volume.box.centre)) + volume.box.radius
    cosine = np.where(np.abs(directions) > 1e-9, np.abs(directions), 1.0).min(axis=-1)
    tolerance = 3.8e-6 + gamma(34) + 4 * 0.3 * (gamma(12) * reach / cosine + 2.0**-18 * reach)
    wrong = np.abs(rgba - exact.rgba).max(axis=-1) > tolerance
    assert wrong.mean() < 4 * 2 / 256, f"{wrong.sum()} pixels"
    assert exact.stats["skipped"]["cells_masked"] > 0
    with pytest.raises(InputError, match=r"1 NaN and 0 infinite samples.*--nan masked"):
        render_reference(volume, tf, camera=camera, size=SIZE)


def test_more_isovalues_and_cubic_segments_bring_the_data_centric_picture_closer(
    gl: moderngl.Context,
) -> None:
    """The rest is the flat mesh's: 8 isovalues per slope are closer than 1, and not below the reference's own."""
    volume = sphere_volume(0.0, (1.0, 1.0, 1.0))
    tf = ramp_tf(3.0, 10.0, (0.0, 0.4))
    camera = Camera.orbit(volume.box, azimuth=33, elevation=21)
    exact = render_reference(volume, tf, camera=camera, size=(48, 48)).rgba
    errors = {}
    for rule in (SegmentRule.LINEAR, SegmentRule.CUBIC):
        for per_slope in (1, 8):
            rgba, _ = picture(gl, volume, tf, camera, (48, 48), per_slope=per_slope, segment=rule)
            errors[rule, per_slope] = float(np.sqrt(np.mean((rgba - exact) ** 2)))
    assert 1e-6 < errors[SegmentRule.LINEAR, 8] < 0.5 * errors[SegmentRule.LINEAR, 1] < 0.02
    assert 1e-6 < errors[SegmentRule.CUBIC, 8] < errors[SegmentRule.LINEAR, 8]
    # One value per slope: the field is a distance, whose profile along a ray the cubic follows.
    assert errors[SegmentRule.CUBIC, 1] < 0.5 * errors[SegmentRule.LINEAR, 1]


@pytest.mark.parametrize("reconstruction", [Reconstruction.CUBIC, Reconstruction.BSPLINE])
def test_a_linear_field_is_the_same_picture_with_splines(reconstruction: Reconstruction) -> None:
    volume, _ = ramp_volume((1.0, 1.0, 2.0), 0.0)
    tf = ramp_tf(*volume.value_range, (0.05, 0.3))
    settings = RenderSettings(background=BACKGROUND, clip_planes=(ClipPlane(1.0, 0.3, -0.2, -2.0),))
    camera = camera_of("inside", volume)
    plain = render_reference(volume, tf, camera=camera, size=SIZE, settings=settings)
    smooth = render_reference(
        volume, tf, camera=camera, size=SIZE, settings=settings, reconstruction=reconstruction, tolerance=1e-7
    )
    assert np.abs(plain.rgba - smooth.rgba).max() <= 1e-7 + gamma(4)
    assert plain.stats["reconstruction"] == "trilinear"
    assert smooth.stats["reconstruction"] == reconstruction.value
    assert smooth.stats["cells_visited"] == plain.stats["cells_visited"]
    assert np.ptp(plain.rgba[..., 3]) > 0.1


def test_a_smooth_reconstruction_of_missing_samples_is_refused() -> None:
    volume, _ = ramp_volume((1.0, 1.0, 1.0), 0.0)
    samples = volume.array.copy()
    samples[2, 3, 4] = np.nan
    with pytest.raises(InputError, match=r"1 NaN and 0 infinite samples.*cubic"):
        render_reference(
            Volume(samples),
            ramp_tf(0.0, 1.0, (0.1, 0.2)),
            size=(4, 4),
            nan_masked=True,
            reconstruction=Reconstruction.CUBIC,
        )


def test_statistics_say_what_the_picture_cost() -> None:
    volume, _ = ramp_volume((1.0, 1.0, 1.0), 0.0)
    tf = ramp_tf(*volume.value_range, (0.05, 0.3))
    seen: list[tuple[str, int, int]] = []
    image = render_reference(
        volume, tf, size=(20, 10), progress=lambda stage, done, total: seen.append((stage, done, total))
    )
    assert image.rgba.shape == (10, 20, 4)
    assert image.rgba.dtype == np.float32
    assert seen == [("render", 200, 200)]
    stats = image.stats
    assert stats["method"] == "reference"
    assert stats["size"] == [20, 10]
    assert set(stats["seconds"]) == {"prepare", "render"}
    assert stats["isovalues"] == pytest.approx(volume.value_range)
    assert stats["cells_visited"] == pytest.approx(200 * stats["samples_per_ray"]["mean"])
    assert stats["samples_per_ray"]["max"] >= 6
    assert stats["lost_fragments"] == 0


# -- light ----------------------------------------------------------------------------------------

LIT = RenderSettings(material=Material(), background=BACKGROUND)


def hill() -> Volume:
    """A smooth hill that leans, on a grid of uneven steps."""
    z, y, x = np.mgrid[-1:1:24j, -1:1:24j, -1:1:24j]
    samples = np.exp(-2.0 * (x * x + 1.3 * y * y + 0.8 * z * z)) * (1.0 + 0.2 * np.sin(4.0 * x + y))
    return Volume(samples.astype(np.float32), spacing=(1.0, 1.25, 0.8))


SLOPES = TransferFunction(
    [
        ControlPoint(0.2, (1.0, 0.3, 0.1), 0.0),
        ControlPoint(0.5, (0.2, 0.9, 0.3), 0.2),
        ControlPoint(0.9, (0.2, 0.3, 1.0), 0.4),
    ]
)


def rms(rgba: F32, exact: F32) -> float:
    return float(np.sqrt(np.mean((rgba.astype(np.float64) - exact) ** 2)))


@pytest.mark.parametrize("reconstruction", [Reconstruction.TRILINEAR, Reconstruction.CUBIC])
@pytest.mark.parametrize("classification", [Classification.PRE_INTEGRATED, Classification.PEAK_FINDING])
@pytest.mark.usefixtures("gl")
def test_the_lit_ray_caster_converges_to_the_lit_reference(
    reconstruction: Reconstruction, classification: Classification
) -> None:
    """Between samples, or the cuts of a step, it takes light to run linearly: the error falls with the step's square,
    by 16 from 1 to 1/4 in the limit; pieces of peak finding end at cells and levels too, the coarse ones gain less.
    """
    volume = hill()
    camera, size = Camera.orbit(volume.box, azimuth=33, elevation=21), (40, 40)
    exact = render_reference(
        volume, SLOPES, camera=camera, size=size, settings=LIT, reconstruction=reconstruction
    ).rgba
    plain = render_reference(volume, SLOPES, camera=camera, size=size, reconstruction=reconstruction).rgba
    assert rms(plain, exact) > 0.1
    errors = []
    for step in (1.0, 0.25, 0.125):
        settings = RaycastSettings(
            classification=classification,
            step=step,
            reconstruction=reconstruction,
            crossings=Crossings.EXACT,
            peak_weight=PeakWeight.INTEGRAL,
        )
        rgba = raycast(volume, SLOPES, camera=camera, size=size, settings=LIT, raycast=settings).rgba
        errors.append(rms(rgba, exact))
    order = np.log2(errors[-2] / errors[-1])
    assert order > 1.5
    assert errors[1] < errors[0] / (10.0 if classification is Classification.PRE_INTEGRATED else 4.0)
    assert errors[-1] < 3e-5


@pytest.mark.usefixtures("gl")
def test_a_lit_isosurface_is_that_of_exact_crossings() -> None:
    """Opaque: the colour is the light of one normal, float32 in the ray caster. A crossing is found to about 2^-20 of a
    cell, over which the normal of this hill turns by less than 2^-20 too, seen through a highlight of the power 32.
    """
    volume = hill()
    tf = TransferFunction([], [Isosurface(0.5, (0.2, 0.5, 0.9), 1.0)])
    camera, size = Camera.orbit(volume.box, azimuth=33, elevation=21), (64, 64)
    exact = render_reference(volume, tf, camera=camera, size=size, settings=LIT).rgba
    settings = RaycastSettings(
        classification=Classification.PEAK_FINDING,
        crossings=Crossings.EXACT,
        peak_weight=PeakWeight.INTEGRAL,
    )
    rgba = raycast(volume, tf, camera=camera, size=size, settings=LIT, raycast=settings).rgba
    surface = exact[..., 3] == 1.0
    assert surface.sum() > 300
    differs = np.abs(rgba - exact).max(axis=-1) > 32 * 0.2 * 2.0**-20 + gamma(64)
    assert differs.sum() <= 0.01 * surface.sum()  # at the outline, where the surface bends away from the ray


def test_more_isovalues_bring_the_lit_data_centric_picture_closer(gl: moderngl.Context) -> None:
    """Gradients that run linearly between crossings err with the square of their distance, humps by less: four times
    the isovalues gain 16 in the limit, 1.5 powers of 4 at least while the mesh does not count.
    """
    volume = hill()
    camera = Camera.orbit(volume.box, azimuth=33, elevation=21)
    exact = render_reference(volume, SLOPES, camera=camera, size=(40, 40), settings=LIT).rgba
    errors = [
        rms(
            render(
                volume, SLOPES, camera=camera, size=(40, 40), settings=LIT, per_slope=per_slope, refine=4
            ).rgba,
            exact,
        )
        for per_slope in (1, 7)
    ]
    assert errors[1] < errors[0] / 4.0**1.5


def test_a_renderer_meets_any_material() -> None:
    volume, _ = ramp_volume((1.0, 1.0, 1.0), 0.0)
    tf = ramp_tf(*volume.value_range, (0.1, 0.2))
    renderer = ReferenceRenderer(volume, tf)
    for settings in (RenderSettings(), LIT, RenderSettings(material=Material(ambient=1.0)), RenderSettings()):
        whole = render_reference(volume, tf, size=(6, 4), settings=settings).rgba
        assert np.array_equal(renderer.render(size=(6, 4), settings=settings).rgba, whole)

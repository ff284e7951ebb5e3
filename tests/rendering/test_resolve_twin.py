"""The resolve pass against its float64 twin, pixel by pixel, on the lists that the GPU built."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
import pytest

from isosample.integral.data_centric import ListIntegrals, integrate_lists
from isosample.integral.segment_rule import SegmentRule
from isosample.rendering.abuffer import ABuffer
from isosample.rendering.camera import Camera, Projection
from isosample.rendering.picture_lists import crossing_lists, least_sheet_slope, visible_parts
from isosample.rendering.scene import LevelRange, Scene
from isosample.rendering.settings import ClipPlane, RenderSettings
from isosample.surfaces.extract import extract_surfaces
from isosample.transfer.control_points import ControlPoint, Isosurface
from isosample.transfer.isovalues import plan_isovalues
from isosample.transfer.transfer_function import TransferFunction
from isosample.volume.analytic import nucleon_like, sample_field
from isosample.volume.grid import Volume
from isosample.volume.reconstruction import GridSpline, Reconstruction
from isosample.volume.statistics import gradient_at_values
from rendering.scenes import box_interval, clip_interval

if TYPE_CHECKING:
    from collections.abc import Callable

    import moderngl
    import numpy.typing as npt

    from isosample.rendering.fragment_lists import FragmentLists
    from isosample.surfaces.extract import SurfaceSet
    from isosample.transfer.isovalue_plan import IsovaluePlan

SIZE = (40, 32)
NORMAL = np.array([0.3, -0.2, 1.0])


def busy_scene() -> tuple[SurfaceSet, IsovaluePlan]:
    """A field whose surfaces run out of the box, with slopes, a plateau, steps and impulses."""
    volume = sample_field(
        nucleon_like(), (17, 19, 21), lower=(6.0, 4.0, 2.0), upper=(30.0, 36.0, 34.0), name="nucleon-like"
    )
    low, high = volume.value_range
    at = [low + (high - low) * part for part in (0.05, 0.2, 0.35, 0.35, 0.5, 0.5, 0.8, 1.0)]
    colors = [(0.1, 0.3, 1.0), (0.2, 0.9, 0.4), (1.0, 1.0, 0.0), (0.5, 0.0, 0.5)] * 2
    extinctions = [0.0, 0.15, 0.0, 0.3, 0.3, 0.02, 0.9, 0.9]
    tf = TransferFunction(
        [ControlPoint(v, c, e) for v, c, e in zip(at, colors, extinctions, strict=True)],
        [Isosurface(at[1], (1.0, 1.0, 1.0), 0.2), Isosurface(at[6], (1.0, 0.0, 0.0), 0.5)],
    )
    plan = plan_isovalues(tf, volume.value_range, per_slope=3)
    return extract_surfaces(volume, plan.isovalues), plan


def rough_scene() -> tuple[SurfaceSet, IsovaluePlan]:
    """Noise with so many levels that the meshes of neighbouring ones cut each other inside the cells."""
    rng = np.random.default_rng(11)
    samples = np.zeros((14, 14, 14))
    samples[1:-1, 1:-1, 1:-1] = rng.random((12, 12, 12))
    volume = Volume(samples)
    tf = TransferFunction(
        [ControlPoint(0.3, (0.1, 0.3, 1.0), 0.0), ControlPoint(0.9, (1.0, 0.6, 0.1), 0.4)],
        [Isosurface(0.5, (0.0, 1.0, 0.0), 0.1)],
    )
    plan = plan_isovalues(tf, volume.value_range, per_slope=12)
    return extract_surfaces(volume, plan.isovalues), plan


def masked_scene() -> tuple[SurfaceSet, IsovaluePlan]:
    """A field with two holes of masked cells, so that rays enter and leave several times."""
    volume = sample_field(nucleon_like(), (15, 15, 15), lower=(6.0,) * 3, upper=(34.0,) * 3)
    samples = volume.array.copy()
    samples[3:5, 4:9, 6:9] = np.nan
    samples[9, 9, 4] = np.nan
    volume = Volume(samples, spacing=volume.spacing, origin=volume.origin)
    high = volume.value_range[1]
    blue, gold = (0.1, 0.3, 1.0), (1.0, 0.7, 0.1)
    tf = TransferFunction([ControlPoint(0.1 * high, blue, 0.1), ControlPoint(0.9 * high, gold, 0.4)])
    plan = plan_isovalues(tf, volume.value_range, per_slope=4)
    return extract_surfaces(volume, plan.isovalues, nan_masked=True), plan


def smooth_scene() -> tuple[SurfaceSet, IsovaluePlan]:
    """A spline whose surfaces run out of the box: bicubic faces, curved crossings; and a thin peak as a sheet."""
    volume = sample_field(nucleon_like(), (13, 15, 14), lower=(6.0, 4.0, 2.0), upper=(30.0, 36.0, 34.0))
    low, high = GridSpline.build(volume, Reconstruction.CUBIC).value_range
    at = [low + (high - low) * part for part in (0.1, 0.5, 0.59999, 0.6, 0.60001, 0.95)]
    gold, white = (1.0, 0.7, 0.1), (1.0, 1.0, 1.0)
    extinctions = [0.0, 0.2, 0.1, 900.0, 0.1, 0.0]
    colors = [gold, gold, gold, white, gold, gold]
    points = [ControlPoint(v, c, e) for v, c, e in zip(at, colors, extinctions, strict=True)]
    plan = plan_isovalues(
        TransferFunction(points), (low, high), per_slope=3, gradients=partial(gradient_at_values, volume)
    )
    assert plan.sheet_area.max() > 0.0
    return extract_surfaces(volume, plan.isovalues, reconstruction=Reconstruction.CUBIC), plan


def camera_of(surfaces: SurfaceSet, kind: str) -> Camera:
    box = surfaces.geometry.box
    if kind == "inside":
        eye = tuple(box.centre + np.array([1.0, 2.0, -3.0]))
        return Camera(
            projection=Projection.PERSPECTIVE, eye=eye, target=tuple(box.corner), fov_y_degrees=100.0
        )
    return Camera.orbit(box, azimuth=200, elevation=-35, projection=Projection(kind))


def expected_picture(
    lists: FragmentLists,
    surfaces: SurfaceSet,
    plan: IsovaluePlan,
    camera: Camera,
    plane: tuple[float, float, float, float],
    rule: SegmentRule,
) -> ListIntegrals:
    """The float64 integral of every pixel's list."""
    rays = camera.rays(SIZE[0] / SIZE[1]).origins_and_directions(*SIZE)
    origins, directions = (part.reshape(-1, 3) for part in rays)
    return integrate_lists(
        crossing_lists(lists, surfaces, origins, directions),
        plan,
        rule=rule,
        visible=visible_parts(origins, directions, (ClipPlane(*plane),)),
        reach=float(np.linalg.norm(surfaces.geometry.spacing)),
        least_slope=least_sheet_slope(surfaces.value_range, surfaces.geometry.box),
    )


def shows_something(
    surfaces: SurfaceSet, camera: Camera, plane: tuple[float, float, float, float]
) -> npt.NDArray[np.bool_]:
    """Whether the plane leaves something of a pixel's way through the box."""
    rays = camera.rays(SIZE[0] / SIZE[1]).origins_and_directions(*SIZE)
    origins, directions = (part.reshape(-1, 3) for part in rays)
    start, end = box_interval(surfaces.geometry.box, origins, directions)
    start, end = clip_interval(start, end, origins, directions, [plane])
    shown: npt.NDArray[np.bool_] = start <= end
    return shown


def tolerance_of(camera: Camera, surfaces: SurfaceSet) -> float:
    """At most 30 segments, each with 8 roundings of distances up to the reach times extinctions up to 0.9, and of
    colours; and the quadrature.

    Of a cubic, the lists hold the slopes that the shader used, half floats, so their rounding is not in it. Its
    coefficients are up to 3 + 2 · 6.75 + 6.75 < 24 (a bump of slope 27/4 at one end fills the band), and 12 roundings
    of them move a position, and the extinction with it: over all segments, 0.9 · 12 · 24 · 2^-24 times the length of
    the way through the box, 2 radii at most, and the colour once.
    """
    box = surfaces.geometry.box
    reach = float(np.linalg.norm(np.asarray(camera.eye) - box.centre)) + 30.0
    cubic = 12 * 24 * 2.0**-24 * (1.0 + 0.9 * 2.0 * box.radius)
    return 4.3e-7 + 30 * 8 * 2.0**-24 * (1.0 + 0.9 * reach) + cubic


CASES = [
    (scene, kind, rule)
    for scene in (busy_scene, rough_scene, masked_scene, smooth_scene)
    for kind in ("orthographic", "perspective", "inside")
    for rule in SegmentRule
]


@pytest.mark.parametrize(("scene", "kind", "rule"), CASES)
def test_every_pixel_is_the_float64_integral_of_its_list(
    gl: moderngl.Context,
    scene: Callable[[], tuple[SurfaceSet, IsovaluePlan]],
    kind: str,
    rule: SegmentRule,
) -> None:
    surfaces, plan = scene()
    camera = camera_of(surfaces, kind)
    plane = (0.3, -0.2, 1.0, float(2.0 - NORMAL @ surfaces.geometry.box.centre))
    settings = RenderSettings(segment=rule, clip_planes=(ClipPlane(*plane),), min_transmittance=0.0)
    with ABuffer(gl, Scene.build(surfaces, plan)) as abuffer:
        lists = abuffer.fragment_lists(camera, SIZE, settings)
        rgba, statistics = abuffer.render(camera, SIZE, settings)
    expected = expected_picture(lists, surfaces, plan, camera, plane, rule)
    error = np.abs(rgba.reshape(-1, 4) - expected.rgba).max(axis=1)
    # Impulses and steps at the cut or at the box may fall on either side by rounding: those pixels are counted, and
    # are fewer than 1 %.
    wrong = error > tolerance_of(camera, surfaces)
    assert wrong.mean() < 0.01, f"{wrong.sum()} pixels, {error.max()}"
    assert (expected.rgba[:, 3] > 0.1).mean() > 0.1
    seen = shows_something(surfaces, camera, plane)  # the GPU walks no other ray
    assert statistics.band_violations == expected.violations[seen].sum()
    assert statistics.repaired_pixels == np.count_nonzero(expected.violations[seen])
    assert statistics.unrepaired_pixels == np.count_nonzero(expected.unplaced[seen])
    assert statistics.reordered_fragments == expected.reordered[seen].sum()
    if (
        scene is not smooth_scene
    ):  # whose crossings, moved onto the curved surface, may change places, or may not
        assert (statistics.reordered_fragments > 0) == (scene is rough_scene)


LOSSES: dict[str, Callable[[list[LevelRange]], list[LevelRange]]] = {
    "the first level": lambda levels: levels[1:],
    "a middle level": lambda levels: levels[:4] + levels[5:],
    "most levels": lambda levels: levels[:3],
    "all levels": lambda _: [],
    "half of a level's triangles": lambda levels: [
        replace(levels[0], index_count=levels[0].index_count // 6 * 3),
        *levels[1:],
    ],
}


@pytest.mark.parametrize("loss", LOSSES)
def test_lost_surfaces_are_counted_and_repaired_as_in_float64(gl: moderngl.Context, loss: str) -> None:
    surfaces, plan = busy_scene()
    camera = camera_of(surfaces, "orthographic")
    plane = (0.0, 0.0, 1.0, 1e3)  # cuts nothing
    settings = RenderSettings(min_transmittance=0.0)
    scene = Scene.build(surfaces, plan)
    with ABuffer(gl, scene) as abuffer:
        intact, _ = abuffer.render(camera, SIZE, settings)
    damaged = replace(scene, levels=tuple(LOSSES[loss](list(scene.levels))))
    with ABuffer(gl, damaged) as abuffer:
        lists = abuffer.fragment_lists(camera, SIZE, settings)
        rgba, statistics = abuffer.render(camera, SIZE, settings)
    expected = expected_picture(lists, surfaces, plan, camera, plane, SegmentRule.CUBIC)
    error = np.abs(rgba.reshape(-1, 4) - expected.rgba).max(axis=1)
    violations = int(expected.violations.sum())
    assert (error > tolerance_of(camera, surfaces)).mean() < 0.01
    # A face value within rounding of an isovalue's tolerance may be judged either way.
    assert abs(statistics.band_violations - violations) <= 0.01 * violations
    assert violations > 20
    changed = np.abs(rgba - intact).max(axis=-1) > 1e-3
    assert changed.any()


def test_a_pair_of_crossings_lost_together_cannot_be_seen(gl: moderngl.Context) -> None:
    surfaces, plan = busy_scene()
    scene = Scene.build(surfaces, plan)
    damaged = replace(
        scene, levels=scene.levels[:-1]
    )  # the innermost level: every ray that enters it leaves it
    with ABuffer(gl, damaged) as abuffer:
        _, statistics = abuffer.render(camera_of(surfaces, "orthographic"), SIZE, RenderSettings())
    assert statistics.band_violations == 0


def test_a_level_lost_in_the_middle_of_a_slope_is_put_back_where_it_was(gl: moderngl.Context) -> None:
    z, _, _ = np.mgrid[0:9, 0:3, 0:3]
    volume = Volume(z.astype(np.float64))
    tf = TransferFunction(
        [ControlPoint(0.0, (1.0, 0.0, 0.0), 0.0), ControlPoint(8.0, (0.0, 0.0, 1.0), 0.4)],
        [Isosurface(4.0, (0.0, 1.0, 0.0), 0.5)],
    )
    plan = plan_isovalues(tf, volume.value_range, per_slope=7)
    scene = Scene.build(extract_surfaces(volume, plan.isovalues), plan)
    camera = Camera.orbit(volume.box, azimuth=20, elevation=30)
    middle = int(np.flatnonzero(plan.isovalues == 4.0)[0])
    damaged = replace(scene, levels=tuple(part for part in scene.levels if part.level != middle))
    with ABuffer(gl, scene) as whole, ABuffer(gl, damaged) as holed:
        expected, _ = whole.render(camera, SIZE, RenderSettings())
        rgba, statistics = holed.render(camera, SIZE, RenderSettings())
    # The field is linear along the ray, so the lost crossing, impulse and all, is put back exactly; but for rays that
    # enter or leave within the face's tolerance of the level, 2 % of the cells beside it.
    assert statistics.band_violations > 30
    crossed = np.abs(expected - expected[0, 0]).max(axis=-1) > 0
    assert (np.abs(rgba - expected).max(axis=-1) > 1e-5)[crossed].mean() < 0.02

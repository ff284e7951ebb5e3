"""The resolve pass against its float64 twin, pixel by pixel, on the lists that the GPU built."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from isosample.integral.crossing_lists import BORDER, CrossingLists
from isosample.integral.data_centric import ListIntegrals, integrate_lists
from isosample.integral.ray import face_tolerance
from isosample.integral.segment_rule import SegmentRule
from isosample.rendering.abuffer import ABuffer
from isosample.rendering.camera import Camera, Projection
from isosample.rendering.scene import LevelRange, Scene
from isosample.rendering.settings import ClipPlane, RenderSettings
from isosample.surfaces.extract import extract_surfaces
from isosample.transfer.control_points import ControlPoint, Isosurface
from isosample.transfer.isovalues import plan_isovalues
from isosample.transfer.transfer_function import TransferFunction
from isosample.volume.analytic import nucleon_like, sample_field
from isosample.volume.grid import Volume
from rendering.scenes import F64, box_interval, clip_interval

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


def camera_of(surfaces: SurfaceSet, kind: str) -> Camera:
    box = surfaces.geometry.box
    if kind == "inside":
        eye = tuple(box.centre + np.array([1.0, 2.0, -3.0]))
        return Camera(
            projection=Projection.PERSPECTIVE, eye=eye, target=tuple(box.corner), fov_y_degrees=100.0
        )
    return Camera.orbit(box, azimuth=200, elevation=-35, projection=Projection(kind))


def border_values(surfaces: SurfaceSet, points: F64) -> tuple[F64, F64]:
    """Values and tolerances at points (N, 3) of the box's surface, bilinear on the nearest face."""
    box = surfaces.geometry.box
    values, tolerances = np.empty(len(points)), np.empty(len(points))
    low, high = surfaces.value_range
    for n, unit in enumerate(np.clip((points - box.corner) @ np.linalg.inv(box.edges), 0.0, 1.0)):
        face = int(np.argmin(np.stack([unit, 1.0 - unit], axis=1).ravel()))
        counts = np.delete(np.array(surfaces.geometry.size_xyz), face // 2)
        u, v = np.delete(unit, face // 2) * (counts - 1)
        column, row = (min(int(x), int(n) - 2) for x, n in zip((u, v), counts, strict=True))
        samples = surfaces.boundary.faces[face].astype(np.float64)
        corners = samples[row : row + 2, column : column + 2].ravel()
        tolerances[n] = float(face_tolerance((corners - low) / (high - low))) * (high - low)
        values[n] = surfaces.boundary.value(face // 2, face % 2, np.array(u), np.array(v))
    return values, tolerances


def crossing_lists(
    lists: FragmentLists, surfaces: SurfaceSet, origins: F64, directions: F64
) -> CrossingLists:
    """What the GPU's lists hold, between the points at which the rays meet the box."""
    entry, leave = box_interval(surfaces.geometry.box, origins, directions)
    met = np.flatnonzero(leave > entry)
    inside = np.isin(lists.pixels, met)
    pixels, count = lists.pixels[inside], int(inside.sum())
    order = np.argsort(np.concatenate([met, pixels, met]), kind="stable")

    def column(first: npt.ArrayLike, middle: npt.ArrayLike, last: npt.ArrayLike) -> npt.NDArray[Any]:
        parts = zip((first, middle, last), (len(met), count, len(met)), strict=True)
        return np.concatenate([np.broadcast_to(part, size) for part, size in parts])[order]

    low, high = surfaces.value_range
    unit = (high - low) / surfaces.geometry.box.radius
    # Rounding may leave a crossing on the border a little outside.
    distances = np.clip(lists.distances[inside].astype(np.float64), entry[pixels], leave[pixels])
    values, tolerances = zip(
        *(border_values(surfaces, origins[met] + t[met, None] * directions[met]) for t in (entry, leave)),
        strict=True,
    )
    return CrossingLists(
        first=np.searchsorted(column(met, pixels, met), np.arange(len(origins) + 1)),
        distance=column(entry[met], distances, leave[met]),
        level=column(BORDER, lists.levels[inside], BORDER),
        rising=column(True, lists.rising[inside], False),
        slope=column(np.nan, lists.slopes[inside].astype(np.float64) * unit, np.nan),
        residual=np.zeros(len(order)),
        value=column(values[0], 0.0, values[1]),
        tolerance=column(tolerances[0], 0.0, tolerances[1]),
    )


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
    far = np.full(len(origins), 1e30)
    visible = clip_interval(np.zeros(len(origins)), far, origins, directions, [plane])
    low, high = surfaces.value_range
    return integrate_lists(
        crossing_lists(lists, surfaces, origins, directions),
        plan,
        rule=rule,
        visible=np.stack(visible, axis=1),
        reach=float(np.linalg.norm(surfaces.geometry.spacing)),
        least_slope=1e-6 * (high - low) / surfaces.geometry.box.radius,
    )


def shows_something(
    surfaces: SurfaceSet, camera: Camera, plane: tuple[float, float, float, float]
) -> npt.NDArray[np.bool_]:
    """Whether the plane leaves something of a pixel's way through the box."""
    rays = camera.rays(SIZE[0] / SIZE[1]).origins_and_directions(*SIZE)
    origins, directions = (part.reshape(-1, 3) for part in rays)
    start, end = box_interval(surfaces.geometry.box, origins, directions)
    start, end = clip_interval(start, end, origins, directions, [plane])
    return start <= end


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
    for scene in (busy_scene, rough_scene)
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
    assert statistics.unrepaired_pixels == np.count_nonzero(expected.unplaced[seen])
    assert statistics.reordered_fragments == expected.reordered[seen].sum()
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

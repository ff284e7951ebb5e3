"""Compute shaders rasterise what the graphics pipeline does."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import moderngl
import numpy as np
import pytest

from isosample.gl.context import is_software, limits
from isosample.rendering import group_shares, triangle_raster
from isosample.rendering.abuffer import ABuffer
from isosample.rendering.camera import Camera, Projection
from isosample.rendering.mesh_batch import OFFSET_ALIGNMENT
from isosample.rendering.scene import Scene
from isosample.rendering.settings import BuildStage, Material, RenderSettings
from isosample.rendering.supplies import storage_bindings
from isosample.surfaces.extract import extract_surfaces
from isosample.transfer.control_points import Isosurface
from isosample.transfer.isovalues import plan_isovalues
from isosample.transfer.transfer_function import TransferFunction
from isosample.volume.analytic import nucleon_like, sample_field
from isosample.volume.grid import Volume
from rendering.scenes import ramp_tf

if TYPE_CHECKING:
    import numpy.typing as npt

    from isosample.rendering.fragment_lists import FragmentLists
    from isosample.rendering.picture_frame import PictureFrame
    from isosample.rendering.tiles import Tile
    from isosample.volume.geometry import Box

FRAGMENT = RenderSettings(build_stage=BuildStage.FRAGMENT)
COMPUTE = RenderSettings(build_stage=BuildStage.COMPUTE)
SIZE = (97, 83)


def nucleon(edge: int = 33) -> Volume:
    return sample_field(nucleon_like(), (edge,) * 3, lower=(0.0,) * 3, upper=(40.0,) * 3, name="nucleon-like")


def scene_of(volume: Volume, tf: TransferFunction, *, per_slope: int = 5) -> Scene:
    plan = plan_isovalues(tf, volume.value_range, per_slope=per_slope)
    return Scene.build(extract_surfaces(volume, plan.isovalues, residuals=True), plan)


def wide_tent(volume: Volume) -> TransferFunction:
    low, high = volume.value_range
    return ramp_tf(low + 0.1 * (high - low), low + 0.9 * (high - low), (0.0, 0.4))


def outside(box: Box) -> Camera:
    eye = box.centre + np.array([1.3, -0.9, 0.8]) * 2.0 * box.radius
    return Camera(
        projection=Projection.PERSPECTIVE,
        eye=tuple(eye.tolist()),
        target=tuple(box.centre.tolist()),
        up=(0.0, 0.0, 1.0),
        fov_y_degrees=35.0,
    )


def nucleon_seen() -> tuple[Scene, Camera]:
    """The scene of most tests, and a camera that has all of it in the picture."""
    volume = nucleon()
    return scene_of(volume, wide_tent(volume)), Camera.orbit(volume.box, azimuth=31.0, elevation=22.0)


def cameras(box: Box) -> dict[str, Camera]:
    return {"parallel": Camera.orbit(box, azimuth=31.0, elevation=22.0), "perspective": outside(box)}


def by_pixel(lists: FragmentLists) -> npt.NDArray[np.int64]:
    """(M,) order by pixel, surface and direction, near ones first."""
    return np.lexsort((lists.distances, lists.rising, lists.levels, lists.pixels))


@pytest.mark.parametrize("view", ["parallel", "perspective"])
@pytest.mark.parametrize("curved", [False, True])
def test_the_lists_are_those_of_the_pipeline(gl: moderngl.Context, view: str, curved: bool) -> None:
    """Both move corners to a grid of 1/256 pixel and keep the top-left rule: the same pixels, exactly.

    Distances: both take the plane through the corners, whose places in the picture are rounded (20 roundings of
    numbers up to 97 pixels on each side). Where the gradient's part along the ray is half of the largest gradient at
    least, the depth changes by less than sqrt(3) pixels' lengths per pixel. Distances themselves, up to 8 radii, have
    16 roundings on each side. A triangle seen from its edge has a corner's distance here and one between the corners
    there: a cell at most.
    """
    volume = nucleon()
    scene, camera = scene_of(volume, wide_tent(volume)), cameras(volume.box)[view]
    found = []
    for stage in (FRAGMENT, COMPUTE):
        with ABuffer(gl, scene) as abuffer:
            lists = abuffer.fragment_lists(camera, SIZE, replace(stage, curved=curved))
            order = by_pixel(lists)
            found.append(
                {
                    name: getattr(lists, name)[order]
                    for name in ("pixels", "levels", "rising", "distances", "slopes", "residuals")
                }
            )
    pipeline, compute = found
    for name in ("pixels", "levels", "rising"):
        np.testing.assert_array_equal(compute[name], pipeline[name])
    apart = np.abs(compute["distances"] - pipeline["distances"])
    cell = float(np.linalg.norm(volume.spacing))
    assert apart.max() <= cell
    steep = pipeline["slopes"] >= 0.5 * pipeline["slopes"].max()
    assert steep.sum() > 1000
    pixel = 2.2 * volume.box.radius / SIZE[1] * (1.0 if view == "parallel" else 2.0)
    ulp = 2.0**-24
    bound = 3.0**0.5 * pixel * 40 * ulp * SIZE[0] + 32 * ulp * 8.0 * volume.box.radius
    assert apart[steep].max() <= bound
    assert (
        np.quantile(np.abs(compute["slopes"] - pipeline["slopes"]), 0.999) <= 2e-3 * pipeline["slopes"].max()
    )
    assert np.quantile(np.abs(compute["residuals"] - pipeline["residuals"]), 0.999) <= 1e-4


@pytest.mark.parametrize("view", ["parallel", "perspective"])
@pytest.mark.parametrize("material", [None, Material()])
def test_the_pictures_are_those_of_the_pipeline(
    gl: moderngl.Context, view: str, material: Material | None
) -> None:
    """All but the pixels with a triangle seen from its edge (1 in 1000 at most) agree to 1e-4; no tile makes a seam."""
    volume = nucleon()
    scene, camera = scene_of(volume, wide_tent(volume)), cameras(volume.box)[view]
    with ABuffer(gl, scene) as abuffer:
        expected, before = abuffer.render(camera, SIZE, replace(FRAGMENT, material=material))
        found, after = abuffer.render(camera, SIZE, replace(COMPUTE, material=material))
        tiled, parts = abuffer.render(
            camera, SIZE, replace(COMPUTE, material=material, fragment_budget_bytes=1 << 16)
        )
    assert before.compute_tiles == 0
    assert after.compute_tiles == after.tiles == 1
    assert parts.compute_tiles == parts.tiles > 1
    assert after.fragments == before.fragments == parts.fragments
    assert after.band_violations == before.band_violations == 0
    assert np.quantile(np.abs(found - expected).max(axis=-1), 0.999) < 1e-4
    np.testing.assert_array_equal(tiled, found)


def test_centres_on_edges_belong_to_one_triangle(gl: moderngl.Context) -> None:
    """A plane of squares of whole pixels, halved by diagonals: edges and corners lie on the centres of pixels.

    One crossing per pixel, on both sides of the plane and for both ways round of its triangles.
    """
    edge = 17
    ramp = np.broadcast_to(np.arange(edge, dtype=np.float64)[:, None, None], (edge, edge, edge))
    tf = TransferFunction([], [Isosurface(8.25, (1.0, 0.5, 0.0), 0.5)])
    for values, towards in ((ramp, 1.0), (ramp, -1.0), (-ramp + 16.5, 1.0)):
        volume = Volume(np.ascontiguousarray(values))
        scene = scene_of(volume, tf)
        centre = volume.box.centre
        camera = Camera(
            projection=Projection.ORTHOGRAPHIC,
            eye=tuple((centre + np.array([0.5, 0.5, 40.0 * towards])).tolist()),
            target=tuple((centre + np.array([0.5, 0.5, 0.0])).tolist()),
            up=(0.0, 1.0, 0.0),
            height=8.0,
        )
        with ABuffer(gl, scene) as abuffer:
            for size in ((8, 8), (16, 16), (64, 64)):
                lists = abuffer.fragment_lists(camera, size, COMPUTE)
                np.testing.assert_array_equal(np.sort(lists.pixels), np.arange(size[0] * size[1]))


def test_noise_at_every_scale_has_the_crossings_of_the_pipeline(gl: moderngl.Context) -> None:
    """Slivers, corners on pixels and triangles much smaller than a pixel, none of them lost or doubled."""
    values = np.random.default_rng(5).random((14, 14, 14))
    volume = Volume(values)
    scene = scene_of(volume, ramp_tf(0.2, 0.8, (0.1, 0.5)), per_slope=3)
    camera = Camera.orbit(volume.box, azimuth=13.0, elevation=-41.0)
    with ABuffer(gl, scene) as abuffer:
        for edge in (3, 16, 61, 150):
            counts = [abuffer.render(camera, (edge, edge), one)[1] for one in (FRAGMENT, COMPUTE)]
            assert counts[1].compute_tiles == 1
            assert counts[1].fragments == counts[0].fragments
            assert counts[1].band_violations == counts[0].band_violations


def test_triangles_that_are_too_large_are_left_to_the_pipeline(gl: moderngl.Context) -> None:
    volume = nucleon(9)  # cells of 5 units: some 300 pixels in this picture
    scene = scene_of(volume, wide_tent(volume))
    camera = replace(Camera.orbit(volume.box, azimuth=31.0, elevation=22.0), height=6.0)
    with ABuffer(gl, scene) as abuffer:
        expected, _ = abuffer.render(camera, (400, 400), FRAGMENT)
        found, statistics = abuffer.render(camera, (400, 400), COMPUTE)
    assert statistics.compute_tiles == 0
    assert statistics.fragments > 100_000
    np.testing.assert_array_equal(found, expected)


def test_an_eye_among_the_surfaces_is_left_to_the_pipeline(gl: moderngl.Context) -> None:
    volume = nucleon()
    scene = scene_of(volume, wide_tent(volume))
    inside = replace(outside(volume.box), eye=tuple((volume.box.centre + 3.0).tolist()))
    with ABuffer(gl, scene) as abuffer:
        expected, _ = abuffer.render(inside, SIZE, FRAGMENT)
        found, statistics = abuffer.render(inside, SIZE, COMPUTE)
    assert statistics.compute_tiles == 0
    assert statistics.fragments > 1000
    np.testing.assert_array_equal(found, expected)


@pytest.mark.parametrize(("way", "by_compute"), [((0.0, 1.0, 0.0), 1), ((1.0, 0.0, 0.0), 0)])
def test_a_box_that_reaches_behind_the_eye_is_seen_as_by_the_pipeline(
    gl: moderngl.Context, way: tuple[float, float, float], by_compute: int
) -> None:
    """Two parallel planes of triangles, the eye between them: one is behind it, or both reach past it."""
    edge = 17
    values = np.broadcast_to(np.abs(np.arange(edge) - 8.0)[None, :, None], (edge, edge, edge))
    volume = Volume(np.ascontiguousarray(values), origin=(40.0, 0.0, 0.0))
    scene = scene_of(volume, TransferFunction([], [Isosurface(5.25, (1.0, 0.5, 0.0), 0.5)]))
    centre = volume.box.centre
    eye = centre + np.array([0.1, 0.2, -9.0])  # beside the box: an eye inside of it is drawn in two passes
    camera = Camera(
        projection=Projection.PERSPECTIVE,
        eye=tuple(eye.tolist()),
        target=tuple((eye + np.array(way) + np.array([0.0, 0.0, 0.3])).tolist()),
        up=(0.0, 0.0, 1.0),
        fov_y_degrees=70.0,
    )
    with ABuffer(gl, scene) as abuffer:
        expected, before = abuffer.render(camera, SIZE, FRAGMENT)
        found, after = abuffer.render(camera, SIZE, COMPUTE)
    assert after.compute_tiles == by_compute
    assert after.fragments == before.fragments > 500
    assert np.quantile(np.abs(found - expected).max(axis=-1), 0.999) < 1e-4


def test_masked_cells_are_left_to_the_pipeline(gl: moderngl.Context) -> None:
    samples = nucleon().array.astype(np.float64)
    samples[:4] = np.nan
    volume = Volume(samples)
    plan = plan_isovalues(wide_tent(nucleon()), volume.value_range, per_slope=3)
    scene = Scene.build(extract_surfaces(volume, plan.isovalues, nan_masked=True), plan)
    camera = Camera.orbit(volume.box, azimuth=31.0, elevation=22.0)
    with ABuffer(gl, scene) as abuffer:
        expected, _ = abuffer.render(camera, SIZE, FRAGMENT)
        found, statistics = abuffer.render(camera, SIZE, COMPUTE)
    assert statistics.compute_tiles == 0
    np.testing.assert_array_equal(found, expected)


def test_from_the_first_unsuited_tile_on_the_pipeline_draws_all(
    gl: moderngl.Context, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene, camera = nucleon_seen()
    with ABuffer(gl, scene) as abuffer:
        expected, before = abuffer.render(camera, SIZE, replace(FRAGMENT, fragment_budget_bytes=1 << 16))
        build, calls = abuffer._builder._build_by_compute, iter((True, False))

        def build_one(tile: Tile, frame: PictureFrame) -> np.void | None:
            counters = build(tile, frame)
            frame.unsuited = not next(calls)  # a third call would end the iteration
            return None if frame.unsuited else counters

        monkeypatch.setattr(abuffer._builder, "_build_by_compute", build_one)
        found, after = abuffer.render(camera, SIZE, replace(COMPUTE, fragment_budget_bytes=1 << 16))
    assert after.fragments == before.fragments
    assert after.compute_tiles == 1
    assert after.tiles == before.tiles > 2
    assert np.quantile(np.abs(found - expected).max(axis=-1), 0.999) < 1e-4


def test_pictures_of_other_scenes_may_be_drawn_between_the_tiles(gl: moderngl.Context) -> None:
    """Both project their vertices into images of their own, which are bound to the same units."""
    scene, camera = nucleon_seen()
    other = scene_of(nucleon(21), wide_tent(nucleon(21)))
    settings = replace(COMPUTE, fragment_budget_bytes=1 << 16)
    with ABuffer(gl, scene) as abuffer, ABuffer(gl, other) as between:
        expected = list(abuffer.fragment_list_parts(camera, SIZE, settings))
        found = []
        for part in abuffer.fragment_list_parts(camera, SIZE, settings):
            found.append(part)
            assert between.render(camera, SIZE, COMPUTE)[1].compute_tiles == 1
    assert len(found) == len(expected) > 2
    for one, same in zip(found, expected, strict=True):
        assert np.array_equal(np.sort(one.distances), np.sort(same.distances))


def test_several_dispatches_make_the_same_picture(
    gl: moderngl.Context, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene, camera = nucleon_seen()
    pictures = []
    for most in (65000, 3):
        monkeypatch.setattr(group_shares, "MOST_GROUPS", most)
        with ABuffer(gl, scene) as abuffer:
            pictures.append(abuffer.render(camera, SIZE, COMPUTE)[0])
    np.testing.assert_array_equal(pictures[1], pictures[0])


def test_buffers_beyond_a_storage_block_are_read_in_windows(
    gl: moderngl.Context, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene, camera = nucleon_seen()
    block = 1 << 14
    largest = replace(limits(gl), storage_block_bytes=block)
    bound: list[int] = []
    bind = moderngl.Buffer.bind_to_storage_buffer
    windowed = {storage_bindings()[name] for name in ("Vertices", "Indices")}

    def bind_and_note(buffer: moderngl.Buffer, binding: int, offset: int = 0, size: int = -1) -> None:
        if binding in windowed:
            assert size > 0
            assert offset % OFFSET_ALIGNMENT == 0
            assert offset + size <= buffer.size
            bound.append(size)
        bind(buffer, binding, offset=offset, size=size)

    with ABuffer(gl, scene) as abuffer:
        expected, _ = abuffer.render(camera, SIZE, COMPUTE)
        monkeypatch.setattr(triangle_raster, "limits", lambda _: largest)
        monkeypatch.setattr(moderngl.Buffer, "bind_to_storage_buffer", bind_and_note)
        found, statistics = abuffer.render(camera, SIZE, COMPUTE)
    assert statistics.compute_tiles == 1
    assert max(bound) <= block < scene.vertices.nbytes / 4
    assert len(bound) > 8
    np.testing.assert_array_equal(found, expected)


def test_residuals_beyond_a_storage_block_are_left_to_the_pipeline(
    gl: moderngl.Context, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene, camera = nucleon_seen()
    largest = replace(limits(gl), storage_block_bytes=1 << 14)
    with ABuffer(gl, scene) as abuffer:
        expected = abuffer.fragment_lists(camera, SIZE, FRAGMENT)
        monkeypatch.setattr(triangle_raster, "limits", lambda _: largest)
        found = abuffer.fragment_lists(camera, SIZE, COMPUTE)
    np.testing.assert_array_equal(np.sort(found.distances), np.sort(expected.distances))


def test_what_lies_behind_the_eye_is_left_out(gl: moderngl.Context) -> None:
    """A parallel camera has no behind: its eye in the middle of the box gives the picture of one in front of it."""
    volume = nucleon()
    scene = scene_of(volume, wide_tent(volume))
    camera = Camera.orbit(volume.box, azimuth=31.0, elevation=22.0)
    middle = replace(
        camera,
        eye=tuple(volume.box.centre.tolist()),
        target=tuple((2.0 * volume.box.centre - np.array(camera.eye)).tolist()),
    )
    with ABuffer(gl, scene) as abuffer:
        expected, _ = abuffer.render(middle, SIZE, FRAGMENT)
        found, statistics = abuffer.render(middle, SIZE, COMPUTE)
    assert statistics.compute_tiles == 1
    assert np.quantile(np.abs(found - expected).max(axis=-1), 0.999) < 1e-4


def test_meshes_in_batches_are_rasterised_batch_by_batch(gl: moderngl.Context) -> None:
    volume = nucleon(60)
    scene = scene_of(volume, wide_tent(volume))
    camera = Camera.orbit(volume.box, azimuth=31.0, elevation=22.0)
    pictures = []
    for budget in (1 << 30, 1_200_000):
        with ABuffer(gl, scene) as abuffer:
            rgba, statistics = abuffer.render(camera, SIZE, replace(COMPUTE, mesh_budget_bytes=budget))
            assert (statistics.mesh_batches > 1) == (budget < 1 << 30)
            assert statistics.compute_tiles == 1
            pictures.append(rgba)
    np.testing.assert_array_equal(pictures[1], pictures[0])


@pytest.mark.parametrize(("edge", "expected"), [(40, 1), (600, 0)])
def test_auto_goes_by_the_size_of_the_cells(gl: moderngl.Context, edge: int, expected: int) -> None:
    """9 samples over the box's diagonal of 69 units: cells of 4 and of 43 pixels, against 24."""
    if not is_software(gl):
        pytest.skip("AUTO takes compute shaders on software renderers alone")
    volume = nucleon(9)
    scene = scene_of(volume, wide_tent(volume))
    camera = Camera.orbit(volume.box, azimuth=31.0, elevation=22.0)
    with ABuffer(gl, scene) as abuffer:
        _, statistics = abuffer.render(camera, (edge, edge), RenderSettings())
    assert statistics.compute_tiles == expected


def test_triangles_up_to_the_largest_cover_what_the_pipeline_covers(gl: moderngl.Context) -> None:
    volume = nucleon(9)
    scene = scene_of(volume, wide_tent(volume), per_slope=1)
    camera = Camera.orbit(volume.box, azimuth=31.0, elevation=22.0, zoom=2)
    size = (600, 550)
    with ABuffer(gl, scene) as abuffer:
        _, told = abuffer.render(camera, size, COMPUTE)
        expected = abuffer.fragment_lists(camera, size, FRAGMENT)
        found = abuffer.fragment_lists(camera, size, COMPUTE)
    assert told.compute_tiles == 1
    assert largest_triangle(scene, camera, size) > 100.0
    np.testing.assert_array_equal(np.bincount(found.pixels), np.bincount(expected.pixels))


def largest_triangle(scene: Scene, camera: Camera, size: tuple[int, int]) -> float:
    """Edge of the largest box around a triangle of a parallel picture [pixel]."""
    rays = camera.rays(size[0] / size[1])
    away = scene.vertices["position"].astype(np.float64) + scene.geometry.box.centre - rays.eye
    places = [
        0.5 * pixels * (away @ span) / (span @ span)
        for span, pixels in zip((rays.span_right, rays.span_up), size, strict=True)
    ]
    corners = [place[scene.indices.reshape(-1, 3)] for place in places]
    return float(max(np.ptp(one, axis=1).max() for one in corners))

"""Pieces of the meshes that are left out, streamed or drawn in one go: the picture does not change by a bit."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt
import pytest

from isosample.errors import CapacityError, InputError
from isosample.rendering.abuffer import ABuffer
from isosample.rendering.camera import Camera, Projection
from isosample.rendering.culling import Bounds, outline_planes, ruled_out, slack_of, tile_planes
from isosample.rendering.device_meshes import bytes_of
from isosample.rendering.frame import frame_block
from isosample.rendering.mesh_batch import GAP, runs
from isosample.rendering.scene import Scene
from isosample.rendering.settings import BuildStage, ClipPlane, RenderSettings
from isosample.rendering.tiles import Tile
from isosample.surfaces.extract import extract_surfaces
from isosample.surfaces.out_of_core import extract_into_store
from isosample.surfaces.settings import ExtractionSettings
from isosample.surfaces.store import MeshStore
from isosample.transfer.control_points import Isosurface
from isosample.transfer.isovalues import plan_isovalues
from isosample.transfer.transfer_function import TransferFunction
from isosample.volume.grid import Volume
from rendering.scenes import ramp_tf

if TYPE_CHECKING:
    from pathlib import Path

    import moderngl

    from isosample.rendering.frame_statistics import FrameStatistics
    from isosample.rendering.picture_frame import PictureFrame

F64 = npt.NDArray[np.float64]
SIZE = (53, 37)
SMALL_BRICKS = ExtractionSettings(brick_cells=4)


def waves(edge: int = 20) -> Volume:
    """Surfaces everywhere in an oblique box of long cells."""
    z, y, x = np.meshgrid(*(np.arange(edge, dtype=np.float64),) * 3, indexing="ij")
    angle = 0.4
    turned = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1.0]])
    field = np.sin(0.9 * x + 0.3 * y) + np.sin(0.8 * y - 0.2 * z) + np.sin(0.7 * z + 0.1 * x)
    return Volume(
        field.astype(np.float32), spacing=(1.0, 0.7, 1.6), origin=(50.0, -3.0, 7.0), direction=turned
    )


def scene_of(volume: Volume, brick_cells: int = 4, *, masked: bool = False) -> Scene:
    low, high = volume.value_range
    tf = TransferFunction(
        ramp_tf(low, high, (0.0, 0.3)).points, [Isosurface(0.5 * (low + high), (0.0, 1.0, 0.0), 0.2)]
    )
    plan = plan_isovalues(tf, volume.value_range, per_slope=3)
    return Scene.build(
        extract_surfaces(volume, plan.isovalues, brick_cells=brick_cells, nan_masked=masked), plan
    )


def in_one_piece(scene: Scene) -> Scene:
    """The same scene, of which nothing is known but where its levels stand: everything is drawn."""
    return replace(scene, levels=tuple(replace(part, chunks=None) for part in scene.levels))


def random_camera(volume: Volume, rng: np.random.Generator) -> Camera:
    box = volume.box
    eye = box.centre + rng.normal(size=3) * box.radius * rng.choice([0.1, 0.4, 1.0, 3.0])
    target = box.centre + rng.normal(size=3) * 0.5 * box.radius
    up = tuple(rng.normal(size=3).tolist())
    if rng.random() < 0.4:
        return Camera(
            projection=Projection.ORTHOGRAPHIC,
            eye=tuple(eye),
            target=tuple(target),
            up=up,
            height=box.radius * float(rng.uniform(0.1, 2.5)),
        )
    fov = float(rng.uniform(5.0, 110.0))
    return Camera(
        projection=Projection.PERSPECTIVE, eye=tuple(eye), target=tuple(target), up=up, fov_y_degrees=fov
    )


def random_planes(volume: Volume, rng: np.random.Generator) -> tuple[ClipPlane, ...]:
    planes = []
    for _ in range(int(rng.integers(0, 4))):
        normal = rng.normal(size=3)
        normal /= np.linalg.norm(normal)
        through = volume.box.centre + rng.uniform(-0.7, 0.4) * volume.box.radius * normal
        x, y, z = normal.tolist()
        planes.append(ClipPlane(x, y, z, float(-normal @ through)))
    return tuple(planes)


def judged(statistics: FrameStatistics) -> tuple[int, ...]:
    """What the resolve pass counts on the rays that show something."""
    return (
        statistics.band_violations,
        statistics.reordered_fragments,
        statistics.repaired_pixels,
        statistics.unrepaired_pixels,
        statistics.terminated_rays,
    )


def test_what_is_ruled_out_changes_no_bit(gl: moderngl.Context) -> None:
    volume = waves()
    scene = scene_of(volume)
    rng = np.random.default_rng(5)
    outside = clipped = seen = 0
    with ABuffer(gl, in_one_piece(scene)) as everything, ABuffer(gl, scene) as pieces:
        for _ in range(60):
            camera = random_camera(volume, rng)
            settings = RenderSettings(clip_planes=random_planes(volume, rng))
            expected, all_drawn = everything.render(camera, SIZE, settings)
            rgba, drawn = pieces.render(camera, SIZE, settings)
            assert np.array_equal(rgba, expected)
            assert judged(drawn) == judged(all_drawn)
            assert drawn.lost_fragments == 0
            assert (all_drawn.chunks_outside_view, all_drawn.chunks_clipped) == (0, 0)
            outside += drawn.chunks_outside_view > 0
            clipped += drawn.chunks_clipped > 0
            seen += rgba[..., 3].max() > 0
    assert outside > 20
    assert clipped > 10
    assert seen > 40


def test_what_is_counted_as_drawn_and_as_skipped_adds_up(gl: moderngl.Context) -> None:
    volume = waves()
    scene = scene_of(volume)
    box = volume.box
    camera = Camera.orbit(box, azimuth=20, elevation=10, zoom=4)
    beside = ClipPlane(1.0, 0.0, 0.0, -float(box.corners()[:, 0].max()) - 1.0)  # leaves nothing
    with ABuffer(gl, scene) as abuffer:
        _, fitting = abuffer.render(Camera.orbit(box), SIZE, RenderSettings())
        _, near = abuffer.render(camera, SIZE, RenderSettings())
        rgba, hidden = abuffer.render(Camera.orbit(box), SIZE, RenderSettings(clip_planes=(beside,)))
    count = len(scene.chunks())
    assert (fitting.chunks, fitting.chunks_outside_view, fitting.triangles_drawn) == (
        count,
        0,
        scene.triangle_count,
    )
    assert 0 < near.triangles_drawn < scene.triangle_count
    assert 0 < near.chunks_outside_view < count
    assert (hidden.chunks_clipped, hidden.triangles_drawn, hidden.fragments) == (count, 0, 0)
    assert not rgba.any()


def test_a_masked_volume_is_not_clipped_by_pieces(gl: moderngl.Context) -> None:
    volume = waves(12)
    samples = volume.array.astype(np.float32).copy()
    samples[:5, :6, :7] = np.nan
    masked = replace(volume, array=samples)
    scene = scene_of(masked, masked=True)
    plane = ClipPlane(1.0, 0.0, 0.3, -float(volume.box.centre @ [1.0, 0.0, 0.3]) - 0.4 * volume.box.radius)
    camera = Camera.orbit(volume.box, azimuth=75, elevation=10, zoom=1.5)
    settings = RenderSettings(clip_planes=(plane,))
    with ABuffer(gl, scene) as pieces, ABuffer(gl, in_one_piece(scene)) as everything:
        rgba, drawn = pieces.render(camera, SIZE, settings)
        expected, _ = everything.render(camera, SIZE, settings)
    assert np.array_equal(rgba, expected)
    assert drawn.chunks_clipped == 0


def test_no_vertex_of_a_piece_that_is_ruled_out_is_inside_the_picture() -> None:
    volume = waves()
    scene = scene_of(volume)
    chunks = scene.chunks()
    bounds = Bounds(chunks["low"].astype(np.float64), chunks["high"].astype(np.float64))
    rng = np.random.default_rng(9)
    ruled = 0
    for _ in range(100):
        camera = random_camera(volume, rng)
        frame = frame_block(scene, camera, SIZE, RenderSettings())[0]
        whole = Tile(0, 0, *SIZE)
        for side in (1.0, -1.0) if frame["perspective"] else (1.0,):
            out = ruled_out(bounds, tile_planes(frame, whole), side, slack_of(frame))
            ruled += int(out.sum())
            rows = np.concatenate(
                [np.arange(c["first_vertex"], c["first_vertex"] + c["vertex_count"]) for c in chunks[out]]
                or [np.zeros(0, dtype=np.int64)]
            )
            assert not in_picture(scene.vertices["position"][rows].astype(np.float64), frame, side).any()
    assert ruled > 1000


def in_picture(points: F64, frame: np.void, side: float) -> npt.NDArray[np.bool_]:
    """Whether build.vert puts points inside the clip volume."""
    from_eye = points - frame["eye"]
    w = side * (from_eye @ frame["forward"] if frame["perspective"] else np.ones(len(points)))
    x = side * (from_eye @ frame["span_right"]) * frame["inverse_span_right"]
    y = side * (from_eye @ frame["span_up"]) * frame["inverse_span_up"]
    inside: npt.NDArray[np.bool_] = (w > 0) & (np.abs(x) <= w) & (np.abs(y) <= w)
    return inside


def test_clip_planes_have_no_outline_where_the_eye_touches_what_they_leave() -> None:
    volume = waves()
    scene = scene_of(volume)
    centre = volume.box.centre
    plane = ClipPlane(1.0, 0.0, 0.0, -float(centre[0]))
    inside = Camera(
        projection=Projection.PERSPECTIVE,
        eye=tuple(centre),
        target=tuple(centre + np.array([1.0, 1.0, 0.0])),
        fov_y_degrees=60.0,
    )
    block = frame_block(scene, inside, SIZE, RenderSettings(clip_planes=(plane,)))
    assert outline_planes(block[0]) is None
    assert outline_planes(frame_block(scene, inside, SIZE, RenderSettings())[0]) is None
    away = Camera.orbit(volume.box, projection=Projection.PERSPECTIVE)
    found = outline_planes(frame_block(scene, away, SIZE, RenderSettings(clip_planes=(plane,)))[0])
    assert found is not None
    assert found.shape == (32, 4)


@pytest.mark.parametrize("share", [None, 0.2])
def test_stored_surfaces_show_the_same_picture_piece_by_piece(
    gl: moderngl.Context, tmp_path: Path, share: float | None
) -> None:
    volume = waves()
    low, high = volume.value_range
    plan = plan_isovalues(ramp_tf(low, high, (0.0, 0.1)), volume.value_range, per_slope=3)
    scene = Scene.build(extract_surfaces(volume, plan.isovalues, brick_cells=4), plan)
    extra = np.unique(
        [*plan.isovalues, 0.3 * low + 0.7 * high]
    )  # the store may hold more than the plan asks for
    stored = Scene.build(extract_into_store(volume, extra, MeshStore(tmp_path), settings=SMALL_BRICKS), plan)
    whole = int(bytes_of(scene.chunks()).sum())
    budget = 2 * whole if share is None else int(share * whole)
    camera = Camera.orbit(volume.box, azimuth=30, elevation=20, zoom=2)
    planes = (ClipPlane(1.0, 0.2, 0.0, -float(volume.box.centre @ [1.0, 0.2, 0.0])),)
    settings = RenderSettings(mesh_budget_bytes=budget, clip_planes=planes)
    with ABuffer(gl, scene) as in_memory, ABuffer(gl, stored) as on_disk:
        expected, _ = in_memory.render(camera, SIZE, RenderSettings(clip_planes=planes))
        rgba, statistics = on_disk.render(camera, SIZE, settings)
        lists = on_disk.fragment_lists(camera, SIZE, settings)
        all_lists = in_memory.fragment_lists(camera, SIZE, settings)
    assert len(stored.vertices) == 0
    assert stored.triangle_count == scene.triangle_count
    assert np.array_equal(rgba, expected)
    assert np.array_equal(lists.distances, all_lists.distances)
    assert statistics.mesh_bytes <= budget
    assert (statistics.mesh_batches == 1) == (share is None)


def test_a_picture_loads_what_it_needs_of_a_store_once(gl: moderngl.Context, tmp_path: Path) -> None:
    volume = waves()
    low, high = volume.value_range
    plan = plan_isovalues(ramp_tf(low, high, (0.0, 0.1)), volume.value_range, per_slope=1)
    store = MeshStore(tmp_path)
    scene = Scene.build(extract_into_store(volume, plan.isovalues, store, settings=SMALL_BRICKS), plan)
    near = Camera.orbit(volume.box, azimuth=30, elevation=20, zoom=6)
    with ABuffer(gl, scene) as abuffer:
        _, first = abuffer.render(near, SIZE, RenderSettings())
        _, again = abuffer.render(near, SIZE, RenderSettings())
        _, fitting = abuffer.render(Camera.orbit(volume.box), SIZE, RenderSettings())
        _, near_again = abuffer.render(near, SIZE, RenderSettings())
    whole = int(bytes_of(scene.chunks()).sum())
    assert (first.mesh_batches, again.mesh_batches) == (1, 0)
    assert first.mesh_bytes == again.mesh_bytes < 0.7 * whole
    assert (fitting.mesh_batches, fitting.mesh_bytes) == (1, whole)
    assert near_again.mesh_batches == 0


def test_the_box_of_a_stored_piece_holds_its_vertices(tmp_path: Path) -> None:
    volume = waves()
    low, high = volume.value_range
    plan = plan_isovalues(ramp_tf(low, high, (0.0, 0.1)), volume.value_range, per_slope=1)
    scene = Scene.build(
        extract_into_store(volume, plan.isovalues, MeshStore(tmp_path), settings=SMALL_BRICKS), plan
    )
    chunks = scene.chunks()
    assert scene.source is not None
    assert len(chunks) > 8
    for chunk, piece in zip(chunks, scene.source.load(chunks), strict=True):
        assert len(piece.vertices) == chunk["vertex_count"]
        assert (piece.vertices["position"] >= chunk["low"]).all()
        assert (piece.vertices["position"] <= chunk["high"]).all()


@pytest.mark.parametrize("kind", ["outside", "inside"])
def test_batches_change_no_bit(gl: moderngl.Context, kind: str) -> None:
    volume = waves()
    scene = scene_of(volume)
    camera = Camera.orbit(volume.box, azimuth=30, elevation=20)
    if kind == "inside":
        eye = tuple(volume.box.centre + np.array([1.0, 2.0, -3.0]))
        camera = Camera(
            projection=Projection.PERSPECTIVE, eye=eye, target=tuple(volume.box.corner), fov_y_degrees=100.0
        )
    budget = int(bytes_of(scene.chunks()).sum()) // 5
    with ABuffer(gl, scene) as abuffer:
        expected, at_once = abuffer.render(camera, SIZE, RenderSettings())
        rgba, in_parts = abuffer.render(camera, SIZE, RenderSettings(mesh_budget_bytes=budget))
        tiles = RenderSettings(mesh_budget_bytes=budget, fragment_budget_bytes=1 << 16)
    with ABuffer(gl, scene) as abuffer:
        tiled, _ = abuffer.render(camera, SIZE, tiles)
    assert np.array_equal(rgba, expected)
    assert np.array_equal(tiled, expected)
    assert (at_once.mesh_batches, at_once.mesh_bytes) == (1, int(bytes_of(scene.chunks()).sum()))
    assert in_parts.mesh_batches >= 5
    assert in_parts.mesh_bytes <= budget
    assert in_parts.fragments == at_once.fragments


def test_lists_that_are_read_back_in_batches_are_the_same(gl: moderngl.Context) -> None:
    volume = waves(12)
    scene = scene_of(volume)
    camera = Camera.orbit(volume.box, azimuth=30, elevation=20, zoom=2)
    budget = int(bytes_of(scene.chunks()).sum()) // 2
    with ABuffer(gl, scene) as abuffer:
        expected = abuffer.fragment_lists(camera, SIZE, RenderSettings())
    with ABuffer(gl, scene) as abuffer:
        found = abuffer.fragment_lists(camera, SIZE, RenderSettings(mesh_budget_bytes=max(budget, 1 << 16)))
    assert np.array_equal(found.distances, expected.distances)
    assert np.array_equal(found.pixels, expected.pixels)


def test_a_piece_that_exceeds_the_budget_is_named(gl: moderngl.Context) -> None:
    scene = scene_of(waves(), brick_cells=32)
    with ABuffer(gl, scene) as abuffer, pytest.raises(CapacityError, match=r"one piece of level \d+ alone"):
        abuffer.render(Camera.orbit(scene.geometry.box), SIZE, RenderSettings(mesh_budget_bytes=1 << 16))


def test_a_budget_without_room_is_refused() -> None:
    with pytest.raises(InputError, match="mesh budget of 1000 bytes"):
        RenderSettings(mesh_budget_bytes=1000)


def test_a_second_split_picture_builds_nothing_in_vain(
    gl: moderngl.Context, monkeypatch: pytest.MonkeyPatch
) -> None:
    volume = waves()
    camera = Camera.orbit(volume.box, azimuth=30, elevation=20, zoom=3)
    linked = RenderSettings(build_stage=BuildStage.FRAGMENT)
    small = replace(linked, fragment_budget_bytes=1 << 16)
    with ABuffer(gl, scene_of(volume)) as abuffer:
        first, split = abuffer.render(camera, SIZE, small)
        built: list[Tile] = []
        build = abuffer._builder._build

        def build_and_note(tile: Tile, frame: PictureFrame) -> object:
            built.append(tile)
            return build(tile, frame)

        monkeypatch.setattr(abuffer._builder, "_build", build_and_note)
        second, again = abuffer.render(camera, SIZE, small)
        assert len(built) == again.tiles == split.tiles > 2
        third, whole = abuffer.render(camera, SIZE, linked)
        assert whole.tiles == 1
        built.clear()
        abuffer.render(camera, SIZE, linked)
        assert len(built) == 1
    assert np.array_equal(first, second)
    assert np.array_equal(first, third)


def test_neighbouring_pieces_of_a_level_are_one_draw() -> None:
    levels = np.array([0, 0, 0, 1, 1])
    starts = np.array([0, 30, 60 + GAP + 3, 9000, 9030])
    counts = np.array([30, 30, 30, 30, 60])
    level, first, count = runs(levels, starts, counts)
    assert level.tolist() == [0, 0, 1]
    assert first.tolist() == [0, 60 + GAP + 3, 9000]
    assert count.tolist() == [60, 30, 90]
    joined = runs(levels[:3], np.array([0, 30, 60 + GAP]), counts[:3])
    assert joined[2].tolist() == [90 + GAP]
    assert len(runs(levels[:0], starts[:0], counts[:0])[0]) == 0

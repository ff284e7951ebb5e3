"""Lists in slots: the pictures of linked lists, bit for bit, however long the lists and however small the budget."""

from __future__ import annotations

import re
from contextlib import contextmanager
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from isosample.gl import buffer_image
from isosample.gl.context import is_software, limits
from isosample.gl.shader_source import shader_root
from isosample.integral.segment_rule import SegmentRule
from isosample.rendering import mesh_batch, stage
from isosample.rendering.abuffer import ABuffer
from isosample.rendering.camera import Camera, Projection
from isosample.rendering.crossing_slots import CLASSES, MOST_SLOT_GROUPS, packet_total
from isosample.rendering.device_scene import DeviceScene
from isosample.rendering.frame import shared_constants
from isosample.rendering.mesh_batch import Batch
from isosample.rendering.scene import Scene
from isosample.rendering.settings import BuildStage, ClipPlane, Material, RenderSettings, ResolveStage
from isosample.rendering.slot_building import MOST_STRIPS
from isosample.rendering.slot_resolve import SlotResolve, takers
from isosample.rendering.tiles import Tile
from isosample.rendering.triangle_raster import RESTING, TriangleRaster
from isosample.surfaces.extract import extract_surfaces
from isosample.transfer.control_points import ControlPoint, Isosurface
from isosample.transfer.isovalues import plan_isovalues
from isosample.transfer.transfer_function import TransferFunction
from isosample.volume.analytic import nucleon_like, sample_field
from isosample.volume.grid import Volume
from rendering.test_capacity import layers
from rendering.test_chains import TOLD, VOLUMES, camera_of, scene_of, smooth_volume

if TYPE_CHECKING:
    from collections.abc import Iterator

    import moderngl

    from isosample.rendering.frame_statistics import FrameStatistics
    from isosample.rendering.picture_frame import PictureFrame

SLOTTED = RenderSettings(build_stage=BuildStage.COMPUTE)
SIZE = (53, 38)  # packets of 4 x 2 pixels stand over at two sides


def assert_same(
    gl: moderngl.Context, scene: Scene, camera: Camera, size: tuple[int, int], look: RenderSettings
) -> FrameStatistics:
    """The same picture and figures as with linked lists; a fresh renderer each."""
    with ABuffer(gl, scene) as abuffer:
        rgba, told = abuffer.render(camera, size, look)
    with ABuffer(gl, scene) as abuffer:
        expected, expected_told = abuffer.render(camera, size, replace(look, stage=ResolveStage.FRAGMENT))
    assert expected_told.slot_tiles == 0
    assert np.array_equal(rgba.view(np.uint32), expected.view(np.uint32))
    for part in TOLD.split():
        assert getattr(told, part) == getattr(expected_told, part), part
    return told


def along_the_layers() -> Camera:
    """A camera whose rays meet none of the planes of `layers`."""
    return Camera(
        projection=Projection.ORTHOGRAPHIC,
        eye=(3.0, 0.5, 0.5),
        target=(0.5, 0.5, 0.5),
        up=(0.0, 0.0, 1.0),
        height=0.5,
    )


@pytest.mark.parametrize("kind", ["orthographic", "perspective"])
@pytest.mark.parametrize("name", VOLUMES)
def test_slots_give_the_picture_of_linked_lists(gl: moderngl.Context, name: str, kind: str) -> None:
    volume = VOLUMES[name]()
    scene = scene_of(volume, 2)
    centre = np.asarray(volume.box.centre)
    for look in (
        SLOTTED,
        replace(SLOTTED, material=Material(), min_transmittance=0.3),
        replace(SLOTTED, clip_planes=(ClipPlane(0.3, -0.2, 1.0, float(-centre.sum())),)),
        replace(SLOTTED, background=(0.2, 0.3, 0.4, 0.5), segment=SegmentRule.LINEAR),
        replace(SLOTTED, segment=SegmentRule.CONSTANT_FIRST_ORDER),
    ):
        told = assert_same(gl, scene, camera_of(volume, kind), SIZE, look)
        assert told.slot_tiles == told.tiles == told.compute_tiles == 1


def test_lists_that_are_no_chains_leave_the_slots_for_the_programs_that_take_them(
    gl: moderngl.Context,
) -> None:
    volume = VOLUMES["rough"]()
    with ABuffer(gl, scene_of(volume, 2)) as abuffer:
        _, told = abuffer.render(camera_of(volume, "orthographic"), SIZE, SLOTTED)
        counters = abuffer._shared.pool.counters()
    assert told.slot_tiles == 1
    assert 0 < int(counters["balanced_lists"]) < int(counters["broken_chains"])  # both programs ran
    assert int(counters["spilled"]) == int(counters["broken_nodes"]) > int(counters["broken_chains"])


def test_a_slot_holds_nothing_of_an_earlier_picture(gl: moderngl.Context) -> None:
    deep, shallow = smooth_volume(), camera_of(smooth_volume(), "perspective")
    scene = scene_of(deep, 4)
    lit = replace(SLOTTED, material=Material())
    with ABuffer(gl, scene) as abuffer:
        expected, _ = abuffer.render(shallow, SIZE, lit)
    with ABuffer(gl, scene) as abuffer:
        abuffer.render(camera_of(deep, "orthographic"), (64, 64), SLOTTED)
        abuffer.render(camera_of(deep, "orthographic"), (64, 64), lit)
        found, told = abuffer.render(shallow, SIZE, lit)
    assert told.slot_tiles == 1
    assert np.array_equal(found, expected)


@pytest.mark.parametrize(
    "count", [8, 9, 12, 13, 16, 17, 24, 25, 32, 33, 48, 49, 64, 65, 80, 81, 96, 97, 128, 129, 192, 193, 256]
)
def test_lists_of_any_length_up_to_the_last_slot_are_resolved(gl: moderngl.Context, count: int) -> None:
    scene, camera = layers(count, 0.05)
    told = assert_same(gl, scene, camera, (12, 10), SLOTTED)
    assert (told.slot_tiles, told.max_depth_complexity) == (1, count)


def test_longer_lists_are_linked_until_they_are_shorter_again(gl: moderngl.Context) -> None:
    most = MOST_SLOT_GROUPS * shared_constants()["SLOT_GROUP"]
    scene, along = layers(most + 1, 0.05)
    across = along_the_layers()
    assert_same(gl, scene, along, (12, 10), SLOTTED)
    with ABuffer(gl, scene) as abuffer:
        told = [
            abuffer.render(camera, (12, 10), SLOTTED)[1] for camera in (along, along, across, across, along)
        ]
        again = abuffer.render(across, (12, 10), SLOTTED)[1]
    assert [one.max_depth_complexity for one in told] == [most + 1, most + 1, 0, 0, most + 1]
    assert [one.slot_tiles for one in told] == [0, 0, 0, 1, 0]
    assert again.tiles == 1


def rough_seen() -> tuple[Scene, Camera]:
    """Some lists of it are no chains."""
    volume = VOLUMES["rough"]()
    return scene_of(volume, 1), camera_of(volume, "orthographic")


@contextmanager
def no_room_to_spill(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Lists that are no chains find no room as linked ones."""
    with monkeypatch.context() as patched:
        patched.setattr(SlotResolve, "_spill", lambda *_: False)
        yield


def clear_scene() -> Scene:
    """Two tents and nothing else, in pieces: nothing is visible between the tents, nor on the faces of the box."""
    volume = sample_field(nucleon_like(), (25, 25, 25), lower=(0.0,) * 3, upper=(40.0,) * 3)
    low, high = volume.value_range
    at = [low + (high - low) * part for part in (0.15, 0.2, 0.25, 0.5, 0.6, 0.7)]
    colors = [(0.1, 0.3, 1.0), (1.0, 0.7, 0.1)] * 3
    tf = TransferFunction(
        [ControlPoint(v, c, e) for v, c, e in zip(at, colors, (0.0, 0.5, 0.0, 0.0, 0.8, 0.0), strict=True)]
    )
    plan = plan_isovalues(tf, volume.value_range, per_slope=2)
    return Scene.build(extract_surfaces(volume, plan.isovalues, brick_cells=6), plan)


@pytest.mark.parametrize("kind", ["orthographic", "perspective"])
@pytest.mark.parametrize("material", [None, Material()])
def test_what_is_passed_without_a_look_changes_no_bit(
    gl: moderngl.Context, kind: str, material: Material | None
) -> None:
    scene = clear_scene()
    camera = Camera.orbit(scene.geometry.box, azimuth=35, elevation=25, projection=Projection(kind))
    look = replace(SLOTTED, material=material, background=(0.2, 0.3, 0.4, 0.5))
    told = assert_same(gl, scene, camera, SIZE, look)
    assert told.slot_tiles == 1
    with ABuffer(gl, scene) as abuffer:
        device = abuffer._shared.scene
        assert device.face_band == 0
        assert device.constants["LEVEL_LIGHT"] == 0
        found, _ = abuffer.render(camera, SIZE, look)
        expected, _ = abuffer.render(camera, SIZE, replace(look, sort_capacity=1))  # the program for any list
    assert np.array_equal(found.view(np.uint32), expected.view(np.uint32))


def test_slots_and_nodes_stay_within_the_budget_in_strips(
    gl: moderngl.Context, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(mesh_batch, "VERTEX_GAP", 0)
    scene, size = clear_scene(), (96, 90)
    camera = Camera.orbit(scene.geometry.box, azimuth=35, elevation=25, zoom=6)  # some pieces are outside
    tight = replace(SLOTTED, fragment_budget_bytes=2 << 20)
    with ABuffer(gl, scene) as abuffer:
        expected, whole = abuffer.render(camera, size, SLOTTED)
        found, told = abuffer.render(camera, size, tight)
        lit, lit_told = abuffer.render(camera, size, replace(tight, material=Material()))
        again, again_told = abuffer.render(camera, size, tight)
    assert whole.chunks_outside_view > 0
    assert whole.tiles == whole.slot_tiles == 1 < told.tiles == told.slot_tiles
    for one in (told, lit_told, again_told):
        assert one.pool_bytes <= tight.fragment_budget_bytes < whole.pool_bytes
    assert np.array_equal(found, expected)
    assert np.array_equal(again, expected)
    assert not np.array_equal(lit, expected)


def test_the_rest_of_a_picture_is_linked_from_the_first_longer_list_on(gl: moderngl.Context) -> None:
    most = MOST_SLOT_GROUPS * shared_constants()["SLOT_GROUP"]
    ramp = np.zeros((2, 3, 2))
    ramp[1, 2] = 1.0  # z (y - 1) above the middle: the higher the pixel, the more levels its ray crosses
    values = (np.arange(2 * most) + 1.0) / (2.0 * most + 1.0)
    tf = TransferFunction([], [Isosurface(float(v), (float(v), 0.5, 0.5), 0.05) for v in values])
    volume = Volume(ramp)
    plan = plan_isovalues(tf, volume.value_range)
    scene = Scene.build(extract_surfaces(volume, plan.isovalues), plan)
    camera = Camera(
        projection=Projection.ORTHOGRAPHIC,
        eye=(0.5, 1.0, 3.0),
        target=(0.5, 1.0, 0.5),
        up=(0.0, 1.0, 0.0),
        height=1.9,
    )
    look = replace(SLOTTED, fragment_budget_bytes=229_376)  # the first strip has 32 rows
    with ABuffer(gl, scene) as abuffer:
        found, told = abuffer.render(camera, (40, 60), look)
        expected, _ = abuffer.render(camera, (40, 60), replace(look, stage=ResolveStage.FRAGMENT))
    assert told.max_depth_complexity > most
    assert 0 < told.slot_tiles < told.tiles
    assert told.pool_bytes <= look.fragment_budget_bytes
    assert np.array_equal(found, expected)


@pytest.mark.parametrize("block", [1 << 12, (1 << 14) + 256])  # [byte]: first crossings take 17 024
@pytest.mark.parametrize("lit", [False, True])
def test_slots_may_be_larger_than_a_storage_block(
    gl: moderngl.Context, monkeypatch: pytest.MonkeyPatch, block: int, lit: bool
) -> None:
    scene, camera = rough_seen()
    look = replace(SLOTTED, material=Material() if lit else None)
    with ABuffer(gl, scene) as abuffer:
        expected, _ = abuffer.render(camera, SIZE, look)
    small = replace(limits(gl), storage_block_bytes=block)
    monkeypatch.setattr(buffer_image, "limits", lambda _: small)
    with ABuffer(gl, scene) as abuffer:
        found, told = abuffer.render(camera, SIZE, look)
        assert abuffer._shared.slots.size_bytes > 2 * block
    assert told.slot_tiles == told.tiles == 1
    assert np.array_equal(found, expected)


def test_as_many_slots_are_begun_with_as_the_picture_before_needed(gl: moderngl.Context) -> None:
    scene, along = layers(50, 0.05)
    across = along_the_layers()
    tight = replace(SLOTTED, fragment_budget_bytes=1 << 19)  # 64 slots of 32² pixels take as much alone
    with ABuffer(gl, scene) as abuffer:
        tiles = [
            abuffer.render(camera, (32, 32), tight)[1].tiles for camera in (along, along, across, across)
        ]
    assert tiles[1] == tiles[2] > tiles[3] == 1


def test_a_few_broken_lists_find_room_in_any_budget(gl: moderngl.Context) -> None:
    scene, camera = rough_seen()
    for kibibytes in range(100, 420, 30):
        look = replace(SLOTTED, fragment_budget_bytes=kibibytes << 10)
        with ABuffer(gl, scene) as abuffer:
            told = abuffer.render(camera, (32, 24), look)[1]
        assert told.pool_bytes <= look.fragment_budget_bytes


def test_where_too_many_lists_are_no_chains_a_picture_is_linked_and_some_that_follow(
    gl: moderngl.Context, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene, camera = rough_seen()
    look = replace(SLOTTED, fragment_budget_bytes=1 << 20)
    with ABuffer(gl, scene) as abuffer:
        expected, whole = abuffer.render(camera, SIZE, look)
        with no_room_to_spill(monkeypatch):
            found, told = abuffer.render(camera, SIZE, look)
        later = [abuffer.render(camera, SIZE, look)[1].slot_tiles for _ in range(RESTING + 1)]
    assert whole.slot_tiles == whole.tiles
    assert told.slot_tiles == 0
    assert told.compute_tiles == told.tiles
    assert told.fragments == whole.fragments
    assert np.array_equal(found, expected)
    assert later == [*([0] * RESTING), whole.slot_tiles]


def test_a_strip_whose_lists_find_no_room_is_linked_and_so_are_those_after_it(
    gl: moderngl.Context, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene, camera = rough_seen()
    tight = replace(SLOTTED, fragment_budget_bytes=1 << 19)
    spill, asked, done = SlotResolve._spill, [], []

    def first_alone(resolve: SlotResolve, tile: Tile, frame: PictureFrame, lists: int, nodes: int) -> bool:
        asked.append(tile)
        return len(asked) < 2 and spill(resolve, tile, frame, lists, nodes)

    with ABuffer(gl, scene) as abuffer:
        expected, whole = abuffer.render(camera, SIZE, SLOTTED)
    with ABuffer(gl, scene) as abuffer:
        monkeypatch.setattr(SlotResolve, "_spill", first_alone)
        found, told = abuffer.render(camera, SIZE, tight, lambda now, of: done.append((now, of)))
    assert len(asked) == 2
    assert 0 < told.slot_tiles < told.tiles == told.compute_tiles
    assert told.fragments == whole.fragments
    assert done[-1] == (SIZE[0] * SIZE[1],) * 2
    assert len(done) == told.tiles
    assert np.array_equal(found, expected)


def test_slots_are_tried_again_with_a_larger_budget(
    gl: moderngl.Context, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene, camera = rough_seen()
    look = replace(SLOTTED, fragment_budget_bytes=1 << 20)
    with ABuffer(gl, scene) as abuffer:
        with no_room_to_spill(monkeypatch):
            assert abuffer.render(camera, SIZE, look)[1].slot_tiles == 0
        assert abuffer.render(camera, SIZE, look)[1].slot_tiles == 0
        assert abuffer.render(camera, SIZE, SLOTTED)[1].slot_tiles == 1


@pytest.mark.parametrize(("budget", "in_slots"), [(185_000, True), (175_000, False)])
def test_lists_that_would_take_many_strips_are_linked(
    gl: moderngl.Context, budget: int, in_slots: bool
) -> None:
    """112 slots of 32² pixels: 114 688 bytes for 4 rows; 65 536 of nodes are kept."""
    scene, camera = layers(100, 0.05)
    look = replace(SLOTTED, fragment_budget_bytes=budget)
    with ABuffer(gl, scene) as abuffer:
        rows = abuffer._shared.slots.most_rows(32, 7, lit=False, budget_bytes=budget)
        told = abuffer.render(camera, (32, 32), look)[1]
    assert (rows >= 32 / MOST_STRIPS) == in_slots
    assert (told.slot_tiles == told.tiles > 1) if in_slots else (told.slot_tiles == 0)


def test_a_lit_picture_after_a_larger_one_keeps_to_the_budget(gl: moderngl.Context) -> None:
    scene, camera = rough_seen()
    with ABuffer(gl, scene) as abuffer:
        held = abuffer.render(camera, (96, 96), SLOTTED)[1].pool_bytes
        for edge in (96, 80, 64, 48):
            look = replace(SLOTTED, fragment_budget_bytes=held, material=Material())
            abuffer.render(camera, (96, 96), replace(look, material=None))
            assert abuffer.render(camera, (edge, edge), look)[1].pool_bytes <= held


def test_pictures_like_one_that_did_not_suit_are_left_to_the_pipeline_for_a_while(
    gl: moderngl.Context, monkeypatch: pytest.MonkeyPatch
) -> None:
    if not is_software(gl):
        pytest.skip("AUTO takes compute shaders on software renderers alone")
    volume, look = smooth_volume(), RenderSettings()
    camera = camera_of(volume, "orthographic")
    assert camera.height is not None
    tried: list[bool] = []
    build = TriangleRaster.build

    def never(*_: object, **__: object) -> bool:
        tried.append(True)
        return False

    def as_it_is(raster: TriangleRaster, *given: object, **named: object) -> bool:
        tried.append(True)
        return build(raster, *given, **named)  # type: ignore[arg-type]

    with ABuffer(gl, scene_of(volume, 2)) as abuffer:
        with monkeypatch.context() as patched:
            patched.setattr(TriangleRaster, "build", never)
            assert abuffer.render(camera, SIZE, look)[1].compute_tiles == 0
        assert len(tried) == 1
        monkeypatch.setattr(TriangleRaster, "build", as_it_is)
        smaller = replace(camera, height=2.0 * camera.height)  # cells, in the picture
        assert abuffer.render(smaller, SIZE, look)[1].compute_tiles == 1
        assert (
            abuffer.render(camera, SIZE, replace(look, build_stage=BuildStage.COMPUTE))[1].compute_tiles == 1
        )
        abuffer.render(camera, SIZE, replace(look, build_stage=BuildStage.FRAGMENT))
        tried.clear()
        told = [abuffer.render(camera, SIZE, look)[1].compute_tiles for _ in range(RESTING + 1)]
    assert told == [*([0] * RESTING), 1]
    assert len(tried) == 1


def test_a_budget_without_room_for_slots_leaves_linked_lists(gl: moderngl.Context) -> None:
    volume = smooth_volume()
    look = replace(SLOTTED, fragment_budget_bytes=1 << 16)
    told = assert_same(gl, scene_of(volume, 2), camera_of(volume, "orthographic"), SIZE, look)
    assert told.slot_tiles == 0
    assert told.pool_bytes <= look.fragment_budget_bytes


@pytest.mark.parametrize(
    "look",
    [
        replace(SLOTTED, build_stage=BuildStage.FRAGMENT),
        replace(SLOTTED, stage=ResolveStage.COMPUTE),
        replace(SLOTTED, sort_capacity=15),
    ],
)
def test_what_asks_for_other_ways_gets_linked_lists(gl: moderngl.Context, look: RenderSettings) -> None:
    volume = smooth_volume()
    with ABuffer(gl, scene_of(volume, 2)) as abuffer:
        assert abuffer.render(camera_of(volume, "orthographic"), SIZE, look)[1].slot_tiles == 0


def test_the_classes_are_those_of_the_shader() -> None:
    constants = shared_constants()
    group = constants["SLOT_GROUP"]
    assert len(CLASSES) == constants["PACKET_CLASSES"]
    longest = [run * runs for run, runs in CLASSES]
    assert longest == sorted(longest)
    assert longest[-1] == group * MOST_SLOT_GROUPS
    text = (shader_root() / "pass" / "packets.glsl").read_text(encoding="utf-8")
    assert [int(bound) for bound in re.findall(r"longest > (\d+)u", text)] == longest[:-1]
    assert constants["PACKET_PIXELS"] == constants["PACKET_WIDTH"] * constants["PACKET_HEIGHT"]
    assert packet_total(Tile(3, 5, 9, 3)) == 3 * 2


def test_the_band_of_the_faces_is_known_where_nothing_of_it_is_seen(gl: moderngl.Context) -> None:
    inner = np.zeros((5, 5, 5))
    inner[1:4, 1:4, 1:4] = np.linspace(-1.0, 1.0, 27).reshape(3, 3, 3)
    volumes = {
        **{name: made() for name, made in VOLUMES.items()},
        "outside": Volume(np.where(inner == 0.0, -1.0, inner)),
        "within": Volume(np.where(inner == 0.0, -0.3, inner)),  # 0.35 of the range, between two levels
    }

    def band(name: str) -> int:
        device = DeviceScene(gl, scene_of(volumes[name], 1))
        device.release()
        return device.face_band

    assert band("rough") == -1  # values of many bands
    assert band("empty") == -1  # two corners are beside the others
    assert band("outside") == 0  # below the first tent
    assert band("within") == -1  # in it


def test_vertices_of_shown_pieces_are_projected_once_and_little_else(
    gl: moderngl.Context, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(mesh_batch, "VERTEX_GAP", 10)
    chunks = np.zeros(
        5, dtype=[("level", "u4"), ("detail", "u4"), ("index_count", "i8"), ("vertex_count", "i8")]
    )
    chunks["vertex_count"] = [20, 20, 30, 40, 5]
    starts = np.array([0, 20, 51, 60, 500])
    buffers = [gl.buffer(reserve=24), gl.buffer(reserve=12)]
    batch = Batch(gl, chunks, np.arange(5), starts, starts, buffers, None, 36)
    every = np.ones(5, dtype=bool)
    first, count = batch.vertex_runs(every)
    assert (first.tolist(), count.tolist()) == ([0, 51, 500], [40, 49, 5])  # a gap of 11; an overlap
    first, count = batch.vertex_runs(every & (np.arange(5) != 1))
    assert (first.tolist(), count.tolist()) == ([0, 51, 500], [20, 49, 5])
    assert batch.vertex_runs(~every)[0].tolist() == []
    batch.release()


def test_a_few_packets_wait_for_no_program_of_their_own() -> None:
    nothing = [False] * 6
    assert takers([900, 100, 100, 100, 0, 3], nothing) == [0, 1, 2, 3, 4, 5]  # the longest need theirs
    assert takers([900, 3, 100, 100, 3, 3], nothing) == [0, 2, 2, 3, 5, 5]
    assert takers([900, 3, 100, 0, 3, 0], [False, False, False, True, False, True]) == [0, 2, 2, 3, 5, 5]
    assert takers([900, 3, 100, 0, 3, 0], [False, True, False, False, True, False]) == [0, 1, 2, 3, 4, 5]
    for counts in ([0] * 6, [5, 0, 0, 1, 0, 0]):
        assert takers(counts, nothing) == [0, 1, 2, 3, 4, 5]


def test_a_picture_of_one_row_stays_what_it_was(gl: moderngl.Context) -> None:
    volume = smooth_volume()
    first, second = camera_of(volume, "orthographic"), camera_of(volume, "perspective")
    with ABuffer(gl, scene_of(volume, 1)) as abuffer:
        one, _ = abuffer.render(first, (9, 1), SLOTTED)
        kept = one.copy()
        other, _ = abuffer.render(second, (9, 1), SLOTTED)
    assert not np.array_equal(other, kept)
    assert np.array_equal(one, kept)


def test_for_how_many_threads_work_is_shared_out_changes_no_bit(
    gl: moderngl.Context, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene = clear_scene()
    camera = Camera.orbit(scene.geometry.box, azimuth=35, elevation=25)
    pictures = []
    for threads in (1, 2, 3, 7, stage.MOST_THREADS):
        monkeypatch.setattr(stage, "renderer_threads", lambda threads=threads: threads)
        with ABuffer(gl, scene) as abuffer:
            pictures.append(abuffer.render(camera, SIZE, SLOTTED)[0])
    for picture in pictures[1:]:
        assert np.array_equal(picture, pictures[0])

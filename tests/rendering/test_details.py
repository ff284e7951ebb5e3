"""Pictures with coarser meshes: each piece once, at a displacement below the asked fraction of a pixel."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
import pytest

from isosample.errors import InputError
from isosample.integral.reference import RAYS_PER_BLOCK
from isosample.rendering.abuffer import ABuffer
from isosample.rendering.camera import Camera, Projection
from isosample.rendering.detail_choice import DetailChoice
from isosample.rendering.frame import frame_block
from isosample.rendering.pipeline import Renderer
from isosample.rendering.preparation import prepare_surfaces
from isosample.rendering.quality import Quality
from isosample.rendering.scene import Scene
from isosample.rendering.screen_error import screen_error_within
from isosample.rendering.settings import ClipPlane, RenderSettings
from isosample.rendering.stored_preparation import prepare_stored_surfaces
from isosample.surfaces.detail import MOST_DETAILS, detail_tolerance
from isosample.surfaces.detail_sets import with_details
from isosample.surfaces.extract import extract_surfaces
from isosample.surfaces.out_of_core import SurfaceLists, extract_into_store
from isosample.surfaces.settings import ExtractionSettings
from isosample.surfaces.store import MeshStore
from isosample.transfer.control_points import Isosurface
from isosample.transfer.isovalues import plan_isovalues
from isosample.transfer.transfer_function import TransferFunction
from isosample.volume.analytic import GaussianMixture, sample_field
from isosample.volume.grid import Volume
from isosample.volume.scan import scan_volume
from rendering.scenes import ramp_tf

if TYPE_CHECKING:
    from pathlib import Path

    import moderngl

    from isosample.surfaces.surface_set import SurfaceSet
    from isosample.transfer.isovalue_plan import IsovaluePlan

F64 = npt.NDArray[np.float64]
SIZE = (61, 47)
SPACING = (0.5, 1.0, 0.7)


def blobs(edge: int = 40) -> Volume:
    """Two Gaussians of smooth, nested isosurfaces, in a box of long cells."""
    field = GaussianMixture(
        centres=((-0.3, 0, 0.1), (0.35, 0.1, 0)), widths=(0.3, 0.25), amplitudes=(1.0, 0.9)
    )
    sampled = sample_field(field, (edge,) * 3, lower=(-1.0,) * 3, upper=(1.0,) * 3)
    return replace(sampled, spacing=SPACING, origin=(3.0, -2.0, 50.0))


def plan_of(volume: Volume) -> IsovaluePlan:
    low, high = volume.value_range
    tf = TransferFunction(ramp_tf(low, high, (0.0, 0.4)).points, [Isosurface(0.5, (0.0, 1.0, 0.0), 0.3)])
    return plan_isovalues(tf, volume.value_range, per_slope=4)


def surfaces_of(
    volume: Volume, plan: IsovaluePlan, details: int = MOST_DETAILS, **options: object
) -> SurfaceSet:
    def at(detail: int) -> SurfaceSet:
        return extract_surfaces(volume, plan.isovalues, brick_cells=16, detail=detail, **options)  # type: ignore[arg-type]

    return with_details(at, details)


def cameras(volume: Volume) -> list[Camera]:
    """From far away, close up, from inside, and parallel."""
    box = volume.box
    far = Camera.orbit(box, azimuth=25, elevation=35, projection=Projection.PERSPECTIVE)
    near = Camera.orbit(box, azimuth=70, elevation=-20, zoom=3.0, projection=Projection.PERSPECTIVE)
    eye = box.centre + 0.3 * box.radius * np.array([0.3, 0.5, 0.8])
    inside = Camera(
        projection=Projection.PERSPECTIVE, eye=tuple(eye), target=tuple(box.centre), fov_y_degrees=70.0
    )
    return [far, near, inside, Camera.orbit(box, azimuth=120, elevation=10)]


@pytest.fixture(scope="module")
def scene() -> Scene:
    volume = blobs()
    plan = plan_of(volume)
    return Scene.build(surfaces_of(volume, plan), plan)


def chosen(scene: Scene, camera: Camera, screen_error: float) -> npt.NDArray[np.bool_]:
    frame = frame_block(scene, camera, SIZE, RenderSettings())[0]
    return DetailChoice(scene.chunks(), max(SPACING)).chosen(frame, screen_error)


@pytest.mark.parametrize("screen_error", [0.0, 0.1, 0.4, 3.0])
def test_every_level_in_every_brick_is_taken_once(scene: Scene, screen_error: float) -> None:
    chunks = scene.chunks()
    for camera in cameras(blobs()):
        taken = chunks[chosen(scene, camera, screen_error)]
        names = np.concatenate([taken["level"][:, None].astype(np.int64), taken["brick"]], axis=1)
        everywhere = np.concatenate([chunks["level"][:, None].astype(np.int64), chunks["brick"]], axis=1)
        assert len(names) == len(np.unique(names, axis=0)) == len(np.unique(everywhere, axis=0))


def test_a_displacement_covers_less_than_is_asked_for(scene: Scene) -> None:
    """Steps of the chosen details' size at vertices, in random directions, by the projection of the vertex shader."""
    chunks, rng, largest = scene.chunks(), np.random.default_rng(4), 0.4
    details: set[int] = set()
    widest = 0.0
    for camera in cameras(blobs()):
        frame = frame_block(scene, camera, SIZE, RenderSettings())[0]
        for chunk in chunks[chosen(scene, camera, largest)]:
            rows = slice(chunk["first_vertex"], chunk["first_vertex"] + chunk["vertex_count"])
            start = scene.vertices["position"][rows].astype(np.float64)
            step = rng.normal(size=start.shape)
            step *= 1e-6 * max(SPACING) / np.linalg.norm(step, axis=1, keepdims=True)  # small: the derivative
            before, after = image_of(start, frame), image_of(start + step, frame)
            seen = (np.abs(before) <= 0.5 * np.array(SIZE)).all(axis=1)
            moved = (
                np.linalg.norm(after - before, axis=1)[seen] * 1e6 * detail_tolerance(int(chunk["detail"]))
            )
            widest = max(widest, float(moved.max(initial=0.0)))
            details.add(int(chunk["detail"]))
    assert len(details) >= 5
    assert (
        0.25 * largest < widest <= largest * (1 + 1e-3)
    )  # details differ by a factor of 2; the finite step by 1e-6


def image_of(points: F64, frame: np.void) -> F64:
    """Place in the picture from its middle [pixel], as build.vert has it."""
    from_eye = points - frame["eye"].astype(np.float64)
    depth = from_eye @ frame["forward"].astype(np.float64) if frame["perspective"] else np.ones(len(points))
    plane = [
        (from_eye @ frame[f"span_{side}"].astype(np.float64)) * float(frame[f"inverse_span_{side}"])
        for side in ("right", "up")
    ]
    with np.errstate(divide="ignore", invalid="ignore"):
        image: F64 = (
            0.5 * np.array(SIZE) * np.where(depth[:, None] > 0, np.stack(plane, axis=1) / depth[:, None], 1e9)
        )
    return image


def test_the_finest_picture_is_that_without_details(gl: moderngl.Context, scene: Scene) -> None:
    volume = blobs()
    plan = plan_of(volume)
    with (
        ABuffer(gl, scene) as detailed,
        ABuffer(gl, Scene.build(surfaces_of(volume, plan, 0), plan)) as plain,
    ):
        for camera in cameras(volume):
            expected, cost = plain.render(camera, SIZE, RenderSettings())
            found, finest = detailed.render(camera, SIZE, RenderSettings(screen_error=0.0))
            assert np.array_equal(found, expected)
            assert (finest.chunks, finest.triangles_drawn, finest.chunks_coarser) == (
                cost.chunks,
                cost.triangles_drawn,
                0,
            )


def test_coarser_pictures_lose_no_crossing_and_hardly_differ(gl: moderngl.Context, scene: Scene) -> None:
    seen = 0
    with ABuffer(gl, scene) as abuffer:
        for camera in cameras(blobs()):
            expected, fine = abuffer.render(camera, SIZE, RenderSettings(screen_error=0.0))
            found, coarse = abuffer.render(camera, SIZE, RenderSettings(screen_error=0.25))
            seen += coarse.chunks_coarser
            assert (coarse.triangles_drawn < fine.triangles_drawn) == (coarse.chunks_coarser > 0)
            assert (coarse.lost_fragments, coarse.unrepaired_pixels, coarse.band_violations) == (0, 0, 0)
            # The impulse appears or not in a pixel whose centre its outline passes by: it moves by a quarter
            # of a pixel at most, so in a quarter of the outlines' pixels at most. Two outlines, seen from
            # inside twice as large as the picture is high, have some 4 * 47 pixels: 0.25 * 188 of 61 * 47 are
            # 1.6 %; three times that is allowed.
            difference = np.abs(found - expected).max(axis=-1)
            assert (difference > 0.02).mean() < 0.05
            assert (difference.max() > 0.0) == (coarse.chunks_coarser > 0)
    assert seen > 50


def test_planes_are_the_same_at_any_detail(gl: moderngl.Context) -> None:
    """On a linear field every triangle lies in its isosurface, however large."""
    z, y, x = np.mgrid[0:24, 0:24, 0:24]
    volume = Volume((0.31 * x + 0.2 * y + 0.5 * z).astype(np.float32))
    plan = plan_isovalues(ramp_tf(*volume.value_range, (0.0, 0.2)), volume.value_range, per_slope=6)
    camera = Camera.orbit(volume.box, azimuth=33, elevation=21)
    with ABuffer(gl, Scene.build(surfaces_of(volume, plan), plan)) as abuffer:
        expected, fine = abuffer.render(camera, SIZE, RenderSettings(screen_error=0.0, curved=False))
        found, coarse = abuffer.render(camera, SIZE, RenderSettings(screen_error=9.0, curved=False))
    assert coarse.triangles_drawn < 0.5 * fine.triangles_drawn
    assert coarse.fragments == pytest.approx(
        fine.fragments, rel=1e-3
    )  # outlines on the box's faces, in sub-pixels
    # A crossing's distance is interpolated between vertices that are rounded to 2^-24 of the box's size (24) and to the
    # rasteriser's 1/256 pixel, which on a plane of slope up to 4 against the image moves it by 4 * 0.7 / 256
    # = 0.01 voxel. Levels are passed in turn, so a shift of 0.01 changes the light of the two segments beside
    # it by 0.01 * 0.2 at most, of opposite sign but for the change of colour and extinction between them: all
    # in all below 8 levels * 0.002 / 4.
    assert np.abs(found - expected).max() < 8 * 0.002 / 4


def test_stored_and_streamed_details_give_the_same_picture(gl: moderngl.Context, tmp_path: Path) -> None:
    volume = blobs()
    plan = plan_of(volume)
    store = MeshStore(tmp_path)

    def stored(detail: int) -> object:
        settings = ExtractionSettings(brick_cells=16, detail=detail)
        return extract_into_store(volume, plan.isovalues, store, settings=settings)

    there = with_details(stored, MOST_DETAILS)  # type: ignore[type-var]
    in_memory = Scene.build(surfaces_of(volume, plan), plan)
    one_by_one = RenderSettings(mesh_budget_bytes=1 << 17)
    batches = 0
    with ABuffer(gl, in_memory) as expected, ABuffer(gl, Scene.build(there, plan)) as found:  # type: ignore[arg-type]
        for camera in cameras(volume):
            rgba, drawn = expected.render(camera, SIZE, RenderSettings())
            for settings in (RenderSettings(), one_by_one):
                other, again = found.render(camera, SIZE, settings)
                assert np.array_equal(other, rgba)
                assert again.triangles_drawn == drawn.triangles_drawn
                batches = max(batches, again.mesh_batches)
    assert batches > 1


def test_clip_planes_rule_out_pieces_of_the_chosen_details_only(gl: moderngl.Context, scene: Scene) -> None:
    volume = blobs()
    plane = ClipPlane(1.0, 0.0, 0.0, -float(volume.box.centre[0]))
    camera = Camera.orbit(volume.box, azimuth=90)
    with ABuffer(gl, scene) as abuffer:
        _, whole = abuffer.render(camera, SIZE, RenderSettings())
        _, cut = abuffer.render(camera, SIZE, RenderSettings(clip_planes=(plane,)))
    assert cut.chunks == whole.chunks
    assert cut.chunks_clipped + cut.chunks_outside_view <= cut.chunks


def test_details_of_other_surfaces_are_refused() -> None:
    volume = blobs()
    plan = plan_of(volume)
    surfaces = surfaces_of(volume, plan, 2)
    for wrong in (
        surfaces.details[0],
        replace(surfaces, details=surfaces.details[1:]),
        replace(surfaces, details=(replace(surfaces.details[0], isovalues=surfaces.isovalues + 0.01),)),
    ):
        with pytest.raises(InputError, match="detail"):
            Scene.build(wrong, plan)


def test_a_piece_of_which_it_is_not_known_where_it_lies_is_shown_at_its_finest(scene: Scene) -> None:
    levels = (replace(scene.levels[0], chunks=None), *scene.levels[1:])
    mixed = replace(scene, levels=levels)
    camera = cameras(blobs())[0]
    chunks = mixed.chunks()
    frame = frame_block(mixed, camera, SIZE, RenderSettings())[0]
    taken = DetailChoice(chunks, max(SPACING)).chosen(frame, 9.0)
    assert taken[np.isinf(chunks["low"]).any(axis=1)].all()


@pytest.mark.parametrize("screen_error", [-0.1, float("nan"), float("inf")])
def test_an_impossible_screen_error_is_refused(screen_error: float) -> None:
    with pytest.raises(InputError, match=r"screen_error .* must be a number of pixels >= 0"):
        RenderSettings(screen_error=screen_error)


def test_preparation_adds_details_from_memory_and_from_a_folder(tmp_path: Path) -> None:
    volume = blobs()
    tf = ramp_tf(*volume.value_range, (0.0, 0.4))
    quality = Quality(per_slope=2, details=2)
    stages: set[str] = set()
    found = prepare_surfaces(volume, tf, quality, progress=lambda stage, *_: stages.add(stage))
    cached = prepare_surfaces(volume, tf, quality, cache=tmp_path / "cache")
    again = prepare_surfaces(volume, tf, quality, cache=tmp_path / "cache")
    lists = SurfaceLists(folder=tmp_path / "lists", content_hash="0" * 64)
    stored = prepare_stored_surfaces(volume, tf, quality, lists, memory=1 << 32, scan=scan_volume(volume))
    assert {"extract", "detail 1", "detail 2"} <= stages
    counts = [one.statistics.triangles for one in found.surfaces.by_detail]
    for other in (cached, again, stored):
        assert [one.statistics.triangles for one in other.surfaces.by_detail] == counts
    assert [one.statistics.brick_visits for one in again.surfaces.details] == [0, 0]
    with pytest.raises(InputError, match="details 6 must be a whole number from 0 to 5"):
        Quality(details=6)


def test_a_tolerance_decides_how_coarse_pictures_may_be(gl: moderngl.Context) -> None:
    volume = blobs()
    plan = plan_of(volume)
    camera = [Camera.orbit(volume.box, azimuth=25, elevation=35)]
    with Renderer(surfaces_of(volume, plan, residuals=True), plan) as renderer:
        finest = renderer.error_map(camera=camera[0], size=SIZE, settings=RenderSettings(screen_error=0.0))
        known = finest.percentiles()
        report = {"reached": 1e-3, "estimates": known, "missed": None}
        looked_at: list[tuple[int, int]] = []

        def allowed(tolerance: float, **changed: object) -> float:
            asked = report | {"tolerance": tolerance} | changed
            return screen_error_within(
                renderer, asked, camera, SIZE, progress=lambda *count: looked_at.append(count)
            )

        # the expected error is what was reached times the growth of the estimates, so 1e-3 where nothing is coarser
        assert allowed(1.0) == 0.25
        assert allowed(0.9e-3) == 0.0
        between = [allowed(tolerance) for tolerance in np.geomspace(1e-3, 1.0, 8).tolist()]
        # What the plan knows nothing of is held against the finest picture of the same view, here the plan's own.
        unknown = {"estimates": known | {"mesh": 0.0}}
        assert [allowed(t, **unknown) for t in (0.9e-3, 1e-2, 1.0)] == [
            allowed(t) for t in (0.9e-3, 1e-2, 1.0)
        ]
        looked_at.clear()
        assert allowed(1.0) == 0.25
        assert looked_at == [(1, 4), (4, 4)]
        looked_at.clear()
        assert allowed(1.0, missed="mesh") == 0.0
        assert not looked_at
        with pytest.raises(InputError, match="cameras is empty"):
            screen_error_within(renderer, report | {"tolerance": 1.0}, [], SIZE)
    assert between == sorted(between)
    assert len(set(between)) > 1


def test_an_estimate_may_not_grow_from_nothing() -> None:
    class Renderer:
        """Error maps whose mesh estimate is 0 unless meshes are coarser than an eighth of a pixel."""

        def error_map(self, *, camera: object, size: object, settings: RenderSettings) -> Any:  # noqa: ARG002
            mesh = 1e-9 if settings.screen_error > 0.125 else 0.0
            return SimpleNamespace(percentiles=lambda: {"indicator": 1e-4, "mesh": mesh})

    report = {
        "tolerance": 1.0,
        "reached": 1e-3,
        "missed": None,
        "estimates": {"indicator": 1e-4, "mesh": 0.0},
    }
    camera = Camera.orbit(blobs().box)
    assert screen_error_within(Renderer(), report, [camera], SIZE) == 0.125  # type: ignore[arg-type]
    known = report | {"estimates": {"indicator": 1e-4, "mesh": 1e-9}}
    assert screen_error_within(Renderer(), known, [camera], SIZE) == 0.25  # type: ignore[arg-type]


@pytest.mark.usefixtures("gl")
def test_an_error_map_tells_how_far_it_is_from_the_start_on() -> None:
    volume = blobs()
    plan = plan_of(volume)
    told: list[tuple[str, int, int]] = []
    with Renderer(surfaces_of(volume, plan, 1, residuals=True), plan) as renderer:
        renderer.error_map(size=(64, 32), progress=lambda *step: told.append(step))
    done = [pixels for stage, pixels, of in told if (stage, of) == ("error map", 64 * 32)]
    # four blocks of rays, of one part of the lists
    assert done == [0, *range(RAYS_PER_BLOCK, 64 * 32 + 1, RAYS_PER_BLOCK)]


def test_an_error_map_leaves_no_seconds_to_the_next_picture(gl: moderngl.Context) -> None:
    volume = blobs()
    plan = plan_of(volume)
    camera = Camera.orbit(volume.box, azimuth=25)
    with Renderer(surfaces_of(volume, plan, 1, residuals=True), plan) as renderer:
        timer = renderer._abuffer.timer
        timer.seconds["build"] = 7.0
        renderer.error_map(camera=camera, size=SIZE)
        assert timer.seconds["build"] == 7.0
        assert set(timer.seconds) == {"build", "upload"}  # the meshes stay on the GPU

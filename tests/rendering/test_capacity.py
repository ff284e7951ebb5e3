"""Long lists, large pictures and small memory: nothing is lost, and the picture depends on none of it."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from isosample.errors import CapacityError, LostFragmentsError
from isosample.gl import buffer_image
from isosample.gl.context import is_software, limits
from isosample.rendering import resolve_pass
from isosample.rendering.abuffer import ABuffer
from isosample.rendering.camera import Camera, Projection
from isosample.rendering.fragment_pool import NODE_STEP, ROOM
from isosample.rendering.frame import shared_constants
from isosample.rendering.scene import LevelRange, Scene
from isosample.rendering.settings import BuildStage, RenderSettings, ResolveStage
from isosample.rendering.tiles import Tile, strips, tiles_that_fit
from isosample.surfaces.extract import extract_surfaces
from isosample.transfer.control_points import ControlPoint, Isosurface
from isosample.transfer.isovalues import plan_isovalues
from isosample.transfer.transfer_function import TransferFunction
from isosample.volume.analytic import nucleon_like, sample_field
from isosample.volume.grid import Volume

if TYPE_CHECKING:
    from collections.abc import Iterator

    import moderngl

NODE_BYTES = 16
LINKED = RenderSettings(build_stage=BuildStage.FRAGMENT)
SLOTTED = RenderSettings(build_stage=BuildStage.COMPUTE)  # lists in slots
BLOCK_LIMIT = 128 << 20  # Mesa's storage block, which every scene must manage with


def layers(count: int, opacity: float) -> tuple[Scene, Camera]:
    """Impulse planes z = constant that cover every pixel of the picture."""
    volume = Volume(np.broadcast_to(np.array([0.0, 1.0])[:, None, None], (2, 2, 2)))
    values = (np.arange(count) + 1.0) / (count + 1.0)
    tf = TransferFunction(
        [], [Isosurface(float(v), (float(v), 1.0 - float(v), 0.5), opacity) for v in values]
    )
    plan = plan_isovalues(tf, volume.value_range)
    camera = Camera(
        projection=Projection.ORTHOGRAPHIC, eye=(0.5, 0.5, 3.0), target=(0.5, 0.5, 0.5), height=0.5
    )
    return Scene.build(extract_surfaces(volume, plan.isovalues), plan), camera


def composite_of_layers(count: int, opacity: float) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
    """Closed form: the eye is on the side of the highest value."""
    values = (np.arange(count) + 1.0)[::-1] / (count + 1.0)
    weights = opacity * (1.0 - opacity) ** np.arange(count)
    color = (weights[:, None] * np.stack([values, 1.0 - values, np.full(count, 0.5)], axis=1)).sum(axis=0)
    return np.array([*color, 1.0 - (1.0 - opacity) ** count])


@pytest.mark.parametrize(
    ("edge", "count"),
    [
        (256, 30),
        (256, 200),
        (1024, 30),
        pytest.param(1024, 200, marks=pytest.mark.slow),
        pytest.param(64, 3000, marks=pytest.mark.slow),
    ],
)
def test_full_screen_layers_composite_to_the_analytic_product(
    gl: moderngl.Context, edge: int, count: int
) -> None:
    opacity = min(0.05, 6.0 / count)
    scene, camera = layers(count, opacity)
    settings = RenderSettings(fragment_budget_bytes=BLOCK_LIMIT)
    with ABuffer(gl, scene) as abuffer:
        rgba, statistics = abuffer.render(camera, (edge, edge), settings)
    assert statistics.fragments == count * edge * edge
    assert statistics.lost_fragments == 0
    assert statistics.max_depth_complexity == count
    assert statistics.band_violations == 0
    assert statistics.pool_bytes <= BLOCK_LIMIT
    assert statistics.tiles >= count * edge * edge * NODE_BYTES / BLOCK_LIMIT
    # 3 roundings per layer on weights that sum to less than 1, and the rest behind min_transmittance = 2^-20.
    assert np.abs(rgba - composite_of_layers(count, opacity)).max() <= min(
        1e-5, 3 * count * 2.0**-24 + 2.0**-20
    )


@pytest.mark.parametrize("stage", [ResolveStage.FRAGMENT, ResolveStage.COMPUTE])
def test_lists_of_many_thousands_are_sorted(gl: moderngl.Context, stage: ResolveStage) -> None:
    count = resolve_pass.LONGEST_LIST
    scene, camera = layers(count, 0.001)
    with ABuffer(gl, scene) as abuffer:
        rgba, statistics = abuffer.render(camera, (8, 8), RenderSettings(stage=stage))
    assert statistics.max_depth_complexity == count
    assert statistics.band_violations == 0
    assert np.abs(rgba - composite_of_layers(count, 0.001)).max() <= 3 * count * 2.0**-24


def test_a_walk_that_the_driver_cuts_short_is_an_error(
    gl: moderngl.Context, monkeypatch: pytest.MonkeyPatch
) -> None:
    if not is_software(gl):
        pytest.skip("only llvmpipe is known to end long loops")
    monkeypatch.setattr(resolve_pass, "LONGEST_LIST", 20_000)
    scene, camera = layers(9000, 0.0005)
    with ABuffer(gl, scene) as abuffer, pytest.raises(LostFragmentsError, match="not walked to their end"):
        abuffer.render(camera, (8, 8), RenderSettings(min_transmittance=0.0))


def translucent_scene() -> tuple[Scene, Camera]:
    """Two tents over a nucleon-like field, from an oblique eye."""
    volume = sample_field(
        nucleon_like(),
        (33, 33, 33),
        lower=(0.0, 0.0, 0.0),
        upper=(40.0, 40.0, 40.0),
        dtype=np.float32,
        name="n",
    )
    low, high = volume.value_range
    at = [low + (high - low) * part for part in (0.1, 0.25, 0.4, 0.6, 0.75, 0.9)]
    colors = [(0.1, 0.3, 1.0)] * 3 + [(1.0, 0.7, 0.1)] * 3
    extinctions = [0.0, 0.1, 0.0, 0.0, 0.5, 0.0]
    tf = TransferFunction(
        [ControlPoint(v, c, e) for v, c, e in zip(at, colors, extinctions, strict=True)],
        [Isosurface(at[2], (0.0, 1.0, 0.0), 0.1)],
    )
    plan = plan_isovalues(tf, volume.value_range)
    camera = Camera.orbit(volume.box, azimuth=30, elevation=20, projection=Projection.PERSPECTIVE)
    return Scene.build(extract_surfaces(volume, plan.isovalues), plan), camera


def test_tiles_change_no_bit(gl: moderngl.Context) -> None:
    scene, camera = translucent_scene()
    size = (101, 67)
    with ABuffer(gl, scene) as abuffer:
        whole, at_once = abuffer.render(camera, size, RenderSettings())
    with ABuffer(gl, scene) as abuffer:
        small = RenderSettings(fragment_budget_bytes=1 << 16)
        tiled, in_parts = abuffer.render(camera, size, small)
    assert at_once.tiles == 1
    assert in_parts.tiles > 5
    assert in_parts.fragments == at_once.fragments
    assert np.array_equal(tiled, whole)


def test_shuffled_triangles_change_no_bit(gl: moderngl.Context) -> None:
    scene, camera = translucent_scene()
    with ABuffer(gl, scene) as abuffer:
        expected, _ = abuffer.render(camera, (96, 96), RenderSettings())
    rng = np.random.default_rng(3)
    for _ in range(3):
        with ABuffer(gl, shuffled(scene, rng)) as abuffer:
            rgba, _ = abuffer.render(camera, (96, 96), RenderSettings())
        assert np.array_equal(rgba, expected)


def shuffled(scene: Scene, rng: np.random.Generator) -> Scene:
    """The same triangles in another order, and the levels drawn in another order."""
    parts: list[np.ndarray[tuple[int, ...], np.dtype[np.uint32]]] = []
    levels = []
    first = 0
    for part in rng.permutation(np.array(scene.levels, dtype=object)):
        rows = scene.indices[part.first_index : part.first_index + part.index_count].reshape(-1, 3)
        parts.append(rng.permutation(rows).ravel())
        levels.append(LevelRange(level=part.level, first_index=first, index_count=part.index_count))
        first += part.index_count
    return replace(scene, indices=np.concatenate(parts), levels=tuple(levels))


def test_a_pixel_that_does_not_fit_the_budget_is_an_error_not_a_darker_picture(gl: moderngl.Context) -> None:
    scene, camera = layers(5000, 0.001)
    with ABuffer(gl, scene) as abuffer, pytest.raises(CapacityError, match=r"5000 fragments.*4096 fit"):
        abuffer.render(camera, (8, 8), RenderSettings(fragment_budget_bytes=1 << 16))


def test_a_list_longer_than_can_be_sorted_is_an_error(gl: moderngl.Context) -> None:
    scene, camera = layers(12_500, 0.001)
    with ABuffer(gl, scene) as abuffer, pytest.raises(CapacityError, match="12500 fragments"):
        abuffer.render(camera, (2, 2), RenderSettings())


def test_lost_fragments_stop_the_frame(gl: moderngl.Context, monkeypatch: pytest.MonkeyPatch) -> None:
    scene, camera = translucent_scene()
    with ABuffer(gl, scene) as abuffer:
        build = abuffer._builder._build
        monkeypatch.setattr(abuffer._builder, "_build", lambda tile, frame: (build(tile, frame)[0], 1, False))
        with pytest.raises(LostFragmentsError, match="1 fragments were rasterised"):
            abuffer.render(camera, (64, 64), LINKED)
        slots = abuffer._builder._slots
        fill = slots.build
        monkeypatch.setattr(slots, "build", lambda tile, frame: fill(tile, frame) and 1)
        with pytest.raises(LostFragmentsError, match="1 fragments were rasterised"):
            abuffer.render(camera, (64, 64), SLOTTED)


@pytest.mark.parametrize("lost", ["stored", "linked"])
def test_lost_fragments_stop_lists_that_are_read_back(
    gl: moderngl.Context, monkeypatch: pytest.MonkeyPatch, lost: str
) -> None:
    scene, camera = translucent_scene()
    with ABuffer(gl, scene) as abuffer:
        pool, build = abuffer._shared.pool, abuffer._builder._build
        if lost == "stored":
            monkeypatch.setattr(
                abuffer._builder, "_build", lambda tile, frame: (build(tile, frame)[0], 1, False)
            )
        else:
            heads = pool.heads
            end = np.uint32(shared_constants()["LIST_END"])
            monkeypatch.setattr(
                pool, "heads", lambda tile: np.where(np.arange(64 * 64) % 2, heads(tile), end)
            )
        with pytest.raises(LostFragmentsError, match="fragments were rasterised"):
            abuffer.fragment_lists(camera, (64, 64), RenderSettings())


def test_lists_that_lead_nowhere_or_in_circles_stop_the_reading(
    gl: moderngl.Context, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene, camera = translucent_scene()
    with ABuffer(gl, scene) as abuffer:
        pool = abuffer._shared.pool
        nodes = pool.nodes
        for next_index in (0, 2**31):

            def damaged(next_index: int = next_index) -> np.ndarray[tuple[int, ...], np.dtype[np.void]]:
                found = nodes().copy()
                found["next_index"] = next_index
                return found

            monkeypatch.setattr(pool, "nodes", damaged)
            with pytest.raises(LostFragmentsError, match="fragments were rasterised"):
                abuffer.fragment_lists(camera, (64, 64), RenderSettings())


def test_the_pool_is_kept_from_frame_to_frame_and_grows_when_needed(gl: moderngl.Context) -> None:
    scene, camera = translucent_scene()
    with ABuffer(gl, scene) as abuffer:
        _, first = abuffer.render(camera, (32, 32), LINKED)
        _, larger = abuffer.render(camera, (64, 64), LINKED)
        _, again = abuffer.render(camera, (32, 32), LINKED)
    step = NODE_STEP * NODE_BYTES
    assert first.pool_bytes == math.ceil(int(ROOM * first.fragments) * NODE_BYTES / step) * step
    assert larger.pool_bytes == again.pool_bytes >= larger.fragments * NODE_BYTES
    assert again.fragments == first.fragments


@pytest.mark.parametrize("build_stage", [BuildStage.FRAGMENT, BuildStage.COMPUTE])
def test_the_pool_may_be_larger_than_a_storage_block(
    gl: moderngl.Context, monkeypatch: pytest.MonkeyPatch, build_stage: BuildStage
) -> None:
    scene, camera = translucent_scene()
    look = RenderSettings(build_stage=build_stage, stage=ResolveStage.FRAGMENT)  # linked lists
    with ABuffer(gl, scene) as abuffer:
        expected, _ = abuffer.render(camera, (64, 64), look)
    small = replace(limits(gl), storage_block_bytes=1 << 14)  # of about half of the pool
    monkeypatch.setattr(buffer_image, "limits", lambda _: small)
    with ABuffer(gl, scene) as abuffer:
        found, told = abuffer.render(camera, (64, 64), look)
    assert told.pool_bytes > 2 * small.storage_block_bytes
    assert told.tiles == 1
    assert told.compute_tiles == int(build_stage is BuildStage.COMPUTE)
    assert np.array_equal(found, expected)


def test_a_smaller_budget_holds_after_a_picture_with_a_larger_one(gl: moderngl.Context) -> None:
    scene, camera = translucent_scene()
    small = RenderSettings(fragment_budget_bytes=1 << 16)
    with ABuffer(gl, scene) as abuffer:
        before, whole = abuffer.render(camera, (64, 64), RenderSettings())
        assert whole.pool_bytes > 4 * small.fragment_budget_bytes
        parts = list(abuffer.fragment_list_parts(camera, (64, 64), small))
        assert len(parts) >= whole.fragments * NODE_BYTES / small.fragment_budget_bytes
        assert max(len(part.pixels) for part in parts) * NODE_BYTES <= small.fragment_budget_bytes
        after, tiled = abuffer.render(camera, (64, 64), small)
    assert tiled.pool_bytes <= small.fragment_budget_bytes
    assert tiled.tiles == len(parts)
    assert np.array_equal(before, after)


def covered(tiles: list[Tile], width: int, height: int) -> Iterator[int]:
    counts = np.zeros((height, width), dtype=int)
    for tile in tiles:
        counts[tile.y : tile.y + tile.height, tile.x : tile.x + tile.width] += 1
    yield from counts.ravel().tolist()


def test_tiles_cover_every_pixel_once_and_fit() -> None:
    rng = np.random.default_rng(1)
    for _ in range(50):
        width, height = (int(n) for n in rng.integers(1, 30, 2))
        counts = rng.integers(0, 40, (height, width)).astype(np.uint32)
        capacity = int(counts.max()) + int(rng.integers(0, 200))
        tiles = tiles_that_fit(Tile(0, 0, width, height), counts, capacity)
        assert set(covered(tiles, width, height)) == {1}
        for tile in tiles:
            part = counts[tile.y : tile.y + tile.height, tile.x : tile.x + tile.width]
            assert part.sum() <= capacity


def test_strips_cover_the_picture_and_a_row_that_does_not_fit_is_an_error() -> None:
    assert set(covered(strips(7, 5, 15), 7, 5)) == {1}
    assert max(tile.pixel_count for tile in strips(7, 5, 15)) <= 15
    with pytest.raises(CapacityError, match="row of 7 pixels"):
        strips(7, 5, 6)

"""What is on the GPU is freed: also where making it failed midway."""

from __future__ import annotations

from typing import TYPE_CHECKING

import moderngl
import numpy as np
import pytest

from isosample.errors import CacheError, CapacityError
from isosample.gl.context import is_software
from isosample.gl.functions import Functions
from isosample.rendering import abuffer as abuffer_module
from isosample.rendering import pass_resources
from isosample.rendering.abuffer import ABuffer
from isosample.rendering.camera import Camera
from isosample.rendering.raycaster import RayCaster
from isosample.rendering.scene import Scene
from isosample.rendering.settings import BuildStage, RenderSettings
from isosample.surfaces.out_of_core import extract_into_store
from isosample.surfaces.store import MeshStore
from isosample.transfer.isovalues import plan_isovalues
from rendering.scenes import ramp_tf
from rendering.test_chunks import SMALL_BRICKS, scene_of, waves

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    import numpy.typing as npt

SIZE = (16, 16)


@pytest.fixture
def buffers(gl: moderngl.Context, monkeypatch: pytest.MonkeyPatch) -> list[moderngl.Buffer]:
    """Every buffer that the test makes."""
    made: list[moderngl.Buffer] = []
    make = moderngl.Context.buffer

    def noted(self: moderngl.Context, *args: object, **named: object) -> moderngl.Buffer:
        made.append(make(self, *args, **named))  # type: ignore[arg-type]
        return made[-1]

    monkeypatch.setattr(moderngl.Context, "buffer", noted)
    return made


def held(buffers: list[moderngl.Buffer]) -> int:
    """How many of these are not released."""
    return sum(not isinstance(buffer.mglo, moderngl.InvalidObject) for buffer in buffers)


@pytest.fixture
def textures(monkeypatch: pytest.MonkeyPatch) -> set[int]:
    """Every texture of a buffer that the test makes and does not delete."""
    alive: set[int] = set()
    create, delete = Functions.create_buffer_texture, Functions.delete_texture

    def created(self: Functions, internal_format: int, buffer: int) -> int:
        name = create(self, internal_format, buffer)
        alive.add(name)
        return name

    def deleted(self: Functions, texture: int) -> None:
        alive.discard(texture)
        delete(self, texture)

    monkeypatch.setattr(Functions, "create_buffer_texture", created)
    monkeypatch.setattr(Functions, "delete_texture", deleted)
    return alive


@pytest.mark.parametrize("stage", list(BuildStage))
def test_nothing_is_held_after_a_release(
    gl: moderngl.Context, buffers: list[moderngl.Buffer], textures: set[int], stage: BuildStage
) -> None:
    scene = scene_of(waves(8))
    with ABuffer(gl, scene) as abuffer:
        abuffer.render(Camera.orbit(scene.geometry.box), SIZE, RenderSettings(build_stage=stage))
        assert held(buffers) > 5
        assert len(textures) > 0
    assert held(buffers) == 0
    assert len(textures) == 0


def test_a_damaged_piece_leaves_no_buffer_of_its_upload(
    gl: moderngl.Context, tmp_path: Path, buffers: list[moderngl.Buffer]
) -> None:
    volume = waves()
    plan = plan_isovalues(ramp_tf(*volume.value_range, (0.0, 0.1)), volume.value_range, per_slope=1)
    store = MeshStore(tmp_path)
    scene = Scene.build(extract_into_store(volume, plan.isovalues, store, settings=SMALL_BRICKS), plan)
    camera = Camera.orbit(volume.box)
    with ABuffer(gl, scene) as abuffer:
        before = held(buffers)
        for chunk in sorted((tmp_path / "chunks").rglob("*")):
            if chunk.is_file():
                chunk.write_bytes(chunk.read_bytes()[:-1])
        with pytest.raises(CacheError):
            abuffer.render(camera, SIZE, RenderSettings())
        assert held(buffers) == before
    assert held(buffers) == 0


@pytest.mark.parametrize("failing", ["DeviceScene", "FragmentPool", "ListBuilder", "ResolvePass"])
def test_a_constructor_that_fails_midway_leaves_nothing(
    gl: moderngl.Context, monkeypatch: pytest.MonkeyPatch, buffers: list[moderngl.Buffer], failing: str
) -> None:
    class FailedError(Exception):
        pass

    def fail(*_: object) -> None:
        raise FailedError

    scene = scene_of(waves(8), masked=False)
    module = pass_resources if failing in ("DeviceScene", "FragmentPool") else abuffer_module
    monkeypatch.setattr(module, failing, fail)
    with pytest.raises(FailedError):
        ABuffer(gl, scene)
    assert held(buffers) == 0


def without_room_for(monkeypatch: pytest.MonkeyPatch, number: int, work: Callable[[], object]) -> str | None:
    """Do the work with a driver that has no room for the allocation of that number; return what the error says."""
    asked = 0

    def error(_: moderngl.Context) -> str:
        nonlocal asked
        asked += 1
        return "GL_OUT_OF_MEMORY" if asked == number + 1 else "GL_NO_ERROR"

    with monkeypatch.context() as patch:
        patch.setattr(moderngl.Context, "error", property(error))
        try:
            work()
        except CapacityError as found:
            return str(found)
    return None if asked <= number else ""  # "": it found another way


@pytest.mark.parametrize("stage", list(BuildStage))
def test_whatever_the_a_buffer_finds_no_room_for_is_named_and_freed(
    gl: moderngl.Context, monkeypatch: pytest.MonkeyPatch, buffers: list[moderngl.Buffer], stage: BuildStage
) -> None:
    look = RenderSettings(build_stage=stage)
    scene = scene_of(waves(8))
    camera = Camera.orbit(scene.geometry.box)
    with ABuffer(gl, scene) as abuffer:
        expected, _ = abuffer.render(camera, SIZE, look)
    said: list[str] = []

    def work() -> npt.NDArray[np.float32]:
        with ABuffer(gl, scene) as abuffer:
            try:
                return abuffer.render(camera, SIZE, look)[0]
            except CapacityError:  # with room again, the same object goes on
                assert np.array_equal(abuffer.render(camera, SIZE, look)[0], expected)
                raise

    while (message := without_room_for(monkeypatch, len(said), work)) is not None:
        said.append(message)
        assert held(buffers) == 0
    own = {
        BuildStage.FRAGMENT: ("nodes of fragment lists",),
        BuildStage.COMPUTE: ("projected vertices", "shares of the meshes"),
        BuildStage.AUTO: (),
    }
    other = stage is BuildStage.COMPUTE or (stage is BuildStage.AUTO and is_software(gl))
    assert ("" in said) == other  # without slots there are linked lists, without compute shaders the pipeline
    for part in (
        *own[stage],
        "a table of the scene",
        "fewer isovalues",
        "meshes",
        "--mesh-budget",
        "fragment_budget_bytes",
        f"the list heads of {SIZE[0] * SIZE[1]} pixels",
        f"a picture of {SIZE[0]} x {SIZE[1]} pixels, {16 * SIZE[0] * SIZE[1]} bytes",
    ):
        assert any(part in message for message in said), part


def test_whatever_the_ray_caster_finds_no_room_for_is_named_and_freed(
    gl: moderngl.Context, monkeypatch: pytest.MonkeyPatch, buffers: list[moderngl.Buffer]
) -> None:
    volume = waves(8)
    said: list[str] = []

    def work() -> None:
        with RayCaster(volume, ramp_tf(*volume.value_range, (0.0, 0.1))) as caster:
            caster.render(size=SIZE)

    while (message := without_room_for(monkeypatch, len(said), work)) is not None:
        said.append(message)
        assert held(buffers) == 0
    for part in (
        "a texture of 8 x 8 x 8 samples, 2048 bytes",
        "Crop or downsample",
        "entries",
        "--table-size",
        "7 x 7 x 7 macrocells, 1372 bytes",
        "--macrocells",
        "a picture of",
    ):
        assert any(part in message for message in said), part

"""What is on the GPU is freed: also where making it failed midway."""

from __future__ import annotations

from typing import TYPE_CHECKING

import moderngl
import pytest

from isosample.errors import CacheError
from isosample.rendering import abuffer as abuffer_module
from isosample.rendering import pass_resources
from isosample.rendering.abuffer import ABuffer
from isosample.rendering.camera import Camera
from isosample.rendering.scene import Scene
from isosample.rendering.settings import RenderSettings
from isosample.surfaces.out_of_core import extract_into_store
from isosample.surfaces.store import MeshStore
from isosample.transfer.isovalues import plan_isovalues
from rendering.scenes import ramp_tf
from rendering.test_chunks import SMALL_BRICKS, scene_of, waves

if TYPE_CHECKING:
    from pathlib import Path

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


def test_nothing_is_held_after_a_release(gl: moderngl.Context, buffers: list[moderngl.Buffer]) -> None:
    scene = scene_of(waves(8))
    with ABuffer(gl, scene) as abuffer:
        abuffer.render(Camera.orbit(scene.geometry.box), SIZE, RenderSettings())
        assert held(buffers) > 5
    assert held(buffers) == 0


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

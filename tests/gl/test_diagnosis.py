"""The diagnosis names the driver, counts with atomics, and finds a driver that loses fragments."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from isosample.errors import OpenGLError
from isosample.gl import diagnosis
from isosample.gl.context import is_software
from isosample.gl.diagnosis import describe, diagnose, self_test

if TYPE_CHECKING:
    import moderngl
    import pytest


def test_self_test_passes_on_this_driver(gl: moderngl.Context) -> None:
    assert [(check.name, check.passed) for check in self_test(gl)] == [
        ("compute shader with storage buffer", True),
        ("fragment shader with storage buffer", True),
    ]


def test_self_test_reports_lost_fragments(gl: moderngl.Context, monkeypatch: pytest.MonkeyPatch) -> None:
    def losing_one(ctx: moderngl.Context) -> npt.NDArray[np.uint32]:
        counts = np.full(1 + diagnosis.IMAGE_EDGE**2, diagnosis.LAYER_COUNT, np.uint32)
        counts[0] = diagnosis.IMAGE_EDGE**2 * diagnosis.LAYER_COUNT - 1
        counts[7] -= 1
        return counts

    monkeypatch.setattr(diagnosis, "_count_fragments", losing_one)
    check = self_test(gl)[1]
    assert not check.passed
    assert check.detail == "counted 327679 of 327680, 1 of 65536 cells wrong"
    assert not diagnose().usable
    assert "fragment shader with storage buffer: counted 327679 of 327680" in diagnose().summary


def test_resolve_stage_follows_the_kind_of_renderer(gl: moderngl.Context) -> None:
    expected = "fragment" if is_software(gl) else "compute"
    assert describe(gl)["resolve_stage"] == expected


def test_diagnosis_is_plain_json_and_names_the_renderer(gl: moderngl.Context) -> None:
    found: dict[str, Any] = json.loads(json.dumps(diagnose().to_dict()))
    assert found["usable"] is True
    assert found["driver"]["renderer"] == gl.info["GL_RENDERER"]
    assert found["driver"]["renderer"] in found["summary"]
    assert set(found["libraries"]) == {"EGL", "GL"}


def test_missing_context_is_a_finding_not_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse() -> None:
        raise OpenGLError("no OpenGL 4.5 context by backend 'egl': libEGL.so not loaded")

    monkeypatch.setattr(diagnosis, "shared_context", refuse)
    found = diagnose()
    assert not found.usable
    assert found.summary == "no OpenGL 4.5 context by backend 'egl': libEGL.so not loaded"
    assert found.driver == {}

"""The diagnosis names the driver, counts with atomics, and finds a driver that loses fragments."""

from __future__ import annotations

import json
from typing import Any

import moderngl
import numpy as np
import numpy.typing as npt
import pytest

from isosample.errors import OpenGLError
from isosample.gl import diagnosis
from isosample.gl.diagnosis import describe, diagnose, self_test
from isosample.rendering.settings import ResolveStage
from isosample.rendering.stage import resolve_stage


def test_self_test_passes_on_this_driver(gl: moderngl.Context) -> None:
    assert [(check.name, check.passed) for check in self_test(gl)] == [
        ("compute shader with storage buffer", True),
        ("fragment shader with storage buffer", True),
    ]


@pytest.mark.parametrize(
    ("total", "cell", "detail"),
    [
        (449_999, 4, "counted 449999 of 450000, 1 of 90000 cells wrong"),
        (449_999, 5, "counted 449999 of 450000, 0 of 90000 cells wrong"),
        (450_000, 4, "counted 450000 of 450000, 1 of 90000 cells wrong"),
    ],
)
def test_lost_fragments_are_reported_from_total_and_from_cells(
    gl: moderngl.Context, monkeypatch: pytest.MonkeyPatch, total: int, cell: int, detail: str
) -> None:
    def losing(ctx: moderngl.Context) -> npt.NDArray[np.uint32]:
        counts = np.full(1 + 300 * 300, 5, np.uint32)  # five layers on 300 x 300 pixels
        counts[0], counts[7] = total, cell
        return counts

    monkeypatch.setattr(diagnosis, "_count_fragments", losing)
    check = self_test(gl)[1]
    assert not check.passed
    assert check.detail == detail
    assert not diagnose().usable
    assert f"fragment shader with storage buffer: {detail}" in diagnose().summary


@pytest.mark.parametrize(
    ("renderer", "stage"),
    [
        ("llvmpipe (LLVM 15.0.7, 256 bits)", "fragment"),
        ("SwiftShader Device (Subzero)", "fragment"),
        ("NVIDIA GeForce RTX 3060/PCIe/SSE2", "compute"),
        ("Mesa Intel(R) UHD Graphics 620 (KBL GT2)", "compute"),
    ],
)
def test_resolve_stage_follows_the_kind_of_renderer(
    gl: moderngl.Context, monkeypatch: pytest.MonkeyPatch, renderer: str, stage: str
) -> None:
    info = gl.info | {"GL_RENDERER": renderer}
    monkeypatch.setattr(moderngl.Context, "info", property(lambda _: info))
    assert describe(gl)["resolve_stage"] == stage
    assert resolve_stage(gl, ResolveStage.AUTO).value == stage  # what is told is what is done


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

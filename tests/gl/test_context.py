"""The context is 4.5, shared once per process, and its absence is one clear line."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING

import pytest

from isosample.errors import OpenGLError
from isosample.gl import context
from isosample.gl.context import drawing_into, is_software, limits, shared_context

if TYPE_CHECKING:
    import moderngl


class _StubContext:
    def __init__(self, renderer: str) -> None:
        self.info = {"GL_RENDERER": renderer}


def _run(code: str, **environment: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-c", code],
        env=os.environ | environment,
        capture_output=True,
        text=True,
        check=False,
    )


def test_context_offers_opengl_4_5(gl: moderngl.Context) -> None:
    assert gl.version_code >= 450


def test_limits_reach_the_minima_of_the_opengl_4_5_specification(gl: moderngl.Context) -> None:
    # OpenGL 4.5 core, tables 23.53 to 23.74: the least a conforming driver offers.
    offered = limits(gl)
    assert offered.storage_block_bytes >= 1 << 24
    assert offered.uniform_block_bytes >= 16384
    assert min(offered.framebuffer_size) >= 16384
    assert offered.texture_size >= 16384
    assert offered.texture_3d_size >= 2048
    assert offered.buffer_texels >= 65536
    assert offered.fragment_storage_blocks >= 8
    assert offered.compute_storage_blocks >= 8
    assert min(offered.work_group_count) >= 65535
    assert offered.work_group_size[0] >= 1024
    assert offered.work_group_invocations >= 1024


@pytest.mark.parametrize(
    ("renderer", "expected"),
    [
        ("llvmpipe (LLVM 15.0.6, 256 bits)", True),
        ("softpipe", True),
        ("ANGLE (Google, Vulkan 1.3.0 (SwiftShader Device (Subzero)), SwiftShader driver)", True),
        ("NVIDIA H200/PCIe/SSE2", False),
        ("Mesa Intel(R) UHD Graphics 620 (KBL GT2)", False),
    ],
)
def test_is_software_tells_renderers_on_the_cpu(renderer: str, expected: bool) -> None:
    assert is_software(_StubContext(renderer)) is expected  # type: ignore[arg-type]


def test_shared_context_is_made_once(gl: moderngl.Context) -> None:
    assert shared_context() is gl


def test_a_framebuffer_drawn_into_can_be_released_and_another_made(gl: moderngl.Context) -> None:
    for _ in range(2):
        framebuffer = gl.empty_framebuffer((8, 4))
        with drawing_into(gl, framebuffer):
            assert gl.viewport == (0, 0, 8, 4)
        framebuffer.release()
    assert gl.error == "GL_NO_ERROR"


def test_shared_context_refuses_another_thread(gl: moderngl.Context) -> None:
    caught: list[OpenGLError] = []

    def use() -> None:
        try:
            shared_context()
        except OpenGLError as error:
            caught.append(error)

    thread = threading.Thread(target=use)
    thread.start()
    thread.join()
    assert len(caught) == 1
    assert "thread" in str(caught[0])


def test_missing_library_is_one_line_that_names_it_and_the_packages() -> None:
    code = (
        "from isosample.errors import OpenGLError\n"
        "from isosample.gl.context import create_context\n"
        "try: create_context()\n"
        "except OpenGLError as error: print(error)\n"
    )
    done = _run(code, GLCONTEXT_LINUX_LIBEGL="libEGL-absent.so")
    assert done.stdout.count("\n") == 1, done.stderr
    assert "libEGL-absent.so not loaded" in done.stdout
    assert "apt-get install libegl1" in done.stdout


def test_unknown_backend_is_named() -> None:
    code = "from isosample.gl.context import create_context; create_context()"
    done = _run(code, ISOSAMPLE_GL_BACKEND="glx11")
    assert "OpenGLError: no OpenGL 4.5 context by backend 'glx11'" in done.stderr


def test_gl_modules_import_without_loading_the_binding() -> None:
    modules = ", ".join(sorted(path.stem for path in Path(context.__file__).parent.glob("[a-z]*.py")))
    bindings = "{'moderngl', 'glcontext'}"
    done = _run(f"import sys; from isosample.gl import {modules}; print({bindings} & sys.modules.keys())")
    assert done.stdout == "set()\n", done.stderr


def test_a_context_of_others_is_refused_where_more_is_needed_than_the_binding_offers() -> None:
    code = (
        "import moderngl; from isosample.gl.buffer_image import BufferImage; "
        "BufferImage(moderngl.create_context(standalone=True, backend='egl'), 4, 'r32ui')"
    )
    assert "OpenGLError: this OpenGL context is another program's" in _run(code).stderr


def test_a_context_that_is_refused_is_released(monkeypatch: pytest.MonkeyPatch) -> None:
    made: list[str] = []
    native = SimpleNamespace(load=lambda _: 0, release=lambda: made.append("released"))
    monkeypatch.setattr("glcontext.get_backend_by_name", lambda _: lambda **_: native)

    def refuse(**_: object) -> None:
        raise ValueError("Requested OpenGL version 450, got version 330")

    monkeypatch.setattr("moderngl.create_context", refuse)
    with pytest.raises(OpenGLError, match="got version 330"):
        context.create_context()
    assert made == ["released"]

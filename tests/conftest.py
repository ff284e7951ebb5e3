"""Shared fixtures: numpy errors raise, hypothesis is derandomised, real volumes and OpenGL are found once."""

from __future__ import annotations

import gc
import os
from pathlib import Path
from typing import TYPE_CHECKING

import hypothesis
import numpy as np
import pytest

from isosample.errors import OpenGLError
from isosample.gl.context import is_software, release_shared_context, shared_context
from isosample.surfaces import memory

if TYPE_CHECKING:
    from collections.abc import Iterator

    import moderngl

hypothesis.settings.register_profile("ci", derandomize=True, deadline=None, max_examples=60)
hypothesis.settings.load_profile("ci")

VOLUMES_VARIABLE = "ISOSAMPLE_VOLUMES"  # names the folder of real scans; the default lies beside the checkout
REAL_VOLUMES = Path(
    os.environ.get(VOLUMES_VARIABLE) or Path(__file__).resolve().parents[2] / "shared" / "volumes"
).absolute()

PROGRAM_BYTES = 300 << 20  # of a program that has loaded its libraries and kernels


@pytest.fixture(autouse=True)
def _numpy_errors_raise() -> Iterator[None]:
    """Turn silent divisions by zero, overflows and invalid operations into test failures."""
    with np.errstate(divide="raise", over="raise", invalid="raise"):
        yield


@pytest.fixture(autouse=True)
def _budgets_of_one_test(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let a memory budget count what a program of its own holds, not what the tests before left in this process.

    Whole programs, whose real memory is watched, run as processes of their own (`test_precompute_memory`).
    """
    monkeypatch.setattr(memory, "resident_bytes", lambda: PROGRAM_BYTES)


@pytest.fixture(scope="session")
def real_volumes() -> Path:
    """Folder of real scans; tests that need it are skipped where it is absent."""
    if not (REAL_VOLUMES / "README.md").is_file():
        pytest.skip(f"{REAL_VOLUMES} is no folder of real scans; {VOLUMES_VARIABLE} names one")
    return REAL_VOLUMES


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark every test that uses the `gl` fixture."""
    for item in items:
        if "gl" in getattr(item, "fixturenames", ()):
            item.add_marker(pytest.mark.gl)


@pytest.fixture(scope="session")
def gl() -> Iterator[moderngl.Context]:
    """Shared OpenGL context; without one, tests are skipped, or fail where ISOSAMPLE_REQUIRE_GL=1."""
    try:
        context = shared_context()
    except OpenGLError as error:
        if os.environ.get("ISOSAMPLE_REQUIRE_GL") == "1":
            pytest.fail(f"ISOSAMPLE_REQUIRE_GL=1, but {error}", pytrace=False)
        pytest.skip(str(error))
    context.gc_mode = "context_gc"  # objects that die without release() are collected, and found below
    yield context
    _drain(context)
    release_shared_context()


def _drain(context: moderngl.Context) -> list[str]:
    """Release what was collected unreleased; return its kinds (objects already released count not)."""
    dropped = [part for part in context.objects if hasattr(part, "release")]
    context.objects.clear()
    for part in dropped:
        part.release()
    return [type(part).__name__ for part in dropped]


@pytest.fixture(autouse=True)
def _gl_left_clean(request: pytest.FixtureRequest) -> Iterator[None]:
    """After a test that uses `gl`: no OpenGL error is pending and no object was dropped without release()."""
    if "gl" not in request.fixturenames:
        yield
        return
    context: moderngl.Context = request.getfixturevalue("gl")
    renderer = f"{context.info['GL_VENDOR']}, {context.info['GL_RENDERER']}"
    if request.node.get_closest_marker("hardware") and is_software(context):
        pytest.skip(f"needs a hardware OpenGL driver; this is {renderer}")
    yield
    gc.collect()
    dropped = _drain(context)
    assert context.error == "GL_NO_ERROR", f"an OpenGL error is pending on {renderer}"
    assert not dropped, f"objects dropped without release(): {dropped}"

"""`doctor` says whether OpenGL is usable, and exit status 3 says that it is not."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

import pytest

from cli.harness import Run, content, run_beside

if TYPE_CHECKING:
    from pathlib import Path

NONSENSE = {"ISOSAMPLE_GL_BACKEND": "nonsense"}


@pytest.mark.usefixtures("gl")
def test_a_usable_driver_is_described(run: Run) -> None:
    outcome = run("doctor")
    assert outcome.status == 0
    assert outcome.err == ""
    assert outcome.fields()["OpenGL"] == "usable"
    assert outcome.out.count("passed") == 2
    assert "FAILED" not in outcome.out


@pytest.mark.usefixtures("gl")
def test_json_has_driver_checks_and_versions(run: Run) -> None:
    found = json.loads(run("doctor --json").out)
    assert found["usable"] is True
    assert found["driver"]["renderer"]
    assert all(check["passed"] for check in found["checks"])
    assert found["versions"].keys() == {"python", "isosample", "numpy", "moderngl", "glcontext"}


def test_without_opengl_doctor_says_what_to_install_and_exits_with_3() -> None:
    outcome = run_beside("doctor", **NONSENSE)
    assert outcome.status == 3
    assert outcome.fields()["OpenGL"] == "not usable"
    assert outcome.err.startswith("isosample: error: no OpenGL 4.5 context by backend 'nonsense'")
    assert "apt-get install" in outcome.err
    assert outcome.err.count("\n") == 1


def test_without_opengl_json_is_whole_and_says_unusable() -> None:
    outcome = run_beside("doctor --json", **NONSENSE)
    assert outcome.status == 3
    found = json.loads(outcome.out)
    assert found["usable"] is False
    assert "nonsense" in found["summary"]


def test_without_opengl_render_exits_with_3_and_leaves_no_file(folder: Path) -> None:
    before = content(folder)
    outcome = run_beside("render blob.npy --tf tf.json --cache meshes -o out.png", **NONSENSE)
    assert outcome.status == 3
    assert outcome.err.count("\n") == 1
    assert "'nonsense'" in outcome.err
    assert content(folder) == before

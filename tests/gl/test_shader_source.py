"""Sources are assembled once per file, constants are exact, and driver logs lead back to the file."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from isosample.errors import ShaderError
from isosample.gl.shader_source import (
    ShaderSource,
    assemble_shader,
    declared_constants,
    glsl_literal,
    load_shader,
    shader_root,
)

DECLARED = '#version 450 core\n#ifndef CAPACITY\n#error "entries of a list"\n#endif\nvoid main() {}\n'


def _write(root: Path, **files: str) -> Path:
    for name, text in files.items():
        path = root / name.replace("__", "/").replace("_", ".")
        path.parent.mkdir(exist_ok=True)
        path.write_text(text)
    return root


def test_nested_includes_are_inserted_before_their_users_and_once(tmp_path: Path) -> None:
    root = _write(
        tmp_path,
        a_frag='#version 450 core\n#include "lib/b.glsl"\n#include "lib/c.glsl"\nmain\n',
        lib__b_glsl='#include "lib/c.glsl"\nb\n',
        lib__c_glsl="c\n",
    )
    source = load_shader("a.frag", root=root)
    assert source.text.split() == ["#version", "450", "core", "c", "b", "main"]


def test_every_line_maps_to_its_file_and_line(tmp_path: Path) -> None:
    root = _write(
        tmp_path,
        a_frag='// header\n\n#version 450 core\n#include "lib/b.glsl"\nmain\n',
        lib__b_glsl="/* two\nlines */\nb\n",
    )
    source = load_shader("a.frag", root=root)
    lines = source.text.split("\n")
    assert lines[0] == "#version 450 core", "a driver log counts from the first line that is sent"
    for word, place in {"b": ("lib/b.glsl", 3), "main": ("a.frag", 5)}.items():
        assert source.line_map[lines.index(word)] == place


def test_comments_hide_includes_and_keep_columns() -> None:
    text = '#version 450 core\n// #include "absent.glsl"\n/* #include "absent.glsl" */ float x;\n'
    source = assemble_shader(text, "a.frag", root=Path())
    assert source.text.split("\n")[2].index("float") == text.split("\n")[2].index("float")
    assert "include" not in source.text


def test_include_cycle_raises_with_the_chain(tmp_path: Path) -> None:
    root = _write(
        tmp_path,
        a_frag='#version 450 core\n#include "b.glsl"\n',
        b_glsl='#include "c.glsl"\n',
        c_glsl='\n#include "b.glsl"\n',
    )
    with pytest.raises(ShaderError, match=r"c\.glsl:2: .* a\.frag > b\.glsl > c\.glsl > b\.glsl"):
        load_shader("a.frag", root=root)


def test_missing_include_names_the_file_and_who_includes_it(tmp_path: Path) -> None:
    root = _write(tmp_path, a_frag='#version 450 core\n#include "lib/absent.glsl"\n')
    with pytest.raises(ShaderError, match=r"no shader lib/absent\.glsl .*\(included by a\.frag\)"):
        load_shader("a.frag", root=root)


def test_include_outside_the_shader_folder_is_refused(tmp_path: Path) -> None:
    (tmp_path / "secret.glsl").write_text("secret\n")
    root = tmp_path / "shaders"
    root.mkdir()
    _write(root, a_frag='#version 450 core\n#include "../secret.glsl"\n')
    with pytest.raises(ShaderError, match="outside the shader folder"):
        load_shader("a.frag", root=root)


@pytest.mark.parametrize(
    "line", ["#include <lib/b.glsl>", 'float x; #include "lib/b.glsl"', "#include lib/b.glsl"]
)
def test_malformed_include_raises_with_its_line(line: str) -> None:
    with pytest.raises(ShaderError, match=r'a\.frag:2: write #include "path" alone on its line'):
        assemble_shader(f"#version 450 core\n{line}\n", "a.frag", root=Path())


@pytest.mark.parametrize("text", ["", "void main() {}\n#version 450 core\n"])
def test_text_that_does_not_start_with_a_version_is_refused(text: str) -> None:
    with pytest.raises(ShaderError, match="must be #version 450 core"):
        assemble_shader(text, "a.frag", root=Path())


def test_constant_is_defined_after_the_version_and_maps_to_its_declaration() -> None:
    source = assemble_shader(DECLARED, "a.frag", {"CAPACITY": 64}, Path())
    assert source.text.split("\n")[:2] == ["#version 450 core", "#define CAPACITY 64"]
    assert source.line_map[1] == ("a.frag", 2)
    assert source.line_map[2] == ("a.frag", 2)


def test_constants_must_be_exactly_those_declared() -> None:
    with pytest.raises(ShaderError, match=r"a\.frag: no value for the declared constants CAPACITY"):
        assemble_shader(DECLARED, "a.frag", {}, Path())
    with pytest.raises(ShaderError, match=r"constants CAPACTIY are not declared; it declares CAPACITY"):
        assemble_shader(DECLARED, "a.frag", {"CAPACITY": 64, "CAPACTIY": 64}, Path())


def test_commented_declaration_does_not_count() -> None:
    assert declared_constants("// #ifndef A\n#error\n#ifndef B\n  #  error\n#endif\n") == {"B": 3}


@pytest.mark.parametrize(
    ("value", "literal"),
    [
        (True, "1"),
        (np.bool_(False), "0"),
        (64, "64"),
        (-3, "(-3)"),
        (np.int64(7), "7"),
        (2**31, "2147483648u"),
        (1.0, "1.0"),
        (-0.5, "(-0.5)"),
        (1e-7, "1e-07"),
        (np.float32(0.25), "0.25"),
    ],
)
def test_literals_are_what_glsl_reads(value: float, literal: str) -> None:
    assert glsl_literal(value) == literal


@pytest.mark.parametrize("value", [2**32, -(2**31), float("nan"), float("inf"), 1e39])
def test_number_that_glsl_cannot_hold_is_refused(value: float) -> None:
    with pytest.raises(ShaderError, match="constant"):
        glsl_literal(value)


@pytest.mark.parametrize(
    ("logged", "mapped"),
    [
        ("0:2(13): error: 'missing' undeclared", "lib/x.glsl:8(13): error: 'missing' undeclared"),
        ("0(2) : error C1503: undefined variable", "lib/x.glsl:8 : error C1503: undefined variable"),
        ("ERROR: 0:2: 'missing' : undeclared", "ERROR: lib/x.glsl:8: 'missing' : undeclared"),
        ("0:9(1): error: past the end", "0:9(1): error: past the end"),
        ("0:0(0): error: no place", "0:0(0): error: no place"),
        ("error: linking failed 0:2(3)", "error: linking failed 0:2(3)"),
    ],
)
def test_log_of_each_driver_is_mapped(logged: str, mapped: str) -> None:
    source = ShaderSource("#version 450 core\nmissing\n", (("a.frag", 1), ("lib/x.glsl", 8)))
    assert source.map_log(f"head\n{logged}\ntail") == f"head\n{mapped}\ntail"


def test_shader_root_holds_the_shared_layouts() -> None:
    assert (shader_root() / "lib" / "layouts.glsl").is_file()

"""Programs compile from files, their errors name file and line, and their interface is checked both ways."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from isosample.errors import ShaderError
from isosample.gl.interface import Block, active_interface, check_interface
from isosample.gl.program import compute_program, graphics_program, map_stage_log
from isosample.gl.shader_source import ShaderSource

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping
    from pathlib import Path

    import moderngl

VERTEX = """#version 450 core
in vec3 position;
in uint level;
layout(std140, binding = 3) uniform FrameBlock { mat4 clip_from_world; vec3 eye; float step_length; };
void main() {
    gl_Position = clip_from_world * vec4(position + eye * step_length * float(level), 1.0 + gl_VertexID);
}
"""
FRAGMENT = """#version 450 core
#include "lib/tint.glsl"
#ifndef SCALE
#error "factor"
#endif
uniform sampler3D volume;
layout(binding = 1, r32ui) uniform uimage2D heads;
layout(std430, binding = 5) buffer Nodes { uint nodes[]; };
out vec4 color;
void main() {
    nodes[0] = imageAtomicAdd(heads, ivec2(0), 1u);
    color = tint(texelFetch(volume, ivec3(0), 0)) * SCALE;
}
"""
TINT = "vec4 tint(vec4 straight) {\n    return straight * 0.5;\n}\n"
UNIFORMS = {"volume": "sampler3D", "heads": "uimage2D"}
ATTRIBUTES = {"position": "vec3", "level": "uint"}
BLOCKS = {"FrameBlock": Block(3, 80), "Nodes": Block(5)}  # mat4 64, vec3 and float 16


@pytest.fixture
def root(tmp_path: Path) -> Path:
    (tmp_path / "lib").mkdir()
    (tmp_path / "draw.vert").write_text(VERTEX)
    (tmp_path / "draw.frag").write_text(FRAGMENT)
    (tmp_path / "lib/tint.glsl").write_text(TINT)
    return tmp_path


@pytest.fixture
def program(gl: moderngl.Context, root: Path) -> Iterator[moderngl.Program]:
    built = graphics_program(gl, "draw.vert", "draw.frag", {"SCALE": 0.5}, root)
    yield built
    built.release()


def test_constant_reaches_the_compute_shader(gl: moderngl.Context, tmp_path: Path) -> None:
    (tmp_path / "write.comp").write_text(
        "#version 450 core\n#ifndef ANSWER\n#error\n#endif\nlayout(local_size_x = 1) in;\n"
        "layout(std430, binding = 0) buffer Result { float result; };\nvoid main() { result = ANSWER; }\n"
    )
    built = compute_program(gl, "write.comp", {"ANSWER": -2.5}, tmp_path)
    buffer = gl.buffer(reserve=4)
    buffer.bind_to_storage_buffer(0)
    built.run()
    gl.finish()
    assert np.frombuffer(buffer.read(), np.float32)[0] == -2.5
    buffer.release()
    built.release()


def test_error_in_an_included_file_names_that_file_and_line(gl: moderngl.Context, root: Path) -> None:
    (root / "lib/tint.glsl").write_text(TINT.replace("straight * 0.5", "missing * 0.5"))
    with pytest.raises(ShaderError, match=r"lib/tint\.glsl:2\b.*missing"):
        graphics_program(gl, "draw.vert", "draw.frag", {"SCALE": 0.5}, root)


def test_error_in_the_vertex_stage_uses_the_map_of_that_stage(gl: moderngl.Context, root: Path) -> None:
    (root / "draw.vert").write_text(VERTEX.replace("eye * step_length", "eye * missing"))
    with pytest.raises(ShaderError, match=r"draw\.vert:6\b.*missing"):
        graphics_program(gl, "draw.vert", "draw.frag", {"SCALE": 0.5}, root)


def test_constant_that_no_stage_declares_is_refused(gl: moderngl.Context, root: Path) -> None:
    with pytest.raises(ShaderError, match=r"SCALES are not declared in draw\.vert or draw\.frag"):
        graphics_program(gl, "draw.vert", "draw.frag", {"SCALE": 0.5, "SCALES": 0.5}, root)


def test_linker_log_of_two_stages_is_mapped_by_stage() -> None:
    sources = {
        "vertex": ShaderSource("v\n", (("draw.vert", 7),)),
        "fragment": ShaderSource("f\n", (("draw.frag", 9),)),
    }
    log = "Vertex info\n-----------\n0(1) : error a\nFragment info\n-------------\n0(1) : error b"
    mapped = map_stage_log(log, sources).split("\n")
    assert (mapped[2], mapped[5]) == ("draw.vert:7 : error a", "draw.frag:9 : error b")


def test_interface_that_matches_passes(program: moderngl.Program) -> None:
    check_interface(program, uniforms=UNIFORMS, attributes=ATTRIBUTES, blocks=BLOCKS)


def test_active_interface_leaves_out_what_glsl_defines(program: moderngl.Program) -> None:
    assert active_interface(program).keys() == {*UNIFORMS, *ATTRIBUTES, *BLOCKS}


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            {"uniforms": {"heads": "uimage2D"}},
            "volume: the program has uniform sampler3D, the pass supplies nothing",
        ),
        (
            {"uniforms": UNIFORMS | {"tint": "vec4"}},
            "tint: the program has no such active member, the pass supplies uniform vec4",
        ),
        (
            {"uniforms": UNIFORMS | {"volume": "sampler2D"}},
            "volume: the program has uniform sampler3D, the pass supplies uniform sampler2D",
        ),
        (
            {"attributes": {"position": "vec3"}},
            "level: the program has attribute uint, the pass supplies nothing",
        ),
        (
            {"attributes": {"position": "vec4", "level": "uint"}},
            "position: the program has attribute vec3, the pass supplies attribute vec4",
        ),
        (
            {"blocks": BLOCKS | {"FrameBlock": Block(3, 96)}},
            "FrameBlock: the program has uniform block of 80 bytes at binding 3, "
            "the pass supplies uniform block of 96 bytes at binding 3",
        ),
        (
            {"blocks": BLOCKS | {"Nodes": Block(4)}},
            "Nodes: the program has storage block at binding 5, the pass supplies storage block at binding 4",
        ),
        (
            {"blocks": {"FrameBlock": Block(3, 80)}},
            "Nodes: the program has storage block at binding 5, the pass",
        ),
    ],
)
def test_each_kind_of_difference_is_named_with_both_sides(
    program: moderngl.Program, change: Mapping[str, Mapping[str, object]], message: str
) -> None:
    supplied: dict[str, Mapping[str, object]] = {
        "uniforms": UNIFORMS,
        "attributes": ATTRIBUTES,
        "blocks": BLOCKS,
    }
    with pytest.raises(ShaderError) as caught:
        check_interface(program, **(supplied | dict(change)))  # type: ignore[arg-type]
    assert message in str(caught.value)
    assert len(str(caught.value).split("\n")) == 2, "one difference, one line"


def test_optional_member_may_be_inactive_but_not_of_another_type(program: moderngl.Program) -> None:
    optional = ATTRIBUTES | {"normal": "vec3"}
    check_interface(program, uniforms=UNIFORMS, attributes=optional, blocks=BLOCKS, optional={"normal"})
    wrong = ATTRIBUTES | {"level": "float"}
    with pytest.raises(ShaderError, match="level: the program has attribute uint"):
        check_interface(program, uniforms=UNIFORMS, attributes=wrong, blocks=BLOCKS, optional={"level"})

"""Layouts parsed from GLSL are those that the driver uses, and what cannot be laid out safely is refused."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

import numpy as np
import pytest

from isosample.errors import ShaderError
from isosample.gl.layouts import Packing, column_major, constants, struct_dtypes
from isosample.gl.program import compile_compute
from isosample.gl.shader_source import assemble_shader, shader_root

if TYPE_CHECKING:
    import moderngl

STRUCTS = """
const int PLANE_COUNT = 3;
struct Mixed {
    float head;
    mat4 clip_from_world;
    vec3 eye;  float step_length;
    ivec2 size;
    uint flags;
    vec4 planes[PLANE_COUNT];
    uvec3 cells;  int count;
    vec2 offset;
    ivec3 corner;  float weight;
};
struct Small {   // 12 bytes in std430, 16 in std140
    uint next_index;
    float distance;
    int level;
};
"""
COMPONENTS = {"vec": "float", "ivec": "int", "uvec": "uint"}
TO_BITS = {"float": "floatBitsToUint({})", "int": "uint({})", "uint": "{}"}


def _scalar_reads(struct: str) -> list[str]:
    """GLSL expressions of the bits of every scalar of a struct `item`, in memory order."""
    body = re.search(rf"struct {struct} \{{(.*?)\n\}};", STRUCTS, re.DOTALL)
    assert body is not None
    reads = []
    for glsl_type, name, length in re.findall(r"(\w+) (\w+)(?:\[(\w+)\])?;", body[1]):
        elements = [f"item.{name}[{i}]" for i in range(3)] if length else [f"item.{name}"]
        if glsl_type == "mat4":
            elements, glsl_type = [f"item.{name}[{column}]" for column in range(4)], "vec4"
        scalar, width = (
            (glsl_type, 0) if glsl_type in TO_BITS else (COMPONENTS[glsl_type[:-1]], int(glsl_type[-1]))
        )
        places = [f"{element}[{i}]" for element in elements for i in range(width)] if width else elements
        reads += [TO_BITS[scalar].format(place) for place in places]
    return reads


def _filled(dtype: np.dtype[np.void], count: int) -> tuple[np.ndarray, list[list[int]]]:
    """An array whose every scalar has its own bits, and those bits in memory order, per item."""
    array, expected, serial = np.zeros(count, dtype), [], 0
    for item in range(count):
        bits: list[int] = []
        for name in dtype.names or ():
            field = array[name][item : item + 1]
            values = np.arange(serial, serial + field.size, dtype=np.uint32) + np.uint32(0x3F800000)
            field[...] = values.view(field.dtype).reshape(field.shape)
            bits += values.tolist()
            serial += field.size
        expected.append(bits)
    return array, expected


@pytest.mark.parametrize("struct", ["Mixed", "Small"])
@pytest.mark.parametrize("packing", list(Packing))
def test_driver_reads_every_scalar_where_the_dtype_puts_it(
    gl: moderngl.Context, struct: str, packing: Packing
) -> None:
    # Two items: the second also proves the array stride. Bits from 0x3F800000 on are normal floats near 1.
    array, expected = _filled(struct_dtypes(STRUCTS, packing)[struct], 2)
    reads = _scalar_reads(struct)
    assert len(reads) == len(expected[0])
    stores = "\n".join(f"    bits[{len(reads)} * i + {n}] = {read};" for n, read in enumerate(reads))
    uniform = packing is Packing.STD140
    block = "uniform Source { {}items[2]; };" if uniform else "readonly buffer Source { {}items[]; };"
    source = assemble_shader(
        f"#version 450 core\nlayout(local_size_x = 1) in;\n{STRUCTS}"
        f"layout({packing.value}, binding = 0) {block.replace('{}', struct + ' ')}\n"
        "layout(std430, binding = 1) writeonly buffer Result { uint bits[]; };\n"
        f"void main() {{\n    uint i = gl_GlobalInvocationID.x;\n    {struct} item = items[i];\n"
        f"{stores}\n}}\n",
        "probe.comp",
    )
    program = compile_compute(gl, source, "probe.comp")
    given, result = gl.buffer(data=array), gl.buffer(reserve=4 * 2 * len(reads))
    if uniform:
        given.bind_to_uniform_block(0)
    else:
        given.bind_to_storage_buffer(0)
    result.bind_to_storage_buffer(1)
    program.run(2)
    gl.finish()
    found = np.frombuffer(result.read(), np.uint32).reshape(2, -1).tolist()
    for part in (given, result, program):
        part.release()
    assert found == expected


def test_shared_layouts_parse_in_both_packings() -> None:
    text = (shader_root() / "lib" / "layouts.glsl").read_text()
    assert struct_dtypes(text, Packing.STD430)["Node"].itemsize <= 16
    assert struct_dtypes(text, Packing.STD140)["Frame"].itemsize % 16 == 0
    assert constants(text)["LIST_END"] == 0xFFFFFFFF


def test_struct_stride_differs_between_the_packings() -> None:
    strides = {packing: struct_dtypes(STRUCTS, packing)["Small"].itemsize for packing in Packing}
    assert strides == {Packing.STD140: 16, Packing.STD430: 12}


def test_constants_have_values_and_types() -> None:
    text = """
    const int BINDING = 3;  const uint LIST_END = 0xFFFFFFFFu;  // const int HIDDEN = 1;
    const float STEP = 0.5f;  const float WHOLE = 2;  const int LOW = -4;
    const int HEX = 0x1F;  const uint FACE = 0xFACEu + 0Xfu;  const float WIDE = 2.5e-3F;  const float THIRD = .3f;
    const uint MASK = (1u << 15) | 0x1u;  const int NEXT = BINDING + 2 * 4 - 1;
    float inside() { const float local = sqrt(2.0); { const int deep = f(1); } return local; }
    """
    assert constants(text) == {
        "BINDING": 3,
        "LIST_END": 0xFFFFFFFF,
        "STEP": 0.5,
        "WHOLE": 2.0,
        "LOW": -4,
        "HEX": 31,
        "FACE": 0xFACE + 15,
        "WIDE": 2.5e-3,
        "THIRD": 0.3,
        "MASK": 0x8001,
        "NEXT": 10,
    }
    assert isinstance(constants(text)["WHOLE"], float)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("const float ROOT = sqrt(2.0);", r"const ROOT = sqrt\(2\.0\): cannot be read"),
        ("const int A = B;", "const A = B: cannot be read"),
        ("const int A = 7 / 2;", "const A = 7 / 2: cannot be read"),
        ("const int A = 2147483648;", r"const int A = 2147483648: expected a whole number"),
        ("const uint A = -1;", "const uint A = -1: expected a whole number"),
        ("const int A = 1.5;", r"const int A = 1\.5: expected a whole number"),
        ("const int A = 1; const int A = 2;", "const A is defined twice"),
    ],
)
def test_constant_that_cannot_be_known_is_refused(text: str, message: str) -> None:
    with pytest.raises(ShaderError, match=message):
        constants(text)


@pytest.mark.parametrize(
    ("members", "message"),
    [
        ("double x;", "member x: type double is not supported"),
        ("bool flag;", "member flag: type bool is not supported"),
        ("mat3 m;", "member m: type mat3 is not supported"),
        ("vec5 v;", "member v: type vec5 is not supported"),
        ("Other o;", "member o: type Other is not supported"),
        ("float x[4];", "member x: arrays of float are not supported"),
        ("vec3 p[2];", "member p: arrays of vec3 are not supported"),
        ("vec4 p[COUNT];", "member p: array length COUNT must be"),
        ("vec4 p[0];", "member p: array length 0 must be"),
        ("vec3 p; vec3 q; float r;", "member q: follows the vec3 p"),
        ("vec3 p; vec4 q;", "member q: follows the vec3 p"),
        ("float x; vec3 p;", "ends in a vec3"),
        ("float x, y;", "cannot read 'float x, y'"),
        ("layout(offset = 0) float x;", "cannot read"),
        ("float x; int x;", "member x: declared twice"),
        ("", "has no member"),
    ],
)
def test_struct_that_cannot_be_laid_out_safely_is_refused(members: str, message: str) -> None:
    with pytest.raises(ShaderError, match=message):
        struct_dtypes(f"struct S {{ {members} }};", Packing.STD430)


def test_struct_defined_twice_is_refused() -> None:
    with pytest.raises(ShaderError, match="struct S is defined twice"):
        struct_dtypes("struct S { int a; }; struct S { int b; };", Packing.STD430)


def test_glsl_multiplies_a_column_major_matrix_as_numpy_the_original(gl: moderngl.Context) -> None:
    # Small whole numbers: every product and sum is exact in float32.
    matrix = np.arange(16.0).reshape(4, 4)
    vector = np.array([1.0, -2.0, 3.0, 4.0], np.float32)
    source = assemble_shader(
        "#version 450 core\nlayout(local_size_x = 1) in;\n"
        "layout(std430, binding = 0) buffer Data { mat4 matrix; vec4 vector; };\n"
        "void main() { vector = matrix * vector; }\n",
        "multiply.comp",
    )
    program = compile_compute(gl, source, "multiply.comp")
    buffer = gl.buffer(data=column_major(matrix).tobytes() + vector.tobytes())
    buffer.bind_to_storage_buffer(0)
    program.run()
    gl.finish()
    product = np.frombuffer(buffer.read(), np.float32)[16:]
    buffer.release()
    program.release()
    assert product.tolist() == (matrix @ vector).tolist()


def test_column_major_refuses_other_shapes() -> None:
    with pytest.raises(ShaderError, match=r"not \(4, 3\)"):
        column_major(np.zeros((4, 3)))

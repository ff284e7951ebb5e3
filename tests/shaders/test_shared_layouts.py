"""The driver reads every member of the shared structs where the host puts it, and the same constants."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from isosample.gl.layouts import Packing, constants, struct_dtypes
from isosample.gl.program import compile_compute
from isosample.gl.shader_source import assemble_shader, shader_root

if TYPE_CHECKING:
    import moderngl

    Layout = np.dtype[np.void]

LAYOUTS = "lib/layouts.glsl"
TO_BITS = {"f": "floatBitsToUint({})", "i": "uint({})", "u": "{}"}
STORAGE = ("Node", "Counters", "Band")


def _text() -> str:
    return (shader_root() / LAYOUTS).read_text(encoding="utf-8")


def _layouts() -> dict[str, Layout]:
    """The dtype of each struct in the kind of block that holds it."""
    storage = struct_dtypes(_text(), Packing.STD430)
    return {
        "Frame": struct_dtypes(_text(), Packing.STD140)["Frame"],
        **{name: storage[name] for name in STORAGE},
    }


def _reads(layout: Layout) -> list[str]:
    """GLSL expressions of the bits of all scalars of `item`, member by member."""
    reads = []
    for name in layout.names or ():
        base, shape = layout[name].base, layout[name].shape
        places = [
            f"item.{name}" + "".join(f"[{index}]" for index in place) for place in np.ndindex(shape or ())
        ]
        reads += [TO_BITS[base.kind].format(place) for place in places]
    return reads


def _filled(layout: Layout) -> tuple[np.ndarray, list[int]]:
    """Two items whose every scalar has its own bits (normal floats from 1 on), and the bits in order."""
    items = np.zeros(2, layout)
    expected: list[int] = []
    for item in range(2):
        for name in layout.names or ():
            field = items[name][item : item + 1]
            first = 0x3F800000 + len(expected)
            bits = np.arange(first, first + field.size, dtype=np.uint32)
            field[...] = bits.view(field.dtype).reshape(field.shape)
            expected += bits.tolist()
    return items, expected


def _probe(gl: moderngl.Context, declarations: str, body: str, blocks: list[bytes], words: int) -> list[int]:
    """Run `body` once in a compute shader that includes the layouts; return what it wrote to `bits`."""
    source = assemble_shader(
        f'#version 450 core\nlayout(local_size_x = 1) in;\n#include "{LAYOUTS}"\n{declarations}\n'
        "layout(std430, binding = 7) writeonly buffer Result { uint bits[]; };\n"
        f"void main() {{\n{body}\n}}\n",
        "probe.comp",
    )
    program = compile_compute(gl, source, "probe.comp")
    result = gl.buffer(reserve=4 * words)
    result.bind_to_storage_buffer(7)
    given = [gl.buffer(data=block) for block in blocks]
    for binding, buffer in enumerate(given):
        buffer.bind_to_uniform_block(binding)
        buffer.bind_to_storage_buffer(binding)
    program.run()
    gl.finish()
    found: list[int] = np.frombuffer(result.read(), np.uint32).tolist()
    for buffer in (*given, result):
        buffer.release()
    program.release()
    return found


def _read_back(gl: moderngl.Context, layouts: dict[str, Layout]) -> tuple[list[int], list[int]]:
    """Bits that a shader reads from two items of each struct, and the bits that were put there."""
    declarations, body = "", ""
    blocks: list[bytes] = []
    expected: list[int] = []
    for binding, (struct, layout) in enumerate(layouts.items()):
        items, bits = _filled(layout)
        kind = (
            f"std140, binding = {binding}) uniform"
            if struct == "Frame"
            else f"std430, binding = {binding}) buffer"
        )
        declarations += f"layout({kind} {struct}Source {{ {struct} given_{struct}[2]; }};\n"
        for i in range(2):
            stores = [
                f"bits[{len(expected) + n + i * len(bits) // 2}] = {read};"
                for n, read in enumerate(_reads(layout))
            ]
            body += f"{{ {struct} item = given_{struct}[{i}];\n" + "\n".join(stores) + "}\n"
        blocks.append(items.tobytes())
        expected += bits
    return _probe(gl, declarations, body, blocks, len(expected)), expected


def test_driver_reads_every_member_where_the_host_writes_it(gl: moderngl.Context) -> None:
    found, expected = _read_back(gl, _layouts())
    assert found == expected


def test_member_that_is_off_by_four_bytes_is_told(gl: moderngl.Context) -> None:
    layouts = _layouts()
    frame = layouts["Frame"]
    names = list(frame.names or ())
    offsets = [frame.fields[name][1] if frame.fields else 0 for name in names]
    offsets[-1] += 4
    layouts["Frame"] = np.dtype(
        {
            "names": names,
            "formats": [frame[name] for name in names],
            "offsets": offsets,
            "itemsize": frame.itemsize,
        }
    )
    found, expected = _read_back(gl, layouts)
    assert found != expected


def test_driver_and_host_have_the_same_constants(gl: moderngl.Context) -> None:
    values = {name: value for name, value in constants(_text()).items() if isinstance(value, int)}
    body = "\n".join(f"bits[{i}] = uint({name});" for i, name in enumerate(values))
    found = _probe(gl, "", body, [], len(values))
    assert dict(zip(values, found, strict=True)) == {name: value % 2**32 for name, value in values.items()}


def test_sizes_that_the_design_counts_on() -> None:
    layouts = _layouts()
    assert layouts["Node"].itemsize == 16
    assert layouts["Band"].itemsize % 16 == 0
    assert layouts["Frame"].itemsize <= 16384  # least size of a uniform block in OpenGL 4.5
    masks = constants(_text())
    assert int(masks["LEVEL_MASK"]) & int(masks["RISING_BIT"]) == 0
    assert int(masks["LEVEL_MASK"]) | int(masks["RISING_BIT"]) == 0xFFFF
    assert masks["MAX_LEVELS"] == masks["DOMAIN_LEVEL"]


@pytest.mark.parametrize("name", ["Frame", *STORAGE])
def test_each_shared_struct_is_read_in_full(name: str) -> None:
    layout = _layouts()[name]
    scalars = sum(int(np.prod(layout[member].shape, dtype=int)) for member in layout.names or ())
    assert len(_reads(layout)) == scalars == len(_filled(layout)[1]) // 2

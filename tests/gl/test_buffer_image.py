"""What is stored into a buffer as a storage block is read from it as an image, and the other way round."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from isosample.errors import CapacityError
from isosample.gl import buffer_image
from isosample.gl.buffer_image import BufferImage, texel_bytes
from isosample.gl.context import limits
from isosample.gl.functions import Functions
from isosample.gl.memory import with_room
from isosample.gl.ownership import Owner

if TYPE_CHECKING:
    import moderngl

WORDS = 256
STORE = """
#version 450 core
layout(local_size_x = 64) in;
layout(std430, binding = 0) writeonly buffer Stored { uvec2 stored[]; };
void main() { uint i = gl_GlobalInvocationID.x; stored[i] = uvec2(i, 1000u + i); }
"""
LENGTH = """
#version 450 core
layout(local_size_x = 1) in;
layout(std430, binding = 0) writeonly buffer Stored { uvec2 stored[]; };
layout(std430, binding = 1) writeonly buffer Length { uint found; };
void main() { found = uint(stored.length()); }
"""
LOAD = """
#version 450 core
layout(local_size_x = 64) in;
layout(FORMAT, binding = 3) uniform uimageBuffer texels;
layout(std430, binding = 1) writeonly buffer Found { uvec4 found[]; };
void main() {
    uint i = gl_GlobalInvocationID.x;
    if (i >= uint(imageSize(texels))) return;
    found[i] = imageLoad(texels, int(i));
    imageStore(texels, int(i), found_value(i));
}
""".replace("void main", "uvec4 found_value(uint i) { return uvec4(7u * i, 3u, 2u, 1u); }\nvoid main")


@pytest.mark.parametrize(("texel", "words"), [("r32ui", 1), ("rg32ui", 2), ("rgba32ui", 4)])
def test_texels_are_the_words_of_the_storage_block(gl: moderngl.Context, texel: str, words: int) -> None:
    assert texel_bytes(texel) == 4 * words
    texels = WORDS // words
    with Owner() as made:
        image = made.keep(BufferImage(gl, texels, texel))
        assert image.size_bytes == 4 * WORDS
        found = made.keep(gl.buffer(reserve=16 * WORDS))
        store = made.keep(gl.compute_shader(STORE))
        load = made.keep(gl.compute_shader(LOAD.replace("FORMAT", texel)))
        image.bind_storage(0)
        image.bind_image(3)
        found.bind_to_storage_buffer(1)
        store.run(WORDS // 2 // 64)
        gl.memory_barrier()
        load.run(WORDS // 64)
        gl.memory_barrier()
        seen = np.frombuffer(found.read(), np.uint32).reshape(-1, 4)[:texels]
        left = np.frombuffer(image.read(), np.uint32)
    stored = np.stack([np.arange(WORDS // 2), 1000 + np.arange(WORDS // 2)], axis=1).astype(np.uint32).ravel()
    expected = np.zeros((texels, 4), np.uint32)
    expected[:, 3] = 1  # where a format has no alpha
    expected[:, :words] = stored.reshape(texels, words)
    np.testing.assert_array_equal(seen, expected)
    written = np.tile(np.array([0, 3, 2, 1], np.uint32), (texels, 1))
    written[:, 0] = 7 * np.arange(texels)
    np.testing.assert_array_equal(left, written[:, :words].ravel())


@pytest.mark.parametrize(("block", "beyond"), [(64, True), (4 * WORDS, False)])
def test_a_storage_block_has_as_much_of_it_as_the_driver_allows(
    gl: moderngl.Context, monkeypatch: pytest.MonkeyPatch, block: int, beyond: bool
) -> None:
    allowed = replace(limits(gl), storage_block_bytes=block)
    monkeypatch.setattr(buffer_image, "limits", lambda _: allowed)
    with Owner() as made:
        image = made.keep(BufferImage(gl, WORDS, "r32ui"))
        length = made.keep(gl.buffer(reserve=4))
        tell = made.keep(gl.compute_shader(LENGTH))
        image.bind_storage(0)
        length.bind_to_storage_buffer(1)
        tell.run()
        gl.memory_barrier()
        assert np.frombuffer(length.read(), np.uint32).tolist() == [block // 8]  # two words each
        assert image.beyond_block == beyond


def test_one_beyond_all_memory_is_refused(gl: moderngl.Context) -> None:
    with pytest.raises(CapacityError, match="Take fewer"):
        with_room(gl, BufferImage(gl, 1 << 42, "rgba32ui"), "numbers", 1 << 46, "Take fewer.")
    assert gl.error == "GL_NO_ERROR"


def test_what_is_released_twice_is_deleted_once(
    gl: moderngl.Context, monkeypatch: pytest.MonkeyPatch
) -> None:
    deleted: list[int] = []
    delete = Functions.delete_texture

    def noted(self: Functions, texture: int) -> None:
        deleted.append(texture)
        delete(self, texture)

    monkeypatch.setattr(Functions, "delete_texture", noted)
    image = BufferImage(gl, 4, "r32ui")
    image.release()
    image.release()
    assert deleted[0] > 0 == deleted[1]

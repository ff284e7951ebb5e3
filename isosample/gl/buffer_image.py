"""Memory that shaders read as an image, and write as a storage block.

Software renderers gather the texels of an image for all lanes at once, but load from a storage block lane by lane; a
storage block takes all words of a store in one turn, though, an image one after the other.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from isosample.gl.context import functions, limits

if TYPE_CHECKING:
    import moderngl

# OpenGL enumerants (gl.xml) of the formats of texels, and their bytes.
_FORMATS = {"r32ui": (0x8236, 4), "rg32ui": (0x823C, 8), "rgba32ui": (0x8D70, 16)}


def texel_bytes(texel: str) -> int:
    """Bytes of a texel of a format: ``r32ui``, ``rg32ui`` or ``rgba32ui``."""
    return _FORMATS[texel][1]


class BufferImage:
    """A buffer that is also an image of one row (``uimageBuffer``).

    Parameters
    ----------
    ctx : moderngl.Context
        Made by `isosample.gl.context.create_context`; an error is left pending if the driver has no room.
    texel_count : int
        At most ``Limits.buffer_texels``.
    texel : str
        Their format, as `texel_bytes` takes it.

    Raises
    ------
    OpenGLError
        If the context was made by another.
    """

    def __init__(self, ctx: moderngl.Context, texel_count: int, texel: str) -> None:
        self._functions = functions(ctx)
        self._block_bytes = limits(ctx).storage_block_bytes
        self._format = _FORMATS[texel][0]
        self._buffer = ctx.buffer(reserve=texel_count * texel_bytes(texel))
        self._texture = self._functions.create_buffer_texture(self._format, self._buffer.glo)

    @property
    def size_bytes(self) -> int:
        """All of it."""
        return int(self._buffer.size)

    @property
    def beyond_block(self) -> bool:
        """Whether a storage block has a part of it alone."""
        return self.size_bytes > self._block_bytes

    def bind_image(self, unit: int) -> None:
        """Bind all texels to an image unit, to be read and written."""
        self._functions.bind_image(unit, self._texture, self._format)

    def bind_storage(self, binding: int) -> None:
        """Bind the words to a storage block: from the first one on as many as the driver allows."""
        self._buffer.bind_to_storage_buffer(binding, size=min(self.size_bytes, self._block_bytes))

    def read(self) -> bytes:
        """All words."""
        content: bytes = self._buffer.read()
        return content

    def release(self) -> None:
        """Free it."""
        self._functions.delete_texture(self._texture)
        self._texture = 0  # that of none
        self._buffer.release()

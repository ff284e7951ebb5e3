"""A float32 texture that programs draw into."""

from __future__ import annotations

from typing import TYPE_CHECKING

from isosample.gl.memory import with_room

if TYPE_CHECKING:
    import moderngl


COMPONENT_BYTES = 4


class FloatTarget:
    """A texture with its framebuffer, made anew when the size changes.

    Parameters
    ----------
    ctx : moderngl.Context
    components : int
        1 to 4.
    """

    def __init__(self, ctx: moderngl.Context, components: int) -> None:
        self._ctx = ctx
        self._components = components
        self._texture: moderngl.Texture | None = None
        self._framebuffer: moderngl.Framebuffer | None = None

    @property
    def size(self) -> tuple[int, int] | None:
        """Width and height; None as long as there is no texture."""
        return None if self._texture is None else self._texture.size

    @property
    def texture(self) -> moderngl.Texture:
        """What was drawn; `resize` comes first."""
        assert self._texture is not None
        return self._texture

    @property
    def framebuffer(self) -> moderngl.Framebuffer:
        """What is drawn into; `resize` comes first."""
        assert self._framebuffer is not None
        return self._framebuffer

    def resize(self, size: tuple[int, int]) -> None:
        """Make the target (width, height) large.

        Raises
        ------
        CapacityError
            If the driver has no room for it.
        """
        if self.size == size:
            return
        self.release()
        width, height = size
        room = (
            f"a picture of {width} x {height} pixels",
            COMPONENT_BYTES * self._components * width * height,
        )
        texture = self._ctx.texture(size, self._components, dtype="f4")
        self._texture = with_room(self._ctx, texture, *room, "Ask for a smaller one.")
        self._texture.filter = (self._ctx.NEAREST, self._ctx.NEAREST)
        self._framebuffer = self._ctx.framebuffer([self._texture])

    def release(self) -> None:
        """Free the texture."""
        if self._framebuffer is not None:
            self._framebuffer.release()
        if self._texture is not None:
            self._texture.release()
        self._framebuffer = self._texture = None

"""Memory on the GPU that the driver did not have."""

from __future__ import annotations

from typing import TYPE_CHECKING

from isosample.errors import CapacityError

if TYPE_CHECKING:
    import moderngl

    from isosample.gl.ownership import Part


def with_room(ctx: moderngl.Context, part: Part, what: str, size_bytes: int, remedy: str) -> Part:
    """Return what was just made, if the driver had room for it.

    Parameters
    ----------
    ctx : moderngl.Context
        Current context.
    part : Releasable
        A buffer, a texture, or what holds one.
    what : str
        Words for it: "a texture of 4 x 4 samples".
    size_bytes : int
    remedy : str
        One sentence: what makes it smaller.

    Raises
    ------
    CapacityError
        If an error of OpenGL is pending; the part is released.
    """
    error = ctx.error
    if error != "GL_NO_ERROR":
        part.release()
        raise CapacityError(
            f"{ctx.info['GL_RENDERER']} has no room for {what}, {size_bytes} bytes ({error}). {remedy}"
        )
    return part

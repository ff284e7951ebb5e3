"""The picture on the GPU: a float32 texture that programs fill tile by tile."""

from __future__ import annotations

from typing import TYPE_CHECKING

import moderngl
import numpy as np
import numpy.typing as npt

from isosample.errors import CapacityError
from isosample.gl.context import drawing_into, limits
from isosample.rendering.float_target import FloatTarget
from isosample.rendering.frame import shared_constants
from isosample.rendering.stage import work_groups

if TYPE_CHECKING:
    from isosample.rendering.programs import Program
    from isosample.rendering.tiles import Tile

    F32 = npt.NDArray[np.float32]


class PictureTarget:
    """Premultiplied linear RGBA, written by a fragment or a compute shader.

    Parameters
    ----------
    ctx : moderngl.Context
    """

    def __init__(self, ctx: moderngl.Context) -> None:
        self._ctx = ctx
        self._pixels = FloatTarget(ctx, 4)
        self._staging = np.empty((0, 0, 4), dtype=np.float32)  # as OpenGL has it, row 0 below

    def resize(self, width: int, height: int) -> None:
        """Make room for a picture of that size.

        Raises
        ------
        CapacityError
            If the driver's framebuffers are smaller.
        """
        if self._pixels.size != (width, height):
            check_picture_fits(self._ctx, (width, height))
            self._pixels.resize((width, height))

    def clear(self, color: npt.ArrayLike, tile: Tile | None = None) -> None:
        """Give every pixel one colour, (4,): of a tile, or of the picture."""
        framebuffer = self._pixels.framebuffer
        framebuffer.scissor = (
            (0, 0, *framebuffer.size) if tile is None else (tile.x, tile.y, tile.width, tile.height)
        )
        red, green, blue, alpha = np.asarray(color, dtype=np.float64).tolist()
        framebuffer.clear(red, green, blue, alpha)

    def fill(self, tile: Tile, program: Program) -> None:
        """Run a program once for every pixel of a tile."""
        if isinstance(program, moderngl.ComputeShader):
            self.bind()
            program.run(*work_groups(tile))
            return
        screen = self._ctx.vertex_array(program, [])
        framebuffer = self._pixels.framebuffer
        framebuffer.scissor = (tile.x, tile.y, tile.width, tile.height)
        with drawing_into(self._ctx, framebuffer):
            screen.render(vertices=3)
        screen.release()

    def bind(self) -> None:
        """Bind the picture for compute shaders."""
        self._pixels.texture.bind_to_image(shared_constants()["BINDING_IMAGE"], read=False, write=True)

    def fill_blocks(self, tile: Tile, program: moderngl.Program, block: int) -> None:
        """Run a program of points, one for every block of a tile: `block` squared pixels, or none where all is done."""
        framebuffer = self._pixels.framebuffer
        width, height = (-(-edge // block) * block for edge in framebuffer.size)
        whole = framebuffer.viewport
        framebuffer.viewport = (0, 0, width, height)  # else the points of the last row and column are cut
        framebuffer.scissor = (tile.x, tile.y, tile.width, tile.height)
        points = self._ctx.vertex_array(program, [])
        with drawing_into(self._ctx, framebuffer):
            self._ctx.enable(self._ctx.PROGRAM_POINT_SIZE)
            points.render(self._ctx.POINTS, vertices=tile.blocks(block))
        points.release()
        framebuffer.viewport = whole

    def read(self) -> F32:
        """(H, W, 4) float32, row 0 on top."""
        framebuffer = self._pixels.framebuffer
        width, height = framebuffer.size
        if self._staging.shape != (height, width, 4):
            self._staging = np.empty((height, width, 4), dtype=np.float32)
        framebuffer.read_into(self._staging, components=4, dtype="f4")
        return self._staging[::-1].copy()

    def release(self) -> None:
        """Free the texture."""
        self._pixels.release()


def check_picture_fits(ctx: moderngl.Context, size: tuple[int, int]) -> None:
    """Raise `CapacityError` if a picture of so many pixels, (width, height), is larger than the driver allows."""
    found = limits(ctx)
    largest = min(*found.framebuffer_size, found.texture_size)
    if max(size) > largest:
        width, height = size
        raise CapacityError(
            f"a picture of {width} x {height} pixels is larger than this driver's {largest}; ask for a smaller one."
        )

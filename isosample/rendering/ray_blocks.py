"""Blocks of pixels whose rays leap over empty macrocells together, before any of them is marched by itself."""

from __future__ import annotations

from typing import TYPE_CHECKING

import moderngl

from isosample.gl.context import drawing_into
from isosample.rendering.float_target import FloatTarget
from isosample.rendering.frame import shared_constants
from isosample.rendering.supplies import ray_block_supply

if TYPE_CHECKING:
    from isosample.rendering.picture_target import PictureTarget
    from isosample.rendering.programs import Program, Programs
    from isosample.rendering.tiles import Tile


class RayBlocks:
    """The spans of a picture's blocks: the distances between which their rays may see something.

    Parameters
    ----------
    ctx : moderngl.Context
    """

    def __init__(self, ctx: moderngl.Context) -> None:
        self._ctx = ctx
        self._spans = FloatTarget(ctx, 2)

    def find(self, size: tuple[int, int], programs: Programs) -> None:
        """Find the spans of a picture of (width, height) pixels, and bind them; the caller has bound all else."""
        edge = shared_constants()["RAY_BLOCK"]
        self._spans.resize((-(-size[0] // edge), -(-size[1] // edge)))
        screen = self._ctx.vertex_array(
            programs.graphics("screen.vert", "raycast_blocks.frag", ray_block_supply()), []
        )
        with drawing_into(self._ctx, self._spans.framebuffer):
            screen.render(vertices=3)
        screen.release()
        self._spans.texture.use(shared_constants()["UNIT_SPANS"])

    def fill(self, target: PictureTarget, tile: Tile, program: Program) -> None:
        """Run a program for the pixels of a tile; a fragment shader only for those of blocks that have a span."""
        if self._spans.size is not None and isinstance(program, moderngl.Program):
            target.fill_blocks(tile, program, shared_constants()["RAY_BLOCK"])
        else:
            target.fill(tile, program)

    def release(self) -> None:
        """Free the texture."""
        self._spans.release()

"""Which shader stage runs a pass over the pixels, and how many work groups a tile takes."""

from __future__ import annotations

from typing import TYPE_CHECKING

from isosample.gl.context import suits_compute
from isosample.rendering.settings import ResolveStage

if TYPE_CHECKING:
    import moderngl

    from isosample.rendering.tiles import Tile

WORK_GROUP = 8  # local size of the compute shaders


def resolve_stage(ctx: moderngl.Context, asked: ResolveStage) -> ResolveStage:
    """The stage that runs a pass over the pixels: what is asked for, or what suits the renderer for AUTO."""
    if asked is not ResolveStage.AUTO:
        return asked
    return ResolveStage.COMPUTE if suits_compute(ctx) else ResolveStage.FRAGMENT


def work_groups(tile: Tile) -> tuple[int, int]:
    """Work groups along x and y that cover a tile."""
    return -(-tile.width // WORK_GROUP), -(-tile.height // WORK_GROUP)

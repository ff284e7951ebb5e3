"""Which shader stage runs a pass over the pixels, and how many work groups a tile takes."""

from __future__ import annotations

import os
from functools import cache
from typing import TYPE_CHECKING

from isosample.gl.context import is_software, suits_compute
from isosample.rendering.settings import ResolveStage

if TYPE_CHECKING:
    import moderngl

    from isosample.rendering.tiles import Tile

WORK_GROUP = 8  # local size of the compute shaders over pixels, along x and y
LINE_GROUP = 64  # and of those over triangles, vertices, packets or lists
MOST_THREADS = 32  # of llvmpipe
MOST_GROUPS = 65535 - MOST_THREADS  # of one call along x: every OpenGL allows 65535


def resolve_stage(ctx: moderngl.Context, asked: ResolveStage) -> ResolveStage:
    """The stage that runs a pass over the pixels: what is asked for, or what suits the renderer for AUTO."""
    if asked is not ResolveStage.AUTO:
        return asked
    return ResolveStage.COMPUTE if suits_compute(ctx) else ResolveStage.FRAGMENT


def work_groups(tile: Tile) -> tuple[int, int]:
    """Work groups along x and y that cover a tile."""
    return -(-tile.width // WORK_GROUP), -(-tile.height // WORK_GROUP)


def line_groups(count: int) -> int:
    """Work groups that so many invocations along a line take."""
    return -(-count // LINE_GROUP)


@cache
def renderer_threads() -> int:
    """Threads of a software renderer."""
    return min(os.cpu_count() or 1, MOST_THREADS)


def run_interleaved(ctx: moderngl.Context, program: moderngl.ComputeShader, groups: int) -> None:
    """Run work groups of a program with ``pass/interleaved.glsl`` such that neighbours go to different threads.

    Parameters
    ----------
    ctx : moderngl.Context
    program : moderngl.ComputeShader
    groups : int
        At most `MOST_GROUPS`; a few more are run, which the program has to pass over.
    """
    threads = renderer_threads() if is_software(ctx) else 1
    each = -(-groups // threads)
    program["thread_count"], program["groups_each"] = threads, each
    program.run(each * threads)

"""Some pieces of a scene's meshes on the GPU, drawn with as few calls as their order allows."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from isosample.rendering.chunk_stream import VERTEX_DTYPE
from isosample.rendering.stage import LINE_GROUP

if TYPE_CHECKING:
    from collections.abc import Sequence

    import moderngl

Bool = npt.NDArray[np.bool_]
I64 = npt.NDArray[np.int64]

GAP = 3 * 256  # indices of ruled out pieces that are drawn along rather than beginning another draw
VERTEX_GAP = LINE_GROUP  # vertices of ruled out pieces that are projected along: a work group's
INDEX_BYTES = 4
OFFSET_ALIGNMENT = (
    256  # [byte] of what is bound to a storage block: the most that OpenGL allows a driver to ask for
)
COMMAND_WORDS = 5  # indices, instances, first index, base vertex, base instance


class Batch:
    """Some pieces on the GPU.

    Attributes
    ----------
    rows : (R,) int64
        Which, in the scene's order.
    bytes : int
    residual : int or None
        Which column of the residuals is there.
    """

    def __init__(
        self,
        ctx: moderngl.Context,
        chunks: npt.NDArray[np.void],
        rows: I64,
        starts: I64,
        vertex_starts: I64,
        buffers: Sequence[moderngl.Buffer],
        residual: int | None,
        size: int,
    ) -> None:
        self._ctx = ctx
        self.rows, self.bytes, self.residual = rows, size, residual
        self._levels, self._counts = chunks["level"][rows], chunks["index_count"][rows]
        self._gap = (
            0 if chunks["detail"].any() else GAP
        )  # what lies between may be another detail of what is drawn
        self._starts = starts
        self._vertex_starts, self._vertex_counts = vertex_starts, chunks["vertex_count"][rows]
        self._vertices, self._indices, *rest = buffers
        self._residuals = rest[0] if rest else None
        self._vertex_arrays: dict[int, moderngl.VertexArray] = {}

    def draw(self, program: moderngl.Program, shown: Bool) -> None:
        """Draw pieces with a program.

        Parameters
        ----------
        program : moderngl.Program
            Must stay alive as long as this object.
        shown : (C,) bool
            Which pieces of the scene are to be drawn; of those here, neighbours may be drawn along.
        """
        levels, first, count = self.runs(shown, largest_gap=self._gap)
        if len(first) == 0:
            return
        vertex_array = self._vertex_array(program)
        has_level = "level" in program
        groups = np.flatnonzero(np.diff(levels, prepend=-1)) if has_level else np.zeros(1, dtype=np.int64)
        stops = [*groups[1:].tolist(), len(first)]
        commands = self._commands(first, count) if len(groups) < len(first) else None
        for start, stop in zip(groups.tolist(), stops, strict=True):
            if has_level:
                program["level"] = int(levels[start])
            if stop - start == 1 or commands is None:
                vertex_array.render(vertices=int(count[start]), first=int(first[start]))
            else:
                vertex_array.render_indirect(commands, count=stop - start, first=start)
        if commands is not None:
            commands.release()

    @property
    def vertex_count(self) -> int:
        """Vertices on the GPU."""
        return int(self._vertices.size) // VERTEX_DTYPE.itemsize

    @property
    def residual_bytes(self) -> int:
        """Of the residuals; 0 where there are none."""
        return 0 if self._residuals is None else int(self._residuals.size)

    def runs(self, shown: Bool, *, largest_gap: int = 0) -> tuple[I64, I64, I64]:
        """Levels, first indices and counts of draws of the `shown` pieces, with at most so many indices between two."""
        kept = shown[self.rows]
        return runs(self._levels[kept], self._starts[kept], self._counts[kept], largest_gap)

    def vertex_runs(self, shown: Bool) -> tuple[I64, I64]:
        """First vertices and counts of what `shown` pieces have, and little else; `shown` as for `draw`."""
        kept = shown[self.rows]
        starts, counts = self._vertex_starts[kept], self._vertex_counts[kept]
        order = np.argsort(starts, kind="stable")
        first, stop = starts[order], (starts + counts)[order]
        if len(first) == 0:
            return first, first
        reached = np.maximum.accumulate(stop)
        begins = np.flatnonzero(np.concatenate([[True], first[1:] > reached[:-1] + VERTEX_GAP]))
        return first[begins], reached[np.append(begins[1:], len(first)) - 1] - first[begins]

    def bind_vertices(self, binding: int, first: int, count: int) -> int:
        """Bind positions and gradients of some vertices to a storage block; return which is the first in it."""
        return _bind_window(self._vertices, VERTEX_DTYPE.itemsize, binding, first, count)

    def bind_indices(self, binding: int, first: int, count: int) -> int:
        """Bind some indices to a storage block; return which is the first in it."""
        return _bind_window(self._indices, INDEX_BYTES, binding, first, count)

    def bind_residuals(self, binding: int) -> None:
        """Bind the residuals, if they are here, to a storage block."""
        if self._residuals is not None:
            self._residuals.bind_to_storage_buffer(binding)

    def release(self) -> None:
        """Free every buffer."""
        for vertex_array in self._vertex_arrays.values():
            vertex_array.release()
        for buffer in (self._vertices, self._indices, self._residuals):
            if buffer is not None:
                buffer.release()
        self._vertex_arrays = {}

    def _commands(self, first: I64, count: I64) -> moderngl.Buffer:
        """The draws as the GPU reads them."""
        commands = np.zeros((len(first), COMMAND_WORDS), dtype=np.uint32)
        commands[:, 0], commands[:, 1], commands[:, 2] = count, 1, first
        return self._ctx.buffer(commands)

    def _vertex_array(self, program: moderngl.Program) -> moderngl.VertexArray:
        key = id(program)
        if key not in self._vertex_arrays:
            layout = ("3f 3f", "position", "gradient") if "gradient" in program else ("3f 3x4", "position")
            content: list[tuple[object, ...]] = [(self._vertices, *layout)]
            if "residual" in program:
                content.append((self._residuals, "1f", "residual"))
            self._vertex_arrays[key] = self._ctx.vertex_array(program, content, index_buffer=self._indices)
        return self._vertex_arrays[key]


def _bind_window(buffer: moderngl.Buffer, item: int, binding: int, first: int, count: int) -> int:
    """Bind a part of a buffer that holds some items; return the first one in it."""
    step = math.lcm(item, OFFSET_ALIGNMENT)
    offset = first * item // step * step
    size = min((first + count) * item, int(buffer.size)) - offset
    buffer.bind_to_storage_buffer(binding, offset=offset, size=size)
    return offset // item


def runs(
    levels: npt.NDArray[np.generic], starts: I64, counts: I64, largest_gap: int = GAP
) -> tuple[I64, I64, I64]:
    """Levels, first indices and counts of draws: pieces of one level that (nearly) follow each other are one."""
    if len(starts) == 0:
        none = np.zeros(0, dtype=np.int64)
        return none, none, none
    stops = starts + counts
    level = levels.astype(np.int64)
    gap = starts[1:] - stops[:-1]
    begins = np.concatenate([[True], (level[1:] != level[:-1]) | (gap < 0) | (gap > largest_gap)])
    first = np.flatnonzero(begins)
    last = np.append(first[1:], len(starts)) - 1
    return level[first], starts[first], stops[last] - starts[first]

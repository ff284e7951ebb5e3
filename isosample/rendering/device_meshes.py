"""The triangles of a scene on the GPU: all of them, or one batch after the other where they exceed a budget."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from isosample.errors import CapacityError
from isosample.gl.memory import with_room
from isosample.gl.ownership import Owner
from isosample.rendering.chunk_stream import VERTEX_DTYPE, source_of
from isosample.rendering.mesh_batch import INDEX_BYTES, Batch
from isosample.tally import MESH_UPLOADS, tally

if TYPE_CHECKING:
    from collections.abc import Iterator

    import moderngl

    from isosample.rendering.scene import Scene

Bool = npt.NDArray[np.bool_]
I64 = npt.NDArray[np.int64]

RESIDUAL_BYTES = 4
STAGED_BYTES = 16 << 20  # pieces that are put together before one call uploads them
LARGEST_DRAW = 2**31 - 1  # indices that one draw can name
FLAT, CURVED = 0, 1  # columns of the residuals
REMEDY = "Give a smaller --mesh-budget (RenderSettings.mesh_budget_bytes)."


@dataclass(slots=True)
class Uploads:
    """What was uploaded since `DeviceMeshes.begin_picture`, and the most that was on the GPU at once."""

    batches: int = 0
    bytes: int = 0
    largest_bytes: int = 0


class DeviceMeshes:
    """Meshes of one scene.

    Parameters
    ----------
    ctx : moderngl.Context
    scene : Scene
    """

    def __init__(self, ctx: moderngl.Context, scene: Scene) -> None:
        self._ctx = ctx
        self.chunks = scene.chunks()
        self._scene = scene
        self._source = source_of(scene)
        self._sizes, self._index_counts = bytes_of(self.chunks), self.chunks["index_count"].copy()
        self._resident: Batch | None = None
        self.uploads = Uploads()

    def begin_picture(self, budget_bytes: int) -> None:
        """Count uploads from here on, and free what exceeds the budget."""
        if self._resident is not None and self._resident.bytes > budget_bytes:
            self.release()
        self.uploads = Uploads(largest_bytes=0 if self._resident is None else self._resident.bytes)

    def missing(self, needed: Bool, budget_bytes: int, residual: int | None) -> I64:
        """Rows to upload before a picture is drawn, so that all its passes find them; none if they do not fit.

        All rows of a scene in memory, so that the next picture finds them too; of one in a store those that this
        picture needs.

        Parameters
        ----------
        needed, budget_bytes, residual
            As for `batches`.
        """
        wanted = np.ones_like(needed) if self._scene.source is None else needed
        if not self._fits(wanted, residual, budget_bytes):
            wanted = needed
        rows = np.flatnonzero(wanted)
        if not self._fits(wanted, residual, budget_bytes) or not (wanted & ~self._held(residual)).any():
            return rows[:0]
        return rows

    def has(self, needed: Bool, residual: int | None) -> bool:
        """Whether all that is needed is on the GPU already; parameters as `batches`."""
        return not (needed & ~self._held(residual)).any()

    def batches(self, needed: Bool, budget_bytes: int, residual: int | None) -> Iterator[Batch]:
        """Yield the needed pieces, as many at a time as the budget allows; a batch is valid until the next.

        Parameters
        ----------
        needed : (C,) bool
        budget_bytes : int
            Vertex and index data on the GPU at once.
        residual : int or None
            The column of the residuals to upload too, `FLAT` or `CURVED`.

        Raises
        ------
        CapacityError
            If one piece alone exceeds the budget.
        """
        held = self._held(residual)
        if self._resident is not None and (needed & held).any():
            yield self._resident  # what is here already needs no upload
        for part in self._parts(np.flatnonzero(needed & ~held), residual, budget_bytes):
            yield self.upload(part, residual)

    def release(self) -> None:
        """Free every buffer."""
        if self._resident is not None:
            self._resident.release()
        self._resident = None

    def upload(self, rows: I64, residual: int | None) -> Batch:
        """Put pieces on the GPU, after what is there was freed.

        Raises
        ------
        CapacityError
            If the driver has no room for them.
        CacheError
            If a stored piece is damaged.
        """
        self.release()
        tally(MESH_UPLOADS)
        size = int(bytes_of(self.chunks[rows], residual).sum())
        whole = len(rows) == len(self.chunks) and self._scene.source is None
        fill = self._fill_with_arrays if whole else self._fill_with_pieces
        with Owner() as made:
            buffers, starts, vertex_starts = fill(made, rows, residual)
            self._resident = Batch(
                self._ctx, self.chunks, rows, starts, vertex_starts, buffers, residual, size
            )
            made.pop_all()  # the batch has them
        self.uploads.batches += 1
        self.uploads.bytes += size
        self.uploads.largest_bytes = max(self.uploads.largest_bytes, size)
        return self._resident

    def _fits(self, wanted: Bool, residual: int | None, budget_bytes: int) -> bool:
        sizes = self._sizes if residual is None else bytes_of(self.chunks, residual)
        indices = int(self._index_counts[wanted].sum())
        return int(sizes[wanted].sum()) <= budget_bytes and indices <= LARGEST_DRAW

    def _held(self, residual: int | None) -> Bool:
        """(C,) whether a piece is on the GPU, with that column of the residuals."""
        held = np.zeros(len(self.chunks), dtype=bool)
        if self._resident is not None and residual in (None, self._resident.residual):
            held[self._resident.rows] = True
        return held

    def _parts(self, rows: I64, residual: int | None, budget_bytes: int) -> Iterator[I64]:
        """Cut rows into runs that fit the budget."""
        sizes, indices = bytes_of(self.chunks[rows], residual), self.chunks["index_count"][rows]
        first, held, named = 0, 0, 0
        for i, (size, count) in enumerate(zip(sizes.tolist(), indices.tolist(), strict=True)):
            if size > budget_bytes:
                level = int(self.chunks["level"][rows[i]])
                raise CapacityError(
                    f"one piece of level {level} alone takes {size} bytes, more than the budget of "
                    f"{budget_bytes} bytes for meshes; raise mesh_budget_bytes, or extract with smaller bricks."
                )
            if i > first and (held + size > budget_bytes or named + count > LARGEST_DRAW):
                yield rows[first:i]
                first, held, named = i, 0, 0
            held, named = held + size, named + count
        if len(rows) > first:
            yield rows[first:]

    def _fill_with_arrays(
        self, made: Owner, rows: I64, residual: int | None
    ) -> tuple[list[moderngl.Buffer], I64, I64]:
        """All arrays of the scene as they are; with the first index and the first vertex of each of the rows."""
        scene = self._scene
        arrays: list[npt.NDArray[np.generic]] = [scene.vertices, scene.indices]
        if residual is not None:
            arrays.append(np.ascontiguousarray(scene.residuals[:, residual]))
        buffers = [
            made.keep(self._room_for(a.nbytes, self._ctx.buffer(a)) if a.size else self._reserved(0))
            for a in arrays
        ]
        return buffers, self.chunks["first_index"][rows], self.chunks["first_vertex"][rows]

    def _fill_with_pieces(
        self, made: Owner, rows: I64, residual: int | None
    ) -> tuple[list[moderngl.Buffer], I64, I64]:
        """Pieces one after the other, in whatever order their source has them; otherwise as `_fill_with_arrays`."""
        counts = self.chunks["index_count"][rows]
        vertex_bytes = int(self.chunks["vertex_count"][rows].sum()) * VERTEX_DTYPE.itemsize
        sizes = [vertex_bytes, INDEX_BYTES * int(counts.sum())]
        if residual is not None:
            sizes.append(vertex_bytes // VERTEX_DTYPE.itemsize * RESIDUAL_BYTES)
        streams = [_Upload(made.keep(self._reserved(n))) for n in sizes]
        vertex = 0
        for piece in self._source.load(self.chunks[rows]):
            streams[0].append(piece.vertices)
            streams[1].append(piece.indices + np.uint32(vertex))
            if residual is not None:
                streams[2].append(np.ascontiguousarray(piece.residuals[:, residual]))
            vertex += len(piece.vertices)
        for stream in streams:
            stream.flush()
        vertex_counts = self.chunks["vertex_count"][rows]
        starts = (np.cumsum(counts) - counts, np.cumsum(vertex_counts) - vertex_counts)
        return [stream.buffer for stream in streams], *starts

    def _reserved(self, size: int) -> moderngl.Buffer:
        """Buffer of so many bytes, or of a few: OpenGL has no empty buffers."""
        return self._room_for(size, self._ctx.buffer(reserve=max(size, VERTEX_DTYPE.itemsize)))

    def _room_for(self, size: int, buffer: moderngl.Buffer) -> moderngl.Buffer:
        return with_room(self._ctx, buffer, "meshes", size, REMEDY)


class _Upload:
    """A buffer that is filled from its beginning, many small arrays at a time."""

    def __init__(self, buffer: moderngl.Buffer) -> None:
        self.buffer = buffer
        self._offset = self._staged_bytes = 0
        self._staged: list[npt.NDArray[np.generic]] = []

    def append(self, array: npt.NDArray[np.generic]) -> None:
        """Add an array behind what is there."""
        self._staged.append(array)
        self._staged_bytes += array.nbytes
        if self._staged_bytes >= STAGED_BYTES:
            self.flush()

    def flush(self) -> None:
        """Upload what is staged."""
        if self._staged_bytes:
            self.buffer.write(np.concatenate(self._staged), offset=self._offset)
        self._offset += self._staged_bytes
        self._staged, self._staged_bytes = [], 0


def bytes_of(chunks: npt.NDArray[np.void], residual: int | None = None) -> I64:
    """(C,) int64, bytes that pieces take on the GPU."""
    per_vertex = VERTEX_DTYPE.itemsize + (RESIDUAL_BYTES if residual is not None else 0)
    sizes: I64 = per_vertex * chunks["vertex_count"] + INDEX_BYTES * chunks["index_count"]
    return sizes

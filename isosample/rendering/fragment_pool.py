"""The A-buffer's memory: list heads, nodes and counters, grown as a picture needs and never past the budget."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from isosample.gl.buffer_image import BufferImage
from isosample.gl.context import limits
from isosample.gl.memory import with_room
from isosample.rendering.frame import shared_constants, storage_dtype
from isosample.rendering.supplies import storage_bindings
from isosample.tally import POOLS, tally

if TYPE_CHECKING:
    import moderngl

    from isosample.rendering.tiles import Tile

HEAD_BYTES = 4
NODE_STEP = 4096  # nodes by which the pool grows
ROOM = 1.25  # nodes asked for over those that are needed: other views of the scene then find room, too
REMEDY = "Ask for a smaller picture, or give RenderSettings a smaller fragment_budget_bytes."


def step_bytes() -> int:
    """Memory of the nodes by which the pool grows."""
    return NODE_STEP * storage_dtype("Node").itemsize


class FragmentPool:
    """Buffers of the lists of one tile.

    Parameters
    ----------
    ctx : moderngl.Context
    """

    def __init__(self, ctx: moderngl.Context) -> None:
        self._ctx = ctx
        self._block_bytes, self._most_nodes = limits(ctx).storage_block_bytes, limits(ctx).buffer_texels
        self._counters = ctx.buffer(reserve=storage_dtype("Counters").itemsize)
        self._nodes: BufferImage | None = None
        self._heads: moderngl.Buffer | None = None
        self._filling: dict[int, npt.NDArray[np.uint32]] = {}

    def release(self) -> None:
        """Free every buffer."""
        for buffer in (self._counters, self._nodes, self._heads):
            if buffer is not None:
                buffer.release()
        self._nodes = self._heads = None
        self._filling = {}

    def keep_within(self, budget_bytes: int) -> None:
        """Free the nodes if they exceed a budget."""
        if self.size_bytes > budget_bytes:
            self._free_nodes()

    @property
    def max_pixels(self) -> int:
        """Pixels whose list heads fit one storage block."""
        return self._block_bytes // HEAD_BYTES

    @property
    def is_empty(self) -> bool:
        """Whether no memory for nodes was asked for yet."""
        return self._nodes is None

    @property
    def capacity(self) -> int:
        """Nodes that fit."""
        return self.size_bytes // storage_dtype("Node").itemsize

    @property
    def size_bytes(self) -> int:
        """Memory of the nodes."""
        return 0 if self._nodes is None else self._nodes.size_bytes

    @property
    def constants(self) -> dict[str, int]:
        """Of the shaders that append nodes."""
        return {"BEYOND_BLOCK": int(self._nodes is not None and self._nodes.beyond_block)}

    def grow(self, node_count: int, budget_bytes: int) -> bool:
        """Make room for `node_count` nodes and some more, or for as many as the budget and the driver allow.

        Returns
        -------
        fits : bool
            Whether that is all of them.

        Raises
        ------
        CapacityError
            If the driver has no room for what the budget allows.
        """
        largest = min(self._most_nodes // NODE_STEP, budget_bytes // step_bytes())  # steps
        if min(max(node_count, 1), largest * NODE_STEP) > self.capacity:
            self._free_nodes()
            tally(POOLS)
            steps = min(max(-(-int(ROOM * node_count) // NODE_STEP), 1), largest)
            nodes = BufferImage(self._ctx, steps * NODE_STEP, "rgba32ui")
            room = (f"{steps * NODE_STEP} nodes of fragment lists", steps * step_bytes(), REMEDY)
            self._nodes = with_room(self._ctx, nodes, *room)
        return node_count <= largest * NODE_STEP

    def fill(self, budget_bytes: int) -> None:
        """Make room for as many nodes as the budget and the driver allow."""
        self.grow(budget_bytes // storage_dtype("Node").itemsize, budget_bytes)

    def clear_lists(self, tile: Tile) -> None:
        """Empty the list of every pixel of a tile, and set all counters to zero."""
        self._fill_heads(tile, shared_constants()["LIST_END"])
        self._counters.clear()

    def clear_counts(self, tile: Tile) -> None:
        """Set the heads of a tile to zero: they count fragments in the count pass."""
        self._fill_heads(tile, 0)

    def bind(self) -> None:
        """Bind what there is to the storage blocks of the shaders."""
        for name, buffer in (("Heads", self._heads), ("CounterBlock", self._counters)):
            if buffer is not None:
                buffer.bind_to_storage_buffer(storage_bindings()[name])
        if self._nodes is not None:
            self._nodes.bind_image(shared_constants()["BINDING_NODES"])
            self._nodes.bind_storage(storage_bindings()["NodeStore"])

    def heads(self, tile: Tile) -> npt.NDArray[np.uint32]:
        """(height · width,) uint32, the heads (or counts) of a tile, rows counted upwards."""
        assert self._heads is not None
        return np.frombuffer(self._heads.read(size=HEAD_BYTES * tile.pixel_count), dtype=np.uint32)

    def nodes(self) -> npt.NDArray[np.void]:
        """(capacity,) struct Node, all nodes."""
        assert self._nodes is not None
        return np.frombuffer(self._nodes.read(), dtype=storage_dtype("Node"))

    def counters(self) -> np.void:
        """Struct Counters as the passes left it."""
        counters: np.void = np.frombuffer(self._counters.read(), dtype=storage_dtype("Counters"))[0]
        return counters

    def _free_nodes(self) -> None:
        if self._nodes is not None:
            self._nodes.release()
        self._nodes = None

    def _fill_heads(self, tile: Tile, head: int) -> None:
        needed = HEAD_BYTES * tile.pixel_count
        if self._heads is None or self._heads.size < needed:
            if self._heads is not None:
                self._heads.release()
            self._heads = None
            room = (f"the list heads of {tile.pixel_count} pixels", needed, REMEDY)
            self._heads = with_room(self._ctx, self._ctx.buffer(reserve=needed), *room)
        if head not in self._filling or len(self._filling[head]) < tile.pixel_count:
            self._filling[head] = np.full(tile.pixel_count, head, dtype=np.uint32)
        # `clear` with a pattern takes 80 times as long.
        self._heads.write(self._filling[head][: tile.pixel_count])

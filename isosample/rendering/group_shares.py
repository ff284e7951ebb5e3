"""What every work group of a compute shader takes of the meshes, so that one call takes pieces from all over them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from isosample.gl.memory import with_room
from isosample.rendering.frame import storage_dtype
from isosample.rendering.stage import LINE_GROUP, MOST_GROUPS
from isosample.rendering.supplies import storage_bindings

if TYPE_CHECKING:
    from collections.abc import Iterator

    import moderngl

I64 = npt.NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class Call:
    """One call of a shader.

    Attributes
    ----------
    first, groups : int
        Of the shares: the first one, and how many work groups take one each.
    window : tuple of int
        First item that they read, and how many from there on.
    """

    first: int
    groups: int
    window: tuple[int, int]


class GroupShares:
    """Shares of one pass on the GPU, of at most `LINE_GROUP` triangles or vertices each.

    Parameters
    ----------
    ctx : moderngl.Context
    remedy : str
        One sentence: how to render without them, if the driver has no room.
    """

    def __init__(self, ctx: moderngl.Context, remedy: str) -> None:
        self._ctx = ctx
        self._remedy = remedy
        self._buffer: moderngl.Buffer | None = None
        self._asked: tuple[bytes, bytes, bytes, int] | None = None
        self._calls: list[Call] = []

    @property
    def size_bytes(self) -> int:
        """Memory on the GPU."""
        return 0 if self._buffer is None else int(self._buffer.size)

    def fill(self, first: I64, count: I64, level: I64, most_items: int) -> list[Call]:
        """Share out runs of items.

        Parameters
        ----------
        first, count : (R,) int64
            First item of every run, and how many it has.
        level : (R,) int64
        most_items : int
            That one call can read, `LINE_GROUP` at least.

        Returns
        -------
        calls : list of Call
            That take all of them.

        Raises
        ------
        CapacityError
            If the driver has no room.
        """
        asked = (first.tobytes(), count.tobytes(), level.tobytes(), most_items)
        if asked != self._asked:  # frames of an animation often show the same
            self._asked = None  # in case there is no room
            shares = shares_of(first, count, level)
            window = shares["first"] // (most_items - LINE_GROUP + 1)
            if window.any():
                order = np.argsort(window, kind="stable")
                shares, window = shares[order], window[order]
            if len(shares):
                self._write(shares)
            self._calls, self._asked = list(calls_of(shares, window)), asked
        return self._calls

    def bind(self) -> None:
        """Bind the shares."""
        if self._buffer is not None:
            self._buffer.bind_to_storage_buffer(storage_bindings()["Shares"])

    def release(self) -> None:
        """Free the shares."""
        if self._buffer is not None:
            self._buffer.release()
        self._buffer = self._asked = None

    def _write(self, shares: npt.NDArray[np.void]) -> None:
        if self._buffer is None or self._buffer.size < shares.nbytes:
            self.release()
            size = shares.nbytes
            buffer = self._ctx.buffer(reserve=size)
            self._buffer = with_room(self._ctx, buffer, "shares of the meshes", size, self._remedy)
        self._buffer.write(shares)


def shares_of(first: I64, count: I64, level: I64) -> npt.NDArray[np.void]:
    """(G,) struct Share, of runs as `GroupShares.fill` takes them; the last one of a run may be smaller."""
    groups = -(-count // LINE_GROUP)
    run = np.repeat(np.arange(len(groups)), groups)
    before = LINE_GROUP * (np.arange(len(run)) - (np.cumsum(groups) - groups)[run])  # items of the run
    shares = np.empty(len(run), dtype=storage_dtype("Share"))
    shares["first"], shares["level"] = first[run] + before, level[run]
    shares["count"] = np.minimum(count[run] - before, LINE_GROUP)
    return shares


def calls_of(shares: npt.NDArray[np.void], window: npt.NDArray[np.integer]) -> Iterator[Call]:
    """Cut shares, in the order of their windows, into calls."""
    edges = np.flatnonzero(np.diff(window)) + 1
    for start, stop in zip([0, *edges.tolist()], [*edges.tolist(), len(shares)], strict=True):
        for first in range(start, stop, MOST_GROUPS):
            part = shares[first : min(first + MOST_GROUPS, stop)]
            low = int(part["first"].min())
            high = int((part["first"].astype(np.int64) + part["count"]).max())
            yield Call(first, len(part), (low, high - low))

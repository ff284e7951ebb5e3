"""Seconds: of each named stage of a frame by the wall clock, and of a whole frame by the GPU's own clock."""

from __future__ import annotations

import time
from contextlib import contextmanager
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterator

    import moderngl

LONGEST_QUERY_NS = (
    2**32 - 1
)  # what a query holds at most: longer times, and times that go backwards, end there


class StageTimer:
    """Wall time by stage, accumulated over repeated entries.

    Parameters
    ----------
    ctx : moderngl.Context
        Current context.
    synchronous : bool, optional
        Whether the GPU is awaited at both ends of a stage, so that the stage's own work is counted to it.
        Without, a stage counts the time to issue its commands, and whoever waits first pays for all.

    Attributes
    ----------
    seconds : dict of str to float
        Wall time by stage [s], in the order in which the stages were first left.
    """

    def __init__(self, ctx: moderngl.Context, *, synchronous: bool = True) -> None:
        self._ctx = ctx
        self._synchronous = synchronous
        self.seconds: dict[str, float] = {}

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Count the time inside the ``with`` block to a stage, also where the block raises.

        Parameters
        ----------
        name : str
            The stage. Stages may nest; the outer one then includes the inner one.

        Yields
        ------
        None
        """
        self._wait()
        start = time.perf_counter()
        try:
            yield
        finally:
            self._wait()
            self.seconds[name] = self.seconds.get(name, 0.0) + time.perf_counter() - start

    def _wait(self) -> None:
        if self._synchronous:
            self._ctx.finish()


class GpuTimer:
    """Seconds that the GPU took from the first to the last command of a block, by a timer query.

    Parameters
    ----------
    ctx : moderngl.Context
        Current context.

    Notes
    -----
    What the GPU idles in between, because the host reads something back, counts. Blocks of one context do not
    nest: OpenGL has one such query at a time.
    """

    def __init__(self, ctx: moderngl.Context) -> None:
        self._ctx = ctx
        self._query = ctx.query(time=True)

    @contextmanager
    def block(self) -> Iterator[None]:
        """Time the commands issued inside the ``with`` block, and await them.

        Yields
        ------
        None
        """
        with self._query:
            yield
        self._ctx.finish()  # else a software renderer ends the query when it pleases

    def seconds(self) -> float | None:
        """Time of the last block [s]; None where the driver does not tell it.

        Returns
        -------
        seconds : float or None
            None above 4.29 s, where the query's 32 bits end, and where the driver's clock had no start (Mesa's
            software renderer in the first block of a process).
        """
        elapsed = int(self._query.elapsed)
        return None if elapsed >= LONGEST_QUERY_NS else 1e-9 * elapsed

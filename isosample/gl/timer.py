"""Seconds spent in each named stage of a frame."""

from __future__ import annotations

import time
from contextlib import contextmanager
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterator

    import moderngl


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

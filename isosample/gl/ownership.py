"""Who frees what is on the GPU: parts that belong together, also where making one of them fails."""

from __future__ import annotations

from contextlib import ExitStack
from typing import Protocol, TypeVar


class Releasable(Protocol):
    """Anything with memory on the GPU."""

    def release(self) -> object:
        """Free it."""


Part = TypeVar("Part", bound=Releasable)


class Owner(ExitStack):
    """Releases what it keeps, last made first: when it is closed, or where its ``with`` block ends.

    Notes
    -----
    A constructor makes its parts in a ``with`` block and takes them over at its end, with `pop_all`; if it fails
    before, none is left behind.
    """

    def keep(self, part: Part) -> Part:
        """Return the part, which is released with the others."""
        self.callback(part.release)
        return part

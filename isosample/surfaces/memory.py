"""A memory budget: what the process has already, what is left, and who may take how much of it."""

from __future__ import annotations

import contextlib
import threading
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from isosample.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Iterator

DEFAULT_MEMORY = 2 << 30
LEAST_RESIDENT = (
    256 << 20
)  # interpreter, libraries and compiled kernels, some of which are loaded on first use
SLACK = 0.25  # of what is left: allocators hold on to freed blocks
SAMPLES_SHARE = 0.4  # of the rest: windows of samples; the others hold meshes in the making
LEAST_BUDGET = 384 << 20


@dataclass(frozen=True, slots=True, kw_only=True)
class MemoryPlan:
    """How a budget is shared out.

    Attributes
    ----------
    total : int
        Bytes that the whole process may take at its peak.
    sample_bytes : int
        For samples read ahead and being worked on.
    mesh_bytes : int
        For bricks in the making.
    """

    total: int
    sample_bytes: int
    mesh_bytes: int

    @classmethod
    def of(cls, total: int) -> MemoryPlan:
        """Share out what the process does not hold yet.

        Raises
        ------
        InputError
            If the budget is too small for the program itself.
        """
        resident = max(resident_bytes(), LEAST_RESIDENT)
        left = total - resident
        if total < LEAST_BUDGET or left < LEAST_BUDGET - LEAST_RESIDENT:
            raise InputError(
                f"a memory budget of {total >> 20} MiB is too small: the program itself and what it holds already take "
                f"{resident >> 20} MiB. Give at least {(resident + LEAST_BUDGET - LEAST_RESIDENT) >> 20} MiB."
            )
        usable = int(left * (1.0 - SLACK))
        samples = int(usable * SAMPLES_SHARE)
        return cls(total=total, sample_bytes=samples, mesh_bytes=usable - samples)


class Gate:
    """Lets work begin while all work in flight stays within a number of bytes.

    Parameters
    ----------
    budget : int
        [bytes]. Work that needs more on its own is let in alone.
    """

    def __init__(self, budget: int) -> None:
        self._budget = budget
        self._taken = 0
        self._changed = threading.Condition()

    def enter(self, amount: int) -> None:
        """Wait until there is room, and take it."""
        with self._changed:
            self._changed.wait_for(lambda: self._taken == 0 or self._taken + amount <= self._budget)
            self._taken += amount

    def leave(self, amount: int) -> None:
        """Give back what `enter` took."""
        with self._changed:
            self._taken -= amount
            self._changed.notify_all()

    @contextlib.contextmanager
    def leaving(self, amount: int) -> Iterator[None]:
        """Give back at the end of a block."""
        try:
            yield
        finally:
            self.leave(amount)


def resident_bytes() -> int:
    """Return the memory that this process holds now, 0 where the system does not tell."""
    return _state("VmRSS")


def peak_bytes() -> int:
    """Return the most memory that this process ever held, 0 where the system does not tell."""
    return _state("VmHWM")


def _state(name: str) -> int:
    try:
        lines = Path("/proc/self/status").read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        return 0
    return next((int(line.split()[1]) * 1024 for line in lines if line.startswith(f"{name}:")), 0)

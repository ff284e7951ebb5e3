"""Memory that a thread uses again and again: fresh memory costs as much as what is computed in it."""

from __future__ import annotations

import math
import threading
from typing import TypeVar, cast

import numpy as np
import numpy.typing as npt

N = TypeVar("N", bound=np.generic)


class Scratch(threading.local):
    """Arrays of the calling thread, by name, each as large as the largest that was asked for."""

    def __init__(self) -> None:
        self._rooms: dict[str, npt.NDArray[np.uint8]] = {}
        self._last: dict[str, tuple[object, npt.NDArray[np.generic]]] = {}  # as it was asked for last

    def room(self, name: str, shape: int | tuple[int, ...], dtype: type[N]) -> npt.NDArray[N]:
        """Return an array of any content; the one of the same name that was asked for before is lost.

        Where it had the same shape and dtype it is the very same object, with what was left in it: hand on copies,
        and change neither its shape nor its flags.
        """
        asked = (shape, dtype)
        last = self._last.get(name)
        if last is not None and last[0] == asked:
            return cast("npt.NDArray[N]", last[1])
        size = (shape if isinstance(shape, int) else math.prod(shape)) * np.dtype(dtype).itemsize
        kept = self._rooms.get(name)
        if kept is None or kept.size < size:
            kept = self._rooms[name] = np.empty(size, dtype=np.uint8)
        found = kept[:size].view(dtype).reshape(shape)
        self._last[name] = (asked, found)
        return found


SCRATCH = Scratch()

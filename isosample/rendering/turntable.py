"""A turn of the camera about what it looks at, and a log of what its frames cost."""

from __future__ import annotations

import math
import statistics
import time
from contextlib import contextmanager
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from isosample.errors import InputError
from isosample.tally import made_since, made_so_far

if TYPE_CHECKING:
    from collections.abc import Iterator

    from isosample.rendering.camera import Camera

LEAST_FRAMES = 2


def turntable(camera: Camera, count: int) -> list[Camera]:
    """Cameras of a full turn about the target and the `up` of a camera, which is the first of them.

    Parameters
    ----------
    camera : Camera
    count : int
        Cameras, at least 2; they are 360° / `count` apart, the eye turning to the right of the picture.

    Raises
    ------
    InputError
        If `count` is no whole number above 1.
    """
    return [turned(camera, degrees) for degrees in turntable_degrees(count)]


def turntable_degrees(count: object) -> list[float]:
    """Angles of a full turn in `count` equal parts, from 0 on; raises as `turntable`."""
    if isinstance(count, bool) or not isinstance(count, int) or count < LEAST_FRAMES:
        raise InputError(
            f"the number of frames of a turn is {count!r}; expected a whole number, at least {LEAST_FRAMES}."
        )
    return [360.0 * frame / count for frame in range(count)]


def turned(camera: Camera, degrees: float) -> Camera:
    """The camera with its eye turned about the axis through its target along its `up` (right-handed)."""
    if degrees == 0.0:
        return camera
    axis = np.asarray(camera.up) / np.linalg.norm(camera.up)
    away = np.subtract(camera.eye, camera.target)
    angle = math.radians(degrees)
    along = (axis @ away) * axis
    moved = along + math.cos(angle) * (away - along) + math.sin(angle) * np.cross(axis, away)
    x, y, z = (np.asarray(camera.target) + moved).tolist()
    return replace(camera, eye=(x, y, z))


class FrameLog:
    """Seconds of every frame of a film, what was made for the first one, and what was made again after it.

    Begun with the work as a whole: all until the first frame counts as preparation.
    """

    def __init__(self) -> None:
        self._start, self._before = time.perf_counter(), made_so_far()
        self._preparation = 0.0
        self.seconds: list[float] = []
        self.made_once: dict[str, int] = {}
        self._after_first = self._before

    @contextmanager
    def frame(self) -> Iterator[None]:
        """Count what happens inside the ``with`` block as the next frame.

        Yields
        ------
        None
        """
        begun = time.perf_counter()
        if not self.seconds:
            self._preparation = begun - self._start
        yield
        self.seconds.append(time.perf_counter() - begun)
        if len(self.seconds) == 1:
            self.made_once, self._after_first = made_since(self._before), made_so_far()

    @property
    def elapsed(self) -> float:
        """Seconds since the log was begun."""
        return time.perf_counter() - self._start

    @property
    def made_again(self) -> dict[str, int]:
        """What was made after the first frame."""
        return made_since(self._after_first)

    @property
    def median_frame(self) -> float:
        """Seconds of a frame after the first; of the first where it is the only one."""
        return statistics.median(self.seconds[1:] or self.seconds)

    @property
    def preparation(self) -> float:
        """Seconds before the first frame."""
        return self._preparation

    @property
    def per_frame(self) -> float:
        """Seconds of a frame with its share of the preparation; writing files does not count."""
        return (self._preparation + math.fsum(self.seconds)) / len(self.seconds)

    def to_dict(self) -> dict[str, Any]:
        """All of it, JSON-ready."""
        return {
            "frames": len(self.seconds),
            "seconds": {
                "preparation": self.preparation,
                "first_frame": self.seconds[0],
                "median_frame": self.median_frame,
                "amortised_frame": self.per_frame,
                "frames": list(self.seconds),
            },
            "made_once": self.made_once,
            "made_again": self.made_again,
        }

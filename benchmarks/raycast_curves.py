"""Error against time: frames of several methods, interleaved, and what they cost at equal error or equal time."""

from __future__ import annotations

import math
import time
from contextlib import ExitStack
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Protocol, cast

import numpy as np

from isosample.gl.context import shared_context
from isosample.rendering.raycaster import RayCaster

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    import numpy.typing as npt

    from benchmarks.raycast_scenes import RaycastScene
    from isosample.rendering.raycast_settings import RaycastSettings

    F32 = npt.NDArray[np.float32]

SLOW_FRAME, ENOUGH_SLOW_FRAMES = 4.0, 3  # [s]; of slow frames fewer are enough


class Frames(Protocol):
    """One method with its step, ready to render the same frame again and again."""

    def render(self) -> F32:
        """Draw and read back."""
        ...

    def release(self) -> None:
        """Free everything."""
        ...


class CountingFrames(Frames, Protocol):
    """One that tells what it evaluates per ray."""

    samples: float
    root_evaluations: float


class OurFrames:
    """The ray caster of this project."""

    def __init__(self, scene: RaycastScene, size: int, settings: RaycastSettings) -> None:
        self._scene = scene
        self._size = size
        self._context = shared_context()
        with self._context:
            self._caster = RayCaster(scene.volume, scene.transfer_function, raycast=settings)
        self.samples = 0.0
        self.root_evaluations = 0.0
        self.occupied = 1.0

    def render(self) -> F32:
        """Draw and read back; keeps the samples per ray."""
        with self._context:  # another program's context may be current
            image = self._caster.render(camera=self._scene.camera, size=(self._size, self._size))
        self.samples = image.stats["samples_per_ray"]["mean"]
        self.root_evaluations = image.stats["root_evaluations_per_ray"]
        cells = image.stats["macrocells"]
        self.occupied = cells["occupied"] / cells["of"]
        return image.rgba

    def release(self) -> None:
        """Free everything on the GPU."""
        with self._context:
            self._caster.release()


@dataclass
class Point:
    """One step of one method."""

    step: float
    seconds: float  # on the wall
    error: float
    largest_error: float
    processor: float = 0.0  # seconds of all cores
    samples: float = 0.0  # mean samples per ray, as far as the program tells
    root_evaluations: float = 0.0

    @property
    def evaluations(self) -> float:
        """All of the field, per ray."""
        return self.samples + self.root_evaluations


@dataclass
class Curve:
    """A method's points, from coarse steps to fine ones."""

    points: list[Point] = field(default_factory=list)

    def seconds_at_error(self, error: float) -> float | None:
        """Least time with which an error is reached, between the points by straight lines in log-log."""
        return self._at("error", error, "seconds")

    def processor_at_error(self, error: float) -> float | None:
        """Least time of all cores with which an error is reached."""
        return self._at("error", error, "processor")

    def evaluations_at_error(self, error: float) -> float | None:
        """Field evaluations per ray with which an error is reached."""
        return self._at("error", error, "evaluations")

    def error_at_seconds(self, seconds: float) -> float | None:
        """Error that a time gives."""
        return self._at("seconds", seconds, "error")

    def evaluations_at_seconds(self, seconds: float) -> float | None:
        """Field evaluations per ray that a time gives."""
        return self._at("seconds", seconds, "evaluations")

    def reached_by_coarsest(self, error: float) -> bool:
        """Whether already the cheapest point is good enough: the time is then an upper bound."""
        return bool(self.points) and self.points[0].error <= error

    def _at(self, by: str, wanted: float, what: str) -> float | None:
        """`what` where `by` first passes `wanted`, from coarse to fine; the coarsest if it is good enough."""
        keys = [getattr(point, by) for point in self.points]
        values = [getattr(point, what) for point in self.points]
        if by == "error" and self.reached_by_coarsest(wanted):
            return float(values[0])
        for row in range(1, len(keys)):
            before, after = keys[row - 1], keys[row]
            if min(before, after) <= wanted <= max(before, after) and before != after:
                share = np.log(wanted / before) / np.log(after / before)
                return float(np.exp((1 - share) * np.log(values[row - 1]) + share * np.log(values[row])))
        return None


def measure(
    makers: Mapping[str, tuple[Callable[[float], Frames], Sequence[float]]],
    reference: F32,
    *,
    repetitions: int,
    stop_error: float = 0.0,
    stop_processor: float = math.inf,
    slow_frame: float = SLOW_FRAME,
) -> dict[str, Curve]:
    """Curves of methods, each with its steps from coarse to fine.

    The methods of one rank of steps are made together, drawn once for warming up, then drawn in turn. A
    method stops where its error is below `stop_error` or a frame takes more than `stop_processor` seconds of all cores
    together, which other work on the machine changes little. Of frames above `slow_frame` three are enough.
    """

    def done(curve: Curve) -> bool:
        last = curve.points[-1] if curve.points else None
        return last is not None and (last.error <= stop_error or last.processor > stop_processor)

    curves = {name: Curve() for name in makers}
    for rank in range(max(len(steps) for _, steps in makers.values())):
        active = {
            name: steps[rank]
            for name, (_, steps) in makers.items()
            if rank < len(steps) and not done(curves[name])
        }
        with ExitStack() as stack:
            frames: dict[str, Frames] = {}
            for name, step in active.items():
                frames[name] = makers[name][0](step)
                stack.callback(frames[name].release)
            for name, point in _in_turn(frames, active, reference, repetitions, slow_frame).items():
                curves[name].points.append(point)
    return curves


def _in_turn(
    frames: Mapping[str, Frames],
    steps: Mapping[str, float],
    reference: F32,
    repetitions: int,
    slow_frame: float,
) -> dict[str, Point]:
    """Draw the frames in turn, after one that warms up and gives the error."""
    found: dict[str, Point] = {}
    spent: dict[str, list[tuple[float, float]]] = {name: [] for name in frames}
    for name, each in frames.items():
        difference = each.render().astype(np.float64) - reference
        found[name] = Point(
            steps[name], 0.0, float(np.sqrt(np.mean(difference**2))), float(np.abs(difference).max())
        )
        if hasattr(each, "samples"):
            told = cast("CountingFrames", each)
            found[name].samples, found[name].root_evaluations = told.samples, told.root_evaluations
    for turn in range(repetitions):
        for name, each in frames.items():
            if turn >= ENOUGH_SLOW_FRAMES and np.median(spent[name], axis=0)[0] > slow_frame:
                continue
            start, processor = time.perf_counter(), time.process_time()
            each.render()
            spent[name].append((time.perf_counter() - start, time.process_time() - processor))
    for name, point in found.items():
        point.seconds, point.processor = np.median(spent[name], axis=0).tolist()
    return found


def timed_frame(frames: Frames, *, repetitions: int) -> tuple[F32, float]:
    """The picture, and the median time of some frames after the first."""
    picture = frames.render()
    spent = []
    for _ in range(repetitions):
        start = time.perf_counter()
        frames.render()
        spent.append(time.perf_counter() - start)
    return picture, float(np.median(spent))

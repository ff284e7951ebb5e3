"""Frames of several contenders in turn, timed by the wall clock and by the GPU."""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from isosample.gl.context import shared_context
from isosample.gl.timer import GpuTimer

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from isosample.compare.contenders import Contender
    from isosample.rendering.camera import Camera
    from isosample.rendering.image import Image

    Progress = Callable[[str, int, int], None]


@dataclass(slots=True)
class Timing:
    """Frames of one contender, by camera."""

    load_seconds: float = 0.0
    first_seconds: float = 0.0  # the first frame, with what was put off to it
    prepare_seconds: float = 0.0
    images: list[Image] = field(default_factory=list)
    wall: list[list[float]] = field(default_factory=list)
    gpu: list[list[float | None]] = field(default_factory=list)
    stages: list[dict[str, list[float]]] = field(default_factory=list)


def draw_once(one: Contender, cameras: Sequence[Camera]) -> Timing:
    """Load a prepared contender and draw every view; the first frame compiles shaders and uploads what was put off.

    Parameters
    ----------
    one : Contender
        Prepared.
    cameras : sequence of Camera

    Returns
    -------
    timing : Timing
        With the pictures and the seconds of what is done once, and no frame timed yet.
    """
    timing = Timing()
    created = one.load(cameras)
    for camera in cameras:
        start = time.perf_counter()
        timing.images.append(one.frame(camera))
        if len(timing.images) == 1:
            timing.first_seconds = time.perf_counter() - start
    stages = timing.images[0].stats["seconds"]
    timing.prepare_seconds = stages.get("prepare", 0.0) + stages.get("merge", 0.0)
    timing.load_seconds = max(created - timing.prepare_seconds, 0.0)
    timing.wall = [[] for _ in cameras]
    timing.gpu = [[] for _ in cameras]
    timing.stages = [{} for _ in cameras]
    return timing


def time_frames(
    group: Sequence[Contender],
    timings: Sequence[Timing],
    cameras: Sequence[Camera],
    repeat: int,
    report: Progress,
) -> None:
    """Time frames of a group in turn.

    Parameters
    ----------
    group : sequence of Contender
        Loaded.
    timings : sequence of Timing
        Of `draw_once`, in the order of the group; the frames are added.
    cameras : sequence of Camera
    repeat : int
        Timed frames per contender and camera.
    report : callable
        Called with "frames", frames done and frames in all, from 0 on.
    """
    gpu = GpuTimer(shared_context())
    total = len(group) * len(cameras) * repeat
    done = 0
    report("frames", done, total)
    for turn in range(repeat):
        for place, camera in enumerate(cameras):
            for number in _rotated(len(group), turn):
                _time_frame(group[number], timings[number], place, camera, gpu)
                done += 1
                report("frames", done, total)


def _time_frame(one: Contender, timing: Timing, place: int, camera: Camera, gpu: GpuTimer) -> None:
    start = time.perf_counter()
    with gpu.block():
        image = one.frame(camera)
    timing.wall[place].append(time.perf_counter() - start)
    timing.gpu[place].append(gpu.seconds())
    for stage, spent in image.stats["seconds"].items():
        timing.stages[place].setdefault(stage, []).append(spent)


def _rotated(count: int, turn: int) -> list[int]:
    return [(number + turn) % count for number in range(count)]

"""Time against a size: frames of several programs at every size, fitted power laws, and figures of them."""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from isosample.compare import svg

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    import numpy.typing as npt

    from benchmarks.raycast_curves import Frames

    F32 = npt.NDArray[np.float32]

ROW = 19  # height of a line of a figure's legend
SLOW = 1.0  # [s]; of longer frames three are enough
DATA_CENTRIC = "data-centric"


@dataclass
class Course:
    """What one program took at every size."""

    places: list[float] = field(default_factory=list)
    seconds: list[float] = field(default_factory=list)  # on the wall
    processor: list[float] = field(default_factory=list)  # of all cores
    stages: list[dict[str, float]] = field(default_factory=list)  # seconds of build and resolve, where told
    counts: list[tuple[int, int]] = field(default_factory=list)  # fragments and triangles, where told
    differences: list[float] = field(default_factory=list)  # RMSE against the first program's picture


@dataclass(frozen=True, eq=False)
class Sweep:
    """A question: how the time of a frame grows with one size, all else fixed."""

    name: str  # of the figure's file
    title: str
    x_label: str
    fixed: str  # what is fixed, in words
    places: Sequence[float]
    make: Callable[[float], Mapping[str, Callable[[], Frames]]]
    label: Callable[[float], str] = "{:g}".format


def measured(sweep: Sweep, places: Sequence[float], repetitions: int) -> dict[str, Course]:
    """Courses of all programs of a sweep; at every size they are drawn in turn, after a frame that warms up."""
    courses: dict[str, Course] = {}
    for place in places:
        frames: dict[str, Frames] = {}
        try:
            for name, make in sweep.make(place).items():
                frames[name] = make()
            _draw(frames, courses, place, repetitions)
        finally:
            for each in frames.values():
                each.release()
        told = ", ".join(f"{name} {1e3 * course.seconds[-1]:.0f} ms" for name, course in courses.items())
        print(f"  {sweep.title}, {sweep.label(place)}: {told}", flush=True)
    return courses


def _draw(frames: Mapping[str, Frames], courses: dict[str, Course], place: float, repetitions: int) -> None:
    pictures = {name: each.render() for name, each in frames.items()}
    first: F32 = next(iter(pictures.values()))
    spent: dict[str, list[tuple[float, float, float, float]]] = {name: [] for name in frames}
    for turn in range(repetitions):
        for name, each in frames.items():
            if turn >= 3 and np.median(spent[name], axis=0)[0] > SLOW:
                continue
            start, processor = time.perf_counter(), time.process_time()
            each.render()
            taken = time.perf_counter() - start, time.process_time() - processor
            stages = getattr(each, "stats", {}).get("seconds", {})
            spent[name].append((*taken, stages.get("build", 0.0), stages.get("resolve", 0.0)))
    for name, each in frames.items():
        course = courses.setdefault(name, Course())
        seconds, processor, build, resolve = np.median(spent[name], axis=0).tolist()
        course.places.append(place)
        course.seconds.append(seconds)
        course.processor.append(processor)
        course.differences.append(float(np.sqrt(np.mean((pictures[name] - first).astype(np.float64) ** 2))))
        stats = getattr(each, "stats", None)
        if stats is not None:
            course.stages.append({"build": build, "resolve": resolve})
            course.counts.append((stats["fragments"], stats["triangles"]["extracted"]))


def exponent(places: Sequence[float], values: Sequence[float]) -> float:
    """The p of the power law value ∝ place^p with the least squares in log-log."""
    return float(np.polyfit(np.log(places), np.log(values), 1)[0])


def rows(sweep: Sweep, courses: Mapping[str, Course]) -> list[tuple[str, ...]]:
    """One row per program: the times, and exponents over all sizes and over the last two."""
    found = []
    for name, course in courses.items():
        fitted = [exponent(course.places, values) for values in (course.seconds, course.processor)]
        last = exponent(course.places[-2:], course.seconds[-2:])
        stages = [
            f"{exponent(course.places, [one[stage] for one in course.stages]):.2f}" if course.stages else "–"
            for stage in ("build", "resolve")
        ]
        work = [
            f"{counts[0]:,} … {counts[-1]:,}" if counts else "–"
            for counts in ([one[kind] for one in course.counts] for kind in (0, 1))
        ]
        found.append(
            (
                sweep.title,
                name,
                ", ".join(
                    f"{sweep.label(place)}: {1e3 * spent:.0f}"
                    for place, spent in zip(course.places, course.seconds, strict=True)
                ),
                f"{course.seconds[-1] / course.seconds[0]:.2f} ({course.processor[-1] / course.processor[0]:.2f})",
                f"{fitted[0]:.2f} ({fitted[1]:.2f})",
                f"{last:.2f}",
                *stages,
                *work,
                f"{max(course.differences):.1e}" if name.startswith(DATA_CENTRIC) else "–",
            )
        )
    return found


HEADS = (
    "against", "method", "milliseconds", "last / first (of all cores)", "exponent (of all cores)",
    "of the last two sizes", "of build", "of resolve", "fragments", "triangles", "RMSE against the first row's picture",
)  # fmt: skip


def figure(sweep: Sweep, courses: Mapping[str, Course]) -> str:
    """SVG file: times as marks, fitted power laws as lines."""
    places = next(iter(courses.values())).places
    spent = [1e3 * one for course in courses.values() for one in course.seconds]
    x = svg.around(places, start=svg.LEFT, stop=svg.WIDTH - svg.RIGHT)
    y = svg.around(spent, start=svg.HEIGHT - svg.BOTTOM, stop=svg.TOP + ROW * max(0, len(courses) - 2))
    body = svg.frame(x, y, x_label=sweep.x_label, y_label="time of a frame [ms]")
    names = []
    for kind, (name, course) in enumerate(courses.items()):
        power = exponent(course.places, course.seconds)
        offset = float(np.mean(np.log(course.seconds) - power * np.log(course.places)))
        ends = [(place, 1e3 * float(np.exp(offset)) * place**power) for place in (places[0], places[-1])]
        body += svg.line([(x.place(place), y.place(value)) for place, value in ends], f"line s{kind}")
        for place, seconds in zip(course.places, course.seconds, strict=True):
            told = f"{name}, {sweep.label(place)}: {1e3 * seconds:.3g} ms"
            body += svg.point(x.place(place), y.place(1e3 * seconds), kind, told, ringed=False)
        names.append((kind, f"{name}: exponent {power:.2f}"))
    body += _legend([name for _, name in names])
    told = f"Fixed: {sweep.fixed}. " + "; ".join(name for _, name in names) + "."
    return svg.standalone(svg.drawing(body, title=f"Time against {sweep.title}", description=told))


def _legend(names: Sequence[str]) -> str:
    """Marks with what they stand for, one to a row."""
    parts = []
    for kind, name in enumerate(names):
        x, y = svg.LEFT + 8, 14 + ROW * kind
        parts.append(f'<path class="f{kind}" transform="translate({x} {y})" d="{svg.MARKS[kind]}"/>')
        parts.append(svg.text(x + 12, y + 4.5, name, anchor="start"))
    return "".join(parts)

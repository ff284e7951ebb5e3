"""What the methods cost per unit of work, and how often `render --method auto` chooses the cheaper one.

python -m benchmarks.bench_method_choice            fit, and try the choice on other scenes
python -m benchmarks.bench_method_choice --write    the same, and keep the fit in rendering/method_costs.py
"""

from __future__ import annotations

import argparse
import json
import os
import pprint
import sys
import time
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.optimize import nnls

from benchmarks import method_scenes
from benchmarks.machine import describe_machine, table
from isosample.compare.machine import processor
from isosample.defaults import CHOSEN_FROM, DATA_CENTRIC, PEAK_FINDING, PRE_INTEGRATED
from isosample.gl.context import is_software, shared_context
from isosample.rendering import method_costs
from isosample.rendering.cost_estimate import FEATURES, estimate_cost
from isosample.rendering.method_choice import is_sharp, raycast_settings_for
from isosample.rendering.pipeline import Renderer
from isosample.rendering.preparation import prepare_surfaces
from isosample.rendering.quality import Quality, plan_for
from isosample.rendering.raycast_settings import RaycastSettings
from isosample.rendering.raycaster import RayCaster
from isosample.rendering.scene_load import LoadEstimator, SceneLoad
from isosample.rendering.settings import Material, RenderSettings
from isosample.rendering.step_search import step_for_tolerance
from isosample.rendering.tolerance import plan_for_tolerance
from isosample.surfaces.extract import extract_surfaces
from isosample.volume.grid import Volume
from isosample.volume.reconstruction import Reconstruction

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence

    from benchmarks.method_scenes import MethodScene

    Costs = dict[str, dict[str, float]]

FILM = 36
TOLERANCES = (1.0 / 64.0, 1.0 / 255.0)
SIZE, QUICK_SIZE = 512, 256
STAGES = ("prepare", "frame")
LOOKS = {
    "shaded": (RenderSettings(material=Material()), Reconstruction.TRILINEAR),
    "smooth": (RenderSettings(), Reconstruction.CUBIC),
}
UNCHANGED = tuple(
    f"{method} prepare shaded" for method in CHOSEN_FROM
)  # light changes nothing before the frames
ABOUT_EQUAL = 1.1  # times of two methods of which either is a right choice
HEAD_LINES = 5  # of method_costs.py, which stay


@dataclass(frozen=True, slots=True)
class Measured:
    """A scene's load, and the seconds of both stages of every method."""

    name: str
    sharp: bool
    load: SceneLoad
    seconds: dict[str, dict[str, float]]

    @property
    def rays(self) -> str:
        """The method of the ray caster that the choice considers."""
        return PEAK_FINDING if self.sharp else PRE_INTEGRATED

    def total(self, method: str, frames: int) -> float:
        """Seconds of a film."""
        return self.seconds[method]["prepare"] + frames * self.seconds[method]["frame"]


class Clock:
    """Wall seconds, or what the process takes on all processors over their number."""

    def __init__(self, *, processor_time: bool) -> None:
        self._processor_time = processor_time

    def __call__(self) -> float:
        return time.process_time() / (os.cpu_count() or 1) if self._processor_time else time.perf_counter()


def report(*, quick: bool) -> str:
    """Fit and trial as a part of the page of results; nothing is kept."""
    clock = Clock(processor_time=False)
    learnt = measure(method_scenes.learnt_from(), clock, 2 if quick else 5)
    tried = measure(method_scenes.tried_on(QUICK_SIZE if quick else SIZE), clock, 2 if quick else 5)
    costs = fitted(learnt)
    parts = [*trial_tables(costs, tried), against_the_rule(learnt, tried, costs)]
    return "## Choice of the method\n\n" + "\n".join(parts)


# -- measuring ------------------------------------------------------------------------------------


def measure(scenes: Iterable[MethodScene], clock: Clock, repetitions: int) -> list[Measured]:
    """Loads and times of scenes."""
    found = []
    compiled: set[str] = set()
    for scene in scenes:
        if str(scene.volume.array.dtype) not in compiled:
            compile_for(scene)
            compiled.add(str(scene.volume.array.dtype))
        scene.volume.value_range  # noqa: B018  # known to whoever opened a volume
        plan = plan_for(scene.volume, scene.transfer_function, Quality())
        load = load_of(scene, RaycastSettings().step)
        sharp = is_sharp(plan)
        methods = (DATA_CENTRIC, PEAK_FINDING if sharp else PRE_INTEGRATED)
        seconds = {method: timed(scene, method, clock, repetitions) for method in methods}
        found.append(Measured(scene.name, sharp, load, seconds))
        told = ", ".join(f"{m} {s['prepare']:.2f} + {s['frame']:.2f} s" for m, s in seconds.items())
        print(f"  {scene.name}, {scene.size[0]}²: {told}", flush=True)
    return found


def compile_for(scene: MethodScene) -> None:
    """Let numba compile for the dtype of a volume, which it does once for all runs on a machine."""
    corner = Volume(np.ascontiguousarray(scene.volume.array[:9, :9, :9]))
    low, high = scene.volume.value_range
    extract_surfaces(corner, [0.5 * (low + high)])
    prepare_surfaces(scene.volume, scene.transfer_function, Quality(per_slope=0))


def load_of(scene: MethodScene, step: float) -> SceneLoad:
    """The estimate that the choice is made from."""
    estimator = LoadEstimator(scene.volume, scene.transfer_function, Reconstruction.TRILINEAR)
    plan = plan_for(scene.volume, scene.transfer_function, Quality())
    return estimator.load(plan, [scene.camera], scene.size, RenderSettings(), step=step)


def timed(
    scene: MethodScene,
    method: str,
    clock: Clock,
    repetitions: int,
    look: tuple[RenderSettings, Reconstruction] = (RenderSettings(), Reconstruction.TRILINEAR),
) -> dict[str, float]:
    """Seconds of the preparation, with what the first frame takes longer than others, and the median of these."""
    settings, reconstruction = look
    start = clock()
    renderer: Renderer | RayCaster
    if method == DATA_CENTRIC:
        quality = Quality(reconstruction=reconstruction)
        surfaces, plan, _, _ = prepare_surfaces(scene.volume, scene.transfer_function, quality)
        renderer = Renderer(surfaces, plan)
    else:
        own = raycast_settings_for(method, RaycastSettings(reconstruction=reconstruction))
        renderer = RayCaster(scene.volume, scene.transfer_function, raycast=own)
    draw: Callable[[], object] = partial(
        renderer.render, camera=scene.camera, size=scene.size, settings=settings
    )
    made = clock() - start
    begun = clock()
    draw()
    first = clock() - begun
    frames = []
    for _ in range(repetitions):
        begun = clock()
        draw()
        frames.append(clock() - begun)
    renderer.release()
    frame = float(np.median(frames))
    return {"prepare": made + max(first - frame, 0.0), "frame": frame}


def factors(clock: Clock, repetitions: int) -> dict[str, float]:
    """How many times longer stages take with light and with a smooth reconstruction, 1 at least.

    Geometric means over three scenes, and over both methods of the ray caster for what they prepare alike.
    """
    ratios: dict[str, list[float]] = {}
    for scene in list(method_scenes.learnt_from())[1:10:4]:
        for method in CHOSEN_FROM:
            plain = timed(scene, method, clock, repetitions)
            for word, look in LOOKS.items():
                changed = timed(scene, method, clock, repetitions, look)
                for stage in STAGES:
                    ratios.setdefault(f"{method} {stage} {word}", []).append(changed[stage] / plain[stage])
    together = ratios[f"{PRE_INTEGRATED} prepare smooth"] + ratios[f"{PEAK_FINDING} prepare smooth"]
    ratios |= {f"{method} prepare smooth": together for method in (PRE_INTEGRATED, PEAK_FINDING)}
    means = {name: float(np.exp(np.mean(np.log(values)))) for name, values in ratios.items()}
    return {name: float(f"{max(mean, 1.0):.3g}") for name, mean in means.items() if name not in UNCHANGED}


def tolerances(clock: Clock) -> list[dict[str, float]]:
    """What tolerances take, as geometric means over scenes; minutes."""
    rows = []
    first = next(method_scenes.learnt_from())
    plan_for_tolerance(first.volume, first.transfer_function, 0.1)  # compiles what is compiled once
    for tolerance in TOLERANCES:
        needs: dict[str, list[float]] = {}
        for scene in list(method_scenes.learnt_from())[:2]:
            plain = prepare_surfaces(scene.volume, scene.transfer_function, Quality())
            own = raycast_settings_for(PEAK_FINDING if is_sharp(plain.plan) else PRE_INTEGRATED)
            start = clock()
            step = step_for_tolerance(scene.volume, scene.transfer_function, tolerance, raycast=own)
            middle = clock()
            found = plan_for_tolerance(scene.volume, scene.transfer_function, tolerance)
            end = clock()
            triangles = [sum(one.statistics.triangles) for one in (found.surfaces, plain.surfaces)]
            row = {
                "isovalues": len(found.plan.isovalues) / len(plain.plan.isovalues),
                "triangles": triangles[0] / triangles[1],
                "step": step.step,
                "surface_search": end - middle,
                "ray_search": middle - start,
            }
            print(f"  {scene.name}, {tolerance:.2g}: {row}", flush=True)
            for name, number in row.items():
                needs.setdefault(name, []).append(number)
        means = {name: float(f"{np.exp(np.mean(np.log(n))):.3g}") for name, n in needs.items()}
        rows.append({"tolerance": tolerance, **means})
    return rows


# -- fitting --------------------------------------------------------------------------------------


def fitted(measured: list[Measured]) -> Costs:
    """Seconds per unit of work, none negative, with the least sum of squares of relative errors.

    The ray caster prepares the same for both of its methods: these are fitted together.
    """
    costs: Costs = {}
    for name, features in FEATURES.items():
        method, stage = name.rsplit(" ", 1)
        of = [
            m for m in CHOSEN_FROM if m == method or (stage == "prepare" and DATA_CENTRIC not in (m, method))
        ]
        rows = [(one.load, one.seconds[m][stage]) for one in measured for m in of if m in one.seconds]
        seconds = np.array([spent for _, spent in rows])
        amounts = np.array(
            [[1.0 if f == "start" else getattr(load, f) for f in features] for load, _ in rows]
        )
        scale = np.maximum(amounts.max(axis=0), 1e-30)
        found, _ = nnls(amounts / scale / seconds[:, None], np.ones(len(rows)))
        costs[name] = {f: float(f"{c:.4g}") for f, c in zip(features, found / scale, strict=True)}
    return costs | {"factors": {}}


def write(costs: Costs, measured: str, tolerated: list[dict[str, float]]) -> None:
    """Keep a fit in the package."""
    path = Path(method_costs.__file__)
    body = "\\\n" + pprint.pformat(costs, width=100, sort_dicts=False)
    head = "".join(path.read_text(encoding="utf-8").splitlines(keepends=True)[:HEAD_LINES])
    path.write_text(
        f"{head}SOFTWARE: dict[str, dict[str, float]] = {body}\nSOFTWARE_MEASURED = {measured!r}\n"
        f"TOLERANCES: list[dict[str, float]] = {pprint.pformat(tolerated, width=100, sort_dicts=False)}\n# fmt: on\n",
        encoding="utf-8",
    )
    print(f"written to {path}")


# -- trying ---------------------------------------------------------------------------------------


def trial_tables(costs: Mapping[str, Mapping[str, float]], tried: list[Measured]) -> Iterator[str]:
    """Every scene's times and estimates, and how often the choice is right."""
    rows, right, regrets = [], {1: 0, FILM: 0}, []
    for one in tried:
        methods = (DATA_CENTRIC, one.rays)
        cells = []
        for method in methods:
            guess = estimate_cost(method, one.load, costs)
            seconds = one.seconds[method]
            cells += [
                f"{seconds['prepare']:.2f} + {seconds['frame']:.2f} s",
                f"{guess.prepare_seconds:.2f} + {guess.frame_seconds:.2f} s",
            ]
        for frames in right:
            times = {method: one.total(method, frames) for method in methods}
            chosen = min(
                methods, key=lambda m: estimate_cost(m, one.load, costs, frames=frames).total_seconds
            )
            regret = times[chosen] / min(times.values())
            regrets.append(regret)
            right[frames] += regret <= ABOUT_EQUAL
            cells.append(chosen + ("" if regret <= ABOUT_EQUAL else f" (wrong, {regret:.2f} times)"))
        rows.append((one.name, one.rays, *cells))
    heads = (
        "scene",
        "ray caster",
        "data-centric, measured",
        "estimated",
        "ray caster, measured",
        "estimated",
    )
    yield table((*heads, "chosen for 1 frame", f"chosen for {FILM} frames"), rows)
    yield (
        f"The cheaper method (or one within {ABOUT_EQUAL - 1:.0%} of it) is chosen in {right[1]} of {len(tried)} "
        f"scenes for one frame and in {right[FILM]} of {len(tried)} for {FILM} frames; the chosen one takes "
        f"{np.mean(regrets):.2f} times the time of the cheaper one in the mean, {max(regrets):.2f} times at most.\n"
    )


def hits(pairs: Sequence[tuple[Measured, Mapping[str, Mapping[str, float]]]], frames: int) -> tuple[int, int]:
    """How often the estimate is right, and a rule without one: surfaces for sharp transfer functions, else rays."""
    estimated = ruled = 0
    for one, costs in pairs:
        methods = (DATA_CENTRIC, one.rays)
        times = {method: one.total(method, frames) for method in methods}
        allowed = ABOUT_EQUAL * min(times.values())
        guesses = [estimate_cost(method, one.load, costs, frames=frames).total_seconds for method in methods]
        estimated += times[methods[int(np.argmin(guesses))]] <= allowed
        ruled += times[DATA_CENTRIC if one.sharp else one.rays] <= allowed
    return estimated, ruled


def against_the_rule(learnt: list[Measured], tried: list[Measured], costs: Costs) -> str:
    """The estimate beside the rule, on the scenes that are tried and on those learnt from, each left out in turn."""
    left_out = [
        (one, fitted([other for other in learnt if other is not one]) | {"factors": {}}) for one in learnt
    ]
    groups = {
        "other scenes": [(one, costs) for one in tried],
        "scenes learnt from, each left out of the fit in turn": left_out,
    }
    rows = [
        (
            name,
            frames,
            f"{hits(pairs, frames)[0]} of {len(pairs)}",
            f"{hits(pairs, frames)[1]} of {len(pairs)}",
        )
        for name, pairs in groups.items()
        for frames in (1, FILM)
    ]
    return table(("scenes", "frames", "estimate right", "surfaces if sharp, else rays: right"), rows)


def _keep(path: Path, parts: Mapping[str, Any]) -> None:
    path.write_text(json.dumps(parts), encoding="utf-8")


def _kept(rows: list[dict[str, Any]], scenes: Iterable[MethodScene]) -> list[Measured]:
    """Kept times with the loads as they are estimated now."""
    found = []
    for row, scene in zip(rows, scenes, strict=True):
        if row["name"] != scene.name:
            sys.exit(
                f"the kept times are those of {row['name']}, and the scene is {scene.name}; measure anew"
            )
        found.append(
            Measured(row["name"], row["sharp"], load_of(scene, RaycastSettings().step), row["seconds"])
        )
    return found


def main() -> None:
    """Run this benchmark alone."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.bench_method_choice", description=__doc__)
    parser.add_argument("--quick", action="store_true", help="small pictures and few repetitions")
    parser.add_argument("--write", action="store_true", help="keep the fit in rendering/method_costs.py")
    parser.add_argument(
        "--processor-time", action="store_true", help="time of the process over the cores: for a busy machine"
    )
    parser.add_argument(
        "--measurements", type=Path, help="JSON file to keep the times in, or to take them from"
    )
    parser.add_argument(
        "--tolerances",
        action="store_true",
        help="measure anew what tolerances take (minutes; default: as kept)",
    )
    arguments = parser.parse_args()
    clock = Clock(processor_time=arguments.processor_time)
    repetitions, size = (2, QUICK_SIZE) if arguments.quick else (5, SIZE)
    print(describe_machine())
    if arguments.measurements and arguments.measurements.exists():
        kept = json.loads(arguments.measurements.read_text(encoding="utf-8"))
    else:
        timed(next(method_scenes.learnt_from()), DATA_CENTRIC, clock, 1)  # compiles what is compiled once
        kept = {
            "learnt": [asdict(one) for one in measure(method_scenes.learnt_from(), clock, repetitions)],
            "factors": factors(clock, repetitions),
            "tried": [
                asdict(one)
                for one in measure(
                    method_scenes.tried_on(QUICK_SIZE if arguments.quick else SIZE), clock, repetitions
                )
            ],
        }
        if arguments.measurements:
            _keep(arguments.measurements, kept)
    learnt = _kept(kept["learnt"], method_scenes.learnt_from())
    tried = _kept(kept["tried"], method_scenes.tried_on(size))
    costs = fitted(learnt) | {"factors": kept["factors"]}
    print(pprint.pformat(costs, width=110, sort_dicts=False))
    for text in trial_tables(costs, tried):
        print(text)
    print(against_the_rule(learnt, tried, costs))
    tolerated = tolerances(clock) if arguments.tolerances else method_costs.TOLERANCES
    if arguments.write:
        if not is_software(shared_context()):
            parser.error("this renderer is no software renderer, and only that one's costs are kept")
        name = shared_context().info["GL_RENDERER"]
        when = f"{datetime.now(tz=UTC):%Y-%m-%d}, {name}, {processor()}, {os.cpu_count()} cores"
        write(costs, when + (", processor time" if arguments.processor_time else ""), tolerated)


if __name__ == "__main__":
    main()

"""What a comparison runs: every method over a sweep of its quality, in turn, against the reference."""

from __future__ import annotations

from contextlib import ExitStack, closing
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from isosample.compare.contenders import SAMPLE_BYTES, ComparedScene, Setting, contender, cost_of
from isosample.compare.conventions import (
    backdrop_of,
    describe_conventions,
    describe_scene,
    grain_band_of,
    shown_share,
)
from isosample.compare.frames import Timing, draw_once, time_frames
from isosample.compare.machine import describe_machine
from isosample.compare.metrics import Pixels, summarise
from isosample.compare.results import Entry, Results, View, median_of_told
from isosample.compare.sweep import Sweep
from isosample.compare.verdict import TARGETS
from isosample.compare.warm_up import warm_up
from isosample.defaults import DEFAULT_REPEAT
from isosample.errors import InputError
from isosample.rendering.reference_image import render_reference

if TYPE_CHECKING:
    from collections.abc import Callable, Generator, Iterator, Sequence

    from isosample.compare.contenders import Contender
    from isosample.rendering.camera import Camera
    from isosample.rendering.image import Image

    F32 = npt.NDArray[np.float32]
    Progress = Callable[[str, int, int], None]

DEFAULT_BUDGET_BYTES = 4 << 30  # of what is loaded at once, and the pictures
PIXEL_BYTES = 16  # of a picture


@dataclass(frozen=True, slots=True, kw_only=True)
class Experiment:
    """A comparison to be run.

    Attributes
    ----------
    scene : ComparedScene
    sweep : Sweep
    cameras : tuple of Camera
    repeat : int
        Timed frames per entry and camera, after one that is not timed.
    budget_bytes : int
        Contenders that together hold more (meshes and fragments, or the volume), beside the pictures of all entries,
        are measured one group after the other.
    targets : tuple of float
        RMSE of the verdict.

    Raises
    ------
    InputError
        If there is no camera or no frame.
    """

    scene: ComparedScene
    cameras: tuple[Camera, ...]
    sweep: Sweep = field(default_factory=Sweep)
    repeat: int = DEFAULT_REPEAT
    budget_bytes: int = DEFAULT_BUDGET_BYTES
    targets: tuple[float, ...] = TARGETS

    def __post_init__(self) -> None:
        if not self.cameras:
            raise InputError("cameras is empty; give at least one camera.")
        if self.repeat < 1:
            raise InputError(f"repeat {self.repeat!r} must be a whole number >= 1.")


@dataclass(frozen=True, slots=True, eq=False)
class Outcome:
    """What an experiment gave.

    Attributes
    ----------
    results : Results
    references : tuple of (H, W, 4) float32
        By camera; premultiplied linear RGBA.
    pictures : dict of str to tuple of (H, W, 4) float32
        By name of the entry, then by camera.
    """

    results: Results
    references: tuple[F32, ...]
    pictures: dict[str, tuple[F32, ...]]


def run_experiment(experiment: Experiment, progress: Progress | None = None) -> Outcome:
    """Render, time and judge every method.

    Parameters
    ----------
    experiment : Experiment
    progress : callable, optional
        Called with the stage ("reference", "warm up", "prepare", "frames", "judge"), steps done and steps in all; first
        of all when a stage begins, with none done.

    Returns
    -------
    outcome : Outcome

    Raises
    ------
    InputError, CapacityError, OpenGLError
        As the renderers and the measures.
    MissingDependencyError
        If a measure's package is not installed.

    Notes
    -----
    The methods share volume, transfer function, camera, size, background, clip planes and reconstruction. All
    contenders that fit `budget_bytes` together are loaded and have drawn every view once before a frame of them is
    timed; then each draws one frame after the other, in an order that rotates from round to round, so that what slows
    the machine down for a while hits all alike.
    """
    report = progress or (lambda _stage, _done, _total: None)
    truths = list(_references(experiment, report))
    warm_up(experiment.scene, experiment.sweep, report)
    entries: dict[str, Entry] = {}
    pictures: dict[str, tuple[F32, ...]] = {}
    by_method = experiment.sweep.settings(experiment.scene.raycast.sampling)
    count = sum(map(len, by_method))
    with closing(_groups(experiment, by_method, report)) as groups:
        for group, timings in groups:
            time_frames(group, timings, experiment.cameras, experiment.repeat, report)
            report("judge", len(entries), count)
            for one, timing in zip(group, timings, strict=True):
                entry = _entry(one, timing, experiment, [truth.rgba for truth in truths])
                entries[entry.name] = entry
                pictures[entry.name] = tuple(image.rgba for image in timing.images)
                report("judge", len(entries), count)
    ordered = tuple(entries[setting.name] for settings in by_method for setting in settings)
    results = Results(
        scene=describe_scene(experiment.scene),
        settings=describe_conventions(experiment.scene, experiment.cameras)
        | {
            "repeat": experiment.repeat,
            "methods": list(experiment.sweep.methods),
            "targets": list(experiment.targets),
        },
        machine=describe_machine(),
        reference={
            "seconds": [truth.stats["seconds"]["render"] for truth in truths],
            "cells_visited": [truth.stats["cells_visited"] for truth in truths],
            "renderer": truths[0].stats["renderer"],
            "shown_share": [shown_share(truth.rgba, experiment.scene.render) for truth in truths],
        },
        entries=ordered,
    )
    return Outcome(results, tuple(truth.rgba for truth in truths), pictures)


# -- parts of a run -------------------------------------------------------------------------------


def _references(experiment: Experiment, report: Progress) -> Iterator[Image]:
    """The truth of every camera."""
    scene, total = experiment.scene, len(experiment.cameras)
    pixels = scene.size[0] * scene.size[1]
    report("reference", 0, total * pixels)
    for number, camera in enumerate(experiment.cameras):
        yield render_reference(
            scene.volume,
            scene.transfer_function,
            camera=camera,
            size=scene.size,
            settings=scene.render,
            reconstruction=scene.raycast.reconstruction,
            nan_masked=scene.nan_masked,
            progress=lambda _, done, of, before=number: report(  # type: ignore[misc]  # a default, not a parameter
                "reference", before * pixels + done * pixels // max(of, 1), total * pixels
            ),
        )


def _groups(
    experiment: Experiment, by_method: list[list[Setting]], report: Progress
) -> Generator[tuple[list[Contender], list[Timing]]]:
    """Loaded contenders that have drawn every view, as many at a time as fit the budget; freed when asked for the next.

    Each group holds neighbours in quality.
    """
    most = max(map(len, by_method))
    ranked = [settings[rank] for rank in range(most) for settings in by_method if rank < len(settings)]
    report("prepare", 0, len(ranked))
    width, height = experiment.scene.size
    pictures = (
        PIXEL_BYTES * width * height * len(experiment.cameras) * (1 + len(ranked))
    )  # with the references
    with ExitStack() as loaded:
        group: list[Contender] = []
        timings: list[Timing] = []
        for number, setting in enumerate(ranked):
            one = contender(experiment.scene, setting)
            one.prepare()
            if group and pictures + sum(other.bytes for other in [one, *group]) > experiment.budget_bytes:
                yield group, timings
                loaded.close()
                group, timings = [], []
            loaded.callback(one.release)
            group.append(one)
            timings.append(draw_once(one, experiment.cameras))
            report("prepare", number + 1, len(ranked))
        yield group, timings


def _entry(one: Contender, timing: Timing, experiment: Experiment, truths: Sequence[F32]) -> Entry:
    """Judge the pictures of one contender, and sum up its frames."""
    late = max(timing.first_seconds - float(np.median(timing.wall[0])), 0.0)
    views = [_view(place, timing, experiment, truths[place]) for place in range(len(experiment.cameras))]
    return Entry(
        setting=one.setting,
        precompute_seconds=one.precompute_seconds,
        prepare_seconds=timing.prepare_seconds,
        load_seconds=timing.load_seconds + late,
        views=tuple(views),
    )


def _view(place: int, timing: Timing, experiment: Experiment, truth: F32) -> View:
    scene, image = experiment.scene, timing.images[place]
    errors = summarise(
        image.rgba,
        truth,
        background=backdrop_of(scene.render.background),
        pixels=Pixels.ALL,
        grain_band=grain_band_of(experiment.cameras[place], scene.size, scene.volume),
        with_flip=True,
    )
    return View(
        wall_seconds=tuple(timing.wall[place]),
        gpu_seconds=tuple(timing.gpu[place]),
        stage_seconds={stage: median_of_told(spent) or 0.0 for stage, spent in timing.stages[place].items()},
        errors=errors,
        cost=cost_of(image.stats, SAMPLE_BYTES * scene.volume.array.size),
    )

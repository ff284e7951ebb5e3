"""A comparison that takes seconds: a blob, two cameras, two settings per method."""

from __future__ import annotations

import numpy as np

import isosample
from isosample.compare.contenders import ComparedScene
from isosample.compare.experiment import DEFAULT_BUDGET_BYTES, Experiment
from isosample.compare.sweep import Sweep
from isosample.defaults import COMPARED_METHODS

SIZE = (36, 24)
REPEAT = 3
STEPS, PER_SLOPES = (2.0, 0.5), (1, 4)


def blob() -> isosample.Volume:
    """A lopsided hill of values between 0 and 100."""
    z, y, x = np.mgrid[-1:1:14j, -1:1:13j, -1:1:12j]
    samples = 100.0 * np.exp(-2.0 * (x * x + y * y + z * z)) * (1.0 + 0.2 * np.sin(5.0 * x))
    return isosample.Volume(samples.astype(np.float32), name="blob.npy")


def blob_scene() -> ComparedScene:
    """The blob under two tents and an isosurface, cut by a plane."""
    red, green, blue = (1.0, 0.2, 0.1), (0.1, 0.8, 0.3), (0.2, 0.3, 1.0)
    rows = [
        (15, red, 0.0),
        (30, red, 0.4),
        (45, green, 0.0),
        (60, blue, 0.0),
        (75, blue, 1.0),
        (90, blue, 0.0),
    ]
    function = isosample.TransferFunction(
        [isosample.ControlPoint(*row) for row in rows], [isosample.Isosurface(52.0, green, 0.3)]
    )
    render = isosample.RenderSettings(clip_planes=(isosample.ClipPlane(0.0, 1.0, 0.0, -3.3),))
    return ComparedScene(volume=blob(), transfer_function=function, size=SIZE, render=render)


CAMERAS = tuple(
    isosample.Camera.orbit(blob().box, azimuth=azimuth, elevation=20.0, aspect=1.5, zoom=1.4)
    for azimuth in (30.0, 210.0)
)


def small_experiment(
    *, budget_bytes: int = DEFAULT_BUDGET_BYTES, methods: tuple[str, ...] = COMPARED_METHODS
) -> Experiment:
    """The comparison of all methods."""
    sweep = Sweep(methods=methods, steps=STEPS, per_slopes=PER_SLOPES, tolerances=())
    return Experiment(
        scene=blob_scene(), cameras=CAMERAS, sweep=sweep, repeat=REPEAT, budget_bytes=budget_bytes
    )

"""Scenes that the cost of the methods is learnt from, and others on which the choice between them is tried."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from benchmarks import accuracy_scenes, raycast_scenes
from isosample.rendering.camera import Camera
from isosample.transfer.control_points import Isosurface
from isosample.transfer.transfer_function import TransferFunction
from isosample.volume.grid import Volume

if TYPE_CHECKING:
    from collections.abc import Iterator

    from benchmarks.accuracy_scenes import AccuracyScene

NOISE = 0.03  # of the range
TENTS, WIDE, DIRAC, BOX, RAMP = accuracy_scenes.SHAPES
LOOKS = (
    *((shape, "translucent") for shape in accuracy_scenes.SHAPES),
    (RAMP, "opaque"),
    ("8 isosurfaces", ""),
    ("32 isosurfaces", ""),
)
SIZES, ZOOMS = (128, 256, 384), (1.0, 1.5, 2.5)


@dataclass(frozen=True, eq=False)
class MethodScene:
    """A volume, a transfer function, a camera and a size of the picture."""

    name: str
    volume: Volume
    transfer_function: TransferFunction
    camera: Camera
    size: tuple[int, int]


def learnt_from() -> Iterator[MethodScene]:
    """Closed-form fields, clean and noisy, with half of all pairs of field and transfer function."""
    fields = [
        accuracy_scenes.nucleon(48),
        accuracy_scenes.nucleon(96),
        accuracy_scenes.nucleon(160),
        accuracy_scenes.shell(64),
        accuracy_scenes.marschner_lobb(64),
        noisy(accuracy_scenes.nucleon(72)),
    ]
    views = itertools.product(ZOOMS, SIZES)
    pairs = [(i, j) for i in range(len(fields)) for j in range(len(LOOKS)) if (i + j) % 2 == 0]
    for (i, j), (zoom, size) in zip(pairs, itertools.cycle(views), strict=False):
        scene = fields[i]
        camera = Camera.orbit(scene.volume.box, azimuth=31, elevation=23, zoom=zoom)
        name = f"{scene.name}, {' '.join(LOOKS[j])}"
        yield MethodScene(name, scene.volume, look(scene, *LOOKS[j]), camera, (size, size))


def tried_on(size: int) -> Iterator[MethodScene]:
    """Scenes of other grids and transfer functions, and scans where their folder is."""
    nucleon, shell = accuracy_scenes.nucleon(128), accuracy_scenes.shell(112)
    ripples = accuracy_scenes.marschner_lobb(81)
    own: list[tuple[AccuracyScene, str, str]] = [
        (nucleon, TENTS, "translucent"),
        (nucleon, WIDE, "opaque"),
        (nucleon, DIRAC, "translucent"),
        (nucleon, "26 isosurfaces", ""),
        (shell, BOX, "opaque"),
        (ripples, TENTS, "translucent"),
        (noisy(nucleon), RAMP, "translucent"),
    ]
    own += [(scan, TENTS if "MR" in scan.name else DIRAC, "translucent") for scan in accuracy_scenes.scans()]
    for scene, shape, opacity in own:
        name = f"{scene.name}, {shape} {opacity}".rstrip()
        yield MethodScene(name, scene.volume, look(scene, shape, opacity), scene.camera, (size, size))
    for found in (raycast_scenes.ramp_impulses(64), *raycast_scenes.scans()):
        yield MethodScene(found.name, found.volume, found.transfer_function, found.camera, (size, size))


def look(scene: AccuracyScene, shape: str, opacity: str) -> TransferFunction:
    """One of the transfer functions of `accuracy_scenes`, or so many isosurfaces."""
    if shape in accuracy_scenes.SHAPES:
        return scene.transfer_function(shape, opacity)
    count = int(shape.split()[0])
    shares = (np.arange(count) + 0.5) / count
    surfaces = [
        Isosurface(float(scene.low + (scene.high - scene.low) * share), (float(share), 0.5, 0.2), 0.05)
        for share in shares
    ]
    return TransferFunction([], isosurfaces=surfaces)


def noisy(scene: AccuracyScene) -> AccuracyScene:
    """The same with Gaussian noise at every sample."""
    noise = np.random.default_rng(7).normal(0.0, NOISE * (scene.high - scene.low), scene.volume.array.shape)
    samples = (scene.volume.array.astype(np.float64) + noise).astype(np.float32)
    volume = Volume(samples, spacing=scene.volume.spacing, origin=scene.volume.origin, name="noisy")
    return accuracy_scenes.AccuracyScene(f"{scene.name} with noise", volume, None, scene.low, scene.high)

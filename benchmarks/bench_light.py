"""Pictures with light: errors against the float64 reference by the number and the places of the isovalues."""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from benchmarks.accuracy_scenes import SCANS
from benchmarks.machine import describe_machine, table
from isosample.rendering.camera import Camera, UpAxis
from isosample.rendering.pipeline import render_surfaces
from isosample.rendering.raycast_settings import Classification, Crossings, PeakWeight, RaycastSettings
from isosample.rendering.raycaster import raycast
from isosample.rendering.reference_image import render_reference
from isosample.rendering.settings import Material, RenderSettings
from isosample.surfaces.extract import extract_surfaces
from isosample.transfer.isovalues import plan_isovalues
from isosample.transfer.transfer_function import TransferFunction
from isosample.volume.readers import open_volume

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    import numpy.typing as npt

    from isosample.volume.grid import F64, Volume

    F32 = npt.NDArray[np.float32]

PIXELS = 200
STEPS = (1 / 2, 1 / 8)  # of the ray casters [voxel]
RAY_CASTERS = (Classification.PRE_INTEGRATED, Classification.PEAK_FINDING)
LIT = RenderSettings(material=Material(), background=(0.0, 0.0, 0.0, 1.0))


@dataclass(frozen=True)
class LitScene:
    """A scan with the transfer function that its histogram suggests, which ends in a plateau, and a view."""

    name: str
    file: str
    view: dict[str, Any]


SCENES = (
    LitScene("nucleon", "nucleon.nhdr", {"azimuth": 30, "elevation": 20}),
    LitScene("head_ct", "head_ct.nii.gz", {"azimuth": 35, "elevation": 8, "zoom": 1.5, "up_axis": UpAxis.Z}),
)


def inside_plateaus(
    volume: Volume, tf: TransferFunction, place: Callable[[F64, F64], F64], count: int
) -> list[float]:
    """Values inside the constant slopes; `place` puts them by shares of the samples there, (N,) ascending."""
    samples = np.sort(np.asarray(volume.array, dtype=np.float64), axis=None)
    shares = np.arange(1, count + 1) / (count + 1)
    values: list[float] = []
    for slope in tf.slopes():
        if slope.visible and slope.constant:
            first, last = np.searchsorted(samples, [slope.low.value, slope.high.value])
            values += place(samples[first:last], shares).tolist()
    return values


def evenly(samples: F64, shares: F64) -> F64:
    """Spaced evenly from the least to the largest."""
    found: F64 = samples[0] + shares * (samples[-1] - samples[0])
    return found


def by_share(samples: F64, shares: F64) -> F64:
    """So that equally many samples are between any two."""
    found: F64 = np.quantile(samples, shares)
    return found


def half_and_half(samples: F64, shares: F64) -> F64:
    """By the mean of both distributions."""
    values = np.linspace(samples[0], samples[-1], 4001)
    below = np.searchsorted(samples, values) / len(samples)
    found: F64 = np.interp(shares, 0.5 * below + 0.5 * np.linspace(0.0, 1.0, 4001), values)
    return found


RULES = {"none": None, "even": evenly, "by share of the samples": by_share, "half and half": half_and_half}


def measured(scene: LitScene, counts: Sequence[int], rules: Sequence[str]) -> list[tuple[str, ...]]:
    """Rows of the table."""
    volume = open_volume(SCANS / scene.file)
    tf = TransferFunction.suggest(volume)
    view: dict[str, Any] = {
        "camera": Camera.orbit(volume.box, **scene.view),
        "size": (PIXELS, PIXELS),
        "settings": LIT,
    }
    truth = render_reference(volume, tf, **view).rgba
    rows: list[tuple[str, ...]] = []
    for classification in RAY_CASTERS:
        for step in STEPS:
            chosen = RaycastSettings(
                classification=classification,
                step=step,
                crossings=Crossings.EXACT,
                peak_weight=PeakWeight.INTEGRAL,
            )
            found = raycast(volume, tf, raycast=chosen, **view).rgba
            name = f"{classification.value}, step 1/{round(1 / step)}"
            rows.append((scene.name, name, "", "", *_errors(found, truth)))
            print(*rows[-1], sep=" | ", flush=True)
    for name in rules:
        for count in counts:
            place = RULES[name]
            extra = [] if place is None else inside_plateaus(volume, tf, place, count)
            plan = plan_isovalues(tf, volume.value_range, per_slope=count, extra=extra)
            surfaces = extract_surfaces(volume, plan.isovalues)
            picture = render_surfaces(surfaces, plan, **view)
            triangles = f"{sum(surfaces.statistics.triangles) / 1e6:.2f} million"
            rows.append((scene.name, name, f"{count}", triangles, *_errors(picture.rgba, truth)))
            print(*rows[-1], sep=" | ", flush=True)
    return rows


def _errors(found: F32, truth: F32) -> tuple[str, str, str]:
    difference = np.abs(found[..., :3].astype(np.float64) - truth[..., :3])
    rmse = float(np.sqrt(np.mean(difference**2)))
    return f"{rmse:.5f}", f"{np.quantile(difference.max(axis=-1), 0.999):.3f}", f"{difference.max():.3f}"


def main() -> None:
    """Measure, and print the table."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.bench_light", description=__doc__)
    parser.add_argument("--scenes", nargs="+", default=[scene.name for scene in SCENES])
    parser.add_argument("--per-slopes", nargs="+", type=int, default=[1, 3, 5, 9, 17])
    parser.add_argument("--rules", nargs="+", default=list(RULES), choices=list(RULES))
    given = parser.parse_args()
    chosen = [scene for scene in SCENES if scene.name in given.scenes]
    rows = [row for scene in chosen for row in measured(scene, given.per_slopes, given.rules)]
    print(describe_machine())
    print(table(("volume", "inside plateaus", "K", "triangles", "RMSE", "99.9 %", "largest"), rows))


if __name__ == "__main__":
    main()

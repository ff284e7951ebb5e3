"""The scenes of the accuracy benchmark: fields and scans, five transfer functions twice, one view."""

from __future__ import annotations

import os
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from isosample.rendering.camera import Camera, UpAxis
from isosample.transfer.control_points import ControlPoint
from isosample.transfer.isovalues import plan_isovalues
from isosample.transfer.transfer_function import TransferFunction
from isosample.volume.analytic import GaussianShell, MarschnerLobb, nucleon_like, sample_field
from isosample.volume.readers import open_volume
from isosample.volume.statistics import gradient_at_values

if TYPE_CHECKING:
    from collections.abc import Iterator

    from isosample.transfer.isovalue_plan import IsovaluePlan
    from isosample.volume.field import Field
    from isosample.volume.grid import F64, Volume

SCANS = Path(
    os.environ.get("ISOSAMPLE_VOLUMES") or Path(__file__).resolve().parents[2] / "shared" / "volumes"
).absolute()
EXTINCTION_RADIUS = 34.641  # extinctions are those of a box of radius √3 · 20: 40 world units along an edge

BLUE, GOLD, TEAL, WHITE, RED = (
    (0.1, 0.3, 1.0),
    (1.0, 0.7, 0.1),
    (0.1, 0.8, 0.6),
    (1.0, 0.95, 0.9),
    (0.9, 0.2, 0.1),
)

# Values as shares of the field's range; extinction per world unit of a box of 40.
SHAPES: dict[str, list[tuple[float, tuple[float, float, float], float]]] = {
    "T1 two narrow tents": [
        (0.16, BLUE, 0.0), (0.20, BLUE, 0.3), (0.24, BLUE, 0.0),
        (0.61, GOLD, 0.0), (0.65, GOLD, 0.6), (0.69, GOLD, 0.0),
    ],
    "T2 wide tent": [(0.25, BLUE, 0.0), (0.50, GOLD, 0.1), (0.75, RED, 0.0)],
    "T3 near-Dirac peak and bump": [
        (0.15, TEAL, 0.0), (0.275, TEAL, 0.1), (0.40, TEAL, 0.0),
        (0.5 - 5e-5, WHITE, 0.0), (0.5, WHITE, 1000.0), (0.5 + 5e-5, WHITE, 0.0),
    ],
    "T4 box": [(0.35, TEAL, 0.0), (0.35, TEAL, 0.1), (0.60, RED, 0.1), (0.60, RED, 0.0)],
    "T5 wide ramp": [(0.1, BLUE, 0.0), (0.9, WHITE, 0.12), (1.2, WHITE, 0.12)],
}  # fmt: skip
OPACITIES = {"translucent": 1.0, "opaque": 15.0}


@dataclass(frozen=True, eq=False)
class AccuracyScene:
    """A volume, the field that it samples where that is known, and one oblique view."""

    name: str
    volume: Volume
    field: Field | None
    low: float  # the values that the shares 0 and 1 of the transfer functions mean
    high: float

    @property
    def camera(self) -> Camera:
        """Orthographic: the step between rays is the same everywhere."""
        return Camera.orbit(self.volume.box, azimuth=31, elevation=23, zoom=1.5, up_axis=UpAxis.Y)

    @property
    def value_range(self) -> tuple[float, float]:
        """Holds the field between the samples too, and does not change with the grid."""
        margin = 0.05 * (self.high - self.low) if self.field is not None else 0.0
        low, high = self.volume.value_range
        return min(low, self.low) - margin, max(high, self.high) + margin

    def transfer_function(self, shape: str, opacity: str) -> TransferFunction:
        """One of the shapes over the scene's values."""
        scale = OPACITIES[opacity] * EXTINCTION_RADIUS / self.volume.box.radius
        span = self.high - self.low
        narrow = SHAPES[shape]
        # a sheet's area is measured in values: the peak's height falls as its width grows with the range
        return TransferFunction(
            [
                ControlPoint(self.low + span * value, color, extinction * scale)
                for value, color, extinction in narrow
            ]
        )

    def plan(self, shape: str, opacity: str, per_slope: int) -> IsovaluePlan:
        """Isovalues with so many inside every visible slope; the near-Dirac peak becomes a sheet."""
        return plan_isovalues(
            self.transfer_function(shape, opacity),
            self.value_range,
            per_slope=per_slope,
            gradients=partial(gradient_at_values, self.volume),
        )

    def rays(self, pixels: int) -> tuple[F64, F64]:
        """Origins and directions of pixels² rays, (N, 3) each."""
        origins, directions = self.camera.rays(1.0).origins_and_directions(pixels, pixels)
        return origins.reshape(-1, 3), directions.reshape(-1, 3)


def nucleon(edge: int) -> AccuracyScene:
    """The two-body field on a grid of edge³."""
    return _sampled(f"nucleon-like {edge}³", nucleon_like(), edge, 0.0, 40.0, 0.96)


def shell(edge: int) -> AccuracyScene:
    """A fuzzy sphere, off the grid's middle."""
    field = GaussianShell(centre=(20.3, 19.8, 20.1), radius=11.0, width=3.0)
    return _sampled(f"Gaussian shell {edge}³", field, edge, 0.0, 40.0, 1.0)


def marschner_lobb(edge: int) -> AccuracyScene:
    """Ripples near the limit of the grid; its surfaces run out of the box."""
    return _sampled(f"Marschner–Lobb {edge}³", MarschnerLobb(), edge, -1.0, 1.0, 1.0)


def scenes(*, quick: bool) -> Iterator[AccuracyScene]:
    """All scenes, one after the other; scans only where their folder is."""
    yield nucleon(41)
    yield nucleon(81)
    if not quick:
        yield nucleon(128)
    yield shell(81)
    yield marschner_lobb(81)
    yield from scans()


def scans() -> Iterator[AccuracyScene]:
    """Two small data sets whose field is known at the samples only."""
    for name, file in (
        ("nucleon (simulation, 41³, 8 bits)", "nucleon.nhdr"),
        ("head MR (48×62×42, 8 bits)", "HeadMRVolume.mhd"),
    ):
        if (SCANS / file).is_file():
            volume = open_volume(SCANS / file)
            yield AccuracyScene(name, volume, None, *volume.value_range)
        else:
            print(f"skipped: {name}, as there is no {file} in the folder of scans (ISOSAMPLE_VOLUMES)")


def _sampled(name: str, field: Field, edge: int, lower: float, upper: float, largest: float) -> AccuracyScene:
    volume = sample_field(field, (edge,) * 3, lower=(lower,) * 3, upper=(upper,) * 3, name=name)
    return AccuracyScene(name, volume, field, 0.0, largest)


def squared(rows: F64) -> F64:
    """Pixels of a square picture, (P², 4) to (P, P, 4)."""
    edge = round(np.sqrt(len(rows)))
    return rows.reshape(edge, edge, 4)

"""The built-in volumes of `isosample demo`: what is sampled, what it looks like, and from where."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from isosample.defaults import DEFAULT_PER_SLOPE

if TYPE_CHECKING:
    from isosample.rendering.camera import Camera
    from isosample.transfer.transfer_function import TransferFunction
    from isosample.volume.geometry import Box
    from isosample.volume.grid import Volume

SAMPLES = 96  # along each edge


@dataclass(frozen=True, slots=True, kw_only=True)
class Subject:
    """One volume of the demo, by closed form, and how it is shown."""

    name: str
    title: str
    half_width: float  # of the box, about its centre [world]
    centre: tuple[float, float, float]
    points: tuple[
        tuple[float, tuple[float, float, float], float], ...
    ]  # part of the range, colour, extinction
    azimuth: float
    elevation: float
    zoom: float
    per_slope: int = DEFAULT_PER_SLOPE  # light shows rings in a slope with too few


BLUE, TEAL, GOLD, RED = (0.05, 0.2, 1.0), (0.05, 0.75, 0.7), (1.0, 0.65, 0.1), (1.0, 0.25, 0.08)
SUBJECTS = (
    Subject(
        name="hydrogen_4f",
        title="hydrogen, 4f orbital: probability density",
        half_width=29.0,  # nothing that is visible reaches the faces
        centre=(0.0, 0.0, 0.0),
        points=(
            *((0.02, BLUE, 0.0), (0.05, BLUE, 0.03), (0.09, BLUE, 0.0)),
            *((0.14, TEAL, 0.0), (0.22, TEAL, 0.15), (0.32, TEAL, 0.0)),
            *((0.45, GOLD, 0.0), (0.7, GOLD, 0.9), (1.0, GOLD, 1.2)),
        ),
        azimuth=35.0,
        elevation=25.0,
        zoom=1.6,
        per_slope=13,
    ),
    Subject(
        name="nucleon",
        title="two-body density, nucleon-like",
        half_width=20.0,
        centre=(20.0, 20.0, 20.0),
        points=(
            *((0.12, BLUE, 0.0), (0.2, BLUE, 0.06), (0.28, BLUE, 0.0)),
            *((0.45, TEAL, 0.0), (0.52, TEAL, 0.25), (0.6, TEAL, 0.0)),
            *((0.72, RED, 0.0), (0.85, RED, 1.5), (1.0, GOLD, 3.0)),
        ),
        azimuth=30.0,
        elevation=30.0,
        zoom=1.6,
    ),
)


def sampled(subject: Subject) -> Volume:
    """The subject's field on its grid."""
    from isosample.volume.analytic import HydrogenOrbital, nucleon_like, sample_field

    field = nucleon_like() if subject.name == "nucleon" else HydrogenOrbital(4, 3, 2)
    x, y, z = subject.centre
    half = subject.half_width
    return sample_field(
        field,
        (SAMPLES,) * 3,
        lower=(x - half, y - half, z - half),
        upper=(x + half, y + half, z + half),
        name=subject.name,
    )


def transfer_function(subject: Subject, volume: Volume) -> TransferFunction:
    """The subject's points over the volume's range."""
    from isosample.transfer.control_points import ControlPoint
    from isosample.transfer.transfer_function import TransferFunction

    low, high = volume.value_range
    return TransferFunction(
        [ControlPoint(low + (high - low) * v, color, e) for v, color, e in subject.points]
    )


def view(subject: Subject, box: Box, size: tuple[int, int]) -> Camera:
    """The subject's camera."""
    from isosample.rendering.camera import Camera, Projection

    return Camera.orbit(
        box,
        azimuth=subject.azimuth,
        elevation=subject.elevation,
        zoom=subject.zoom,
        projection=Projection.PERSPECTIVE,
        aspect=size[0] / size[1],
    )

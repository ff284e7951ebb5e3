"""Scenes of the comparison at equal errors: two tents, a near-Dirac peak, isosurfaces; a clean and a noisy scan."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from benchmarks import accuracy_scenes
from benchmarks.raycast_scenes import RaycastScene, impulses, nucleon_tents, scans
from isosample.transfer.control_points import ControlPoint
from isosample.transfer.transfer_function import TransferFunction

if TYPE_CHECKING:
    from collections.abc import Iterator

DIRAC = "T3 near-Dirac peak and bump"
CLEAN, NOISY, THIN = "engine", "embryo (noisy)", "vessels (MRA)"
ISOSURFACES = 26
HALF_WIDTH = 5e-5  # of the range; half of the peak's foot
PEAK_EXTINCTION, BUMP_SHARE = 1000.0, 1.0 / 3.0  # as those of the nucleon-like field


def tents_and_peaks(*names: str) -> Iterator[RaycastScene]:
    """The nucleon-like field and the named scans, each with both transfer functions."""
    yield tents()
    yield replace(
        nucleon_tents(),
        name="nucleon-like 128³, near-Dirac",
        transfer_function=accuracy_scenes.nucleon(128).transfer_function(DIRAC, "translucent"),
    )
    for scan in scans(*names) if names else ():
        yield named(scan, "two tents")
        yield near_dirac(scan)


def tents() -> RaycastScene:
    """The nucleon-like field with two tents."""
    return named(nucleon_tents(), "two tents")


def isosurfaces() -> RaycastScene:
    """Isosurfaces of the nucleon-like field, with nothing between them."""
    return replace(impulses(ISOSURFACES), name=f"nucleon-like 128³, {ISOSURFACES} isosurfaces")


def named(scene: RaycastScene, shape: str) -> RaycastScene:
    """The scene with its transfer function in its name."""
    return replace(scene, name=f"{scene.name}, {shape}")


def near_dirac(scan: RaycastScene) -> RaycastScene:
    """A scan with two tents: the first three times lower, the second as narrow as 1e-4 of the range."""
    low, high = scan.volume.value_range
    points = scan.transfer_function.points
    first, peak = points[:3], points[4]
    width = HALF_WIDTH * (high - low)
    extinction = PEAK_EXTINCTION * accuracy_scenes.EXTINCTION_RADIUS / scan.volume.box.radius
    bump = [replace(point, extinction=BUMP_SHARE * point.extinction) for point in first]
    spike = [
        ControlPoint(peak.value + offset, accuracy_scenes.WHITE, height)
        for offset, height in ((-width, 0.0), (0.0, extinction), (width, 0.0))
    ]
    return replace(scan, name=f"{scan.name}, near-Dirac", transfer_function=TransferFunction([*bump, *spike]))

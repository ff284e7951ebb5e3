"""What a picture of the ray caster cost, and what it did without."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import numpy as np


@dataclass(slots=True)
class RayStatistics:
    """Counts over all rays of a picture.

    Attributes
    ----------
    samples, most_samples : int
        Field evaluations of the sampling, over all rays and of the ray with most; gradients are not counted.
    roots : int
        Field evaluations of root finding.
    crossings : int
        Peaks and isosurfaces composited.
    macrocells : int
        Macrocells visited with samples.
    skipped : int
        Leaps over empty macrocells.
    terminated_rays : int
        Rays that ended behind an opaque front.
    tiles, calls : int
        Parts of the picture, and calls of the shader for them: long rays take several.
    """

    samples: int = 0
    most_samples: int = 0
    roots: int = 0
    crossings: int = 0
    macrocells: int = 0
    skipped: int = 0
    terminated_rays: int = 0
    tiles: int = 0
    calls: int = 0

    def add(self, counters: np.void) -> None:
        """Add what one call counted (struct RayCounters)."""
        for name in ("samples", "roots", "crossings", "macrocells", "skipped", "terminated_rays"):
            setattr(self, name, getattr(self, name) + int(counters[name]))
        self.most_samples = max(self.most_samples, int(counters["most_samples"]))
        self.calls += 1

    def to_dict(self, size: tuple[int, int], occupied: int, macrocells: int) -> dict[str, Any]:
        """Return the counts per ray, JSON-ready; see docs/manual.md, "Statistics"."""
        rays = size[0] * size[1]
        return {
            "samples_per_ray": {"mean": self.samples / rays, "max": self.most_samples},
            "root_evaluations_per_ray": self.roots / rays,
            "crossings": self.crossings,
            "macrocells": {
                "visited_per_ray": self.macrocells / rays,
                "skipped_per_ray": self.skipped / rays,
                "occupied": occupied,
                "of": macrocells,
            },
            "skipped": {
                "macrocells_empty": macrocells - occupied,
                "leaps_over_empty_macrocells": self.skipped,
                "rays_ended_early": self.terminated_rays,
            },
            "tiles": self.tiles,
            "calls": self.calls,
        }

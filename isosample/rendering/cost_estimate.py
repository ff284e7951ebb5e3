"""Seconds that a method is expected to take for a load: sums of coefficients times amounts of work.

The figures of `method_costs.py` come from ``python -m benchmarks.bench_method_choice --write``, which measures scenes
of known load and fits seconds per unit of work.
"""

from __future__ import annotations

import dataclasses
import math
import time
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from isosample.defaults import DATA_CENTRIC, PEAK_FINDING, PRE_INTEGRATED
from isosample.rendering import method_costs
from isosample.rendering.step_search import LONGEST, SHORTEST

if TYPE_CHECKING:
    from collections.abc import Mapping

    from isosample.rendering.scene_load import SceneLoad
    from isosample.volume.grid import Volume

# What the seconds of a stage go with; `start` is what every picture costs. The names are those of `SceneLoad`.
FEATURES: dict[str, tuple[str, ...]] = {
    f"{DATA_CENTRIC} prepare": ("start", "scanned_cells", "triangles"),
    f"{DATA_CENTRIC} frame": (
        "start",
        "pixels",
        "triangles",
        "fragments",
        "ordered_fragments",
        "resolved_fragments",
    ),
    f"{PRE_INTEGRATED} prepare": ("start", "voxels"),
    f"{PRE_INTEGRATED} frame": ("start", "pixels", "samples", "pieces", "macrocells"),
    f"{PEAK_FINDING} prepare": ("start", "voxels"),
    f"{PEAK_FINDING} frame": ("start", "pixels", "visible_length", "samples", "pieces", "macrocells"),
}
ASSUMED_SPEED = 50.0  # of a GPU over the software renderer, where its own figures are not measured


@dataclass(frozen=True, slots=True)
class CostEstimate:
    """Seconds that a method is expected to take.

    Attributes
    ----------
    method : str
    prepare_seconds : float
        Before the first frame: plan, extraction, upload, programs; volume and macrocells.
    frame_seconds : float
        Of every frame.
    frames : int
    read_seconds : float
        Of reading and decoding the samples once more, where they stay in their file.
    spent_seconds : float
        Before: start-up, reading, and choosing the method.
    """

    method: str
    prepare_seconds: float
    frame_seconds: float
    frames: int
    read_seconds: float = 0.0
    spent_seconds: float = 0.0

    @property
    def total_seconds(self) -> float:
        """Of all frames with the preparation, and of what comes before."""
        return (
            self.spent_seconds + self.read_seconds + self.prepare_seconds + self.frames * self.frame_seconds
        )

    def to_dict(self) -> dict[str, float]:
        """All of it, JSON-ready."""
        return {
            "spent": self.spent_seconds,
            "read": self.read_seconds,
            "prepare": self.prepare_seconds,
            "frame": self.frame_seconds,
            "frames": self.frames,
            "total": self.total_seconds,
        }


def estimate_cost(
    method: str,
    load: SceneLoad,
    costs: Mapping[str, Mapping[str, float]],
    *,
    frames: int = 1,
    shaded: bool = False,
    smooth: bool = False,
) -> CostEstimate:
    """Seconds of a method for a load.

    Parameters
    ----------
    method : str
        One of `CHOSEN_FROM`.
    load : SceneLoad
    costs : mapping
        Of `costs_of`.
    frames : int
    shaded : bool
        Whether the picture is lit.
    smooth : bool
        Whether the reconstruction is smooth.
    """
    seconds = {
        stage: sum(cost * _amount(load, name) for name, cost in costs[f"{method} {stage}"].items())
        for stage in ("prepare", "frame")
    }
    factors = costs["factors"]
    for stage in seconds:
        for holds, word in ((shaded, "shaded"), (smooth, "smooth")):
            seconds[stage] *= factors.get(f"{method} {stage} {word}", 1.0) if holds else 1.0
    return CostEstimate(method, seconds["prepare"], seconds["frame"], frames)


def costs_of(*, software: bool) -> dict[str, dict[str, float]]:
    """Seconds per unit of work by stage; of a GPU those of the software renderer with frames `ASSUMED_SPEED` faster."""
    if software:
        return method_costs.SOFTWARE
    return {
        stage: {
            name: cost / (ASSUMED_SPEED if stage.endswith(" frame") else 1.0) for name, cost in costs.items()
        }
        for stage, costs in method_costs.SOFTWARE.items()
    }


def tolerance_needs(tolerance: float) -> dict[str, float]:
    """What a tolerance took in measured scenes, between and beyond them by powers of the tolerance.

    Parameters
    ----------
    tolerance : float

    Returns
    -------
    needs : dict
        ``isovalues`` and ``triangles``, as multiples of those without a tolerance; ``step`` [voxel];
        ``surface_search`` and ``ray_search`` [s].
    """
    rows = sorted(method_costs.TOLERANCES, key=lambda row: row["tolerance"])
    known = np.log([row["tolerance"] for row in rows])
    at = int(np.clip(np.searchsorted(known, math.log(tolerance)), 1, len(rows) - 1))
    part = (math.log(tolerance) - known[at - 1]) / (known[at] - known[at - 1])
    found = {}
    for name in rows[0].keys() - {"tolerance"}:
        low, high = math.log(rows[at - 1][name]), math.log(rows[at][name])
        found[name] = math.exp(low + part * (high - low))
    found["step"] = min(max(found["step"], SHORTEST), LONGEST)
    return found


def with_tolerance(load: SceneLoad, needs: Mapping[str, float]) -> SceneLoad:
    """The load with the isovalues and triangles of a tolerance."""
    more = needs["isovalues"]
    return dataclasses.replace(
        load,
        isovalues=round(load.isovalues * more),
        triangles=load.triangles * needs["triangles"],
        fragments=load.fragments * more,
        ordered_fragments=load.ordered_fragments * more,
        resolved_fragments=load.resolved_fragments * more,
    )


def after_search(one: CostEstimate, needs: Mapping[str, float]) -> CostEstimate:
    """An estimate with the search for a tolerance in its preparation."""
    search = needs["surface_search" if one.method == DATA_CENTRIC else "ray_search"]
    return dataclasses.replace(one, prepare_seconds=one.prepare_seconds + search)


def seconds_to_read(volume: Volume) -> float:
    """Processor seconds that reading and decoding all samples takes, from a block of them; 0 for those in memory."""
    if not volume.stays_in_file:
        return 0.0
    begun = time.process_time()
    block = next(volume.blocks())
    return (time.process_time() - begun) * volume.array.size / block.size


def origin_of_costs(*, software: bool) -> str:
    """Say where the seconds per unit of work come from."""
    if software:
        return method_costs.SOFTWARE_MEASURED
    return (
        f"assumed, not measured: frames {ASSUMED_SPEED:g} times faster than {method_costs.SOFTWARE_MEASURED}"
    )


def _amount(load: SceneLoad, name: str) -> float:
    return 1.0 if name == "start" else float(getattr(load, name))

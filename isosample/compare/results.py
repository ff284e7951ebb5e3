"""What a comparison found: one entry per method and setting, as JSON and as CSV."""

from __future__ import annotations

import csv
import io
import json
import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from isosample.compare.verdict import judge
from isosample.files import replacing

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence
    from pathlib import Path

    from isosample.compare.contenders import Setting
    from isosample.compare.metrics import ErrorSummary

FORMAT_NAME, FORMAT_VERSION = "isosample comparison", 1
MEANS = (
    *("ssim", "delta_e_2000", "flip", "wood_grain_energy"),
    *(
        "samples_per_ray",
        "root_evaluations_per_ray",
        "evaluations_per_ray",
        "fragments",
        "triangles_drawn",
        "crossings",
    ),
)
LARGEST = ("max_error", "percentile_error", "tangent_step", "most_samples", "bytes")


@dataclass(frozen=True, slots=True, kw_only=True)
class View:
    """One camera's frames and picture.

    Attributes
    ----------
    wall_seconds : tuple of float
        Of every repeated frame, read back included.
    gpu_seconds : tuple of (float or None)
        The same by the GPU's clock; None where the driver does not tell.
    stage_seconds : dict of str to float
        Median of every stage of the frame.
    errors : ErrorSummary
        Of the picture against the reference.
    cost : dict
        As `contenders.cost_of`.
    """

    wall_seconds: tuple[float, ...]
    gpu_seconds: tuple[float | None, ...]
    stage_seconds: dict[str, float]
    errors: ErrorSummary
    cost: dict[str, Any]

    def to_dict(self) -> dict[str, Any]:
        """All numbers and the medians, JSON-ready."""
        return {
            "frame_seconds": float(np.median(self.wall_seconds)),
            "gpu_seconds": median_of_told(self.gpu_seconds),
            "wall_seconds": list(self.wall_seconds),
            "gpu_seconds_of_frames": list(self.gpu_seconds),
            "stage_seconds": self.stage_seconds,
            "errors": self.errors.to_dict(),
            "cost": self.cost,
        }


@dataclass(frozen=True, slots=True, kw_only=True)
class Entry:
    """One method at one setting.

    Attributes
    ----------
    setting : Setting
    precompute_seconds : float
        Once per volume and transfer function: plan and extraction.
    prepare_seconds : float
        Once per scene on the host: macrocells; merging the meshes.
    load_seconds : float
        Once per scene: upload, programs, and what the first frame takes longer than the others.
    views : tuple of View
        By camera.
    """

    setting: Setting
    precompute_seconds: float
    prepare_seconds: float
    load_seconds: float
    views: tuple[View, ...]

    @property
    def name(self) -> str:
        """Short, for file names and identifiers."""
        return self.setting.name

    def to_dict(self) -> dict[str, Any]:
        """All numbers, JSON-ready; ``summary`` is over all cameras."""
        views = [view.to_dict() for view in self.views]
        return {
            "name": self.name,
            "method": self.setting.method,
            "parameter": self.setting.parameter.value,
            "value": self.setting.value,
            "label": self.setting.label,
            "precompute_seconds": self.precompute_seconds,
            "prepare_seconds": self.prepare_seconds,
            "load_seconds": self.load_seconds,
            "setup_seconds": self.precompute_seconds + self.prepare_seconds + self.load_seconds,
            "summary": summary_of(views),
            "views": views,
        }


@dataclass(frozen=True, slots=True, kw_only=True)
class Results:
    """Everything that a comparison found.

    Attributes
    ----------
    scene : dict
        Volume, transfer function, histogram.
    settings : dict
        Size, cameras, repetitions and conventions.
    machine : dict
        As `machine.describe_machine`.
    reference : dict
        What the reference pictures cost.
    entries : tuple of Entry
        By method, from coarse to fine.
    """

    scene: dict[str, Any]
    settings: dict[str, Any]
    machine: dict[str, Any]
    reference: dict[str, Any]
    entries: tuple[Entry, ...] = field(default=())

    def to_dict(self) -> dict[str, Any]:
        """The content of results.json: all of it, with the verdict that follows from the entries."""
        entries = [entry.to_dict() for entry in self.entries]
        return {
            "format": FORMAT_NAME,
            "version": FORMAT_VERSION,
            "verdict": judge(entries, self.settings["targets"]).to_dict(),
            "scene": self.scene,
            "settings": self.settings,
            "machine": self.machine,
            "reference": self.reference,
            "entries": entries,
        }


def summary_of(views: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """One number for all cameras.

    Parameters
    ----------
    views : sequence of dict
        As `View.to_dict`.

    Returns
    -------
    summary : dict
        ``rmse`` and ``psnr`` of all pictures together; ``worst_pixels_share`` of the squared error of all of them that
        lies in the worst 0.1 % of the pixels of each; ``not_shown``, the largest count by reason; the largest of the
        largest and 99.9 % errors, tangent steps, samples and bytes; the means of everything else. None where one
        camera has None.
    """
    merged = [view["errors"] | view["cost"] for view in views]
    squares = [one["rmse"] ** 2 for one in merged]
    rmse = math.sqrt(math.fsum(squares) / len(merged))
    worst = math.fsum(one["worst_pixels_share"] * square for one, square in zip(merged, squares, strict=True))
    peak = merged[0]["peak"]
    summary: dict[str, Any] = {
        "frame_seconds": math.fsum(view["frame_seconds"] for view in views) / len(views),
        "gpu_seconds": _mean(view["gpu_seconds"] for view in views),
        "rmse": rmse,
        "psnr": 20.0 * math.log10(peak / rmse) if rmse > 0.0 else None,
        "worst_pixels_share": worst / math.fsum(squares) if rmse > 0.0 else 0.0,
        "not_shown": _largest(one["not_shown"] for one in merged),
    }
    for name in MEANS:
        summary[name] = _mean(one[name] for one in merged)
    for name in LARGEST:
        summary[name] = max(one[name] for one in merged)
    for name in ("isovalues", "triangles_extracted"):
        summary[name] = merged[0][name]
    energy = summary.pop("wood_grain_energy")
    summary["wood_grain"] = None if energy is None else math.sqrt(energy)
    return summary


def median_of_told(seconds: Iterable[float | None]) -> float | None:
    """Median of those that are not None."""
    told = [one for one in seconds if one is not None]
    return float(np.median(told)) if told else None


def write_results(document: dict[str, Any], path: Path) -> None:
    """Write results.json, whole or not at all."""
    text = json.dumps(document, indent=1, allow_nan=False, ensure_ascii=False)
    with replacing(path) as file:
        file.write(f"{text}\n".encode(errors="backslashreplace"))


def write_table(document: dict[str, Any], path: Path) -> None:
    """Write results.csv: a row per entry and camera, and one per entry for all cameras.

    Parameters
    ----------
    document : dict
        Content of results.json.
    path : Path
    """
    rows = [row for entry in document["entries"] for row in _rows(entry)]
    columns = list(dict.fromkeys(name for row in rows for name in row))
    text = io.StringIO(newline="")
    writer = csv.DictWriter(text, columns, restval="")
    writer.writeheader()
    writer.writerows(rows)
    with replacing(path) as file:
        file.write(text.getvalue().encode(errors="backslashreplace"))


def _rows(entry: dict[str, Any]) -> list[dict[str, Any]]:
    common = {name: value for name, value in entry.items() if name not in ("summary", "views")}
    rows = [common | {"camera": "all"} | _flat(entry["summary"], "")]
    rows += [
        common | {"camera": number} | _flat(view, "") for number, view in enumerate(entry["views"], start=1)
    ]
    return rows


def _flat(document: dict[str, Any], prefix: str) -> dict[str, Any]:
    """Nested names as one, such as ``skipped.rays_ended_early``; lists with spaces between."""
    found: dict[str, Any] = {}
    for name, value in document.items():
        if name in ("errors", "cost"):
            found |= _flat(value, prefix)
        elif isinstance(value, dict):
            found |= _flat(value, f"{prefix}{name}.")
        elif isinstance(value, list):
            found[prefix + name] = " ".join("" if one is None else str(one) for one in value)
        else:
            found[prefix + name] = value
    return found


def _largest(counts: Iterable[dict[str, int]]) -> dict[str, int]:
    """The largest count of every reason: what views do not show is the same, not one thing more for each of them."""
    found: dict[str, int] = {}
    for one in counts:
        for reason, count in one.items():
            found[reason] = max(count, found.get(reason, 0))
    return found


def _mean(numbers: Iterable[float | None]) -> float | None:
    found = list(numbers)
    told = [number for number in found if number is not None]
    return math.fsum(told) / len(told) if told and len(told) == len(found) else None

"""Columns of a report's tables: what stands in a cell, and above it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from isosample.wording import byte_size, percentage, thousands

if TYPE_CHECKING:
    from collections.abc import Callable

    Document = dict[str, Any]
    Cell = Callable[[Document], str]

ABSENT = "–"


def whole_number(number: float | None) -> str:
    """A count, in groups of three digits."""
    return ABSENT if number is None else thousands(round(number))


def milliseconds(duration: float | None) -> str:
    """A duration in s, with three digits or whole milliseconds."""
    if duration is None:
        return ABSENT
    digits = 2 if duration < 0.01 else 1 if duration < 0.1 else 0
    return f"{1e3 * duration:.{digits}f}"


def _seconds(name: str) -> Cell:
    return lambda entry: f"{entry[name]:.3f}" if entry[name] else "0"


def _number(name: str, pattern: str) -> Cell:
    """A cell of the summary; errors in scientific notation."""

    def cell(entry: Document) -> str:
        value = entry["summary"][name]
        return ABSENT if value is None else format(value, pattern)

    return cell


def _percentage(name: str) -> Cell:
    return lambda entry: percentage(entry["summary"][name])


def _bytes(name: str) -> Cell:
    def cell(entry: Document) -> str:
        size = entry["summary"][name]
        return ABSENT if size is None else byte_size(round(size))

    return cell


def _whole(name: str) -> Cell:
    return lambda entry: whole_number(entry["summary"][name])


TIMES: tuple[tuple[str, str, Cell], ...] = (
    ("precompute [s]", "plan and extraction, once per volume and TF", _seconds("precompute_seconds")),
    ("prepare [s]", "macrocells, or merging of meshes, once per scene", _seconds("prepare_seconds")),
    ("load [s]", "upload, programs, and what the first frame takes longer", _seconds("load_seconds")),
    ("frame [ms]", "wall clock, read back included", lambda e: milliseconds(e["summary"]["frame_seconds"])),
    ("GPU [ms]", "timer query", lambda e: milliseconds(e["summary"]["gpu_seconds"])),
)
ERRORS: tuple[tuple[str, str, Cell], ...] = (
    ("RMSE", "of all components", _number("rmse", ".2e")),
    ("99.9 %", "all pixels but a thousandth err less", _number("percentile_error", ".2e")),
    ("largest", "of a component", _number("max_error", ".2e")),
    ("in 0.1 %", "of the squared error, in the worst pixels", _percentage("worst_pixels_share")),
    ("PSNR [dB]", "against 1", _number("psnr", ".1f")),
    ("SSIM", "as displayed", _number("ssim", ".5f")),
    ("ΔE2000", "mean, as displayed", _number("delta_e_2000", ".4f")),
    ("FLIP", "mean, as displayed", _number("flip", ".5f")),
    ("tangent step", "largest jump between neighbours beyond the truth's", _number("tangent_step", ".2e")),
    ("wood grain", "RMS error at the frequencies of one-voxel steps", _number("wood_grain", ".2e")),
)
COSTS: tuple[tuple[str, str, Cell], ...] = (
    ("per ray", "samples and root evaluations, or fragments", _number("evaluations_per_ray", ".1f")),
    ("most", "of one ray", _whole("most_samples")),
    ("isovalues", "chosen", _whole("isovalues")),
    ("triangles", "extracted", _whole("triangles_extracted")),
    ("drawn", "triangles", _whole("triangles_drawn")),
    ("fragments", "in the lists", _whole("fragments")),
    ("on the GPU", "volume, or meshes and lists", _bytes("bytes")),
)

"""Accuracy: errors of every method, robustness, the planner and the pictures: python -m benchmarks accuracy."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

from benchmarks import accuracy_planner, accuracy_reconstruction, accuracy_robustness, accuracy_table
from benchmarks.accuracy_cells import Table
from benchmarks.accuracy_pictures import draw_all
from benchmarks.accuracy_reports import planner_page, robustness_page
from benchmarks.machine import describe_machine

if TYPE_CHECKING:
    from collections.abc import Callable

Rows = list[dict[str, Any]]

FOLDER = Path(__file__).parent
RAW = FOLDER / "accuracy.json"
PAGE = FOLDER / "ACCURACY.md"
PICTURES = "pictures"
ABSENT = "-"  # of a row without that column

MEASURED: dict[str, Callable[[bool], Rows]] = {
    "table": lambda quick: Table(quick=quick).run(),
    "reconstruction": lambda quick: accuracy_reconstruction.rows(quick=quick),
    "robustness": lambda quick: accuracy_robustness.rows(),  # noqa: ARG005  # has one size
    "planner": lambda quick: accuracy_planner.rows(quick=quick),
}


def main(arguments: list[str]) -> None:
    """Measure the parts that are asked for, keep their rows, and write the page of all that are kept."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks accuracy", description=__doc__)
    parser.add_argument(
        "--quick", action="store_true", help="fewer isovalues, rays and plans; prints only, keeps no page"
    )
    parser.add_argument(
        "--part", choices=[*MEASURED, PICTURES], action="append", help="this part only; may be repeated"
    )
    parser.add_argument(
        "--page", action="store_true", help="measure nothing: the page anew from accuracy.json"
    )
    options = parser.parse_args(arguments)
    parts = [] if options.page else options.part or [*MEASURED, PICTURES]
    kept: dict[str, Any] = {} if options.quick else _load()
    for name in parts:
        if name in MEASURED:
            machine = describe_machine().strip()
            kept[name] = {"machine": machine, "rows": MEASURED[name](options.quick)}
            if not options.quick:
                RAW.write_text(compact(kept), encoding="utf-8")
    if options.quick:
        print(page(kept))
        return
    if PICTURES in parts:
        draw_all()
    PAGE.write_text(page(kept), encoding="utf-8")
    print(f"written to {PAGE}")


def page(kept: dict[str, Any]) -> str:
    """Page of the parts that were measured."""
    pages = {
        "table": accuracy_table.page,
        "reconstruction": accuracy_reconstruction.page,
        "robustness": robustness_page,
        "planner": planner_page,
    }
    parts = [
        "# Accuracy\n",
        "Errors of pictures in premultiplied linear RGBA: RMSE over the visible pixels, the largest component's error "
        "that 99.9 % of them keep to, and the tangent step, the largest jump between neighbouring pixels beyond the "
        "truth's. K is the number of isovalues inside every visible slope. Made by `python -m benchmarks accuracy`; "
        "the rows are in `accuracy.json`, what they mean for pictures is in `docs/accuracy.md`.\n",
    ]
    for name, write in pages.items():
        if name in kept:
            parts += [write(kept[name]["rows"]), f"*Measured: {kept[name]['machine']}*\n"]
    return "\n".join(parts)


def compact(kept: dict[str, Any]) -> str:
    """JSON with the names of the columns once, and one row per line."""
    sections = []
    for name, part in kept.items():
        columns = list(dict.fromkeys(column for row in part["rows"] for column in row))
        rows = ",\n".join(
            json.dumps([row.get(column, ABSENT) for column in columns], ensure_ascii=False)
            for row in part["rows"]
        )
        heads = f'"machine": {json.dumps(part["machine"])}, "columns": {json.dumps(columns)}'
        sections.append(f'"{name}": {{{heads}, "rows": [\n{rows}\n]}}')
    return "{" + ",\n".join(sections) + "}\n"


def _load() -> dict[str, Any]:
    """Read the parts that `compact` wrote."""
    if not RAW.is_file():
        return {}
    kept: dict[str, Any] = json.loads(RAW.read_text(encoding="utf-8"))
    for part in kept.values():
        columns = part.pop("columns")
        part["rows"] = [
            {name: entry for name, entry in zip(columns, row, strict=True) if entry != ABSENT}
            for row in part["rows"]
        ]
    return kept

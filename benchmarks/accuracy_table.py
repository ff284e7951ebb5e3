"""The accuracy table as a page: summaries, geometric means by scene, and every cell."""

from __future__ import annotations

from collections import defaultdict
from typing import TYPE_CHECKING, Any

import numpy as np

from benchmarks.machine import table

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    Row = dict[str, Any]
    Cells = dict[tuple[Any, ...], Row]

LEAST_COUNT = 5  # isovalues per slope from which the order shows
EXACT = ("exact constant", "exact linear", "exact cubic")
GRID = ("grid constant", "grid linear", "grid cubic")
MESH = ("mesh constant", "mesh linear", "mesh cubic", "mesh cubic, refine 4")
SMOOTH = ("spline curved cubic",)
MEASURES = {"rmse": "RMSE", "p999": "99.9 %", "step": "step"}
METHOD = (
    "The view is orthographic, 31° and 23°, 64² rays. Meshes of grids above half a million samples are measured at "
    "K = 1, 5 and 17 only; meshes above 1.5 million triangles, and refined ones expected above 2 million, are left "
    "out. Truths are good to 1e-6; that of the near-Dirac peak over an analytic field is verified at points only (it "
    "agreed to 5e-9 with a hundredfold smaller tolerance on 24² rays).\n"
)


def page(rows: list[Row]) -> str:
    """All sections that come from the table."""
    cells = {_key(row): row for row in rows}
    parts = [
        METHOD,
        exact_summary(cells),
        mesh_ratio_summary(cells),
        mesh_share_summary(cells),
        refine_summary(cells),
        scene_means(rows),
        full_table(rows),
    ]
    return "\n".join(parts)


def exact_summary(cells: Cells) -> str:
    """How much smaller the error of cubic segments is where crossings are exact."""
    lines = []
    for kind, title in (("exact", "analytic field"), ("grid", "trilinear interpolant")):
        ratios = list(_ratios(cells, f"{kind} cubic", f"{kind} linear"))
        if kind == "exact":  # grids of one field have the same exact crossings: counted once
            first = {key[0].rsplit(" ", 1)[0]: key[0] for key, _ in reversed(ratios)}
            ratios = [pair for pair in ratios if pair[0][0] in first.values()]
        for scene in dict.fromkeys(key[0] for key, _ in ratios):
            chosen = [ratio for key, ratio in ratios if key[0] == scene and key[3] >= LEAST_COUNT]
            if chosen:
                lines.append((title, scene, len(chosen), _short(_mean(chosen)), _short(max(chosen))))
        chosen = [ratio for key, ratio in ratios if key[3] >= LEAST_COUNT]
        if chosen:
            lines.append((title, "**all**", len(chosen), f"**{_short(_mean(chosen))}**", _short(max(chosen))))
    heads = ("crossings of the", "scene", "cells", "geometric mean", "largest")
    return (
        "## Exact crossings: RMSE of cubic segments over that of linear ones\n\n"
        f"From {LEAST_COUNT} isovalues per slope on, every analytic field once (0.1 or less was expected). On a "
        "trilinear interpolant slopes jump from cell to cell, and the cubics gain less.\n\n"
        + table(heads, lines)
    )


def mesh_ratio_summary(cells: Cells) -> str:
    """Where cubic segments are worse than linear ones on the same mesh, and why."""
    ratios = list(_ratios(cells, "mesh cubic", "mesh linear"))
    if not ratios:
        return ""
    above = sorted((pair for pair in ratios if pair[1] > 1.0), key=lambda pair: -pair[1])
    lines = [
        (
            key[0],
            key[1],
            key[2],
            key[3],
            cells[_method(key, "mesh linear")]["rmse"],
            cells[_method(key, "mesh cubic")]["rmse"],
            _short(ratio),
            _reason(cells, key),
        )
        for key, ratio in above
    ]
    worst = max(ratio for _, ratio in ratios)
    heads = ("scene", "transfer function", "opacity", "K", "linear", "cubic", "ratio", "reason")
    return (
        "## Flat meshes: RMSE of cubic segments over that of linear ones\n\n"
        f"Against the trilinear reference. {len(above)} of {len(ratios)} cells are above 1, the worst at "
        f"{worst:.3g} (1.5 or less was expected); the geometric mean of all is "
        f"{_short(_mean([ratio for _, ratio in ratios]))}.\n\n" + (table(heads, lines) if lines else "")
    )


def mesh_share_summary(cells: Cells) -> str:
    """Share of the squared error that comes from the mesh."""
    shares: dict[tuple[str, int], list[float]] = defaultdict(list)
    for key, row in cells.items():
        if key[4] == "mesh cubic" and _method(key, "grid cubic") in cells and row["rmse"] > 0:
            exact = cells[_method(key, "grid cubic")]["rmse"]
            shares[key[0], key[3]].append(1.0 - (exact / row["rmse"]) ** 2)
    counts = sorted({count for _, count in shares})
    lines = [
        (scene, *(_percent(shares.get((scene, count), [])) for count in counts))
        for scene in dict.fromkeys(scene for scene, _ in shares)
    ]
    heads = ("scene", *(f"K = {count}" for count in counts))
    return (
        "## Share of the mesh in the squared error of cubic segments\n\n"
        "1 − (exact crossings of the trilinear interpolant / flat mesh)², both against the trilinear reference: "
        "median over the transfer functions. Below 0 the picture of the mesh is the nearer one: its slopes are "
        "smooth central differences, those of the exact crossings jump from cell to cell (given central "
        "differences, the exact crossings of the three cells that were tried erred by 0.2 to 0.7 as much).\n\n"
        + table(heads, lines)
    )


def refine_summary(cells: Cells) -> str:
    """What dividing bent triangles gains, on the cells that have both."""
    ratios = list(_ratios(cells, "mesh cubic, refine 4", "mesh cubic"))
    counts = sorted({key[3] for key, _ in ratios})
    lines = []
    for scene in dict.fromkeys(key[0] for key, _ in ratios):
        line = [scene]
        for count in counts:
            chosen = [ratio for key, ratio in ratios if (key[0], key[3]) == (scene, count)]
            line.append(f"{_short(_mean(chosen))} ({len(chosen)})" if chosen else "–")
        lines.append(line)
    return (
        "## Refinement: RMSE of `refine` 4 over that of the flat mesh, cubic segments\n\n"
        "Geometric mean over the cells that have both (their number in brackets: the refined meshes of many isovalues "
        "were beyond the limit of triangles), against the trilinear reference.\n\n"
        + table(("scene", *(f"K = {count}" for count in counts)), lines)
    )


def scene_means(rows: list[Row]) -> str:
    """Geometric means over the transfer functions and opacities that all methods of a column have."""
    methods = [*EXACT, *GRID, *MESH]
    columns = [(method, None) for method in methods] + [(SMOOTH[0], "spline"), (SMOOTH[0], "field")]
    parts = ["## Geometric means by scene, RMSE\n"]
    parts.append(
        "Exact crossings: analytic field, against it. Grid and mesh: exact crossings of the trilinear interpolant, and "
        "flat triangles, against the trilinear reference. Spline: curved triangles of the cubic spline, against the "
        "spline's reference, and against the field. A number in brackets counts the cells, where fewer than the ten "
        "of a row (two opacities of five transfer functions) were within the limit of triangles.\n"
    )
    for scene in dict.fromkeys(row["scene"] for row in rows):
        lines = []
        for count in sorted({row["K"] for row in rows if row["scene"] == scene and row["K"]}):
            line = [str(count)]
            for method, against in columns:
                found = [
                    row["rmse"]
                    for row in rows
                    if (row["scene"], row["K"], row["method"]) == (scene, count, method)
                    and against in (None, row["against"])
                ]
                line.append(_cell(found))
            lines.append(line)
        heads = [_head(method) + (f", against {against}" if against else "") for method, against in columns]
        used = [i for i in range(len(heads)) if any(line[i + 1] != "–" for line in lines)]
        parts.append(f"### {scene}\n")
        parts.append(
            table(
                ["K", *(heads[i] for i in used)], [[line[0], *(line[i + 1] for i in used)] for line in lines]
            )
        )
    return "\n".join(parts)


def full_table(rows: list[Row]) -> str:
    """Every cell, folded."""
    heads = ("scene", "transfer function", "opacity", "K", "method", "against", "isovalues", "triangles")
    lines = [
        (
            *(row[name] for name in ("scene", "tf", "opacity")),
            row["K"] or "–",
            row["method"],
            row["against"],
            row.get("isovalues", "–"),
            f"{row['triangles']:,}" if "triangles" in row else "–",
            *(f"{row[name]:.2g}" for name in MEASURES),
        )
        for row in rows
    ]
    return (
        f"<details><summary>All {len(rows)} cells</summary>\n\n"
        + table((*heads, *MEASURES.values()), lines)
        + "\n</details>\n"
    )


def _key(row: Row) -> tuple[Any, ...]:
    """Scene, transfer function, opacity, K, method, reference."""
    return tuple(row[name] for name in ("scene", "tf", "opacity", "K", "method", "against"))


def _method(key: tuple[Any, ...], method: str) -> tuple[Any, ...]:
    return (*key[:4], method, key[5])


def _ratios(cells: Cells, method: str, base: str) -> Iterable[tuple[tuple[Any, ...], float]]:
    for key, row in cells.items():
        other = cells.get(_method(key, base))
        if key[4] == method and other is not None and other["rmse"] > 0:
            yield key, row["rmse"] / other["rmse"]


def _reason(cells: Cells, key: tuple[Any, ...]) -> str:
    """Which part of the error makes a cell worse than linear segments."""
    cubic, exact, line = (
        cells[_method(key, name)]["rmse"] for name in ("mesh cubic", "grid cubic", "grid linear")
    )
    if exact > line:
        return "the slopes of the trilinear interpolant jump: exact crossings show it too"
    share = 1.0 - (exact / cubic) ** 2
    return f"the mesh has {100 * share:.0f} % of the squared error: with exact crossings {exact:.2g} against {line:.2g}"


def _mean(values: Sequence[float]) -> float:
    positive = [value for value in values if value > 0]
    return float(np.exp(np.mean(np.log(positive)))) if positive else 0.0


def _cell(found: list[float]) -> str:
    if not found:
        return "–"
    return f"{_mean(found):.1e}" + (f" ({len(found)})" if len(found) < 10 else "")


def _percent(values: list[float]) -> str:
    return f"{100 * float(np.median(values)):.0f} %" if values else "–"


def _short(number: float) -> str:
    return f"{number:.2g}"


def _head(method: str) -> str:
    return method.replace("exact", "exact:").replace("grid", "grid:").replace("mesh", "mesh:")

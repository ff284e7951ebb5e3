"""Robustness and planner as pages."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from benchmarks.accuracy_planner import GOAL, REPORTED
from benchmarks.machine import table
from isosample.defaults import DEFAULT_MAX_TRIANGLES

if TYPE_CHECKING:
    Row = dict[str, Any]


def robustness_page(rows: list[Row]) -> str:
    """Errors relative to those of clean crossings."""
    lines = []
    for row in rows:
        clean = next(
            other["rmse"]
            for other in rows
            if other["change"] == "none, cubic" and (other["tf"], other["K"]) == (row["tf"], row["K"])
        )
        found = row.get("detected")
        lines.append(
            (
                f"{row['tf']}, {row['opacity']}, K = {row['K']}",
                row["change"],
                f"{row['rmse']:.2g}",
                f"{row['rmse'] / clean:.2g}",
                f"{row['p999']:.2g}",
                f"{row['step']:.2g}",
                "" if found is None else f"{100 * found:.1f} %",
            )
        )
    heads = ("case", "change", "RMSE", "of clean cubic", "99.9 %", "step", "rays found")
    return (
        "## Robustness\n\n"
        "Exact crossings of the nucleon-like field, 64² rays, against the analytic field; changes are random, of one "
        "seed. "
        "`Not repaired`: the list is cut where neighbouring crossings do not fit, and the gap is linear. "
        "`Rays found`: share of the rays with a lost crossing whose walk notices.\n\n" + table(heads, lines)
    )


def planner_page(rows: list[Row]) -> str:
    """Plans on other views, and against evenly spaced isovalues."""
    plans = [row for row in rows if row.get("tolerance") in REPORTED and "view" in row]
    limits = {"1/64": 1 / 64, "1/255": 1 / 255, "1/1000": 1 / 1000}
    limits = {name: limit for name, limit in limits.items() if any(row["tolerance"] == name for row in plans)}
    lines = [
        (
            f"{row['scene']}, {row['tf'][:2]} {row['opacity']}",
            f"{row['view'][0]:.0f}°, {row['view'][1]:.0f}°",
            row["tolerance"],
            f"{row['reached']:.2g}",
            "yes" if row["reached"] <= limits[row["tolerance"]] else "no",
            row["missed"] or "–",
            f"{row['planning']:.2g}",
            f"{row['expected']:.2g}",
            f"{row['indicator']:.2g}",
            f"{row['mesh']:.2g}",
            row["isovalues"],
            row["refine"],
            f"{row['flatness']:.2g}",
            f"{row['triangles']:,}",
        )
        for row in plans
    ]
    heads = (
        "scene", "view", "tolerance", "reached", "kept", "plan says missed", "on planning views", "expected here",
        "indicator", "mesh estimate", "isovalues", "refine", "flatness", "triangles",
    )  # fmt: skip
    return (
        "## Plans for a tolerance, on other views\n\n"
        "`plan_for_tolerance` with its four default views; measured on two others at 96², against the trilinear "
        "reference: the error that a thousandth of all pixels exceed. Plans had the default limits "
        f"({DEFAULT_MAX_TRIANGLES / 1e6:g} million triangles). Flatness [voxel]: edges whose middle is nearer to the "
        "isosurface are not divided. `Expected here` is `expected_error`, from the error map of the view.\n\n"
        + table(heads, lines)
        + "\n"
        + _counts(plans, limits)
        + "\n"
        + _against_even(rows)
    )


def _counts(plans: list[Row], limits: dict[str, float]) -> str:
    """How many pairs keep to their tolerance, and how many that do not were announced."""
    lines = []
    for name, limit in limits.items():
        chosen = [row for row in plans if row["tolerance"] == name]
        missed = [row for row in chosen if row["reached"] > limit]
        lines.append(
            (
                name,
                len(chosen),
                len(chosen) - len(missed),
                len(missed),
                sum(row["missed"] is not None for row in missed),
                sum(row["expected"] > limit for row in missed),
                sum(row["expected"] > limit for row in chosen if row not in missed),
            )
        )
    heads = (
        "tolerance", "pairs", "kept", "not kept", "of these the plan says missed", "of these expected above",
        "kept, but expected above",
    )  # fmt: skip
    return table(heads, lines)


def _against_even(rows: list[Row]) -> str:
    lines = []
    for row in rows:
        if "way" not in row:
            continue
        if "triangles" in row:
            settings = (
                f"K = {row['K']}" if "K" in row else f"tolerance {row['tolerance']}, refine {row['refine']}"
            )
            outcome = (f"{row['triangles']:,}", row["isovalues"], settings, f"{row['rmse']:.2g}")
        else:
            best = f" (best: {row['best_rmse']:.2g} at K = {row['best_K']})" if "best_K" in row else ""
            outcome = ("not reached" + best, "–", "–", "–")
        lines.append((f"{row['scene']}, {row['tf'][:2]} {row['opacity']}", row["way"], *outcome))
    heads = ("scene", "way", "triangles", "isovalues", "settings", "RMSE")
    return (
        f"### Triangles for an RMSE of 1/{round(1 / GOAL)} on both views\n\n"
        "The plan with the fewest triangles among the tolerances 1/16 to 1/1000, and the fewest evenly spaced "
        "isovalues (K up to 49) with flat triangles and linear segments.\n\n" + table(heads, lines)
    )

"""The isovalue plan as a table."""

from __future__ import annotations

from typing import TYPE_CHECKING

from isosample.cli.console import say, say_table
from isosample.transfer.sheets import SHEET_COUNT, SHEET_WIDTH

if TYPE_CHECKING:
    from isosample.transfer.isovalues import IsovaluePlan, PlanRow

COLUMNS = ("level", "isovalue", "reason", "extinction below", "above [1/world]", "opacity")
SHEET_COLUMNS = ("sheet area", "width [voxel]")


def say_plan(plan: IsovaluePlan) -> None:
    """Write one line per isovalue, and what was left out."""
    rows = plan.describe()
    sheets = [row for row in rows if row.sheet_area]
    low, high = plan.value_range
    say_table(
        COLUMNS + (SHEET_COLUMNS if sheets else ()),
        [_cells(row)[: None if sheets else len(COLUMNS)] for row in rows],
        numeric=(0, 1, 3, 4, 5, 6, 7) if sheets else (0, 1, 3, 4, 5),
        title=f"{len(rows)} isovalues in the range {low:g} to {high:g}",
    )
    counts = {name: count for name, count in plan.skipped.items() if count and name != SHEET_COUNT}
    skipped = [f"{reason.replace('_', ' ')} {count}" for reason, count in counts.items()]
    say(f"left out: {', '.join(skipped) or 'nothing'}")
    if sheets:
        say(
            f"narrow peaks drawn as one sheet each: {len(sheets)} (a mesh cannot separate what is closer than "
            f"{SHEET_WIDTH:g} voxel)"
        )


def _cells(row: PlanRow) -> list[str]:
    """Return the words of one line."""
    return [
        str(row.level_index),
        f"{row.value:.9g}",
        row.reason,
        f"{row.extinction_below:.4g}",
        f"{row.extinction_above:.4g}",
        f"{row.opacity:.3g}" if row.opacity else "",
        f"{row.sheet_area:.4g}" if row.sheet_area else "",
        f"{row.sheet_width:.2g}" if row.sheet_area else "",
    ]

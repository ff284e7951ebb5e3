"""The isovalue plan as a table."""

from __future__ import annotations

from typing import TYPE_CHECKING

from isosample.cli.console import say, say_table

if TYPE_CHECKING:
    from isosample.transfer.isovalues import IsovaluePlan

COLUMNS = ("level", "isovalue", "reason", "extinction below", "above [1/world]", "opacity")


def say_plan(plan: IsovaluePlan) -> None:
    """Write one line per isovalue, and what was left out."""
    rows = [
        [
            str(row.level_index),
            f"{row.value:.9g}",
            row.reason,
            f"{row.extinction_below:.4g}",
            f"{row.extinction_above:.4g}",
            f"{row.opacity:.3g}" if row.opacity else "",
        ]
        for row in plan.describe()
    ]
    low, high = plan.value_range
    say_table(
        COLUMNS,
        rows,
        numeric=(0, 1, 3, 4, 5),
        title=f"{len(rows)} isovalues in the range {low:g} to {high:g}",
    )
    skipped = [f"{reason.replace('_', ' ')} {count}" for reason, count in plan.skipped.items() if count]
    say(f"left out: {', '.join(skipped) or 'nothing'}")

"""What commands write: tables and lines on standard output, notes and progress on standard error."""

from __future__ import annotations

import contextlib
import json
import logging
import math
import sys
import time
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence

    Progress = Callable[[str, int, int], None]

COLUMN_GAP = "  "
MOMENT = 10.0  # s; of shorter work a log says nothing


def say(line: str = "") -> None:
    """Write one line of a result."""
    sys.stdout.write(f"{line}\n")


def note(line: str) -> None:
    """Tell on standard error what was assumed."""
    sys.stderr.write(f"isosample: note: {line}\n")


class LogNotes(logging.Handler):
    """Shows what the library logs, as notes."""

    def emit(self, record: logging.LogRecord) -> None:
        """Write one line."""
        note(record.getMessage())


def say_json(document: Mapping[str, Any]) -> None:
    """Write a document as JSON."""
    say(json_text(document))


def json_text(document: Mapping[str, Any]) -> str:
    """Return a document as indented JSON; NaN and infinities are an error."""
    return json.dumps(document, indent=2, allow_nan=False, ensure_ascii=False)


def say_fields(fields: Mapping[str, str], title: str = "") -> None:
    """Write names and values, one pair per line."""
    say_table(("", ""), [[name, value] for name, value in fields.items()], title=title)


def say_table(
    columns: Sequence[str], rows: Sequence[Sequence[str]], *, numeric: Sequence[int] = (), title: str = ""
) -> None:
    """Write a table: drawn on a terminal, aligned plain text elsewhere.

    Parameters
    ----------
    columns : sequence of N str
        Headings; a table whose headings are all empty has no heading line.
    rows : sequence of sequences of N str
    numeric : sequence of int
        Columns that are aligned to the right.
    title : str
    """
    if sys.stdout.isatty():
        _draw_table(columns, rows, numeric, title)
        return
    if title:
        say(title)
    lines = [columns, *rows] if any(columns) else list(rows)
    widths = [max((len(line[place]) for line in lines), default=0) for place in range(len(columns))]
    for line in lines:
        cells = [
            cell.rjust(width) if place in numeric else cell.ljust(width)
            for place, (cell, width) in enumerate(zip(line, widths, strict=True))
        ]
        say(COLUMN_GAP.join(cells).rstrip())


def _draw_table(
    columns: Sequence[str], rows: Sequence[Sequence[str]], numeric: Sequence[int], title: str
) -> None:
    """Write a table with rules and colours, as wide as the terminal allows."""
    from rich import box
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    table = Table(
        title=title or None, title_justify="left", box=box.SIMPLE, show_header=any(columns), pad_edge=False
    )
    for place, heading in enumerate(columns):
        style = "bold cyan" if place == 0 else None
        table.add_column(heading, justify="right" if place in numeric else "left", style=style)
    for row in rows:
        table.add_row(*(Text(cell, overflow="fold") for cell in row))
    Console(file=sys.stdout).print(table)


@contextlib.contextmanager
def progress_bars(*, begins: bool = False) -> Iterator[Progress]:
    """Give a callable (stage, done, total) that draws one bar per stage, or writes lines where there is no terminal.

    Parameters
    ----------
    begins : bool
        Without a terminal, tell the beginning of every stage too: for work that is known to be long.
    """
    if not sys.stderr.isatty():
        yield ProgressLines(begins=begins)
        return
    from rich.console import Console
    from rich.progress import Progress as Bars
    from rich.progress import TaskID

    tasks: dict[str, TaskID] = {}
    with Bars(console=Console(file=sys.stderr), transient=True) as bars:

        def report(stage: str, done: int, total: int) -> None:
            if stage not in tasks:
                tasks[stage] = bars.add_task(stage, total=total)
            bars.update(tasks[stage], completed=done, total=total)

        yield report


class ProgressLines:
    """Progress for a log: a line per tenth of a stage, on standard error, of stages that take longer than a moment.

    With `begins`, a line for the beginning of every stage besides, whatever it takes.
    """

    def __init__(self, *, begins: bool = False) -> None:
        self._begins = begins
        self._told = time.monotonic()  # when something was last reported: no stage began before
        self._began: dict[str, float] = {}
        self._share: dict[str, float] = {}
        self._tenth: dict[str, int] = {}

    def __call__(self, stage: str, done: int, total: int) -> None:
        """Take what is done of a stage; one that falls back has begun anew."""
        now = time.monotonic()
        share = done / total if total > 0 else 0.0
        if share < self._share.get(stage, math.inf):
            self._began[stage], self._tenth[stage] = self._told, 0
            if self._begins:
                _log(f"{stage}: begun")
        self._share[stage], self._told = share, now
        tenth, spent = math.floor(10.0 * share), now - self._began[stage]
        if tenth > self._tenth[stage] and spent >= MOMENT:
            self._tenth[stage] = tenth
            _log(f"{stage}: {10 * tenth} % after {seconds(spent)}")


def _log(line: str) -> None:
    """Write a line of a log at once."""
    sys.stderr.write(f"isosample: {line}\n")
    sys.stderr.flush()


def seconds(duration: float) -> str:
    """Return a duration with three digits, in seconds."""
    return f"{duration:.3g} s" if duration < 100 else f"{duration:.0f} s"

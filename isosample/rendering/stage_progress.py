"""Progress of work that is done in stages: the name of the stage, steps done and steps in all."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

Progress = Callable[[str, int, int], None]


def of_stage(progress: Progress | None, stage: str) -> Callable[[int, int], None] | None:
    """Return what one stage calls with steps done and steps in all, if anybody is to be told."""
    return None if progress is None else partial(progress, stage)


def of_detail(progress: Progress | None, detail: int) -> Callable[[int, int], None] | None:
    """Return what the extraction of one detail calls."""
    return of_stage(progress, f"detail {detail}" if detail else "extract")

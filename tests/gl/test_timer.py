"""Stages accumulate wall time, also when they raise, and only wait for the GPU when asked."""

from __future__ import annotations

import time

import pytest

from isosample.gl.timer import StageTimer


class _CountingContext:
    """Stands for a context; only the number of waits matters here."""

    def __init__(self) -> None:
        self.wait_count = 0

    def finish(self) -> None:
        self.wait_count += 1


def _timer(synchronous: bool) -> tuple[StageTimer, _CountingContext]:
    context = _CountingContext()
    return StageTimer(context, synchronous=synchronous), context  # type: ignore[arg-type]


def test_repeated_stages_accumulate() -> None:
    timer, _ = _timer(synchronous=True)
    for _ in range(3):
        with timer.stage("build"):
            time.sleep(0.01)  # sleeps at least this long (Python 3.5 and later)
    with timer.stage("resolve"):
        pass
    assert timer.seconds["build"] >= 0.03
    assert 0.0 <= timer.seconds["resolve"] < timer.seconds["build"]
    assert list(timer.seconds) == ["build", "resolve"]


def test_outer_stage_includes_the_inner_one() -> None:
    timer, _ = _timer(synchronous=True)
    with timer.stage("frame"), timer.stage("build"):
        time.sleep(0.01)
    assert timer.seconds["frame"] >= timer.seconds["build"] >= 0.01


def test_stage_that_raises_is_counted() -> None:
    timer, _ = _timer(synchronous=True)
    with pytest.raises(ZeroDivisionError), timer.stage("build"):
        1 / 0  # noqa: B018
    assert timer.seconds["build"] > 0.0


@pytest.mark.parametrize(("synchronous", "wait_count"), [(True, 2), (False, 0)])
def test_gpu_is_awaited_at_both_ends_only_if_synchronous(synchronous: bool, wait_count: int) -> None:
    timer, context = _timer(synchronous=synchronous)
    with timer.stage("build"):
        pass
    assert context.wait_count == wait_count

"""Stages accumulate wall time and wait for the GPU only when asked; the GPU's clock agrees with the wall's."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

import pytest

from isosample.gl.timer import LONGEST_QUERY_NS, GpuTimer, StageTimer

if TYPE_CHECKING:
    import moderngl


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


def test_the_gpus_clock_lies_within_the_walls(gl: moderngl.Context) -> None:
    timer = GpuTimer(gl)
    texture = gl.texture((2048, 2048), 4, dtype="f4")
    target = gl.framebuffer([texture])
    found = []
    for _ in range(3):  # the first block of a process may be untold
        start = time.perf_counter()
        with timer.block():
            for level in range(8):
                target.clear(level / 8.0, 0.0, 0.0, 1.0)
            gl.finish()
        found.append((timer.seconds(), time.perf_counter() - start))
    target.release()
    texture.release()
    told = [(gpu, wall) for gpu, wall in found if gpu is not None]
    assert len(told) >= 2
    assert all(0.0 < gpu <= wall for gpu, wall in told)


class _FullQuery:
    """Stands for a query whose counter is at its end."""

    elapsed = LONGEST_QUERY_NS


class _QueryContext:
    def query(self, **_: bool) -> _FullQuery:
        return _FullQuery()


def test_a_full_counter_is_no_time() -> None:
    assert GpuTimer(_QueryContext()).seconds() is None  # type: ignore[arg-type]  # stands for a context

"""Progress without a terminal: a line per tenth of what takes long, and nothing of what does not."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from cli.harness import Run, blob
from isosample.cli import console

if TYPE_CHECKING:
    from collections.abc import Sequence


class Clock:
    """A clock that is set by hand."""

    def __init__(self) -> None:
        self.now = 100.0

    def monotonic(self) -> float:
        return self.now


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    found = Clock()
    monkeypatch.setattr(console, "time", found)
    monkeypatch.setattr(console, "MOMENT", 5.0)
    return found


def run_stage(
    clock: Clock, progress: console.Progress, stage: str, steps: Sequence[int], pace: float
) -> None:
    for done in steps:
        clock.now += pace
        progress(stage, done, steps[-1])


def test_long_work_is_told_by_the_tenth(clock: Clock, capsys: pytest.CaptureFixture[str]) -> None:
    with console.progress_bars() as progress:
        run_stage(clock, progress, "extract", range(1, 201), 0.5)
    captured = capsys.readouterr()
    assert captured.out == ""
    lines = captured.err.splitlines()
    assert lines == [
        f"isosample: extract: {10 * n} % after {console.seconds(10.0 * n)}" for n in range(1, 11)
    ]


def test_short_work_is_not_told(clock: Clock, capsys: pytest.CaptureFixture[str]) -> None:
    with console.progress_bars() as progress:
        run_stage(clock, progress, "scan", range(1, 21), 0.2)  # 4 s
        run_stage(clock, progress, "extract", range(1, 21), 0.2)
    assert capsys.readouterr().err == ""


def test_the_time_before_the_first_report_counts_and_tenths_may_be_leapt_over(
    clock: Clock, capsys: pytest.CaptureFixture[str]
) -> None:
    with console.progress_bars() as progress:
        run_stage(clock, progress, "scan", [1, 2], 1.0)
        run_stage(clock, progress, "extract", [1, 3], 20.0)
    told = [f"isosample: extract: {share} % after {after} s" for share, after in ((30, 20), (100, 40))]
    assert capsys.readouterr().err.splitlines() == told


def test_a_stage_that_begins_anew_is_told_anew(clock: Clock, capsys: pytest.CaptureFixture[str]) -> None:
    """As the pictures of a film, or the rounds of a search, where each is short but the film is not."""
    with console.progress_bars() as progress:
        for frame in range(3):
            progress("film", frame, 3)
            run_stage(clock, progress, "render", [1, 2, 3, 4], 1.0)
        progress("film", 3, 3)
    told = [f"isosample: film: {share} % after {after} s" for share, after in ((60, 8), (100, 12))]
    assert capsys.readouterr().err.splitlines() == told


def test_work_that_is_known_to_be_long_tells_the_beginning_of_every_stage(
    clock: Clock, capsys: pytest.CaptureFixture[str]
) -> None:
    with console.progress_bars(begins=True) as progress:
        progress("reference", 0, 4)
        told = capsys.readouterr().err
        run_stage(clock, progress, "reference", [1, 2, 3, 4], 1.0)
        for _ in range(2):  # of the second group the frames begin anew
            progress("frames", 0, 2)
            run_stage(clock, progress, "frames", [1, 2], 3.0)
    assert told == "isosample: reference: begun\n"
    frames = ["isosample: frames: begun", "isosample: frames: 100 % after 6 s"]
    assert capsys.readouterr().err.splitlines() == frames * 2


def test_a_command_without_a_terminal_tells_its_progress_on_standard_error(
    run: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(console, "MOMENT", 0.0)
    np.save("more.npy", np.kron(blob(), np.ones((2, 2, 2), dtype=np.float32)))
    outcome = run("precompute more.npy --tf tf.json --cache meshes")
    assert outcome.status == 0
    lines = [line for line in outcome.err.splitlines() if line.startswith("isosample: extract: ")]
    assert 1 <= len(lines) <= 10
    assert lines[-1].startswith("isosample: extract: 100 % after ")
    assert "extract:" not in outcome.out

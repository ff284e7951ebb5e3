"""`verify` tells every study and fails if one does; what it cannot write it says before the studies run."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import PIL.Image
import pytest

from isosample.compare import studies
from isosample.compare.study import Study

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from cli.harness import Run

pytestmark = pytest.mark.usefixtures("gl")


def study(name: str, order: float) -> Study:
    """One of errors that fall like a power; second order is expected."""
    refinement = np.array([1.0, 2.0, 4.0])
    return Study(
        name=name,
        question="Does the error fall?",
        parameter="refinement",
        refinement=refinement,
        errors=refinement**-order,
        measure="RMSE",
        reason="so it is made",
        expected=(1.9, 2.1),
    )


@pytest.fixture
def seen(monkeypatch: pytest.MonkeyPatch) -> list[bool]:
    """What the studies were asked for; one of the two passes."""
    asked: list[bool] = []

    def run_studies(*, quick: bool, progress: Callable[[str], None] | None) -> Iterator[Study]:
        asked.append(quick)
        for name, order in (("good", 2.0), ("bad", 1.0)):
            if progress is not None:
                progress(name)
            yield study(name, order)

    monkeypatch.setattr(studies, "run_studies", run_studies)
    return asked


def test_a_study_that_fails_is_told_and_is_the_exit_status(run: Run, seen: list[bool]) -> None:
    outcome = run("verify --quick")
    assert (outcome.status, seen) == (1, [True])
    rows = {line.split()[0]: line.split()[-1] for line in outcome.out.splitlines() if line}
    assert (rows["good"], rows["bad"]) == ("passed", "FAILED")
    assert "\n1 of 2 studies passed on " in outcome.out
    assert outcome.err == "isosample: note: good …\nisosample: note: bad …\n"


def test_all_figures_are_json_and_each_study_is_plotted(run: Run, seen: list[bool]) -> None:
    pytest.importorskip("matplotlib")
    outcome = run("verify --json -o checked")
    assert (outcome.status, outcome.err, seen) == (1, "", [False])
    document = json.loads(outcome.out)
    assert document == json.loads(Path("checked/studies.json").read_text(encoding="utf-8"))
    assert [(one["name"], one["passed"]) for one in document["studies"]] == [("good", True), ("bad", False)]
    assert document["studies"][1]["errors"] == [1.0, 0.5, 0.25]
    for name in ("good", "bad"):
        with PIL.Image.open(f"checked/{name}.png") as picture:
            assert picture.format == "PNG"


def test_plots_that_cannot_be_made_are_told_before_the_studies(
    run: Run, seen: list[bool], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    outcome = run("verify -o checked")
    assert (outcome.status, outcome.out, seen) == (2, "", [])
    assert "isosample[plot]" in outcome.err
    assert run("verify").status == 1  # the table needs none


def test_figures_are_kept_where_a_plot_fails(
    run: Run, seen: list[bool], monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("matplotlib")

    def fails(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("isosample.compare.study_plots.plot_study", fails)
    assert run("verify -o checked").status == 2
    kept = json.loads(Path("checked/studies.json").read_text(encoding="utf-8"))
    assert [one["name"] for one in kept["studies"]] == ["good", "bad"]

"""The table of a plan has a line per isovalue, and tells which peaks became sheets and how wide they are."""

from __future__ import annotations

from typing import TYPE_CHECKING

from isosample.cli.plan_table import say_plan
from isosample.transfer.isovalues import plan_isovalues
from isosample.transfer.transfer_function import ControlPoint, TransferFunction

if TYPE_CHECKING:
    import pytest

RED = (1.0, 0.0, 0.0)
TF = TransferFunction(
    [ControlPoint(v, RED, tau) for v, tau in [(2, 0), (3, 1), (4, 0), (5, 0), (5.001, 50), (5.002, 0)]]
)


def test_sheets_have_area_and_width(capsys: pytest.CaptureFixture[str]) -> None:
    say_plan(plan_isovalues(TF, (0, 10), per_slope=0, gradients=lambda values: [0.5] * len(values)))
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == "4 isovalues in the range 0 to 10"
    assert lines[1].endswith("width [voxel]")
    sheet = next(line for line in lines[2:] if " sheet " in line)
    assert sheet.split()[:3] == ["3", "5.001", "sheet"]
    assert sheet.split()[-2:] == ["0.05", "0.004"]  # 0.002 · 50 / 2, and 0.002 / 0.5
    assert lines[-1].startswith("narrow peaks drawn as one sheet each: 1 (")
    assert "sheet" not in lines[-2]


def test_without_sheets_the_table_does_not_speak_of_them(capsys: pytest.CaptureFixture[str]) -> None:
    say_plan(plan_isovalues(TF, (0, 10), per_slope=0))
    out = capsys.readouterr().out
    assert out.startswith("6 isovalues")
    assert "sheet" not in out
    assert out.splitlines()[1].endswith("opacity")

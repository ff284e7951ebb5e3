"""The convergence studies pass, and fail when something is wrong."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from isosample.compare import exact_crossings, studies
from isosample.compare.study import Study
from isosample.compare.study_plots import plot_study
from isosample.errors import InputError
from isosample.integral.data_centric import integrate_lists
from isosample.integral.segment_rule import SegmentRule

if TYPE_CHECKING:
    from pathlib import Path

    import moderngl


def power_law(order: float, **options: Any) -> Study:
    x = np.array([2.0, 4.0, 8.0, 16.0])
    settings: dict[str, Any] = {"expected": (order - 0.1, order + 0.1)} | options
    return Study(
        name="s",
        question="q",
        parameter="p",
        refinement=x,
        errors=3.0 * x**-order,
        measure="m",
        reason="r",
        **settings,
    )


def test_the_order_of_a_power_law_is_its_exponent() -> None:
    for order in (0.5, 1.0, 2.5):
        study = power_law(order)
        assert study.order == pytest.approx(order, abs=1e-12)
        assert study.passed


def test_an_order_outside_the_expected_ones_fails_on_either_side() -> None:
    assert not power_law(2.0, expected=(1.0, 1.5)).passed
    assert not power_law(1.0, expected=(1.5, 2.0)).passed


def test_bounds_are_per_refinement() -> None:
    errors = power_law(1.0).errors
    assert power_law(1.0, expected=None, bounds=errors).passed
    tight = errors.copy()
    tight[2] *= 0.99
    assert not power_law(1.0, expected=None, bounds=tight).passed


@pytest.mark.parametrize("options", [{"bounds": np.ones(4)}, {"expected": None}])
def test_a_study_needs_an_order_or_bounds_not_both(options: dict[str, Any]) -> None:
    with pytest.raises(InputError, match="study s"):
        power_law(1.0, **options)


def test_every_study_passes(gl: moderngl.Context) -> None:
    del gl
    found = list(studies.run_studies(quick=True))
    assert [study.name for study in found if not study.passed] == []
    assert len({study.name for study in found}) == len(found) >= 9
    assert {study.to_dict()["passed"] for study in found} == {True}


def test_a_wrong_segment_rule_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    def another(lists: Any, plan: Any, *, rule: Any, reach: float) -> Any:
        wrong = {SegmentRule.LINEAR: SegmentRule.CONSTANT_FIRST_ORDER, SegmentRule.CUBIC: SegmentRule.LINEAR}
        return integrate_lists(lists, plan, rule=wrong[rule], reach=reach)

    monkeypatch.setattr(exact_crossings, "integrate_lists", another)
    for rule in (SegmentRule.LINEAR, SegmentRule.CUBIC):
        assert not studies.isovalue_study(rule, quick=True).passed


def test_a_plot_is_a_whole_png(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    for study in (power_law(2.0), power_law(1.0, expected=None, bounds=np.ones(4))):
        plot_study(study, tmp_path / "s.png")
        assert (tmp_path / "s.png").read_bytes().startswith(b"\x89PNG")
    assert [path.name for path in tmp_path.iterdir()] == ["s.png"]

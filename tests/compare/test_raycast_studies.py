"""The ray caster's studies tell a rule from a worse one."""

from __future__ import annotations

import numpy as np
import pytest

from isosample.compare import raycast_studies
from isosample.compare.raycast_scenes import ramp, ramp_bound

pytestmark = pytest.mark.usefixtures("gl")


def test_a_rule_of_a_lower_order_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(raycast_studies, "TRAPEZOID", raycast_studies.RIEMANN)
    assert not raycast_studies.trapezoid_study(quick=True).passed
    monkeypatch.setattr(raycast_studies, "RIEMANN", raycast_studies.PRE_INTEGRATED)
    assert not raycast_studies.riemann_study(quick=True).passed


def test_weights_that_are_not_the_integral_and_crossings_that_are_missed_are_found(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(raycast_studies, "EXACT", raycast_studies.SHARE)
    assert not raycast_studies.narrow_peak_study(quick=True).passed
    monkeypatch.setattr(raycast_studies, "SHARE", raycast_studies.PAPER)
    assert not raycast_studies.peak_share_study(quick=True).passed


def test_a_limit_that_is_another_picture_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    scene = ramp(24)
    monkeypatch.setattr(type(scene), "truth", 0.98 * scene.truth)
    assert not raycast_studies.limit_study(quick=True).passed


def test_the_bound_falls_to_what_float32_leaves() -> None:
    scene = ramp(4)
    bounds = np.array([ramp_bound(scene, 1.0 / n) for n in (1, 2, 4, 64)])
    assert np.all(np.diff(bounds) < 0)
    assert bounds[0] / bounds[1] == pytest.approx(4.0, rel=0.05)  # chords alone: order 2
    assert bounds[-1] > 2.0**-24  # roundings

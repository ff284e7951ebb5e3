"""The step that a tolerance needs is found by trying, and said where there is none."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from isosample.defaults import DATA_CENTRIC, PRE_INTEGRATED
from isosample.errors import InputError, OpenGLError
from isosample.rendering import method_costs, raycaster, step_search
from isosample.rendering.camera import Camera
from isosample.rendering.cost_estimate import tolerance_needs
from isosample.rendering.method_choice import choose_method
from isosample.rendering.planning_views import PlanningViews
from isosample.rendering.quality import Quality
from isosample.rendering.raycast_settings import Classification, Integration, RaycastSettings
from isosample.rendering.raycaster import RayCaster, raycast
from isosample.rendering.reference_image import render_reference
from isosample.rendering.step_search import step_for_tolerance
from isosample.volume.analytic import nucleon_like, sample_field
from rendering.scenes import ramp_tf

if TYPE_CHECKING:
    import moderngl

    from isosample.volume.grid import Volume


@pytest.fixture(scope="module")
def volume() -> Volume:
    return sample_field(nucleon_like(), (21,) * 3, lower=(0.0,) * 3, upper=(40.0,) * 3, name="nucleon")


def test_the_step_keeps_the_tolerance_on_its_view_and_none_is_tried_in_vain(
    gl: moderngl.Context, volume: Volume
) -> None:
    tf, camera = ramp_tf(0.3, 0.5, (0.0, 0.6)), Camera.orbit(volume.box, azimuth=20.0, elevation=10.0)
    found = step_for_tolerance(volume, tf, 1 / 500, views=[camera])
    assert found.report["missed"] is None
    size = (step_search.PIXELS,) * 2
    shown = raycast(volume, tf, camera=camera, size=size, raycast=RaycastSettings(step=found.step)).rgba
    truth = render_reference(volume, tf, camera=camera, size=size).rgba
    errors = np.abs(shown - truth).max(axis=-1)
    # The truth of the search is known to a thousandth of the tolerance.
    assert np.quantile(errors, 0.999, method="higher") <= 1.002 / 500
    assert [one["error"] > 1 / 500 for one in found.report["rounds"]] == [True] * (
        len(found.report["rounds"]) - 1
    ) + [False]
    assert found.step < step_search.LONGEST


def test_a_smaller_tolerance_takes_a_shorter_step(gl: moderngl.Context, volume: Volume) -> None:
    tf, camera = ramp_tf(0.3, 0.5, (0.0, 0.6)), Camera.orbit(volume.box, azimuth=20.0)
    coarse, fine = (step_for_tolerance(volume, tf, e, views=[camera]).step for e in (1 / 50, 1 / 1000))
    assert fine < coarse


def test_a_tolerance_out_of_reach_is_told(
    gl: moderngl.Context, volume: Volume, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(step_search, "ROUNDS", 2)
    found = step_for_tolerance(volume, ramp_tf(0.3, 0.5, (0.0, 0.6)), 1e-5, views=[Camera.orbit(volume.box)])
    assert found.report["missed"] == "step"
    assert len(found.report["rounds"]) == 2
    assert found.error == min(one["error"] for one in found.report["rounds"])


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"tolerance": -1.0}, r"tolerance -1.0 must be a number from 1e-05 to 1"),
        ({"tolerance": 1e-9}, r"tolerance 1e-09 must be"),
        ({"tolerance": "1/64"}, r"tolerance '1/64' must be"),
        ({"views": []}, r"views is empty"),
        ({"views": ["front"]}, r"views\[0\] is 'front'; expected a Camera"),
    ],
)
def test_impossible_options_of_a_search_for_a_step_are_refused_before_its_work(
    volume: Volume, monkeypatch: pytest.MonkeyPatch, options: dict[str, Any], message: str
) -> None:
    monkeypatch.setattr(PlanningViews, "trace", refuse)
    tolerance = options.pop("tolerance", 1 / 64)
    with pytest.raises(InputError, match=message):
        step_for_tolerance(volume, ramp_tf(0.3, 0.5, (0.0, 0.6)), tolerance, **options)


def refuse(*_: object, **__: object) -> None:
    raise AssertionError("the truth is traced, though the options are impossible")


def test_a_missing_driver_is_told_before_the_truth_is_traced(
    volume: Volume, monkeypatch: pytest.MonkeyPatch
) -> None:
    def missing() -> None:
        raise OpenGLError("there is none")

    monkeypatch.setattr(PlanningViews, "trace", refuse)
    monkeypatch.setattr(raycaster, "shared_context", missing)
    with pytest.raises(OpenGLError):
        step_for_tolerance(volume, ramp_tf(0.3, 0.5, (0.0, 0.6)), 1 / 64)


def test_a_search_puts_its_volume_on_the_gpu_once(
    gl: moderngl.Context, volume: Volume, monkeypatch: pytest.MonkeyPatch
) -> None:
    made = []

    class Counted(RayCaster):
        def __init__(self, *arguments: Any, **options: Any) -> None:
            made.append(self)
            super().__init__(*arguments, **options)

    monkeypatch.setattr(step_search, "RayCaster", Counted)
    found = step_for_tolerance(
        volume, ramp_tf(0.3, 0.5, (0.0, 0.6)), 1 / 1000, views=[Camera.orbit(volume.box)]
    )
    assert len(found.report["rounds"]) > 1
    assert len(made) == 1


@pytest.mark.parametrize(
    "settings",
    [
        RaycastSettings(),
        RaycastSettings(integration=Integration.TABLE_2D, table_size=64),
        RaycastSettings(integration=Integration.TABLE_3D, table_size=16),
        RaycastSettings(classification=Classification.PEAK_FINDING, adaptive=True),
    ],
)
def test_another_step_gives_the_picture_of_a_ray_caster_that_was_made_with_it(
    gl: moderngl.Context, volume: Volume, settings: RaycastSettings
) -> None:
    tf, camera = ramp_tf(0.3, 0.5, (0.0, 0.6)), Camera.orbit(volume.box, azimuth=20.0, elevation=10.0)
    pictures = []
    with RayCaster(volume, tf, raycast=replace(settings, step=2.0)) as caster:
        for step in (2.0, 0.5):
            caster.set_step(step)
            with RayCaster(volume, tf, raycast=replace(settings, step=step)) as made_with_it:
                expected = made_with_it.render(camera=camera, size=(48, 32)).rgba
            pictures.append(caster.render(camera=camera, size=(48, 32)).rgba)
            np.testing.assert_array_equal(pictures[-1], expected)
        assert np.abs(pictures[0] - pictures[1]).max() > 0.0
        with pytest.raises(InputError, match=r"step 0\.0 must be"):
            caster.set_step(0.0)
        np.testing.assert_array_equal(caster.render(camera=camera, size=(48, 32)).rgba, pictures[-1])


def test_what_tolerances_need_goes_through_the_measured_ones_by_powers(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    names = ("isovalues", "triangles", "surface_search", "ray_search")
    rows = [
        {"tolerance": 0.01, "step": 0.5, **dict.fromkeys(names, 2.0)},
        {"tolerance": 0.0001, "step": 0.05, **dict.fromkeys(names, 200.0)},
    ]
    monkeypatch.setattr(method_costs, "TOLERANCES", rows)
    assert tolerance_needs(0.01)["triangles"] == pytest.approx(2.0)
    assert tolerance_needs(0.001)["triangles"] == pytest.approx(20.0)  # halfway, in powers
    assert tolerance_needs(0.0001)["step"] == pytest.approx(0.05)
    assert tolerance_needs(0.1)["triangles"] == pytest.approx(0.2)
    assert tolerance_needs(0.5)["step"] == step_search.LONGEST  # 0.5 · sqrt(50) is beyond what is tried


def test_a_tolerance_adds_its_search_and_its_load(volume: Volume, monkeypatch: pytest.MonkeyPatch) -> None:
    needs = {"isovalues": 3.0, "triangles": 9.0, "step": 0.25, "surface_search": 7.0, "ray_search": 5.0}
    monkeypatch.setattr(method_costs, "TOLERANCES", [{"tolerance": e, **needs} for e in (1 / 64, 1 / 255)])
    tf, tolerance = ramp_tf(0.3, 0.5, (0.0, 0.6)), 1 / 255
    plain, asked = (
        {
            one.method: one
            for one in choose_method(
                volume,
                tf,
                size=(64, 64),
                software=True,
                quality=Quality(tolerance=e),
            ).estimates
        }
        for e in (None, tolerance)
    )
    # exp(log 5) is 5 up to a few roundings of float64
    expected = plain[PRE_INTEGRATED].prepare_seconds + needs["ray_search"]
    assert asked[PRE_INTEGRATED].prepare_seconds == pytest.approx(expected, rel=1e-12)
    expected = plain[DATA_CENTRIC].prepare_seconds + needs["surface_search"]
    assert asked[DATA_CENTRIC].prepare_seconds > (1.0 - 1e-12) * expected  # and more triangles
    for method in (DATA_CENTRIC, PRE_INTEGRATED):
        assert asked[method].frame_seconds > plain[method].frame_seconds

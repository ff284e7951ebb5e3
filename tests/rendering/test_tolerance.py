"""A plan for a tolerance keeps it on the views, nearly so on others, and says truthfully where it cannot."""

from __future__ import annotations

import json
from functools import cache
from typing import Any

import numpy as np
import pytest

from isosample.errors import InputError
from isosample.rendering import isovalue_search, mesh_search
from isosample.rendering.camera import Camera
from isosample.rendering.error_map import PANELS, ErrorMap
from isosample.rendering.expected_error import expected_error
from isosample.rendering.mesh_search import Stop
from isosample.rendering.pipeline import Renderer, render_surfaces
from isosample.rendering.planning_views import PlanningViews, orbit_views
from isosample.rendering.reference_image import render_reference
from isosample.rendering.settings import Material, RenderSettings, SegmentRule
from isosample.rendering.shown_error import shown_error
from isosample.rendering.tolerance import LOOSENED, SAFETY, TolerancePlan, plan_for_tolerance
from isosample.surfaces.extract import ExtractionSettings, extract_surfaces
from isosample.transfer.isovalue_plan import IsovaluePlan, Reason
from isosample.transfer.isovalues import plan_isovalues
from isosample.transfer.transfer_function import ControlPoint, Isosurface, TransferFunction
from isosample.volume.analytic import nucleon_like, sample_field
from isosample.volume.grid import Volume
from isosample.volume.reconstruction import Reconstruction

BLUE, GOLD = (0.1, 0.3, 1.0), (1.0, 0.7, 0.1)
PIXELS = 24
HELD_OUT = ((60.0, 5.0), (170.0, -50.0))  # azimuth and elevation, far from those of the planning views


@cache
def nucleon(edge: int = 25) -> Volume:
    """Eight bells on a coarse grid."""
    upper = (40.0, 40.0, 40.0)
    return sample_field(nucleon_like(), (edge,) * 3, lower=(0.0, 0.0, 0.0), upper=upper, name="nucleon-like")


@cache
def slab() -> Volume:
    """A field that rises along x alone: meshes are exact."""
    x = np.linspace(0.0, 1.0, 9)
    return Volume(np.broadcast_to(x, (9, 9, 9)).copy(), spacing=(0.125,) * 3, name="slab")


def points(*rows: tuple[float, tuple[float, float, float], float]) -> TransferFunction:
    """Transfer function in shares of the nucleon-like field's largest sample."""
    high = nucleon().value_range[1]
    return TransferFunction([ControlPoint(high * value, color, tau) for value, color, tau in rows])


TENTS = points(
    (0.15, BLUE, 0), (0.3, BLUE, 0.3), (0.45, BLUE, 0), (0.5, GOLD, 0), (0.65, GOLD, 0.8), (0.8, GOLD, 0)
)
RAMP = points((0.1, BLUE, 0), (0.9, GOLD, 0.5), (1.0, GOLD, 0.5))
TFS = {"tents": TENTS, "ramp": RAMP}


@cache
def found(
    tf: str = "tents",
    tolerance: float = 1 / 64,
    reconstruction: Reconstruction = Reconstruction.TRILINEAR,
    **options: Any,
) -> TolerancePlan:
    """Plan for the nucleon-like field, with small views; made once."""
    options = {"pixels": PIXELS, "max_isovalues": 128, **options}
    return plan_for_tolerance(nucleon(), TFS[tf], tolerance, reconstruction=reconstruction, **options)


def errors_on(plan: TolerancePlan, tf: TransferFunction, cameras: list[Camera], volume: Volume) -> Any:
    """Errors of the pixels of several views, by the pictures of an independent call."""
    settings = RenderSettings(segment=SegmentRule.CUBIC)
    size = (PIXELS, PIXELS)
    errors = []
    with Renderer(plan.surfaces, plan.plan) as renderer:
        for camera in cameras:
            drawn = renderer.render(camera=camera, size=size, settings=settings).rgba
            truth = render_reference(
                volume,
                tf,
                camera=camera,
                size=size,
                tolerance=1e-6,
                reconstruction=plan.surfaces.settings.reconstruction,
            ).rgba
            errors.append(np.abs(drawn - truth).max(axis=-1).ravel())
    return np.concatenate(errors)


SCENES = [
    ("tents", Reconstruction.TRILINEAR),
    ("ramp", Reconstruction.TRILINEAR),
    ("tents", Reconstruction.CUBIC),
]


@pytest.mark.usefixtures("gl")
@pytest.mark.parametrize(("tf", "reconstruction"), SCENES)
def test_the_tolerance_is_kept_on_the_planning_views(tf: str, reconstruction: Reconstruction) -> None:
    plan = found(tf, reconstruction=reconstruction)
    assert plan.missed is None
    assert plan.reached <= 1 / 64
    errors = errors_on(plan, TFS[tf], list(orbit_views(nucleon().box)), nucleon())
    assert np.mean(errors > 1 / 64) <= 1e-3
    # the same pictures again: they differ from the report by the truths' 1e-3 · tolerance and by float32
    assert shown_error(errors) == pytest.approx(plan.reached, abs=1e-3 / 64 + 1e-5)


@pytest.mark.usefixtures("gl")
@pytest.mark.parametrize(("tf", "reconstruction"), SCENES)
def test_views_that_were_not_tried_are_nearly_as_good(tf: str, reconstruction: Reconstruction) -> None:
    plan = found(tf, reconstruction=reconstruction)
    cameras = [Camera.orbit(nucleon().box, azimuth=a, elevation=e) for a, e in HELD_OUT]
    errors = errors_on(plan, TFS[tf], cameras, nucleon())
    # not proven, and a different thousandth of the rays is the worst: five thousandths may exceed the tolerance
    assert np.mean(errors > 1 / 64) <= 5e-3


@pytest.mark.usefixtures("gl")
def test_a_smaller_tolerance_takes_at_least_as_many_isovalues_and_triangles() -> None:
    plans = [found(tolerance=tolerance) for tolerance in (1 / 16, 1 / 32, 1 / 64)]
    counts = [len(plan.plan.isovalues) for plan in plans]
    triangles = [sum(plan.surfaces.statistics.triangles) for plan in plans]
    assert counts == sorted(counts)
    assert triangles == sorted(triangles)
    assert counts[0] < counts[-1]
    assert all(plan.reached <= plan.report["tolerance"] for plan in plans)


@pytest.mark.usefixtures("gl")
def test_the_plan_is_deterministic() -> None:
    first, again = (
        plan_for_tolerance(nucleon(), TENTS, 1 / 32, pixels=16, max_isovalues=64) for _ in range(2)
    )
    assert first.plan.to_dict() == again.plan.to_dict()
    assert first.refine == again.refine


@pytest.mark.usefixtures("gl")
def test_too_few_isovalues_are_reported() -> None:
    plan = found(tolerance=1 / 64, max_isovalues=16)
    assert plan.missed == "isovalues"
    assert len(plan.plan.isovalues) <= 16
    assert plan.report["rounds"][-1]["isovalues"] == 16
    assert plan.reached > 1 / 64
    assert plan.report["rounds"][-1]["error"] > SAFETY / 64
    assert "with exact crossings" in plan.report["reason"]
    assert "16" in plan.report["reason"]


@pytest.mark.usefixtures("gl")
def test_control_points_are_kept_even_where_they_are_too_many() -> None:
    plan = found(max_isovalues=1)
    assert plan.missed == "isovalues"
    control = [point.value for point in TENTS.points]
    assert np.isin(control, plan.plan.isovalues).all()


@pytest.mark.usefixtures("gl")
@pytest.mark.parametrize(
    ("options", "words"),
    [({"max_refine": 1}, "refine 1 is the limit"), ({"max_triangles": 1000}, "more than 1000 triangles")],
)
def test_a_mesh_that_is_too_coarse_is_reported(options: dict[str, int], words: str) -> None:
    plan = found(tolerance=1 / 128, **options)
    assert plan.missed == "mesh"
    assert plan.refine == 1
    assert plan.reached > 1 / 128
    looser = (
        LOOSENED[-1] if "max_triangles" in options else 1.0
    )  # fewer isovalues leave room for finer meshes
    assert plan.report["rounds"][-1]["error"] <= looser * SAFETY / 128
    assert words in plan.report["reason"]


@pytest.mark.usefixtures("gl")
def test_refinement_is_used_where_the_mesh_errs() -> None:
    plan = found(tolerance=1 / 64)
    tried = plan.report["refinements"]
    assert plan.refine > 1
    assert [entry["refine"] for entry in tried] == [1, 2, 4, 8, 8, 8][: len(tried)]
    assert tried[0]["error"] > 1 / 64 >= tried[-1]["error"]
    assert tried[0]["above"] > 1e-3 >= tried[-1]["above"]
    assert plan.surfaces.settings.refine == plan.refine
    np.testing.assert_array_equal(plan.surfaces.isovalues, plan.plan.isovalues)


@pytest.mark.slow
@pytest.mark.usefixtures("gl")
def test_a_plan_for_light_tells_what_the_lit_pictures_err() -> None:
    """Recomputed from the library's own pictures: float32, and the truth's thousandth of the tolerance, apart."""
    volume, tf = nucleon(), TransferFunction.suggest(nucleon())
    found = plan_for_tolerance(volume, tf, 1 / 64, pixels=PIXELS, lit=True)
    told = found.report["lit"]
    settings = RenderSettings(material=Material())
    assert tuple(told["material"]) == Material().factors
    errors = []
    for camera in orbit_views(volume.box):
        size = (PIXELS, PIXELS)
        exact = render_reference(volume, tf, camera=camera, size=size, settings=settings).rgba
        rgba = render_surfaces(found.surfaces, found.plan, camera=camera, size=size, settings=settings).rgba
        errors.append(np.abs(rgba - exact).max(axis=-1).ravel())
    expected = float(np.quantile(np.concatenate(errors), 0.999, method="higher"))
    assert told["reached"] == pytest.approx(expected, abs=2e-3 / 64)
    assert told["reached"] > found.reached  # light is known at crossings alone
    assert "lit" not in plan_for_tolerance(volume, tf, 1 / 64, pixels=PIXELS).report


def test_the_report_is_kept_with_the_plan() -> None:
    plan = found()
    stored = IsovaluePlan.from_dict(json.loads(json.dumps(plan.plan.to_dict())))
    assert stored.report == json.loads(json.dumps(plan.report))
    assert Camera.from_dict(stored.report["views"][0]) == orbit_views(nucleon().box)[0]
    assert stored.report["pixels"] == PIXELS
    counts = [entry["isovalues"] for entry in stored.report["rounds"]]
    assert counts == sorted(counts)
    assert counts[-1] == len(stored.isovalues)


@pytest.mark.usefixtures("gl")
def test_given_views_are_used() -> None:
    camera = Camera.orbit(nucleon().box, azimuth=60, elevation=5)
    plan = plan_for_tolerance(nucleon(), RAMP, 1 / 16, views=[camera], pixels=PIXELS)
    assert plan.report["views"] == [camera.to_dict()]
    assert np.mean(errors_on(plan, RAMP, [camera], nucleon()) > 1 / 16) <= 1e-3


@pytest.mark.usefixtures("gl")
def test_isosurfaces_and_sheets_are_kept() -> None:
    tf = TransferFunction(
        [ControlPoint(v, GOLD, tau) for v, tau in [(0.4, 0.0), (0.4001, 2000.0), (0.4002, 0.0)]],
        [Isosurface(0.7, BLUE, 0.5)],
    )
    # the field rises by 0.125 per voxel: the peak is 0.0016 voxels wide
    plan = plan_for_tolerance(slab(), tf, 1 / 64, pixels=PIXELS)
    assert plan.plan.reasons == (Reason.SHEET, Reason.IMPULSE)
    np.testing.assert_allclose(plan.plan.sheet_area, [2000 * 1e-4, 0], rtol=1e-9)
    assert plan.plan.sheet_width[0] == pytest.approx(0.0016, rel=1e-3)
    assert plan.missed is None


@pytest.mark.usefixtures("gl")
def test_nothing_visible_needs_no_isovalues() -> None:
    plan = plan_for_tolerance(nucleon(), points((2.0, BLUE, 0), (3.0, BLUE, 1)), 1 / 64, pixels=8)
    assert len(plan.plan.isovalues) == 0
    assert plan.reached == 0
    assert plan.missed is None


@pytest.mark.usefixtures("gl")
def test_progress_is_told() -> None:
    told: list[tuple[str, int, int]] = []
    plan_for_tolerance(
        nucleon(),
        RAMP,
        1 / 16,
        pixels=8,
        progress=lambda stage, done, total: told.append((stage, done, total)),
    )
    assert list(dict.fromkeys(stage for stage, _, _ in told)) == ["truth", "isovalues", "refine"]
    assert all(0 <= done <= total for _, done, total in told)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"tolerance": 0.0}, "tolerance 0.0 must be a number from 1e-05 to 1"),
        ({"tolerance": float("nan")}, "tolerance nan"),
        ({"tolerance": "1/256"}, "tolerance '1/256'"),
        ({"pixels": 4}, "pixels 4 must be a whole number >= 8"),
        ({"max_isovalues": 0}, "max_isovalues 0"),
        ({"max_triangles": 1.5}, "max_triangles 1.5"),
        ({"max_refine": 3}, "max_refine 3"),
        ({"views": []}, "views is empty"),
        ({"views": ["front"]}, "views\\[0\\] is 'front'; expected a Camera"),
    ],
)
def test_impossible_options_are_refused(options: dict[str, Any], message: str) -> None:
    tolerance = options.pop("tolerance", 1 / 64)
    with pytest.raises(InputError, match=message):
        plan_for_tolerance(nucleon(), RAMP, tolerance, **options)


def test_samples_that_are_not_finite_are_refused() -> None:
    array = nucleon().array.copy()
    array[3, 3, 3] = np.nan
    with pytest.raises(InputError, match="NaN"):
        plan_for_tolerance(Volume(array), RAMP, 1 / 64)


def test_no_more_than_a_thousandth_of_the_rays_exceed_what_is_reached() -> None:
    for count in (100, 999, 1000, 2304, 9216):
        errors = np.random.default_rng(count).random(count)
        assert np.mean(errors > shown_error(errors)) <= 1e-3
    assert shown_error(np.arange(9216.0)) == 9206


def test_error_maps_tell_the_same_of_their_pixels() -> None:
    errors = np.random.default_rng(7).random((48, 48)).astype(np.float32)
    told = ErrorMap(errors, errors, errors).percentiles()
    assert told == dict.fromkeys(PANELS, shown_error(errors))
    # Three pixels of 2304, more than a thousandth, exceed what lies 0.999 of the way from the first to the last.
    assert np.mean(errors > told["mesh"]) <= 1e-3


def test_bands_that_weigh_most_are_divided_and_one_by_its_optics() -> None:
    plan = plan_isovalues(
        TransferFunction([ControlPoint(v, BLUE, tau) for v, tau in [(0, 0), (1, 1), (2, 0), (8, 5), (9, 5)]]),
        (0, 10),
        per_slope=0,
    )
    # bands 0-1, 1-2, 2-8, 8-9 (constant), 9-10 (empty)
    weights = np.array([0.1, 0.2, 0.0, 9.0, 9.0])
    middles = isovalue_search._middles
    assert middles(plan, weights, 0.25, 10) == [5.0, 1.5]  # the wide one by its optics, then the heaviest
    assert middles(plan, weights, 0.5, 10) == [5.0, 1.5, 0.5]
    assert middles(plan, weights, 0.5, 2) == [5.0, 1.5]
    assert middles(plan, weights, 0.5, 0) == []
    assert middles(plan, np.zeros(5), 0.5, 10) == [5.0]


def test_meshes_are_refined_and_flattened_in_turn() -> None:
    steps = mesh_search.steps_of_search(8, 0.004)
    assert [step.refine for step in steps] == [1, 2, 4, 8, 8, 8]
    np.testing.assert_allclose([step.flatness for step in steps[1:]], [0.008, 0.004, 0.002, 0.001, 0.0005])
    assert [step.refine for step in mesh_search.steps_of_search(2, 0.004)] == [1, 2, 2, 2]
    assert [step.refine for step in mesh_search.steps_of_search(1, 0.004)] == [1]


@pytest.mark.parametrize("residuals", [False, True])
def test_meshes_that_are_known_are_those_of_a_fresh_extraction(residuals: bool) -> None:
    settings = ExtractionSettings(residuals=residuals, brick_cells=8)
    known = mesh_search.KnownMeshes(nucleon(), settings)
    for refine, values in [(1, [0.2, 0.4, 0.6]), (2, [0.2, 0.4]), (1, [0.2, 0.3, 0.6]), (2, [0.2, 0.3, 0.4])]:
        found = known.surfaces(np.array(values), mesh_search.Step(refine, 2e-3))
        fresh = extract_surfaces(
            nucleon(), values, refine=refine, flatness=2e-3, residuals=residuals, brick_cells=8
        )
        assert found.statistics.triangles == fresh.statistics.triangles
        assert found.statistics.vertices == fresh.statistics.vertices
        assert found.settings == fresh.settings
        assert found.mesh_errors == fresh.mesh_errors
        for mine, theirs in zip(found.meshes, fresh.meshes, strict=True):
            assert (mine.isovalue, mine.brick) == (theirs.isovalue, theirs.brick)
            np.testing.assert_array_equal(mine.positions, theirs.positions)
            np.testing.assert_array_equal(mine.triangles, theirs.triangles)
    # the second list forgot 0.6, the third one 0.4; refinements are kept apart
    assert found.statistics.levels_reused == 1


@pytest.mark.parametrize(
    ("triangles", "growth"),
    [
        ([100], 4.0),
        ([100, 300], 3.0),
        ([100, 300, 600], 1.5),
        ([100, 300, 900], 3.0),
        ([0, 0], 0.0),
        ([100, 150, 450], 3.0),
    ],
)
def test_how_many_triangles_a_further_refinement_has(triangles: list[int], growth: float) -> None:
    assert mesh_search._next_growth(triangles) == pytest.approx(growth)


@pytest.mark.parametrize(
    ("rounds", "expected"),
    [
        ([(100, 0.5, 0.1)], None),
        (
            [(300, 0.5, 0.1)],
            Stop("a finer one could have 1200 triangles, more than 1000", too_many_triangles=True),
        ),
        ([(100, 0.5, 0.1), (300, 0.4, 0.1)], None),
        ([(100, 0.5, 0.1), (300, 0.5, 0.05)], None),
        (
            [(100, 0.5, 0.1), (300, 0.48, 0.095)],
            Stop("refining from refine 1 to refine 2, flatness 0.004 did not help"),
        ),
        (
            [(100, 0.5, 0.1), (101, 0.5, 0.1)],
            None,
        ),  # hardly an edge was divided, and the next step divides some
        (
            [(100, 0.5, 0.1), (101, 0.5, 0.1), (120, 0.49, 0.1)],
            Stop("refining from refine 1 to refine 4, flatness 0.002 did not help"),
        ),
        (
            [(100, 0.5, 0.1), (150, 0.4, 0.1), (200, 0.3, 0.1), (250, 0.29, 0.1)],
            Stop("refining from refine 4, flatness 0.002 to refine 4, flatness 0.001 did not help"),
        ),
        (
            [(200, 0.5, 0.1), (600, 0.2, 0.05)],
            Stop("a finer one could have 1800 triangles, more than 1000", too_many_triangles=True),
        ),
    ],
)
def test_when_a_mesh_is_not_refined_further(
    rounds: list[tuple[int, float, float]], expected: Stop | None
) -> None:
    entries = [
        {**step._asdict(), "triangles": triangles, "error": error, "above": above}
        for step, (triangles, error, above) in zip(mesh_search.steps_of_search(4, 2e-3), rounds, strict=False)
    ]
    assert mesh_search._no_further(entries, 1000) == expected


def test_the_truth_is_that_of_the_reference() -> None:
    cameras = orbit_views(nucleon().box)[:2]
    views = PlanningViews.trace(
        nucleon(), RAMP, cameras, 8, tolerance=1e-2, reconstruction=Reconstruction.TRILINEAR
    )
    size = (8, 8)
    pictures = [render_reference(nucleon(), RAMP, camera=camera, size=size).rgba for camera in cameras]
    expected = np.concatenate([picture.reshape(-1, 4) for picture in pictures])
    np.testing.assert_allclose(views.truth, expected, rtol=0, atol=1e-5 + 1e-7)
    assert views.errors(np.add(expected, [0, 0, 0, 0.5])) == pytest.approx(0.5, abs=2e-5)


def test_a_view_is_expected_to_err_as_much_more_as_its_estimates_are_larger() -> None:
    report = {"reached": 0.004, "estimates": {"indicator": 0.02, "interval": 0.5, "mesh": 0.0}}
    same = {"indicator": 0.02, "interval": 0.9, "mesh": 0.3}
    assert expected_error(same, report) == 0.004  # a mesh that showed no error on the views says nothing
    assert expected_error(same | {"indicator": 0.06}, report) == pytest.approx(0.012)
    assert expected_error(same | {"indicator": 0.001}, report) == 0.004  # never less than what was reached
    report["estimates"] = {"indicator": 0.02, "interval": 0.5, "mesh": 0.1}
    assert expected_error(same, report) == pytest.approx(0.012)

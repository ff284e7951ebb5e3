"""The load of a scene is estimated without rendering, and the choice follows the estimated seconds."""

from __future__ import annotations

import json
import math
import time
from dataclasses import replace
from typing import TYPE_CHECKING, Any, cast

import numpy as np
import numpy.typing as npt
import pytest

from isosample.defaults import CHOSEN_FROM, DATA_CENTRIC, PEAK_FINDING, PRE_INTEGRATED
from isosample.errors import InputError
from isosample.rendering import cost_estimate
from isosample.rendering.camera import Camera, Projection
from isosample.rendering.cost_estimate import FEATURES, costs_of, estimate_cost
from isosample.rendering.method_choice import choose_method
from isosample.rendering.pipeline import render
from isosample.rendering.quality import Quality, plan_for
from isosample.rendering.raycast_settings import RaycastSettings
from isosample.rendering.raycaster import raycast
from isosample.rendering.scene_load import LoadEstimator, SceneLoad
from isosample.rendering.settings import ClipPlane, Material, RenderSettings
from isosample.transfer.control_points import ControlPoint, Isosurface
from isosample.transfer.transfer_function import TransferFunction
from isosample.volume.analytic import SphereDistance, nucleon_like, sample_field
from isosample.volume.cell_sample import sample_cells
from isosample.volume.grid import Volume
from isosample.volume.lazy import LazySamples
from isosample.volume.reconstruction import Reconstruction
from rendering.scenes import ramp_tf

if TYPE_CHECKING:
    import moderngl

SIZE = (64, 48)


def ball(samples: int = 49) -> Volume:
    """Distance from the middle of a box of 48 world units along an edge."""
    field = SphereDistance(centre=(24.0, 24.0, 24.0), radius=0.0)
    return sample_field(field, (samples,) * 3, lower=(0.0,) * 3, upper=(48.0,) * 3, name="ball")


def spheres(*radii: float) -> TransferFunction:
    return TransferFunction([], isosurfaces=[Isosurface(radius, (1.0, 1.0, 1.0), 0.1) for radius in radii])


def load_of(
    volume: Volume,
    tf: TransferFunction,
    camera: Camera | None = None,
    settings: RenderSettings | None = None,
    step: float = 0.5,
) -> SceneLoad:
    estimator = LoadEstimator(volume, tf, Reconstruction.TRILINEAR)
    plan = plan_for(volume, tf, Quality())
    cameras = [camera or Camera.orbit(volume.box, aspect=SIZE[0] / SIZE[1])]
    return estimator.load(plan, cameras, SIZE, settings or RenderSettings(), step=step)


def test_a_sphere_has_the_fragments_of_its_disc_twice() -> None:
    volume, radius = ball(), 15.0
    camera = Camera.orbit(volume.box, azimuth=30.0, aspect=SIZE[0] / SIZE[1])
    assert camera.height is not None
    pixel = camera.height / SIZE[1]
    expected = 2.0 * math.pi * radius**2 / pixel**2
    # Marching cubes crosses about 1.5 · area cells of 1 voxel; some hundred coarse rays meet the disc, whose rim cuts
    # blocks of 1.5 voxels: 1 / sqrt(500) is 5 %.
    found = load_of(volume, spheres(radius), camera)
    assert found.fragments == pytest.approx(expected, rel=0.15)
    assert found.resolved_fragments == pytest.approx(found.fragments)
    assert found.isovalues == 1
    assert found.triangles == pytest.approx(3.0 * 4.0 * math.pi * radius**2, rel=0.15)


def test_a_medium_has_the_samples_of_its_way() -> None:
    volume = ball(33)
    tf = TransferFunction([ControlPoint(-1.0, (1, 1, 1), 1e-3), ControlPoint(100.0, (1, 1, 1), 1e-3)])
    camera = Camera.orbit(volume.box)
    assert camera.height is not None
    share = 48.0**2 / (camera.height**2 * SIZE[0] / SIZE[1])
    estimator = LoadEstimator(volume, tf, Reconstruction.TRILINEAR)
    plan = plan_for(volume, tf, Quality())
    wide = Camera.orbit(volume.box, aspect=SIZE[0] / SIZE[1])
    found = estimator.load(plan, [wide], SIZE, RenderSettings(), step=0.25)
    assert found.samples == pytest.approx(share * SIZE[0] * SIZE[1] * 32 / 0.25, rel=0.08)
    half = estimator.load(
        plan, [wide], SIZE, RenderSettings(clip_planes=(ClipPlane(0, 0, 1, -24.0),)), step=0.25
    )
    assert half.samples == pytest.approx(0.5 * found.samples, rel=0.03)


def test_what_is_opaque_hides_samples_and_not_fragments_from_the_build_pass() -> None:
    volume = ball()
    thin, dense = (ramp_tf(10.0, 23.0, (tau, tau)) for tau in (0.001, 50.0))
    clear, hidden = load_of(volume, thin), load_of(volume, dense)
    assert hidden.samples < 0.3 * clear.samples
    assert hidden.fragments == pytest.approx(clear.fragments)
    assert hidden.resolved_fragments <= hidden.fragments


@pytest.mark.parametrize("projection", Projection)
@pytest.mark.parametrize("noise", [0.0, 0.05])
def test_estimates_are_near_the_counts_of_the_pictures(
    gl: moderngl.Context, projection: Projection, noise: float
) -> None:
    volume = sample_field(nucleon_like(), (48,) * 3, lower=(0.0,) * 3, upper=(40.0,) * 3, name="nucleon")
    grain = np.random.default_rng(3).normal(0.0, 1.0, volume.array.shape)
    volume = Volume(
        (volume.array.astype(np.float64) + noise * grain).astype(np.float32), spacing=volume.spacing
    )
    tf = TransferFunction([*ramp_tf(0.2, 0.3, (0.0, 0.2)).points, *ramp_tf(0.6, 0.7, (0.3, 0.0)).points])
    camera = Camera.orbit(
        volume.box, azimuth=30.0, elevation=20.0, aspect=SIZE[0] / SIZE[1], projection=projection
    )
    found = load_of(volume, tf, camera)
    surfaces = render(volume, tf, camera=camera, size=SIZE).stats
    rays = raycast(volume, tf, camera=camera, size=SIZE).stats
    # Costs go with these numbers: a quarter off in one of them moves a choice only where it hardly matters.
    assert found.triangles == pytest.approx(surfaces["triangles"]["extracted"], rel=0.25)
    assert found.fragments == pytest.approx(surfaces["fragments"], rel=0.25)
    pixels = SIZE[0] * SIZE[1]
    assert found.samples == pytest.approx(rays["samples_per_ray"]["mean"] * pixels, rel=0.25)


@pytest.mark.parametrize("what", ["masked", "constant", "nothing visible", "thin"])
def test_odd_volumes_have_a_load(what: str) -> None:
    volume, tf = ball(9), ramp_tf(5.0, 20.0, (0.1, 0.2))
    samples = np.array(volume.array)
    if what == "masked":
        samples[:4] = np.nan
    elif what == "constant":
        samples[:] = 10.0
    elif what == "thin":
        samples = samples[:2]
    elif what == "nothing visible":
        tf = ramp_tf(500.0, 600.0, (0.1, 0.2))
    found = load_of(Volume(samples), tf)
    assert all(np.isfinite(number) and number >= 0.0 for number in found.to_dict().values())
    assert json.loads(json.dumps(found.to_dict())) == found.to_dict()
    assert (found.samples > 0.0) == (what != "nothing visible")


def test_the_kept_costs_name_what_a_load_has() -> None:
    for software in (True, False):
        costs = costs_of(software=software)
        assert {stage: tuple(names) for stage, names in costs.items() if stage != "factors"} == FEATURES
        numbers = [cost for stage in FEATURES for cost in costs[stage].values()]
        assert all(math.isfinite(cost) and cost >= 0.0 for cost in numbers)
        assert all(max(costs[stage].values()) > 0.0 for stage in FEATURES)


def test_seconds_are_sums_of_costs_times_amounts() -> None:
    load = load_of(ball(17), spheres(9.0))
    costs = {
        f"{DATA_CENTRIC} prepare": {"start": 2.0, "triangles": 1e-3},
        f"{DATA_CENTRIC} frame": {"fragments": 1e-4},
        "factors": {f"{DATA_CENTRIC} frame shaded": 3.0},
    }
    plain = estimate_cost(DATA_CENTRIC, load, costs, frames=10)
    assert plain.prepare_seconds == pytest.approx(2.0 + 1e-3 * load.triangles)
    assert plain.total_seconds == pytest.approx(plain.prepare_seconds + 10 * 1e-4 * load.fragments)
    lit = estimate_cost(DATA_CENTRIC, load, costs, shaded=True, smooth=True)
    assert (lit.prepare_seconds, lit.frame_seconds) == (plain.prepare_seconds, 3.0 * plain.frame_seconds)


@pytest.mark.parametrize("software", [True, False])
def test_the_cheapest_is_chosen_and_all_are_told(software: bool) -> None:
    volume, tf = ball(25), ramp_tf(5.0, 20.0, (0.1, 0.2))
    for frames in (1, 1000):
        cameras = [Camera.orbit(volume.box)] * frames
        found = choose_method(volume, tf, cameras=cameras, size=SIZE, software=software)
        assert [one.method for one in found.estimates] in (
            [DATA_CENTRIC, PRE_INTEGRATED],
            [PRE_INTEGRATED, DATA_CENTRIC],
        )
        assert found.method == min(found.estimates, key=lambda one: one.total_seconds).method
        assert found.estimates[0].frames == frames
        assert ("assumed" in found.measured) == (not software)
        assert json.loads(json.dumps(found.to_dict())) == found.to_dict()


def test_peak_finding_stands_for_the_ray_caster_where_peaks_are_sharp() -> None:
    volume = ball(25)
    near_dirac = TransferFunction(
        [ControlPoint(v, (1, 1, 1), t) for v, t in ((9.9999, 0.0), (10.0, 1e3), (10.0001, 0.0))]
    )
    for tf in (spheres(10.0), near_dirac):
        found = choose_method(volume, tf, size=SIZE, software=True)
        assert {one.method for one in found.estimates} == {DATA_CENTRIC, PEAK_FINDING}
        only = choose_method(volume, tf, size=SIZE, software=True, among=[PRE_INTEGRATED])
        assert only.method == PRE_INTEGRATED


def test_light_and_smoothness_cost_what_was_measured() -> None:
    volume, tf = ball(17), ramp_tf(5.0, 20.0, (0.1, 0.2))
    plain = choose_method(volume, tf, size=SIZE, software=True)
    lit = choose_method(volume, tf, size=SIZE, software=True, settings=RenderSettings(material=Material()))
    factors = costs_of(software=True)["factors"]
    for one, other in zip(
        sorted(plain.estimates, key=lambda e: e.method),
        sorted(lit.estimates, key=lambda e: e.method),
        strict=True,
    ):
        ratio = other.frame_seconds / one.frame_seconds
        assert ratio == pytest.approx(factors[f"{one.method} frame shaded"])


def test_a_longer_step_is_cheaper_for_the_ray_caster_alone() -> None:
    volume, tf = ball(25), ramp_tf(5.0, 20.0, (0.1, 0.2))
    coarse, fine = (
        {
            one.method: one.frame_seconds
            for one in choose_method(
                volume, tf, size=SIZE, software=True, raycast=replace(RaycastSettings(), step=step)
            ).estimates
        }
        for step in (2.0, 0.125)
    )
    assert coarse[DATA_CENTRIC] == fine[DATA_CENTRIC]
    assert coarse[PRE_INTEGRATED] < fine[PRE_INTEGRATED]


@pytest.mark.parametrize("among", [(), ("post-classified",), (*CHOSEN_FROM, "best")])
def test_unknown_methods_are_refused(among: tuple[str, ...]) -> None:
    with pytest.raises(InputError, match="data-centric, pre-integrated, peak-finding"):
        choose_method(ball(9), spheres(5.0), among=among, software=True)


@pytest.mark.parametrize(
    "quality",
    [
        Quality(refine=8),
        Quality(refine="auto"),
        Quality(details=5),
        Quality(tolerance=1 / 64, refine=1),
        Quality(tolerance=1 / 64, max_isovalues=9),
    ],
)
def test_a_quality_whose_costs_are_not_measured_is_refused_by_name(quality: Quality) -> None:
    other = Quality(tolerance=quality.tolerance)
    (name,) = (n for n in ("refine", "details", "max_isovalues") if getattr(quality, n) != getattr(other, n))
    with pytest.raises(InputError, match=f"{name} {getattr(quality, name)!r}: what it costs is not measured"):
        choose_method(ball(9), spheres(5.0), size=SIZE, software=True, quality=quality)


def test_methods_are_compared_on_one_field() -> None:
    volume, tf = ball(17), ramp_tf(5.0, 20.0, (0.1, 0.2))
    smooth = RaycastSettings(reconstruction=Reconstruction.CUBIC)
    with pytest.raises(InputError, match="quality has the reconstruction trilinear, and raycast cubic"):
        choose_method(volume, tf, size=SIZE, software=True, quality=Quality(), raycast=smooth)
    by_rays = choose_method(volume, tf, size=SIZE, software=True, raycast=smooth)
    quality = Quality(reconstruction=Reconstruction.CUBIC)
    by_surfaces = choose_method(volume, tf, size=SIZE, software=True, quality=quality)
    assert by_rays.load == by_surfaces.load
    seconds, expected = (
        {one.method: (one.prepare_seconds, one.frame_seconds) for one in found.estimates}
        for found in (by_rays, by_surfaces)
    )
    assert seconds == expected


class Chunked(LazySamples):
    """Samples in memory that stand for a chunked file, and tell how many slices were decoded."""

    def __init__(self, samples: npt.NDArray[np.float32], chunk: int) -> None:
        super().__init__(samples.shape, samples.dtype, chunks=(chunk,) * 3)
        self.samples = samples
        self.slices_read = 0

    def read(self, block: tuple[slice, slice, slice]) -> npt.NDArray[np.float32]:
        depth = self.chunks[0]
        self.slices_read += (-(-block[0].stop // depth) - block[0].start // depth) * depth
        return self.samples[block].copy()


def in_file(samples: Chunked, spacing: tuple[float, float, float] = (1.0, 1.0, 1.0)) -> Volume:
    return Volume(cast("Any", samples), spacing=spacing)


@pytest.mark.parametrize("chunk", [1, 8, 16, 64])
def test_chunks_are_decoded_once_for_a_sample_of_the_cells(chunk: int) -> None:
    volume = ball(64)
    chunked = Chunked(np.asarray(volume.array), chunk)
    found = sample_cells(in_file(chunked, volume.spacing), 2000)
    for one, other in zip(found, sample_cells(volume, 2000), strict=True):
        np.testing.assert_array_equal(one, other)
    # A pair of slices may lie on both sides of the border of two layers of chunks: these are read once more.
    assert chunked.slices_read <= 2 * 64


def test_samples_that_stay_in_their_file_are_read_once_more() -> None:
    volume = ball(25)
    tf = ramp_tf(5.0, 20.0, (0.1, 0.2))
    chunked = in_file(Chunked(np.asarray(volume.array), 8), volume.spacing)
    held, lazy = (
        choose_method(v, tf, size=SIZE, software=True, spent_seconds=100.0).estimates
        for v in (volume, chunked)
    )
    assert all(one.read_seconds == 0.0 for one in held)
    assert all(one.read_seconds >= 0.0 for one in lazy)
    for one in (*held, *lazy):
        assert one.spent_seconds > 100.0
        parts = one.spent_seconds + one.read_seconds + one.prepare_seconds + one.frame_seconds
        assert one.total_seconds == pytest.approx(parts)


def test_the_seconds_of_reading_go_with_the_number_of_samples(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = iter([10.0, 10.5])
    volume = ball(49)
    chunked = in_file(Chunked(np.asarray(volume.array), 7))
    block = next(chunked.blocks())
    monkeypatch.setattr(time, "process_time", lambda: next(clock))
    assert cost_estimate.seconds_to_read(chunked) == 0.5 * 49**3 / block.size
    assert cost_estimate.seconds_to_read(volume) == 0.0

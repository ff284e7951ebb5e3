"""Every classification of a ray along which the field is known, against quadrature in float64.

The limits of float32: what a ray composites is a sum of at most a few hundred products, 1e-6; a narrow peak's place
and slope are known to 2^-24 of a cell, see `NARROW_ERROR`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from isosample.rendering.frame import shared_constants
from isosample.rendering.raycast_settings import (
    Classification,
    Crossings,
    Integration,
    PeakMode,
    PeakWeight,
    Quadrature,
    RaycastSettings,
    TableDtype,
    TransferLookup,
)
from isosample.rendering.transfer_texture import has_few_bands
from isosample.transfer.peaks import NO_PEAK
from isosample.transfer.transfer_function import ControlPoint, Isosurface, TransferFunction
from isosample.transfer.value_bands import ValueBands
from rendering.stretches import Caster, integrated

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    import moderngl
    import numpy.typing as npt

    from isosample.volume.grid import F64

RED, GREEN, BLUE, WHITE = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0), (1.0, 1.0, 1.0)
ROUNDING = 2e-6
WIDTH = 1e-4
NARROW_ERROR = 2.0 * 2.0**-24 / WIDTH  # of a narrow peak: its width of values is known to two roundings

SMOOTH = TransferFunction(
    [
        ControlPoint(0.1, RED, 0.0),
        ControlPoint(0.4, GREEN, 5.0),
        ControlPoint(0.8, BLUE, 0.5),
        ControlPoint(1.0, RED, 2.0),
    ]
)
STEPS = TransferFunction(
    [
        ControlPoint(0.1, RED, 0.0),
        ControlPoint(0.3, (1.0, 0.5, 0.0), 5.0),
        ControlPoint(0.5, GREEN, 1.0),
        ControlPoint(0.5, BLUE, 4.0),
        ControlPoint(0.8, WHITE, 0.0),
    ],
    [Isosurface(0.4, WHITE, 0.3), Isosurface(0.9, (1.0, 1.0, 0.0), 0.8)],
)
DIRAC = TransferFunction(
    [
        ControlPoint(0.5 - WIDTH / 2, BLUE, 0.0),
        ControlPoint(0.5, BLUE, 2.0 / WIDTH),
        ControlPoint(0.5 + WIDTH / 2, BLUE, 0.0),
    ]
)
MANY = TransferFunction(
    [], [Isosurface(v, (1.0 - v, v, 0.5), 0.05) for v in np.linspace(0.005, 0.995, 128).tolist()]
)
LINES = [(0.0, 1.0, 0.0, 0.0), (1.0, -1.0, 0.0, 0.0), (0.2, 0.5, 0.0, 0.0), (0.45, 0.0, 0.0, 0.0)]
CUBICS = [(0.2, 0.5, 1.0, -1.0), (0.95, -3.0, 4.0, -1.2), (0.1, 2.6, -2.4, 0.3)]

MEANS = RaycastSettings(integration=Integration.TABLE_1D)
POST = RaycastSettings(classification=Classification.POST_CLASSIFIED)
PRE = RaycastSettings(classification=Classification.PRE_INTEGRATED)


def peaks(
    crossings: Crossings, weight: PeakWeight, mode: PeakMode = PeakMode.BOTH, count: int = 4
) -> RaycastSettings:
    """Peak finding."""
    return RaycastSettings(
        classification=Classification.PEAK_FINDING,
        crossings=crossings,
        peak_weight=weight,
        peak_mode=mode,
        peaks=count,
    )


EXACT = peaks(Crossings.EXACT, PeakWeight.INTEGRAL)
SECANT = peaks(Crossings.SECANT, PeakWeight.INTEGRAL)


@pytest.fixture(scope="module")
def caster(gl: moderngl.Context) -> Iterator[Caster]:
    """Compiles every variant once."""
    made = Caster(gl)
    yield made
    made.release()


def errors(
    caster: Caster,
    transfer_function: TransferFunction,
    settings: RaycastSettings,
    curves: Sequence[tuple[float, ...]],
    steps: int,
) -> F64:
    """(n,) largest error of radiance and opacity of every ray."""
    expected = np.array([integrated(transfer_function, curve) for curve in curves])
    found, _ = caster.cast(transfer_function, settings, curves, steps)
    worst: F64 = np.abs(found - expected).max(axis=1)
    return worst


@pytest.mark.parametrize(("quadrature", "order"), [(Quadrature.RIEMANN, 1), (Quadrature.TRAPEZOID, 2)])
def test_post_classification_converges_in_its_order(
    caster: Caster, quadrature: Quadrature, order: int
) -> None:
    settings = RaycastSettings(classification=Classification.POST_CLASSIFIED, quadrature=quadrature)
    coarse, fine = (np.linalg.norm(errors(caster, SMOOTH, settings, CUBICS, steps)) for steps in (32, 128))
    # The kinks of the transfer function fall anywhere between samples: half an order of scatter.
    assert np.log2(coarse / fine) / 2.0 > order - 0.5


@pytest.mark.parametrize(
    "transfer_function", [SMOOTH, STEPS, DIRAC, MANY], ids=["smooth", "steps", "dirac", "many"]
)
@pytest.mark.parametrize("settings", [PRE, EXACT, SECANT], ids=["pre-integrated", "exact", "secant"])
@pytest.mark.parametrize("steps", [1, 8])
def test_a_linear_field_is_integrated_exactly_by_any_steps(
    caster: Caster, transfer_function: TransferFunction, settings: RaycastSettings, steps: int
) -> None:
    if settings is SECANT and transfer_function is MANY:
        pytest.skip("the table holds four peaks between two samples, see the test of that")
    found = errors(caster, transfer_function, settings, LINES, steps)
    quadrature = 1.6**6 * 5e-7 if settings is EXACT and steps == 1 else 0.0  # see the test of cubic fields
    assert found.max() < ROUNDING + quadrature + (NARROW_ERROR if transfer_function is DIRAC else 0.0)


@pytest.mark.parametrize(
    "transfer_function", [SMOOTH, STEPS, DIRAC, MANY], ids=["smooth", "steps", "dirac", "many"]
)
@pytest.mark.parametrize("steps", [1, 3, 64])
def test_exact_crossings_integrate_a_cubic_field_by_any_steps(
    caster: Caster, transfer_function: TransferFunction, steps: int
) -> None:
    # Three Gauss nodes err by f^(6) / 2016000 on a panel of optical depth 1: 5e-7 where the extinction is constant, and
    # r^6 times that where it changes by a factor r: 3 over a whole cell of these curves, 1.6 over a third of it.
    limit = ROUNDING + (3.0 if steps == 1 else 1.6) ** 6 * 5e-7
    found = errors(caster, transfer_function, EXACT, CUBICS, steps)
    assert found.max() < limit + (NARROW_ERROR if transfer_function is DIRAC else 0.0)


@pytest.mark.parametrize("settings", [PRE, SECANT], ids=["pre-integrated", "secant"])
@pytest.mark.parametrize("transfer_function", [SMOOTH, STEPS], ids=["smooth", "steps"])
def test_linear_parts_of_a_cubic_field_converge_in_second_order(
    caster: Caster, transfer_function: TransferFunction, settings: RaycastSettings
) -> None:
    coarse, fine = (
        np.linalg.norm(errors(caster, transfer_function, settings, CUBICS, steps)) for steps in (16, 64)
    )
    assert np.log2(coarse / fine) / 2.0 > 1.5


def test_a_peak_between_two_samples_is_missed_by_post_classification_and_found_by_the_others(
    caster: Caster,
) -> None:
    line = [(0.21, 0.53, 0.0, 0.0)]
    expected = integrated(DIRAC, line[0])
    assert expected[3] == pytest.approx(-np.expm1(-1.0 / 0.53), rel=1e-6)  # area 1 over the slope
    found, _ = caster.cast(DIRAC, POST, line, 16)
    assert found[0, 3] == 0.0
    for settings in (PRE, EXACT, SECANT):
        assert errors(caster, DIRAC, settings, line, 16).max() < ROUNDING + NARROW_ERROR


@pytest.mark.parametrize("crossings", list(Crossings))
@pytest.mark.parametrize("slope", [0.3, -0.7])
def test_the_paper_s_weight_is_the_extinction_over_a_length_of_one(
    caster: Caster, crossings: Crossings, slope: float
) -> None:
    tent = TransferFunction(
        [ControlPoint(0.4, RED, 0.0), ControlPoint(0.5, RED, 0.7), ControlPoint(0.6, RED, 0.0)]
    )
    settings = peaks(crossings, PeakWeight.PAPER, PeakMode.PEAK_ONLY)
    found, counts = caster.cast(tent, settings, [(0.5 - 0.4 * slope, slope, 0.0, 0.0)], 7)
    assert found[0, 3] == pytest.approx(-np.expm1(-0.7), abs=ROUNDING)
    assert counts[0, 1] == 1


def test_the_modes_show_what_they_are_named_after(caster: Caster) -> None:
    tent = TransferFunction(
        [ControlPoint(0.4, RED, 0.0), ControlPoint(0.5, RED, 0.7), ControlPoint(0.6, RED, 0.0)]
    )
    line = [(0.1, 0.77, 0.0, 0.0)]
    found = {
        mode: caster.cast(tent, peaks(Crossings.SECANT, PeakWeight.PAPER, mode), line, 40)[0][0, 3]
        for mode in PeakMode
    }
    through = {mode: 1.0 - opacity for mode, opacity in found.items()}
    samples = caster.cast(tent, POST, line, 40)[0][0, 3]
    assert found[PeakMode.DVR_ONLY] == samples
    assert through[PeakMode.BOTH] == pytest.approx(
        through[PeakMode.PEAK_ONLY] * through[PeakMode.DVR_ONLY], abs=ROUNDING
    )
    assert found[PeakMode.PEAK_ONLY] < found[PeakMode.XOR] < found[PeakMode.BOTH]


def test_shader_and_table_mean_the_same_by_no_peak() -> None:
    assert shared_constants()["NO_PEAK"] == NO_PEAK


def test_dvr_only_counts_no_root(caster: Caster) -> None:
    _, counts = caster.cast(STEPS, peaks(Crossings.EXACT, PeakWeight.PAPER, PeakMode.DVR_ONLY), CUBICS, 16)
    assert not counts.any()


@pytest.mark.parametrize("count", [1, 2, 3, 4])
def test_as_many_peaks_are_found_between_two_samples_as_are_asked_for(caster: Caster, count: int) -> None:
    close = TransferFunction([], [Isosurface(v, WHITE, 0.5) for v in (0.41, 0.42, 0.43, 0.44, 0.45)])
    found, counts = caster.cast(
        close, peaks(Crossings.SECANT, PeakWeight.PAPER, count=count), [LINES[0], LINES[1]], 1
    )
    assert counts[:, 1].tolist() == [count, count]
    np.testing.assert_allclose(found[:, 3], 1.0 - 0.5**count, atol=ROUNDING)


@pytest.mark.parametrize(
    "settings", [PRE, EXACT, peaks(Crossings.SECANT, PeakWeight.PAPER)], ids=["pre", "exact", "secant"]
)
def test_a_falling_stretch_meets_the_surfaces_in_the_other_order(
    caster: Caster, settings: RaycastSettings
) -> None:
    two = TransferFunction([], [Isosurface(0.3, RED, 0.75), Isosurface(0.6, BLUE, 0.75)])
    found, _ = caster.cast(two, settings, [LINES[0], LINES[1]], 1)
    np.testing.assert_allclose(found[0, :3], [0.75, 0.0, 0.1875], atol=ROUNDING)
    np.testing.assert_allclose(found[1, :3], [0.1875, 0.0, 0.75], atol=ROUNDING)


@pytest.mark.parametrize(
    "settings", [PRE, EXACT, peaks(Crossings.SECANT, PeakWeight.PAPER)], ids=["pre", "exact", "secant"]
)
@pytest.mark.parametrize("steps", [2, 4, 8])
def test_a_sample_equal_to_an_isovalue_is_one_crossing(
    caster: Caster, settings: RaycastSettings, steps: int
) -> None:
    half = TransferFunction([], [Isosurface(0.5, RED, 0.25)])
    # Through the value at a sample, upwards and downwards, and touching it from below (twice) and from above (never).
    curves = [LINES[0], LINES[1], (0.25, 1.0, -1.0, 0.0), (0.75, -1.0, 1.0, 0.0)]
    found, counts = caster.cast(half, settings, curves, steps)
    assert counts[:, 1].tolist() == [1, 1, 2, 0]
    np.testing.assert_allclose(found[:, 3], [0.25, 0.25, 1.0 - 0.75**2, 0.0], atol=ROUNDING)


@pytest.mark.parametrize("value", [0.0, 0.5, 1.0])
@pytest.mark.parametrize("settings", [POST, PRE, EXACT, SECANT], ids=["post", "pre", "exact", "secant"])
def test_a_plateau_equal_to_a_control_point_has_its_extinction(
    caster: Caster, settings: RaycastSettings, value: float
) -> None:
    ramp = TransferFunction(
        [ControlPoint(0.0, RED, 1.0), ControlPoint(0.5, GREEN, 2.0), ControlPoint(1.0, BLUE, 3.0)]
    )
    assert errors(caster, ramp, settings, [(value, 0.0, 0.0, 0.0)], 8).max() < ROUNDING


def test_a_grazing_bump_between_two_samples_is_found_by_exact_crossings_alone(caster: Caster) -> None:
    half = TransferFunction([], [Isosurface(0.5, RED, 0.25)])
    bump = [(0.4, 0.5, -0.5, 0.0)]  # up to 0.525 in the middle
    assert caster.cast(half, peaks(Crossings.SECANT, PeakWeight.PAPER), bump, 1)[0][0, 3] == 0.0
    assert caster.cast(half, EXACT, bump, 1)[0][0, 3] == pytest.approx(1.0 - 0.75**2, abs=ROUNDING)


def test_integrals_over_the_value_give_the_opacity_of_a_straight_line_of_any_length(caster: Caster) -> None:
    expected = np.array([integrated(SMOOTH, line)[3] for line in LINES])
    for steps in (1, 3, 50):
        found, _ = caster.cast(SMOOTH, MEANS, LINES, steps)
        # Integrals up to 2.1 are read off to 4 roundings at each end of a step and divided by the slope of the line, at
        # least 1/2: 8 * 2.1 * 2^-24 / 0.5 = 2e-6 of depth, which the next step takes back at the end that they share
        # (the slope is the same); what is between the nodes of the table, h^2 / 8 times a slope of 17, is 3e-8. Where
        # the line is level, the mean of a cell stands for the value: half a cell times a slope of 11, 7e-4 of a depth
        # of 4.4, behind which 1.2 % of the light is left: 8.4e-6.
        assert np.abs(found[:, 3] - expected).max() < 8.4e-6 + ROUNDING


def test_integrals_over_the_value_show_a_faint_medium_behind_a_dense_peak(caster: Caster) -> None:
    """The means over short stretches are not those of the roundings of an integral that the peak has made large."""
    peak = [(0.1, 0.0), (0.15, 1e4), (0.2, 0.0), (0.3, 0.0), (0.4, 1.0), (1.0, 1.0)]  # its integral is 500
    dense = TransferFunction([ControlPoint(value, WHITE, extinction) for value, extinction in peak])
    starts, stretches = np.linspace(0.45, 0.95, 8).tolist(), (1.02, 1.5, 3.3, 20.0, -1.02, -20.0)
    lines = [(start, cells / 8192, 0.0, 0.0) for start in starts for cells in stretches]
    found, _ = caster.cast(dense, MEANS, lines, 1)
    # Of one float32 number, integrals would be off by 2^-25 * 500 at both ends: over a stretch of 1/8192, by 0.24.
    np.testing.assert_allclose(found[:, 3], -np.expm1(-1.0), atol=ROUNDING)


def test_integrals_over_the_value_converge_in_second_order(caster: Caster) -> None:
    coarse, fine = (np.linalg.norm(errors(caster, SMOOTH, MEANS, CUBICS, steps)) for steps in (8, 32))
    assert np.log2(coarse / fine) / 2.0 > 1.7  # data as chords, colours as means: both of second order


def test_one_step_has_the_mean_colour_whichever_way_it_is_crossed(caster: Caster) -> None:
    rising, falling = caster.cast(SMOOTH, MEANS, LINES[:2], 1)[0]
    # Of c tau and tau over [0, 1]: closed forms of the straight pieces.
    emission = 0.3 * np.array([2.5 / 3, 5.0 / 3, 0]) + 0.4 * np.array([0, 10.5 / 6, 6.0 / 6])
    emission += 0.2 * np.array([4.5 / 6, 0, 3.0 / 6])
    depth = 0.3 * 2.5 + 0.4 * 2.75 + 0.2 * 1.25
    expected = np.array([*(emission / depth), 1.0]) * -np.expm1(-depth)
    np.testing.assert_allclose([rising, falling], [expected] * 2, atol=ROUNDING)


@pytest.mark.parametrize("spacing", [0.3 / 1024, 1.5 / 1024], ids=["many bands in a bin", "two at most"])
@pytest.mark.parametrize("settings", [PRE, POST], ids=["pre-integrated", "post-classified"])
def test_values_find_their_band_among_those_of_one_bin(
    caster: Caster, settings: RaycastSettings, spacing: float
) -> None:
    heights = (0.0, 3.0, 1.0, 4.0, 0.5, 2.0, 6.0, 0.0)
    comb = TransferFunction(
        [
            ControlPoint(0.5 + n * spacing, (n / 7, 1.0 - n / 7, 0.5), height)
            for n, height in enumerate(heights)
        ]
    )
    assert has_few_bands(ValueBands.of(comb, 0.0, 1.0)) == (spacing > 1 / 1024)
    places = np.arange(-1.0, 8.0)[:, None] + np.linspace(0.02, 0.98, 20)  # beside the points
    values: list[float] = (0.5 + spacing * places).astype(np.float32).ravel().tolist()
    lines = [(value, 0.0, 0.0, 0.0) for value in values]
    expected = np.array([integrated(comb, line) for line in lines])
    found, _ = caster.cast(comb, settings, lines, 1)
    # Ends of bands are float32 numbers, and so are values: an extinction is off by its slope times 2 roundings of 1/2.
    steepest = 6.0 / spacing
    np.testing.assert_allclose(found, expected, atol=2 * steepest * 2.0**-25 + ROUNDING)


def mean_color_bound(depth: npt.ArrayLike) -> F64:
    """Largest error of a step whose light has the mean colour, by its optical depth, where the colour spans 1 in it.

    In parts s of the step's depth X the light of the colour c is X ∫ c(s) exp(-X s) ds; the mean colour gives that with
    c outside the integral. The difference, X times the covariance of c and exp(-X s), is largest where c is 1 as far as
    exp(-X s) is above its mean m = (1 - exp(-X)) / X, and 0 behind: 1 - m + m log m, which is below X² / 8.
    """
    depths = np.asarray(depth, dtype=np.float64)
    mean = -np.expm1(-depths) / depths
    bound: F64 = 1.0 - mean + mean * np.log(mean)
    return bound


def test_the_bound_of_a_mean_color_is_of_second_order_in_the_depth() -> None:
    depths = np.geomspace(1e-2, 1e3, 200)
    assert (mean_color_bound(depths) <= depths**2 / 8.0).all()
    assert float(mean_color_bound(1e-2)) == pytest.approx(1e-4 / 8.0, rel=1e-2)
    assert 0.99 < float(mean_color_bound(1e3)) < 1.0


@pytest.mark.parametrize("length", [0.05, 0.5, 1.0, 4.0])
def test_a_mean_color_errs_by_its_bound_at_most(caster: Caster, length: float) -> None:
    generator = np.random.default_rng(3)
    ends = generator.uniform(0.0, 1.0, (200, 2))
    ends = ends[np.abs(ends[:, 1] - ends[:, 0]) > 0.3]
    lines = [(front, (back - front) / length, 0.0, 0.0) for front, back in ends]
    expected = np.array([integrated(SMOOTH, line, length) for line in lines])
    found, _ = caster.cast(SMOOTH, MEANS, lines, 1, length)
    inside = ends[:, :1] + np.linspace(0.0, 1.0, 2001) * (ends[:, 1:] - ends[:, :1])
    colors, _ = SMOOTH.evaluate(inside)
    span = colors.max(axis=1) - colors.min(axis=1)
    bound = span * mean_color_bound(-np.log1p(-expected[:, 3]))[:, None]
    # Integrals up to 2.1 are read off to 4 roundings at both ends, and divided by at least 0.3: 3.4e-6 of the means; of
    # a step of 4, 1.4e-5 of the depth and of the light without self-attenuation, which both move the colour. Spans of
    # 2001 places fall short by a slope of 1 / 0.2 times half of 1 / 2001: 0.0013 of what is at most 1.
    assert (np.abs(found[:, :3] - expected[:, :3]) <= bound + 1.3e-3 * bound.max() + 2.8e-5).all()


@pytest.mark.parametrize("depth", [0.1, 1.0, 5.0])
def test_the_bound_of_a_mean_color_is_reached(caster: Caster, depth: float) -> None:
    mean = -np.expm1(-depth) / depth
    place = round(float(-np.log(mean) / depth) * 8192) / 8192  # an edge of the table's cells
    points = [(0.0, RED), (place, RED), (place, BLUE), (1.0, BLUE)]
    halves = TransferFunction([ControlPoint(value, color, depth) for value, color in points])
    rising = [(0.0, 1.0, 0.0, 0.0)]
    missed = integrated(halves, rising[0])[:3] - caster.cast(halves, MEANS, rising, 1)[0][0, :3]
    # The place is off by 2^-14 of the step, in second order; the opacity's roundings as above.
    assert missed[0] == pytest.approx(float(mean_color_bound(depth)), abs=ROUNDING)
    assert missed[2] == pytest.approx(-float(mean_color_bound(depth)), abs=ROUNDING)


def test_half_precision_moves_a_table_s_picture_by_less_than_its_rounding(caster: Caster) -> None:
    for integration in (Integration.TABLE_2D, Integration.TABLE_3D):
        full, half = (
            caster.cast(SMOOTH, RaycastSettings(integration=integration, table_dtype=dtype), LINES, 8)[0]
            for dtype in (TableDtype.FLOAT32, TableDtype.FLOAT16)
        )
        difference = np.abs(full - half).max()
        # An entry is off by 2^-11 of itself (2^-25 below the normal numbers), and so is what is interpolated between
        # entries; brought to another length, opacities below 1/2 are off by 1.5 times that. With the transmittance T_i
        # in front of step i, its light and its opacity change the picture by no more than 2 * 1.5 * 2^-11 T_i a_i, and
        # the T_i a_i sum to the opacity of the ray, at most 1.
        assert 0.0 < difference < 3.0 * 2.0**-11 + 8 * 2.0**-24


@pytest.mark.parametrize("integration", [Integration.TABLE_2D, Integration.TABLE_3D])
def test_a_table_converges_to_piecewise_integration(caster: Caster, integration: Integration) -> None:
    def found(size: int) -> float:
        settings = RaycastSettings(integration=integration, table_size=size)
        return float(errors(caster, SMOOTH, settings, LINES, 4).max())

    # Bilinear interpolation: second order in the size, to the rounding of the many entries.
    assert found(256) < 5e-4
    assert found(256) < 0.25 * found(64)


def test_a_table_of_many_lengths_serves_all_of_them(caster: Caster) -> None:
    settings = RaycastSettings(integration=Integration.TABLE_3D, table_size=128)
    expected = np.array([integrated(SMOOTH, line) for line in LINES])
    for steps in (1, 3, 7, 50):
        found, _ = caster.cast(SMOOTH, settings, LINES, steps, table_length=0.1)
        # Between two layers the mean of two opacities brought to the length: 2e-4 of this scene's depth of at most 5.
        assert np.abs(found - expected).max() < 2e-3


def test_a_sampled_transfer_function_is_the_exact_one_between_its_entries(caster: Caster) -> None:
    texture = RaycastSettings(
        classification=Classification.POST_CLASSIFIED, transfer_lookup=TransferLookup.TEXTURE
    )
    smooth = [caster.cast(SMOOTH, settings, CUBICS, 64)[0] for settings in (POST, texture)]
    # A kink is cut off within an entry: 30 extinction per value times 1 / 8192, once or twice a ray.
    assert np.abs(smooth[0] - smooth[1]).max() < 30.0 / 8192.0 / 8.0
    line = [
        (0.5, 0.0, 0.0, 0.0)
    ]  # half-way between two entries, 6.1e-5 from either: the peak's half-width is 5e-5
    exact, sampled = (caster.cast(DIRAC, settings, line, 1)[0][0, 3] for settings in (POST, texture))
    assert (exact, sampled) == (1.0, 0.0)

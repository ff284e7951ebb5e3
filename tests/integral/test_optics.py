"""Opacity, panels and the emission integral of a stretch: closed forms, limits, identities, quadrature."""

from __future__ import annotations

import itertools
import math
import re
from typing import TYPE_CHECKING

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from isosample.errors import InputError
from isosample.gl.shader_source import shader_root
from isosample.integral.optics import (
    PANEL_DEPTH,
    mean_opacity,
    mean_transmittance,
    opacity_from_depth,
    panel_end,
    partial_depth,
    segment_weights,
)
from isosample.integral.quadrature import panel_nodes

if TYPE_CHECKING:
    from collections.abc import Callable

    from isosample.volume.grid import F64

PROMISED = 1e-14  # relative error of segment_weights
UNIT = 2.0**-53
ENDS = (0.0, 1e-300, 1e-12, 1e-6, 1e-3, 0.1, 0.5, 0.999, 1.0, 1.001, 2.0, 5.0, 20.0, 100.0, 1e3, 1e4)
NEARNESSES = (1e-15, -1e-15, 1e-12, -1e-12, 1e-8, -1e-8, 1e-4, -1e-4, 1e-2, -1e-2)
ends = st.floats(0.0, 1e4, allow_subnormal=False)
fractions = st.floats(0.0, 1.0, allow_subnormal=False)


def _all_pairs() -> F64:
    """(N, 2) ends: all pairs of ENDS, nearly equal ends, and random ones over 16 decades."""
    near = [(x, x * (1.0 + part)) for x in (0.5, 1.0, 2.0, 10.0, 1e3, 1e4) for part in NEARNESSES]
    random = 10.0 ** np.random.default_rng(0).uniform(-12, 4, (400, 2))
    return np.concatenate([list(itertools.product(ENDS, ENDS)), near, random])


def _weights_by_quadrature(x0: float, x1: float, nodes: F64, weights: F64) -> tuple[float, float]:
    depths = nodes * (x0 * (1.0 - 0.5 * nodes) + 0.5 * nodes * x1)
    emission = (x0 * (1.0 - nodes) + x1 * nodes) * np.exp(-depths)
    return float(weights @ -np.expm1(-depths)), float(weights @ (nodes * emission))


def _assert_quadrature_agrees(function: Callable[[F64, F64], F64]) -> None:
    # Panels grow by 7 % from 1e-9 on, so that the layer of depth 1 behind the front of a stretch of depth 1e4
    # is resolved; where the depth is below 40 it grows by 15 % of 40 = 6 at most within a panel, for which
    # 20 nodes err by about (20!)^4 / (41 (40!)^3) 6^40 = 2e-41.
    nodes, weights = panel_nodes(np.concatenate([[0.0], np.geomspace(1e-9, 1.0, 300)]), 20)
    pairs = _all_pairs()
    expected = np.array([_weights_by_quadrature(x0, x1, nodes, weights) for x0, x1 in pairs])
    np.testing.assert_allclose(function(pairs[:, 0], pairs[:, 1]), expected, rtol=PROMISED, atol=1e-300)


def test_segment_weights_agree_with_quadrature_from_thin_to_opaque() -> None:
    _assert_quadrature_agrees(segment_weights)


def test_quadrature_tells_a_wrong_constant() -> None:
    with pytest.raises(AssertionError):
        _assert_quadrature_agrees(lambda x0, x1: segment_weights(x0, x1) * (1.0, 1.0 + 1e-12))


@pytest.mark.parametrize("depth", [1e-9, 0.3, 0.9999, 1.0, 7.0, 300.0, 1e4])
def test_constant_extinction_has_the_slab_weights(depth: float) -> None:
    # ∫ (1 − exp(−x u)) du = 1 − (1 − exp(−x)) / x. The right side cancels: 1/x of its rounding is left.
    front, back = segment_weights(depth, depth)
    mean = -math.expm1(-depth) / depth
    assert front == pytest.approx(1.0 - mean, abs=4 * UNIT, rel=PROMISED)
    assert back == pytest.approx(mean - math.exp(-depth), abs=4 * UNIT, rel=PROMISED)


@pytest.mark.parametrize("slope", [1e-9, 0.3, 1.9999, 2.0, 7.0, 300.0, 1e4])
def test_extinction_that_rises_from_zero_has_the_error_function(slope: float) -> None:
    # ∫ exp(−s u²/2) du = sqrt(π / 2s) erf(sqrt(s/2)).
    mean = math.sqrt(math.pi / (2.0 * slope)) * math.erf(math.sqrt(slope / 2.0))
    assert float(mean_transmittance(0.0, slope)) == pytest.approx(mean, rel=PROMISED)


@pytest.mark.parametrize(("x0", "x1"), [(1e-12, 0.0), (0.0, 1e-12), (1e-12, 1e-12), (3e-13, 1e-12)])
def test_thin_stretch_weighs_its_ends_by_thirds_and_sixths(x0: float, x1: float) -> None:
    # 1 − exp(−D) = D (1 − D/2 …): ∫ D du = x0/3 + x1/6, and what is left of D(1) is x0/6 + x1/3; the next
    # order is D <= 1e-12 of it.
    expected = [x0 / 3 + x1 / 6, x0 / 6 + x1 / 3]
    np.testing.assert_allclose(segment_weights(x0, x1), expected, rtol=1.1e-12)


def test_empty_stretch_has_no_weight() -> None:
    assert segment_weights(0.0, 0.0).tolist() == [0.0, 0.0]


@pytest.mark.parametrize("x0", [1e8, 1e30, 1e300])
def test_opaque_stretch_shows_the_front_colour(x0: float) -> None:
    # F = 1/x0 − x'/x0³ …, where |x'| <= x0: the next order is 1/x0² <= 1e-8 of the first.
    front, back = segment_weights(x0, [0.0, x0]).T
    np.testing.assert_allclose(back, 1.0 / x0, rtol=2.0 / x0 + PROMISED)
    np.testing.assert_allclose(front, 1.0 - 1.0 / x0, rtol=PROMISED)


@given(x0=ends, x1=ends)
def test_weights_sum_to_the_opacity(x0: float, x1: float) -> None:
    weights = segment_weights(x0, x1)
    opacity = float(opacity_from_depth(0.5 * (x0 + x1)))
    assert (weights >= 0.0).all()
    assert float(weights.sum()) == pytest.approx(opacity, rel=2 * PROMISED)


@given(x0=ends, x1=ends, u=fractions, c0=fractions, c1=fractions)
def test_stretch_split_in_two_composites_to_the_whole(
    x0: float, x1: float, u: float, c0: float, c1: float
) -> None:
    xu, cu = x0 * (1.0 - u) + x1 * u, c0 * (1.0 - u) + c1 * u
    near = float(segment_weights(x0 * u, xu * u) @ [c0, cu])
    far = float(segment_weights(xu * (1.0 - u), x1 * (1.0 - u)) @ [cu, c1])
    near_depth, whole_depth = partial_depth(x0, x1, u), partial_depth(x0, x1, 1.0)
    far_depth = partial_depth(xu * (1.0 - u), x1 * (1.0 - u), 1.0)
    # Depths carry 6 roundings, and exp(−D) D <= 1/e of them: below one PROMISED with those of the weights.
    assert math.exp(-near_depth) * math.exp(-far_depth) == pytest.approx(math.exp(-whole_depth), abs=PROMISED)
    whole = float(segment_weights(x0, x1) @ [c0, c1])
    assert near + math.exp(-near_depth) * far == pytest.approx(whole, abs=4 * PROMISED)


@given(x0=ends, x1=ends)
def test_opacity_is_the_same_from_either_side(x0: float, x1: float) -> None:
    forth, back = segment_weights(x0, x1).sum(), segment_weights(x1, x0).sum()
    assert float(forth) == pytest.approx(float(back), rel=4 * PROMISED)


def test_thin_and_thick_formulas_meet_without_a_step() -> None:
    # Across the depth 1 the weights rise by at most the step in depth, 4 units, and their errors.
    below, above = np.nextafter(1.0, 0.0), 1.0
    for share in (0.0, 0.3, 1.0, 1.7, 2.0):
        thin, thick = (segment_weights(depth * share, depth * (2.0 - share)) for depth in (below, above))
        np.testing.assert_allclose(thin, thick, rtol=2 * PROMISED)


def test_weights_keep_the_shape_that_the_ends_broadcast_to() -> None:
    assert segment_weights(1.0, 2.0).shape == (2,)
    assert segment_weights(np.ones((3, 1)), np.ones(4)).shape == (3, 4, 2)
    assert segment_weights(np.zeros(0), np.zeros(0)).shape == (0, 2)


def test_opacity_keeps_the_digits_of_a_thin_path() -> None:
    assert opacity_from_depth([0.0, 1e-300, 1e-17]).tolist() == [0.0, 1e-300, 1e-17]
    assert float(opacity_from_depth(math.log(2.0))) == pytest.approx(0.5, rel=2 * UNIT)
    assert float(opacity_from_depth(1e4)) == 1.0


@given(a=ends, b=ends)
def test_transmittances_of_two_paths_multiply(a: float, b: float) -> None:
    first, second = opacity_from_depth([a, b])
    # 1 − (1 − α)(1 − β) = α + β (1 − α): both terms positive, 3 roundings and those of expm1 (1 ulp each).
    assert float(opacity_from_depth(a + b)) == pytest.approx(first + second * (1.0 - first), rel=16 * UNIT)


def test_partial_depth_is_the_area_of_the_trapezium() -> None:
    # Quarters: every product and sum is exact.
    assert partial_depth(4.0, 8.0, [0.0, 0.25, 0.5, 1.0]).tolist() == [0.0, 1.125, 2.5, 6.0]
    assert partial_depth(8.0, 0.0, [0.5, 1.0]).tolist() == [3.0, 4.0]


@pytest.mark.parametrize("x", [1.0, 4.0, 100.0])
def test_panels_of_constant_extinction_are_equally_long(x: float) -> None:
    starts = np.arange(2) * PANEL_DEPTH / x
    np.testing.assert_allclose(
        panel_end(x, x, starts), np.minimum(1.0, starts + PANEL_DEPTH / x), rtol=4 * UNIT
    )


@given(x0=ends, x1=ends, u=fractions)
def test_panel_holds_its_depth_or_the_rest(x0: float, x1: float, u: float) -> None:
    end = float(panel_end(x0, x1, u))
    width = end - u
    assert width >= 0.0
    # Extinctions at both ends of the panel carry 3 roundings, and `end` that of u + step.
    depth = width * (x0 * (1.0 - 0.5 * (u + end)) + 0.5 * (u + end) * x1)
    rounding = (8 * PANEL_DEPTH + 4 * (x0 + x1)) * UNIT
    assert depth <= PANEL_DEPTH + rounding
    assert end == 1.0 or depth == pytest.approx(PANEL_DEPTH, abs=rounding)


def test_panel_of_an_empty_stretch_reaches_the_end() -> None:
    assert panel_end([0.0, 1e-310, 0.4], [0.0, 1e-310, 0.0], [0.0, 0.25, 0.0]).tolist() == [1.0, 1.0, 1.0]


def test_mean_opacity_is_one_less_the_mean_transmittance() -> None:
    a, b = (part.ravel() for part in np.meshgrid(np.linspace(0.0, 1.0, 21), np.linspace(-0.5, 0.5, 21)))
    rising = a + 2.0 * b >= 0.0
    found = mean_opacity(a[rising], b[rising])
    # The extinction of the depth a v + b v² runs from a to a + 2 b; both are sums of 12 nodes.
    np.testing.assert_allclose(
        found, 1.0 - mean_transmittance(a[rising], (a + 2.0 * b)[rising]), atol=40 * UNIT
    )
    constant = np.linspace(0.1, 1.0, 10)
    np.testing.assert_allclose(
        mean_opacity(constant, 0.0), 1.0 + np.expm1(-constant) / constant, rtol=200 * UNIT
    )


def test_polynomial_of_the_shader_has_its_stated_error() -> None:
    text = (shader_root() / "lib" / "optics.glsl").read_text(encoding="utf-8")
    coefficients = [float(re.search(rf"const float c{n} = (\S+);", text)[1]) for n in (1, 2, 3, 4)]  # type: ignore[index]
    x = np.linspace(1e-3, PANEL_DEPTH, 10_001)
    series = 1.0 + sum(float(np.float32(c)) * x**n for n, c in enumerate(coefficients, start=1))
    error = np.abs(series * x / opacity_from_depth(x) - 1.0).max()
    assert 8.0e-8 < error <= 9.1e-8


@pytest.mark.parametrize(
    ("function", "arguments", "message"),
    [
        (opacity_from_depth, ([1.0, -0.5, -2.0],), r"depth is -0\.5 at index 1; expected finite and >= 0"),
        (opacity_from_depth, (math.nan,), "depth is nan; expected finite"),
        (segment_weights, ([[1.0, math.inf]], 1.0), "x0 is inf at index 0, 1"),
        (segment_weights, (1.0, -1.0), "x1 is -1; expected"),
        (mean_transmittance, (-1.0, 1.0), "x0 is -1; expected"),
        (partial_depth, (1.0, 1.0, 1.5), r"u is 1\.5; expected 0 to 1"),
        (panel_end, (1.0, 1.0, -0.1), r"u is -0\.1; expected 0 to 1"),
    ],
)
def test_argument_out_of_range_is_named(
    function: Callable[..., F64], arguments: tuple[object, ...], message: str
) -> None:
    with pytest.raises(InputError, match=message):
        function(*arguments)

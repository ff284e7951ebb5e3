"""The parts of the reference integral: cubics in cells, their roots and extrema, bands, quadrature rules."""

from __future__ import annotations

import math
from itertools import product
from typing import TYPE_CHECKING

import numpy as np
import pytest

from isosample.integral.band_table import NODE_COUNTS, BandTable, PanelRules
from isosample.integral.cell_cubic import (
    cubic_between,
    cubic_extrema,
    cubic_part,
    cubic_root,
    cubic_value,
)
from isosample.transfer.control_points import ControlPoint, Isosurface
from isosample.transfer.transfer_function import TransferFunction

if TYPE_CHECKING:
    from collections.abc import Sequence

    from isosample.integral.cell_cubic import Cubic
    from isosample.volume.grid import F64

U = 2.0**-53


def four(values: Sequence[float] | F64) -> Cubic:
    """Coefficients as a tuple of plain numbers."""
    b0, b1, b2, b3 = (float(value) for value in values)
    return b0, b1, b2, b3


def test_a_line_through_a_cell_gives_the_cubic_of_the_interpolant() -> None:
    rng = np.random.default_rng(1)
    for _ in range(50):
        corners, start, end = rng.random((2, 2, 2)), rng.random(3), rng.random(3)
        cubic = cubic_between(corners, start, end)
        for s in (0.0, 0.3, 0.8, 1.0):
            x, y, z = start + s * (end - start)
            weights = np.einsum("i,j,k->ijk", [1 - z, z], [1 - y, y], [1 - x, x])
            # Three lerps of numbers below 1, three more of the cubic, some 30 roundings in all.
            assert cubic_value(*cubic, s) == pytest.approx((weights * corners).sum(), abs=60 * U)
        assert min(cubic) >= corners.min() - 8 * U
        assert max(cubic) <= corners.max() + 8 * U


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_both_sides_of_a_face_give_the_same_value_to_the_last_bit(axis: int) -> None:
    rng = np.random.default_rng(2)
    for _ in range(200):
        samples = rng.random([3 if 2 - axis == i else 2 for i in range(3)])
        low, high = np.take(samples, [0, 1], axis=2 - axis), np.take(samples, [1, 2], axis=2 - axis)
        start, face, end = rng.random((3, 3))
        other = face.copy()
        face[axis], other[axis] = 1.0, 0.0
        assert cubic_between(low, start, face)[3] == cubic_between(high, other, end)[0]


def test_equal_samples_give_equal_coefficients_to_the_last_bit() -> None:
    rng = np.random.default_rng(3)
    for value in rng.normal(size=50):
        assert set(cubic_between(np.full((2, 2, 2), value), rng.random(3), rng.random(3))) == {value}


def test_roots_are_good_to_rounding_over_slope() -> None:
    rng = np.random.default_rng(4)
    for _ in range(200):
        cubic = four(np.sort(rng.random(4)))
        exact = rng.random()
        level = cubic_value(*cubic, exact)
        slope = (cubic_value(*cubic, exact + 1e-6) - cubic_value(*cubic, exact - 1e-6)) / 2e-6
        found = cubic_root(*cubic, level, 0.0, 1.0, True)
        assert abs(found - exact) <= 40 * U / slope + 4 * U
        falling = four(cubic[::-1])
        found = cubic_root(*falling, level, 0.0, 1.0, False)
        assert abs(found - (1.0 - exact)) <= 40 * U / slope + 4 * U
    assert cubic_root(0.0, 0.0, 0.0, 1.0, 1e-30, 0.0, 1.0, True) == pytest.approx(1e-10, rel=1e-5)


@pytest.mark.parametrize(
    ("slopes", "places"),
    [
        ((1.0, 2.0, 3.0), []),
        ((-1.0, 0.0, -1.0), []),
        ((1.0, -3.0, 1.0), [0.5 - math.sqrt(0.125), 0.5 + math.sqrt(0.125)]),
        ((1.0, 0.0, -1.0), [0.5]),
        ((2.0, 0.5, -1.0), [2.0 / 3.0]),
        ((-1.0, 2.0, 3.0), [(3.0 - math.sqrt(7.0)) / 2.0]),
    ],
)
def test_extrema_are_where_the_slope_changes_sign(slopes: tuple[float, ...], places: list[float]) -> None:
    """The slope is 3 Σ d_i B_i(s) with quadratic Bernstein polynomials."""
    cubic = four(np.cumsum([0.25, *slopes]))
    count, first, second = cubic_extrema(*cubic)
    found = [first, second][:count]
    assert found == pytest.approx(places, abs=8 * U)


def test_a_part_of_a_cubic_is_the_same_cubic() -> None:
    rng = np.random.default_rng(5)
    for _ in range(50):
        cubic = four(rng.normal(size=4))
        low, high = np.sort(rng.random(2))
        part = cubic_part(*cubic, low, high)
        for s in (0.0, 0.25, 0.7, 1.0):
            assert cubic_value(*part, s) == pytest.approx(
                cubic_value(*cubic, low + s * (high - low)), abs=200 * U
            )


@pytest.mark.parametrize("tolerance", [1e-3, 1e-10, 1e-13])
def test_depth_limits_keep_the_proven_bound(tolerance: float) -> None:
    """A rule of n nodes is exact for degree 2n − 1; J powers of the depth leave (δ/2)^J / J! three times."""
    rules = PanelRules.for_tolerance(tolerance)
    for row, count in enumerate(NODE_COUNTS):
        powers = max(j for j in range(1, 20) if 6 + 4 * (j - 1) <= 2 * count - 1)
        half_depth = 0.5 * rules.depth_limits[row]
        assert 3.0 * half_depth**powers / math.factorial(powers) <= tolerance * (1 + 1e-12)
        assert math.exp(2 * half_depth) < 1.5
    assert np.all(np.diff(rules.depth_limits) >= 0)


def test_the_basis_at_the_nodes_integrates_cubics_exactly() -> None:
    rules = PanelRules.for_tolerance(1e-10)
    cubic = np.array([0.3, -1.0, 2.0, 0.7])
    for row, count in enumerate(NODE_COUNTS):
        nodes = rules.nodes[row, :count]
        values = [cubic_value(*four(cubic), s) for s in nodes]
        assert rules.basis[row, :count] @ cubic == pytest.approx(values, abs=1e-14)
        parts = [np.mean(cubic_part(*four(cubic), 0.0, s)) * s for s in nodes]
        assert rules.integrals[row, :count] @ cubic == pytest.approx(parts, abs=1e-14)
        assert rules.weights[row].sum() == pytest.approx(1.0, abs=1e-14)


def test_bands_have_the_one_sided_limits_of_the_transfer_function() -> None:
    red, blue = (1.0, 0.0, 0.0), (0.0, 0.0, 1.0)
    tf = TransferFunction(
        [ControlPoint(v, c, x) for v, c, x in [(1, red, 0.5), (2, red, 1.0), (2, blue, 3.0), (4, blue, 2.0)]],
        [Isosurface(3.0, red, 0.25), Isosurface(2.0, blue, 0.5)],
    )
    bands = BandTable.from_transfer_function(tf, base=1.0)
    assert bands.edges.tolist() == [-math.inf, 0.0, 1.0, 2.0, 3.0, math.inf]
    assert bands.extinction.tolist() == [[0, 0], [0.5, 1.0], [3.0, 2.5], [2.5, 2.0], [0, 0]]
    assert bands.color[1:4].tolist() == [[list(red)] * 2, [list(blue)] * 2, [list(blue)] * 2]
    assert bands.impulse[:, 0].tolist() == [0.0, 0.5, 0.25, 0.0]
    assert bands.plateau.tolist() == [1, 2, 3, 3]
    for (k, band), side in product(enumerate(bands.extinction[1:4]), (0, 1)):
        value = bands.edges[k + 1 + side] + 1.0
        assert tf.evaluate(value, "left" if side else "right")[1] == band[side]

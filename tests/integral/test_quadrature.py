"""Gauss-Legendre rules are exact where they promise it, and refuse what bounds no panel."""

from __future__ import annotations

import numpy as np
import pytest

from isosample.errors import InputError
from isosample.integral.quadrature import gauss_legendre, panel_nodes

UNIT = 2.0**-53


@pytest.mark.parametrize("count", [1, 2, 4, 12, 20])
def test_rule_is_exact_to_twice_its_nodes(count: int) -> None:
    # ∫ u^p du = 1 / (p + 1). Weights are positive and sum to 1; a node error of 2 units is amplified p times.
    nodes, weights = gauss_legendre(count)
    for power in range(2 * count):
        assert float(weights @ nodes**power) == pytest.approx(1.0 / (power + 1), abs=(8 + 2 * power) * UNIT)
    # The first power that is missed, by (n!)^4 / ((2n + 1) (2n)!^2): resolvable up to 4 nodes.
    if count <= 4:
        assert abs(float(weights @ nodes ** (2 * count)) - 1.0 / (2 * count + 1)) > 1e-6


def test_shader_nodes_are_those_of_four_points() -> None:
    # Roots of the Legendre polynomial P4: x² = 3/7 ± 2/7 sqrt(6/5); weights (18 ± sqrt(30)) / 36, halved.
    inner, outer = (np.sqrt(3.0 / 7.0 - sign * 2.0 / 7.0 * np.sqrt(1.2)) for sign in (1.0, -1.0))
    nodes, weights = gauss_legendre(4)
    expected = 0.5 + 0.5 * np.array([-outer, -inner, inner, outer])
    np.testing.assert_allclose(nodes, expected, rtol=16 * UNIT)
    heavy, light = (18.0 + np.sqrt(30.0)) / 72.0, (18.0 - np.sqrt(30.0)) / 72.0
    np.testing.assert_allclose(weights, [light, heavy, heavy, light], rtol=16 * UNIT)


def test_panels_sum_to_the_whole() -> None:
    # A cubic on 2 nodes per panel: exact but for roundings, however the panels are cut.
    nodes, weights = panel_nodes([[-1.0, 0.5, 2.0, 2.0], [-1.0, -0.9, 1.0, 2.0]], 2)
    assert nodes.shape == weights.shape == (2, 6)
    integrals = (weights * (nodes**3 - nodes)).sum(axis=-1)
    np.testing.assert_allclose(integrals, 15.0 / 4.0 - 3.0 / 2.0, rtol=32 * UNIT)


def test_shared_nodes_cannot_be_overwritten() -> None:
    for shared in gauss_legendre(3):
        with pytest.raises(ValueError, match="read-only"):
            shared[0] = 0.0


@pytest.mark.parametrize("count", [0, 101])
def test_number_of_nodes_out_of_range_is_refused(count: int) -> None:
    with pytest.raises(InputError, match=f"{count} quadrature nodes; expected 1 to 100"):
        gauss_legendre(count)


def test_edges_that_bound_no_panel_are_refused() -> None:
    with pytest.raises(InputError, match=r"edges of shape \(1,\) bound no panel"):
        panel_nodes([0.0], 4)
    with pytest.raises(InputError, match="edges descend"):
        panel_nodes([0.0, 1.0, 0.5], 4)

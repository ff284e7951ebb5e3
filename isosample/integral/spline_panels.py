"""Emission along a polynomial of degree 9 inside one band, by Gauss-Legendre panels with a proven error."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import numpy.typing as npt

from isosample.compiled import compiled
from isosample.integral.band_walk import PANELS, absorb_lit, composite
from isosample.integral.bernstein_basis import bernstein_basis
from isosample.integral.quadrature import gauss_legendre
from isosample.integral.spline_cells import DEGREE

if TYPE_CHECKING:
    from isosample.integral.band_table import BandTable
    from isosample.integral.cell_light import CellLight

F64 = npt.NDArray[np.float64]

NODE_COUNTS = (24, 32, 48)  # Gauss nodes of the rules, from thin to thick panels


class SplineRules(NamedTuple):
    """Gauss-Legendre rules for a panel of a ray, with the largest optical depth for which each suffices.

    Attributes
    ----------
    depth_limits : (R,) float64
        Largest optical depth of a panel for each rule, ascending.
    node_counts : (R,) int64
    nodes, weights : (R, N) float64
        In [0, 1]; the sum of the weights is 1.
    basis, integrals : (R, N, 10) float64
        Bernstein polynomials of degree 9 at the nodes, and their integrals from 0 to the nodes.

    Notes
    -----
    The proof is that of `band_table.PanelRules`, in degree 9: on a panel of depth δ, exp(−D) is P(D) + r with P of
    degree J − 1 and |r| <= (δ/2)^J / J!, D of degree 10. A rule of n nodes is exact for w τ P(D), of degree
    18 + 10 (J − 1) <= 2n − 1, so that the radiance of a ray errs by less than 3 (δ/2)^J / J!.
    """

    depth_limits: F64
    node_counts: npt.NDArray[np.int64]
    nodes: F64
    weights: F64
    basis: F64
    integrals: F64

    @classmethod
    def for_tolerance(cls, tolerance: float, panels: int) -> SplineRules:
        """Rules whose error over a whole ray is below a tolerance; `panels` divides every panel again."""
        rows, most = len(NODE_COUNTS), max(NODE_COUNTS)
        limits, nodes, weights = np.empty(rows), np.zeros((rows, most)), np.zeros((rows, most))
        basis, integrals = np.zeros((rows, most, DEGREE + 1)), np.zeros((rows, most, DEGREE + 1))
        for row, count in enumerate(NODE_COUNTS):
            order = (2 * count - 1 - 2 * DEGREE) // (DEGREE + 1) + 1
            limits[row] = min(0.4, 2.0 * (math.factorial(order) * tolerance / 3.0) ** (1.0 / order)) / panels
            nodes[row, :count], weights[row, :count] = gauss_legendre(count)
            basis[row] = bernstein_basis(nodes[row], DEGREE)
            raised = bernstein_basis(nodes[row], DEGREE + 1)
            integrals[row] = np.cumsum(raised[:, :0:-1], axis=1)[:, ::-1] / (DEGREE + 1)
        return cls(limits, np.array(NODE_COUNTS), nodes, weights, basis, integrals)


class Accuracy(NamedTuple):
    """What keeps the tolerance of a spline.

    Attributes
    ----------
    agreement : (K + 1,) float64
        By how much a cubic may differ from the field in each band [data units].
    rules : SplineRules
    """

    agreement: F64
    rules: SplineRules

    @classmethod
    def build(
        cls,
        bands: BandTable,
        scales: tuple[float, float],
        tolerance: float,
        panels: int,
        brightest: float = 1.0,
    ) -> Accuracy:
        """What is needed for a tolerance of cubics, and of quadrature.

        Parameters
        ----------
        bands : BandTable
        scales : longest chord [world], range of the values [data units]
        tolerance : float
        panels : int
            Divides every panel and every cubic again; the error of a cubic falls by 16 when it is halved.
        brightest : float
            Largest component of a colour, >= 1.
        """
        chord, value_range = scales
        finite = np.isfinite(bands.edges[1:]) & np.isfinite(bands.edges[:-1])
        width = np.subtract(bands.edges[1:], bands.edges[:-1], where=finite, out=np.ones(len(finite)))
        by_depth = np.abs(np.diff(bands.extinction, axis=1)[:, 0]) * chord
        by_color = np.abs(np.diff(bands.color, axis=1)[:, 0]).max(axis=1)
        shown = bands.extinction.max(axis=1) > 0
        sensitivity = np.maximum((by_depth + by_color) / width * shown, 1.0 / value_range)
        return cls(
            tolerance / brightest / panels**4 / sensitivity, SplineRules.for_tolerance(tolerance, panels)
        )


@compiled
def panel_depth(bands: BandTable, band: int, mean: float, length: float) -> float:
    """Optical depth of a stretch [world] inside a band, of which the mean value is known."""
    low, high = bands.edges[band], bands.edges[band + 1]
    front, back = bands.extinction[band, 0], bands.extinction[band, 1]
    depth = length * (front + (mean - low) / (high - low) * (back - front))
    return float(max(0.0, depth))


@compiled
def absorb_polynomial(
    walk: F64,
    band: int,
    polynomial: F64,
    extent: tuple[float, float],
    bands: BandTable,
    rules: SplineRules,
    places: F64,
    light: CellLight | None,
) -> None:
    """Composite a panel inside one band: opacity in closed form, colour by quadrature.

    Parameters
    ----------
    walk, band, bands
        As for `band_walk.absorb`.
    polynomial : (10,) float64
        The values, strictly inside the band.
    extent : length [world], optical depth
        The depth is at most the last of the rules' limits.
    rules : SplineRules
    places : (10,) float64
        Is overwritten.
    light : CellLight or None
    """
    length, depth = extent
    rule = 0
    while rule < len(rules.depth_limits) - 1 and depth > rules.depth_limits[rule]:
        rule += 1
    low = bands.edges[band]
    scale = 1.0 / (bands.edges[band + 1] - low)
    for k in range(DEGREE + 1):
        places[k] = (polynomial[k] - low) * scale
    if light is not None:
        absorb_lit(walk, band, places, (0.0, 1.0), length, depth, bands, light)
        return
    front = bands.extinction[band, 0] * length
    change = bands.extinction[band, 1] * length - front
    toward_high = 0.0
    for i in range(rules.node_counts[rule]):
        basis, integral = rules.basis[rule, i], rules.integrals[rule, i]
        w, w_sum = 0.0, 0.0
        for k in range(DEGREE + 1):
            w += places[k] * basis[k]
            w_sum += places[k] * integral[k]
        so_far = front * rules.nodes[rule, i] + change * w_sum
        toward_high += rules.weights[rule, i] * w * (front + change * w) * math.exp(-so_far)
    walk[PANELS] += 1.0
    color = bands.color[band]
    composite(walk, -math.expm1(-depth), math.exp(-depth), color[0], color[1], toward_high)

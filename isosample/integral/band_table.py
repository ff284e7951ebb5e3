"""What the reference integrator reads: the transfer function by bands, and rules with a proven error."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import numpy.typing as npt

from isosample.errors import InputError
from isosample.integral.bernstein_basis import bernstein_basis
from isosample.integral.quadrature import gauss_legendre

if TYPE_CHECKING:
    from isosample.transfer.transfer_function import TransferFunction

F64 = npt.NDArray[np.float64]

NODE_COUNTS = (6, 8, 10, 12, 16)  # Gauss nodes of the five rules, from thin to thick panels
SMALLEST_TOLERANCE, LARGEST_TOLERANCE = 1e-13, 1e-2  # rounding of a long ray; useless beyond


class BandTable(NamedTuple):
    """The transfer function between its levels: all values at which something changes.

    Band `k` lies between `edges[k]` and `edges[k + 1]`; the outermost are infinite. A value equal to a level
    belongs to the band above ("value >= isovalue is inside").

    Attributes
    ----------
    edges : (K + 2,) float64
        −inf, the K levels (control points and isosurfaces), +inf; in data units, less the base.
    extinction : (K + 1, 2) float64
        One-sided limits at the lower and upper end [1/world].
    color : (K + 1, 2, 3) float64
        The same for the colour (linear RGB, straight).
    impulse : (K, 4) float64
        Opacity and colour (linear RGB, straight) of a crossing of each level; 0 where it is no isosurface.
    plateau : (K,) int64
        Band whose optics hold where the field is equal to a level over a length: the band above, but at
        the last control point the one below, as `TransferFunction.evaluate` has it.
    """

    edges: F64
    extinction: F64
    color: F64
    impulse: F64
    plateau: npt.NDArray[np.int64]

    @classmethod
    def from_transfer_function(cls, transfer_function: TransferFunction, base: float = 0.0) -> BandTable:
        """Bands of a transfer function, for a field from which `base` has been subtracted."""
        points = [point.value for point in transfer_function.points]
        surfaces = {surface.value: surface for surface in transfer_function.isosurfaces}
        levels = np.unique(np.array([*points, *surfaces]))
        count = len(levels)
        extinction, color = np.zeros((count + 1, 2)), np.zeros((count + 1, 2, 3))
        color[:-1, 1], extinction[:-1, 1] = transfer_function.evaluate(levels, side="left")
        color[1:, 0], extinction[1:, 0] = transfer_function.evaluate(levels, side="right")
        extinction[0] = extinction[-1] = 0.0
        impulse = np.zeros((count, 4))
        for value, surface in surfaces.items():
            impulse[np.searchsorted(levels, value)] = (surface.opacity, *surface.color)
        plateau = np.arange(1, count + 1)
        if points:
            last = int(np.searchsorted(levels, points[-1]))
            plateau[last] = last
        edges = np.concatenate([[-np.inf], levels - base, [np.inf]])
        return cls(edges, extinction, color, impulse, plateau)

    @property
    def level_visible(self) -> npt.NDArray[np.bool_]:
        """(K,) bool, True for isosurfaces."""
        visible: npt.NDArray[np.bool_] = self.impulse[:, 0] > 0
        return visible


class PanelRules(NamedTuple):
    """Gauss-Legendre rules for a panel of a ray, with the largest optical depth for which each suffices.

    Attributes
    ----------
    depth_limits : (R,) float64
        Largest optical depth of a panel for each rule, ascending.
    node_counts : (R,) int64
    weights : (R, N) float64
        Their sum is 1.
    basis, integrals : (R, N, 4) float64
        Cubic Bernstein polynomials at the nodes, and their integrals from 0 to the nodes.
    nodes : (R, N) float64

    Notes
    -----
    On a panel of depth δ, with w(s) and τ(s) cubic, D(s) = ∫τ quartic, 0 <= w <= 1, τ >= 0, Taylor's
    theorem about the middle depth gives exp(−D) = P(D) + r with P of degree J − 1 and |r| <= (δ/2)^J / J!.
    A rule of n nodes is exact for w τ P(D), of degree 6 + 4 (J − 1) <= 2n − 1, and the integral and the sum
    of w τ |r| are each at most δ (δ/2)^J / J!. Over a ray, the sum of transmittance times δ is below
    exp(max δ) < 1.5, so the radiance errs by less than 3 (δ/2)^J / J!, which the limits make the tolerance.
    """

    depth_limits: F64
    node_counts: npt.NDArray[np.int64]
    nodes: F64
    weights: F64
    basis: F64
    integrals: F64

    @classmethod
    def for_tolerance(cls, tolerance: float) -> PanelRules:
        """Rules whose error over a whole ray is below `tolerance` (absolute, colours in [0, 1]).

        Raises
        ------
        InputError
            If the tolerance is not between 1e-13 and 1e-2.
        """
        if not SMALLEST_TOLERANCE <= tolerance <= LARGEST_TOLERANCE:
            raise InputError(
                f"tolerance {tolerance!r} must be between {SMALLEST_TOLERANCE:g} and {LARGEST_TOLERANCE:g}."
            )
        rows, most = len(NODE_COUNTS), max(NODE_COUNTS)
        limits, nodes, weights = np.empty(rows), np.zeros((rows, most)), np.zeros((rows, most))
        basis, integrals = np.zeros((rows, most, 4)), np.zeros((rows, most, 4))
        for row, count in enumerate(NODE_COUNTS):
            order = (2 * count - 7) // 4 + 1
            limits[row] = min(0.4, 2.0 * (math.factorial(order) * tolerance / 3.0) ** (1.0 / order))
            nodes[row, :count], weights[row, :count] = gauss_legendre(count)
            basis[row] = bernstein_basis(nodes[row], 3)
            quartic = bernstein_basis(nodes[row], 4)
            integrals[row] = 0.25 * np.cumsum(quartic[:, :0:-1], axis=1)[:, ::-1]
        return cls(limits, np.array(NODE_COUNTS), nodes, weights, basis, integrals)


class Optics(NamedTuple):
    """All that a walk along a ray asks about the transfer function and the quadrature.

    Attributes
    ----------
    bands : BandTable
    rules : PanelRules
    panels : int
        Every quadrature panel is divided into so many more.
    """

    bands: BandTable
    rules: PanelRules
    panels: int

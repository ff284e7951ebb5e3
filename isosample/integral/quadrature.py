"""Gauss-Legendre quadrature on panels, in float64."""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from isosample.errors import InputError

if TYPE_CHECKING:
    import numpy.typing as npt

    from isosample.volume.grid import F64

MAX_NODES = 100  # numpy's nodes and weights are tested up to this degree


@lru_cache(maxsize=16)
def gauss_legendre(count: int) -> tuple[F64, F64]:
    r"""Nodes and weights on [0, 1].

    Parameters
    ----------
    count : int
        Number of nodes, 1 to 100.

    Returns
    -------
    nodes : (count,) float64
        Ascending, in (0, 1); read-only.
    weights : (count,) float64
        Positive, their sum is 1; read-only.

    Raises
    ------
    InputError
        If `count` is out of range.

    Notes
    -----
    Exact for polynomials of degree 2 count − 1; the error for f on [0, 1] is
    :math:`(n!)^4 f^{(2n)}(\xi) / ((2n+1)\,((2n)!)^3)`, [1]_ eq. 25.4.30.

    References
    ----------
    .. [1] M. Abramowitz and I. Stegun, "Handbook of mathematical functions", 1964.
    """
    if not 1 <= count <= MAX_NODES:
        raise InputError(
            f"{count} quadrature nodes; expected 1 to {MAX_NODES}. Use more panels instead of more nodes."
        )
    symmetric, weights = np.polynomial.legendre.leggauss(count)
    nodes, halved = 0.5 * (symmetric + 1.0), 0.5 * weights
    nodes.setflags(write=False)
    halved.setflags(write=False)
    return nodes, halved


def panel_nodes(edges: npt.ArrayLike, count: int) -> tuple[F64, F64]:
    """Nodes and weights of the composite rule: `count` Gauss-Legendre nodes on each panel.

    Parameters
    ----------
    edges : (..., P + 1) array_like of float
        Ends of the P panels along the last axis, ascending.
    count : int
        Nodes per panel, 1 to 100.

    Returns
    -------
    nodes, weights : (..., P * count) float64
        ``(weights * f(nodes)).sum(-1)`` is the integral of f over all panels.

    Raises
    ------
    InputError
        If there is no panel, the edges descend, or `count` is out of range.
    """
    ends = np.asarray(edges, dtype=np.float64)
    if ends.ndim == 0 or ends.shape[-1] < 2:
        raise InputError(f"edges of shape {ends.shape} bound no panel; give at least two on the last axis.")
    widths = np.diff(ends, axis=-1)
    if not (widths >= 0).all():
        raise InputError(f"edges descend (smallest step {widths.min():g}); sort them along the last axis.")
    nodes, weights = gauss_legendre(count)
    places = ends[..., :-1, None] + widths[..., None] * nodes
    shape = (*ends.shape[:-1], widths.shape[-1] * count)
    return places.reshape(shape), (widths[..., None] * weights).reshape(shape)

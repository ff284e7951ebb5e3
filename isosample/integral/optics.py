"""Opacity, transmittance and the emission integral of one stretch of a ray, in float64.

Twin of ``shaders/lib/optics.glsl``; the emission integral, there in panels, is here in closed form.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from isosample.integral.checks import at_least_zero, within
from isosample.integral.quadrature import gauss_legendre

if TYPE_CHECKING:
    import numpy.typing as npt

    from isosample.volume.grid import F64

PANEL_DEPTH = 0.5  # optical depth of one panel of the shader
THIN_DEPTH = 1.0  # below, the closed forms would cancel and 12 Gauss nodes are exact to rounding
THIN_NODES = 12  # error <= 8.8e-39 |24th derivative|, which is < 1e18 for ends <= 2: far below 2**-53


def opacity_from_depth(depth: npt.ArrayLike) -> F64:
    r"""Opacity of a path of given optical depth.

    Parameters
    ----------
    depth : (...) array_like of float
        Optical depth, unitless, >= 0 and finite.

    Returns
    -------
    opacity : (...) float64
        :math:`1 - e^{-x}` without cancellation, in [0, 1].

    Raises
    ------
    InputError
        If a depth is negative or not finite (names its first index).
    """
    return np.negative(np.expm1(-at_least_zero(depth, "depth")))


def partial_depth(x0: npt.ArrayLike, x1: npt.ArrayLike, u: npt.ArrayLike) -> F64:
    r"""Optical depth of the first part of a stretch in which extinction runs linearly.

    Parameters
    ----------
    x0, x1 : (...) array_like of float
        Extinction at the front and at the back, times the stretch's length; unitless, >= 0.
    u : (...) array_like of float
        End of the part as a fraction of the stretch, in [0, 1].

    Returns
    -------
    depth : (...) float64
        :math:`D(u) = u\,(x_0 + \tfrac12 u\,(x_1 - x_0))`, unitless.

    Raises
    ------
    InputError
        If an end is negative or not finite, or a fraction outside [0, 1].

    Notes
    -----
    Evaluated as :math:`u\,(x_0 (1 - \tfrac12 u) + \tfrac12 u\,x_1)`, where no term cancels.
    """
    front, back = at_least_zero(x0, "x0"), at_least_zero(x1, "x1")
    part = within(u, "u", 0.0, 1.0)
    depth: F64 = part * (front * (1.0 - 0.5 * part) + 0.5 * part * back)
    return depth


def panel_end(x0: npt.ArrayLike, x1: npt.ArrayLike, u: npt.ArrayLike) -> F64:
    r"""Largest end w such that the panel [u, w] has optical depth ``PANEL_DEPTH`` at most.

    Parameters
    ----------
    x0, x1 : (...) array_like of float
        Extinction at the front and at the back, times the stretch's length; unitless, >= 0.
    u : (...) array_like of float
        Start of the panel as a fraction of the stretch, in [0, 1].

    Returns
    -------
    end : (...) float64
        In [u, 1]; 1 where the rest of the stretch has less depth.

    Raises
    ------
    InputError
        If an end is negative or not finite, or a fraction outside [0, 1].

    Notes
    -----
    With :math:`s = x_1 - x_0` and :math:`x_u = x_0 (1 - u) + x_1 u`, the root of
    :math:`\tfrac12 s d^2 + x_u d = P` in the form that does not cancel:
    :math:`d = 2P / (x_u + \sqrt{x_u^2 + 2 s P})`.
    """
    front, back = at_least_zero(x0, "x0"), at_least_zero(x1, "x1")
    start = within(u, "u", 0.0, 1.0)
    at_start = front * (1.0 - start) + back * start
    discriminant = at_start * at_start + 2.0 * (back - front) * PANEL_DEPTH
    scale = at_start + np.sqrt(np.maximum(discriminant, 0.0))
    step = np.divide(2.0 * PANEL_DEPTH, scale, out=np.ones(np.shape(scale)), where=discriminant > 0.0)
    return np.minimum(1.0, start + step)


def mean_opacity(a: npt.ArrayLike, b: npt.ArrayLike) -> F64:
    r"""Opacity of the parts [0, v] of a stretch, averaged over v in [0, 1].

    Parameters
    ----------
    a, b : (...) array_like of float
        Optical depth of the part: a v + b v², unitless; a >= 0, and it never falls (a + 2 b >= 0, to rounding). They
        broadcast.

    Returns
    -------
    opacity : (...) float64
        :math:`\int_0^1 1 - e^{-(a v + b v^2)}\,dv`, by 12 Gauss nodes, to rounding where a + b is at most 1.

    Raises
    ------
    InputError
        If a is negative or not finite.
    """
    linear, bend = np.broadcast_arrays(at_least_zero(a, "a"), np.asarray(b, dtype=np.float64))
    nodes, weights = gauss_legendre(THIN_NODES)
    depths = nodes * (linear[..., None] + nodes * bend[..., None])
    opacity: F64 = -np.expm1(-depths) @ weights
    return opacity


def segment_weights(x0: npt.ArrayLike, x1: npt.ArrayLike) -> F64:
    r"""Weights of the front and the back colour of a stretch: its radiance is their weighted sum.

    Extinction and colour both run linearly from the front to the back.

    Parameters
    ----------
    x0, x1 : (...) array_like of float
        Extinction at the front and at the back, times the stretch's length; unitless, >= 0. They broadcast.

    Returns
    -------
    weights : (..., 2) float64
        Weight of the front colour and of the back colour, >= 0; their sum is the opacity. Relative error of
        each below 1e-14 for optical depths up to 1e4.

    Raises
    ------
    InputError
        If an end is negative or not finite (names its first index).

    Notes
    -----
    With :math:`D` from `partial_depth`, integration by parts of [1]_ eq. 5 for :math:`c(u)` linear gives

    .. math:: \int_0^1 c\,D'\,e^{-D}\,du = c_0 (1 - F) + c_1 (F - e^{-D(1)}), \quad F = \int_0^1 e^{-D}\,du.

    F is a difference of error functions (rising extinction) or of Dawson functions (falling), see
    `mean_transmittance`.

    References
    ----------
    .. [1] N. Max, "Optical models for direct volume rendering", IEEE TVCG 1(2), 1995.
    """
    front, back = np.broadcast_arrays(at_least_zero(x0, "x0"), at_least_zero(x1, "x1"))
    depth = 0.5 * (front + back)
    weights = np.empty((*front.shape, 2))
    thin = depth < THIN_DEPTH
    weights[thin] = _thin_weights(front[thin], back[thin])
    mean = mean_transmittance(front[~thin], back[~thin])
    weights[~thin, 0] = 1.0 - mean
    weights[~thin, 1] = mean - np.exp(-depth[~thin])
    return weights


def mean_transmittance(x0: npt.ArrayLike, x1: npt.ArrayLike) -> F64:
    r"""Transmittance from the front to a point of a stretch, averaged over the points.

    Parameters
    ----------
    x0, x1 : (...) array_like of float
        Extinction at the front and at the back, times the stretch's length; unitless, >= 0. They broadcast.

    Returns
    -------
    mean : (...) float64
        :math:`F = \int_0^1 e^{-D(u)}\,du`, in [0, 1].

    Raises
    ------
    InputError
        If an end is negative or not finite (names its first index).

    Notes
    -----
    Completing the square, with :math:`s = |x_1 - x_0|`, :math:`a = x_0/\sqrt{2s}`, :math:`b = x_1/\sqrt{2s}`:

    - rising: :math:`F = \sqrt{\pi/(2s)}\,(\mathrm{erfcx}(a) - e^{-D(1)}\,\mathrm{erfcx}(b))`;
    - falling: :math:`F = \sqrt{2/s}\,(\mathrm{daw}(a) - e^{-D(1)}\,\mathrm{daw}(b))`;
    - constant: :math:`F = (1 - e^{-x_0})/x_0`.

    In each the subtrahend is below half of the minuend where D(1) >= 1, however close the two ends are;
    thinner stretches are summed on 12 Gauss nodes. [1]_ section 7.1 and 7.2.

    References
    ----------
    .. [1] F. Olver et al., "NIST digital library of mathematical functions", chapter 7.
    """
    front, back = np.broadcast_arrays(at_least_zero(x0, "x0"), at_least_zero(x1, "x1"))
    depth = 0.5 * (front + back)
    mean = np.empty(front.shape)
    thin = depth < THIN_DEPTH
    parts = (
        (thin, _mean_thin),
        (~thin & (back > front), _mean_rising),
        (~thin & (back < front), _mean_falling),
        (~thin & (back == front), _mean_constant),
    )
    for chosen, formula in parts:
        mean[chosen] = formula(front[chosen], back[chosen])
    return mean


def _thin_weights(front: F64, back: F64) -> F64:
    """Both weights by quadrature, each of terms of one sign, so that none loses digits however thin it is."""
    nodes, weights = gauss_legendre(THIN_NODES)
    depths = partial_depth(front[:, None], back[:, None], nodes)
    extinctions = front[:, None] * (1.0 - nodes) + back[:, None] * nodes
    return np.stack(
        [-np.expm1(-depths) @ weights, (nodes * extinctions * np.exp(-depths)) @ weights], axis=-1
    )


def _mean_thin(front: F64, back: F64) -> F64:
    nodes, weights = gauss_legendre(THIN_NODES)
    mean: F64 = np.exp(-partial_depth(front[:, None], back[:, None], nodes)) @ weights
    return mean


def _mean_rising(front: F64, back: F64) -> F64:
    from scipy.special import erfcx

    scale = np.sqrt(2.0 * (back - front))
    mean: F64 = (
        np.sqrt(np.pi) / scale * (erfcx(front / scale) - _transmittance(front, back) * erfcx(back / scale))
    )
    return mean


def _mean_falling(front: F64, back: F64) -> F64:
    from scipy.special import dawsn

    scale = np.sqrt(2.0 * (front - back))
    mean: F64 = 2.0 / scale * (dawsn(front / scale) - _transmittance(front, back) * dawsn(back / scale))
    return mean


def _mean_constant(front: F64, back: F64) -> F64:
    mean: F64 = opacity_from_depth(0.5 * (front + back)) / front
    return mean


def _transmittance(front: F64, back: F64) -> F64:
    transmittance: F64 = np.exp(-0.5 * (front + back))
    return transmittance

r"""The field between two neighbouring crossings of a ray as a cubic, and the emission integral over it, in float64.

Twin of ``shaders/lib/segment.glsl``. Positions are those in a band: 0 at its lower isovalue, 1 at its upper
one. Slopes are in band widths per length of the segment. Scalars, for use in kernels.

The cubic is the Hermite interpolant of the two positions and slopes [1]_. Between two crossings it is kept in
its band: a bump between two crossings of one isovalue is scaled, a monotone part is limited by the condition
of [2]_, but only as far as the cubic leaves the band.

References
----------
.. [1] C. de Boor, "A practical guide to splines", 1978, chapter IV.
.. [2] F. N. Fritsch and R. E. Carlson, "Monotone piecewise cubic interpolation", SIAM J. Numer. Anal. 17(2), 1980.
"""

from __future__ import annotations

import math

from isosample.compiled import compiled

PANEL_DEPTH = 1.0  # largest optical depth of one panel of three nodes, unless MAX_PANELS do not suffice
MAX_PANELS = 24
SPENT = 2.0**-24  # less transmittance than this ends the integral
LEAVES = 1e-3  # part of the band by which a cubic may leave it: it is then clamped
LEAVES_FAR = 0.02  # further part over which the limiter sets in, so that the picture has no step

_ROOT_15 = 15.0**0.5
NODES = (0.5 - _ROOT_15 / 10.0, 0.5, 0.5 + _ROOT_15 / 10.0)
WEIGHTS = (5.0 / 18.0, 8.0 / 18.0, 5.0 / 18.0)
# integrals of the Lagrange polynomials of the nodes, from 0 to each node (the matrix of Gauss's method of order 6)
BEFORE_FIRST = (5.0 / 36.0, 2.0 / 9.0 - _ROOT_15 / 15.0, 5.0 / 36.0 - _ROOT_15 / 30.0)
BEFORE_SECOND = (5.0 / 36.0 + _ROOT_15 / 24.0, 2.0 / 9.0, 5.0 / 36.0 - _ROOT_15 / 24.0)
BEFORE_THIRD = (5.0 / 36.0 + _ROOT_15 / 30.0, 2.0 / 9.0 + _ROOT_15 / 15.0, 5.0 / 36.0)


@compiled
def bump_height(a: float, b: float) -> float:
    """Largest value of a u (1 − u)² + b u² (1 − u) on [0, 1], for a, b >= 0.

    The derivative vanishes where 3 (a − b) u² − 2 (2a − b) u + a = 0, written so that nothing cancels: from the
    end with the larger slope.
    """
    larger = max(a, b)
    if larger == 0.0:
        return 0.0
    share = min(a, b) / larger
    u = 1.0 / (2.0 - share + math.sqrt(1.0 - share + share * share))
    return larger * u * (1.0 - u) * (1.0 - u + share * u)


@compiled
def overshoot(a: float, b: float) -> float:
    """How far the cubic from 0 to 1 with slopes a, b >= 0 leaves [0, 1]; 0 where a² + b² <= 9 [2]_."""
    if a * a + b * b <= 9.0:
        return 0.0
    half, square = 3.0 - 2.0 * a - b, 3.0 * (a + b - 2.0)
    discriminant = half * half - a * square
    if discriminant <= 0.0:
        return 0.0
    root = math.sqrt(discriminant)
    high = a / (root - half)
    low = (root - half) / square
    return max(segment_curve(0.0, 1.0, a, b, high) - 1.0, -segment_curve(0.0, 1.0, a, b, low), 0.0)


@compiled
def limit_slopes(front: float, back: float, slope_front: float, slope_back: float) -> tuple[float, float]:
    """Slopes of a segment between two crossings that keep its cubic in the band.

    Parameters
    ----------
    front, back : float
        Positions of the ends, 0 or 1.
    slope_front, slope_back : float
        In the direction of travel [band widths per segment]; of the sign with which the walk goes.

    Returns
    -------
    slope_front, slope_back : float
        Both times one factor in (0, 1].
    """
    a, b = abs(slope_front), abs(slope_back)
    if front == back:
        factor = 1.0 / max(bump_height(a, b), 1.0)
    else:
        size = math.sqrt(a * a + b * b)
        far = min(max((overshoot(a, b) - LEAVES) / LEAVES_FAR, 0.0), 1.0)
        factor = 1.0 + far * (3.0 / max(size, 3.0) - 1.0)
    return factor * slope_front, factor * slope_back


@compiled
def segment_curve(front: float, back: float, slope_front: float, slope_back: float, u: float) -> float:
    """Cubic Hermite interpolant at `u`, not kept in the band."""
    rise = back - front
    square = 3.0 * rise - 2.0 * slope_front - slope_back
    cube = slope_front + slope_back - 2.0 * rise
    return front + u * (slope_front + u * (square + u * cube))


@compiled
def segment_position(front: float, back: float, slope_front: float, slope_back: float, u: float) -> float:
    """Position in the band at the part `u` of the segment, in [0, 1]."""
    return min(max(segment_curve(front, back, slope_front, slope_back, u), 0.0), 1.0)


@compiled
def panel_edge(number: int, count: int, thickness: float) -> float:
    """End of the first `number` of `count` panels, in [0, 1].

    Even, unless the segment is so thick that even panels would be too deep: then finer towards the front,
    where the light comes from.
    """
    even = number / count
    return even * even if thickness > PANEL_DEPTH * MAX_PANELS else even


@compiled
def panel_count(front: float, back: float, thickness: float) -> int:
    """Number of panels for the largest optical depth that a segment can have; two at least for a bump.

    Position times extinction is of degree 6 in u, one above what three nodes integrate exactly: over a bump,
    whose slopes are large, one panel would err by 2e-3 of the band's change of colour.
    """
    least = 2.0 if front == back else 1.0
    return int(min(max(math.ceil(thickness / PANEL_DEPTH), least), float(MAX_PANELS)))


@compiled
def largest_depth(
    depth_low: float, depth_high: float, front: float, back: float, slope_front: float, slope_back: float
) -> float:
    """Largest extinction times length that the cubic reaches.

    It stays between its Bernstein coefficients, so that a shallow bump needs few panels, however dense the far
    end of its band.
    """
    first = min(max(front + slope_front / 3.0, 0.0), 1.0)
    last = min(max(back - slope_back / 3.0, 0.0), 1.0)
    lowest, highest = min(front, back, first, last), max(front, back, first, last)
    change = depth_high - depth_low
    return max(depth_low + lowest * change, depth_low + highest * change)


@compiled
def segment_panel(
    depth_low: float,
    depth_high: float,
    front: float,
    back: float,
    slope_front: float,
    slope_back: float,
    start: float,
    length: float,
) -> tuple[tuple[float, float, float], tuple[float, float, float], tuple[float, float, float], float]:
    """Three Gauss-Legendre nodes of a piece of a segment, in which the optical depth is small.

    Parameters
    ----------
    depth_low, depth_high, front, back, slope_front, slope_back : float
        As for `cubic_moments`.
    start, length : float
        The piece, in parts of the segment.

    Returns
    -------
    parts, positions, emitted : three floats each
        Of the segment, in the band, and in proportion to what is seen of each node.
    opacity : float
        Of the piece.
    """
    u0, u1, u2 = start + length * NODES[0], start + length * NODES[1], start + length * NODES[2]
    p0 = segment_position(front, back, slope_front, slope_back, u0)
    p1 = segment_position(front, back, slope_front, slope_back, u1)
    p2 = segment_position(front, back, slope_front, slope_back, u2)
    x0 = length * (depth_low + p0 * (depth_high - depth_low))
    x1 = length * (depth_low + p1 * (depth_high - depth_low))
    x2 = length * (depth_low + p2 * (depth_high - depth_low))
    d0 = BEFORE_FIRST[0] * x0 + BEFORE_FIRST[1] * x1 + BEFORE_FIRST[2] * x2
    d1 = BEFORE_SECOND[0] * x0 + BEFORE_SECOND[1] * x1 + BEFORE_SECOND[2] * x2
    d2 = BEFORE_THIRD[0] * x0 + BEFORE_THIRD[1] * x1 + BEFORE_THIRD[2] * x2
    least = min(d0, d1, d2)
    e0 = WEIGHTS[0] * x0 * math.exp(least - d0)
    e1 = WEIGHTS[1] * x1 * math.exp(least - d1)
    e2 = WEIGHTS[2] * x2 * math.exp(least - d2)
    opacity = -math.expm1(-(WEIGHTS[0] * x0 + WEIGHTS[1] * x1 + WEIGHTS[2] * x2))
    return (u0, u1, u2), (p0, p1, p2), (e0, e1, e2), opacity


@compiled
def cubic_moments(
    depth_low: float,
    depth_high: float,
    front: float,
    back: float,
    slope_front: float,
    slope_back: float,
    start: float,
    end: float,
) -> tuple[float, float, float, float]:
    r"""Emission integrals over a part of a segment, along which the position in the band is a cubic.

    Parameters
    ----------
    depth_low, depth_high : float
        Extinction at the lower and upper end of the band, times the length of the whole segment, >= 0.
    front, back, slope_front, slope_back : float
        The cubic.
    start, end : float
        The part, in [0, 1].

    Returns
    -------
    opacity, position, part, both : float
        Integrals of :math:`w\,\tau e^{-D}` for w = 1, p, u and u p, where p is the position in the band and u
        the part of the segment. A colour that runs linearly from c_low to c_high over the band gives
        c_low (opacity − position) + c_high position.

    Notes
    -----
    Panels of optical depth 1 at most, each with the three Gauss-Legendre nodes; the optical depth in front of
    a node by the matrix of Gauss's method of order 6; the weights of the nodes are scaled so that they sum to
    the opacity, which is in closed form: extinction is a cubic of u, for which the rule is exact.
    """
    width = end - start
    thickness = largest_depth(depth_low, depth_high, front, back, slope_front, slope_back) * width
    count = panel_count(front, back, thickness)
    first = second = third = fourth = 0.0
    through, left = 1.0, 0.0
    for panel in range(count):
        right = panel_edge(panel + 1, count, thickness)
        origin, length = start + width * left, width * (right - left)
        (u0, u1, u2), (p0, p1, p2), (e0, e1, e2), opacity = segment_panel(
            depth_low, depth_high, front, back, slope_front, slope_back, origin, length
        )
        total = e0 + e1 + e2
        if total > 0.0:
            scale = through * opacity / total
            first += through * opacity
            second += scale * (e0 * p0 + e1 * p1 + e2 * p2)
            third += scale * (e0 * u0 + e1 * u1 + e2 * u2)
            fourth += scale * (e0 * u0 * p0 + e1 * u1 * p1 + e2 * u2 * p2)
            through *= 1.0 - opacity
        left = right
        if through < SPENT:
            break
    return first, second, third, fourth

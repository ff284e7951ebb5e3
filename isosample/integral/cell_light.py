r"""Light inside one cell of a grid: what the gradient along a ray makes of a colour.

With n the unit gradient and d the unit direction of the ray, q = \|n · d\| and a colour c becomes
c (k_a + k_d q) + k_s q^m, as `shading.blinn_phong` has it. Where the gradient is 0, so is q: the ambient part is left.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from isosample.compiled import compiled
from isosample.integral.quadrature import gauss_legendre

F64 = npt.NDArray[np.float64]

NODES = 10  # of a piece; it is compared with its two halves of as many
MAX_PIECES = 128  # of a panel that wait at once: each is shorter than the one behind it
MOST_TURN_HALVINGS = 50  # of a cell, where a double zero is told from none
# `CellLight.numbers`: where in the cell the polynomial that is walked begins, and how much of the cell it is; rounding
# of the unit gradient where it is longest; bound of the gradient's change per cell; number of turns; what is left
# unresolved of this ray, and of the worst ray so far, and which one that is
START, WIDTH, DOUBT, CHANGE, TURNS, UNRESOLVED, WORST, WORST_RAY = range(8)
END, RED, DOUBTED = 0, 1, 4  # columns of `CellLight.pieces`


class CellLight(NamedTuple):
    """A material, and the gradient along the part of a ray in one cell; one for every thread.

    Attributes
    ----------
    material : (4,) float64
        Ambient, diffuse and specular factor, and the shininess.
    world_from_slopes : (3, 3) float64
        Turns derivatives per sample step into derivatives per world unit.
    slope_kernel : (4, 4) float64
        Of a spline: the derivatives of the taps' weights, see `GridSpline.kernel`.
    allowed : float
        Largest error of the light by quadrature; as much again may be left unresolved.
    nodes, weights : (N,) float64
        Gauss-Legendre rule of a piece.
    gradient : (4, D + 1) float64
        Bernstein coefficients along the part of the ray: x, y, z, and the component along the ray; divided by the
        largest of the first three.
    numbers : (8,) float64
        See ``START``.
    turns : (D,) float64
        Where in the cell the component along the ray changes its sign, ascending: there the light has a kink.
    slopes : (2, 2, 2, 2) float64
        Scratch: derivatives at the corners, per sample step, and their sizes.
    taps : (4, 4, 4), sizes : (3, 4, 4), mixed : (10,) float64
        Scratch: sizes of the taps of a spline, and of their weights, and what they are mixed to.
    sums : (11,) float64
        Scratch: integral of a polynomial.
    waiting : (`MOST_TURN_HALVINGS` + 2, D + 2), row : (D + 1,) float64
        Scratch: parts of the component along the ray that wait.
    pieces : (`MAX_PIECES` + 2, 5) float64
        Scratch: pieces of a panel that wait, the first one at the end.
    """

    material: F64
    world_from_slopes: F64
    slope_kernel: F64
    allowed: float
    nodes: F64
    weights: F64
    gradient: F64
    numbers: F64
    turns: F64
    slopes: F64
    taps: F64
    sizes: F64
    mixed: F64
    sums: F64
    waiting: F64
    row: F64
    pieces: F64

    @classmethod
    def build(
        cls, material: F64, index_from_world: F64, tolerance: float, kernel: F64 | None = None
    ) -> CellLight:
        """Light for one thread; `kernel` is that of a spline."""
        nodes, weights = gauss_legendre(NODES)
        slope_kernel, count = np.zeros((4, 4)), 4 if kernel is None else 10
        if kernel is not None:
            slope_kernel[:, :3] = kernel[:, 1:] * np.array([1.0, 2.0, 3.0])
        return cls(
            np.array(material, dtype=np.float64),
            np.ascontiguousarray(index_from_world[:3, :3].T),
            slope_kernel,
            0.5 * tolerance,
            nodes.copy(),
            weights.copy(),
            np.zeros((4, count)),
            np.zeros(8),
            np.zeros(count - 1),
            np.zeros((2, 2, 2, 2)),
            np.zeros((4, 4, 4)),
            np.zeros((3, 4, 4)),
            np.zeros(10),
            np.zeros(11),
            np.zeros((MOST_TURN_HALVINGS + 2, count + 1)),
            np.zeros(count),
            np.zeros((MAX_PIECES + 2, 5)),
        )


@compiled
def begin_lit_ray(light: CellLight) -> None:
    """Nothing is unresolved of a new ray."""
    light.numbers[UNRESOLVED] = 0.0


@compiled
def end_lit_ray(light: CellLight, ray: int) -> None:
    """Remember the worst ray."""
    if light.numbers[UNRESOLVED] > light.numbers[WORST]:
        light.numbers[WORST], light.numbers[WORST_RAY] = light.numbers[UNRESOLVED], ray


@compiled
def next_turn(light: CellLight, start: float, end: float) -> float:
    """First turn between two places of the part that is walked, or −1."""
    begin, width = light.numbers[START], light.numbers[WIDTH]
    for n in range(int(light.numbers[TURNS])):
        place = (light.turns[n] - begin) / width
        if start < place < end:
            return float(place)
    return -1.0


@compiled
def set_part(light: CellLight, start: float, width: float) -> None:
    """Tell which part of the cell is walked next, from 0 to 1."""
    light.numbers[START], light.numbers[WIDTH] = start, width


@compiled
def gradient_at(light: CellLight, s: float) -> tuple[float, float, float, float]:
    """The four components at a place in [0, 1] of the part that is walked, by Bernstein's basis [1]_.

    References
    ----------
    .. [1] G. Farin, "Curves and surfaces for CAGD", 5th edition, 2002, section 5.1.
    """
    gradient = light.gradient
    t = light.numbers[START] + s * light.numbers[WIDTH]
    last = gradient.shape[1] - 1
    u, power, choose = 1.0 - t, 1.0, 1.0
    x, y, z, along = gradient[0, 0] * u, gradient[1, 0] * u, gradient[2, 0] * u, gradient[3, 0] * u
    for i in range(1, last):
        power *= t
        choose = choose * (last - i + 1) / i
        weight = power * choose
        x = (x + weight * gradient[0, i]) * u
        y = (y + weight * gradient[1, i]) * u
        z = (z + weight * gradient[2, i]) * u
        along = (along + weight * gradient[3, i]) * u
    power *= t
    return (
        x + power * gradient[0, last],
        y + power * gradient[1, last],
        z + power * gradient[2, last],
        along + power * gradient[3, last],
    )


@compiled
def light_at(light: CellLight, s: float) -> tuple[float, float, float]:
    """What light makes of a colour at a place in [0, 1] of the part that is walked.

    Returns
    -------
    shade, highlight : float
        A colour c becomes c · shade + highlight.
    doubt : float
        By how much rounding of the gradient may change the cosine, at most 1.
    """
    x, y, z, along = gradient_at(light, s)
    ambient, diffuse, specular, shininess = (
        light.material[0],
        light.material[1],
        light.material[2],
        light.material[3],
    )
    steepness = math.sqrt(x * x + y * y + z * z)
    if steepness == 0.0:
        return ambient, 0.0, 1.0 if light.numbers[DOUBT] > 0.0 else 0.0
    cosine = min(abs(along) / steepness, 1.0)
    highlight = specular * cosine**shininess if specular > 0.0 and cosine > 0.0 else 0.0
    doubt = min(light.numbers[DOUBT] / steepness, 1.0)
    return ambient + diffuse * cosine, highlight, doubt

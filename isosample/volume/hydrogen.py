"""Probability densities of the hydrogen atom, as polynomials: no angle, hence no pole, is ever formed."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.polynomial import Polynomial

from isosample.errors import InputError
from isosample.volume.field import Field

if TYPE_CHECKING:
    from isosample.volume.grid import F64


@dataclass(frozen=True)
class HydrogenOrbital(Field):
    r"""Density of a real hydrogen orbital, scaled to a maximum of 1.

    Parameters
    ----------
    n, l, m : int
        Quantum numbers: n >= 1, 0 <= l < n, -l <= m <= l. m >= 0 varies as cos(m φ), m < 0 as sin(\|m\| φ):
        (3, 2, 0) is 3d_z², (4, 3, -2) is 4f_xyz.
    bohr_radius : float
        Length unit [world], > 0.
    centre : 3 floats
        The nucleus [world].

    Notes
    -----
    :math:`f = |\psi|^2 / \max|\psi|^2` with :math:`\psi = e^{-\rho/2} L_{n-l-1}^{2l+1}(\rho)\, r^l Y_{lm}`,
    :math:`\rho = 2r / (n a_0)` [1]_, and the solid harmonic as a polynomial [2]_:
    :math:`r^l Y_{lm} = \Pi(z, r^2)\,\mathrm{Re\ or\ Im}(x + iy)^{|m|}`,
    :math:`\Pi = \sum_k \gamma_k r^{2k} z^{l-2k-|m|}`. The density of an s orbital has a cusp at the nucleus;
    its gradient is returned as 0 there.

    References
    ----------
    .. [1] D. J. Griffiths, "Introduction to Quantum Mechanics", 2nd ed., 2005, eq. 4.89.
    .. [2] T. Helgaker, P. Jørgensen, J. Olsen, "Molecular Electronic-Structure Theory", 2000, section 6.4.2.
    """

    n: int
    l: int  # noqa: E741  (the quantum number's name)
    m: int
    bohr_radius: float = 1.0
    centre: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        if not (self.n >= 1 and 0 <= self.l < self.n and abs(self.m) <= self.l):
            raise InputError(
                f"no orbital has n, l, m = {self.n}, {self.l}, {self.m}; n >= 1, 0 <= l < n, |m| <= l."
            )
        if not self.bohr_radius > 0:
            raise InputError(f"bohr_radius {self.bohr_radius} must be > 0.")

    def value(self, points: F64) -> F64:
        """Density at `points`, in [0, 1]."""
        amplitude = self._amplitude(self._scaled(points))
        squared: F64 = amplitude**2 / self._peak
        return squared

    def gradient(self, points: F64) -> F64:
        """Gradient of the density at `points`, per world unit."""
        scaled = self._scaled(points)
        rho = np.sqrt((scaled**2).sum(axis=-1))
        harmonic, slope = self._harmonic(scaled)
        envelope = np.exp(-rho / 2)
        radial = envelope * self._laguerre(rho)
        radial_slope = envelope * (self._laguerre.deriv()(rho) - self._laguerre(rho) / 2)
        direction = scaled / np.where(rho > 0, rho, 1.0)[..., None]
        amplitude_slope = (radial_slope * harmonic)[..., None] * direction + radial[..., None] * slope
        gradient: F64 = (2 * radial * harmonic)[..., None] * amplitude_slope / (self._peak * self._length)
        return gradient

    @property
    def _length(self) -> float:
        """World length of one unit of ρ."""
        return self.n * self.bohr_radius / 2

    def _scaled(self, points: F64) -> F64:
        """Positions about the nucleus in units of ρ."""
        scaled: F64 = (np.asarray(points, dtype=np.float64) - np.asarray(self.centre)) / self._length
        return scaled

    def _amplitude(self, scaled: F64) -> F64:
        rho = np.sqrt((scaled**2).sum(axis=-1))
        amplitude: F64 = np.exp(-rho / 2) * self._laguerre(rho) * self._harmonic(scaled)[0]
        return amplitude

    @cached_property
    def _laguerre(self) -> Polynomial:
        """Associated Laguerre polynomial of degree n − l − 1 and order 2l + 1."""
        degree, order = self.n - self.l - 1, 2 * self.l + 1
        return Polynomial(
            [(-1) ** i * math.comb(degree + order, degree - i) / math.factorial(i) for i in range(degree + 1)]
        )

    @cached_property
    def _zonal_terms(self) -> list[tuple[float, int, int]]:
        """Terms (γ, power of r², power of z) of Π."""
        m = abs(self.m)
        return [
            (
                (-1) ** k
                * math.comb(self.l, k)
                * math.comb(2 * self.l - 2 * k, self.l)
                * math.factorial(self.l - 2 * k)
                / (2**self.l * math.factorial(self.l - 2 * k - m)),
                k,
                self.l - 2 * k - m,
            )
            for k in range((self.l - m) // 2 + 1)
        ]

    def _harmonic(self, points: F64) -> tuple[F64, F64]:
        """Solid harmonic, without its normalisation, and its gradient."""
        x, y, z = np.moveaxis(points, -1, 0)
        square = x * x + y * y + z * z
        zonal, by_square, by_z = np.zeros_like(z), np.zeros_like(z), np.zeros_like(z)
        for factor, k, power in self._zonal_terms:
            zonal += factor * square**k * z**power
            if k:
                by_square += factor * k * square ** (k - 1) * z**power
            if power:
                by_z += factor * power * square**k * z ** (power - 1)
        sector, by_x, by_y = self._sector(x, y)
        slope = 2 * (by_square * sector)[..., None] * points
        slope[..., 0] += zonal * by_x
        slope[..., 1] += zonal * by_y
        slope[..., 2] += by_z * sector
        return zonal * sector, slope

    def _sector(self, x: F64, y: F64) -> tuple[F64, F64, F64]:
        """Re or Im of (x + iy)^|m| and its derivatives by x and y."""
        m = abs(self.m)
        power = (x + 1j * y) ** m
        lower = m * (x + 1j * y) ** (m - 1) if m else np.zeros_like(power)
        if self.m >= 0:
            return power.real, lower.real, -lower.imag
        return power.imag, lower.imag, lower.real

    @cached_property
    def _peak(self) -> float:
        """Largest value of |ψ|²: the product of the largest radial and the largest angular factor."""
        rho = Polynomial([0.0, 1.0])
        radial = rho**self.l * self._laguerre  # times exp(−ρ/2): stationary where p' = p/2
        at = _real_roots(radial.deriv() - radial / 2)
        at = np.append(at[at >= 0], 0.0)
        radial_peak = float(np.max(radial(at) ** 2 * np.exp(-at)))
        z = Polynomial([0.0, 1.0])
        zonal = sum((factor * z**power for factor, _, power in self._zonal_terms), Polynomial([0.0]))
        angular = zonal**2 * (1 - z**2) ** abs(self.m)
        heights = np.clip(_real_roots(angular.deriv()), -1.0, 1.0)
        return radial_peak * float(np.max(angular(np.append(heights, [-1.0, 1.0]))))


def _real_roots(polynomial: Polynomial) -> F64:
    """Real parts of all roots: a spurious one adds a candidate, it cannot raise a maximum over the axis."""
    roots: F64 = np.real(polynomial.roots()).astype(np.float64)
    return roots

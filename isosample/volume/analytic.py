"""Closed-form fields with gradients: the scenes whose pictures are known."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from isosample.errors import InputError
from isosample.volume.field import Field, sample_field
from isosample.volume.gaussian_mixture import GaussianMixture, nucleon_like
from isosample.volume.hydrogen import HydrogenOrbital

if TYPE_CHECKING:
    from isosample.volume.grid import F64

__all__ = [
    "Constant",
    "Field",
    "GaussianMixture",
    "GaussianShell",
    "Gyroid",
    "HydrogenOrbital",
    "LinearRamp",
    "MarschnerLobb",
    "PlaneWaves",
    "SphereDistance",
    "nucleon_like",
    "sample_field",
]

Vector = tuple[float, float, float]


@dataclass(frozen=True)
class Constant(Field):
    """f(p) = level."""

    level: float

    def value(self, points: F64) -> F64:
        """`level` everywhere."""
        return np.full(np.shape(points)[:-1], self.level, dtype=np.float64)

    def gradient(self, points: F64) -> F64:
        """Zero everywhere."""
        return np.zeros(np.shape(points), dtype=np.float64)

    def lipschitz(self) -> float:
        """Return 0."""
        return 0.0


@dataclass(frozen=True)
class LinearRamp(Field):
    """f(p) = normal · p + offset; `normal` need not have unit length."""

    normal: Vector
    offset: float = 0.0

    def value(self, points: F64) -> F64:
        """Ramp at `points`."""
        ramp: F64 = np.asarray(points, dtype=np.float64) @ np.asarray(self.normal) + self.offset
        return ramp

    def gradient(self, points: F64) -> F64:
        """Return `normal` everywhere."""
        return np.broadcast_to(np.asarray(self.normal, dtype=np.float64), np.shape(points)).copy()

    def lipschitz(self) -> float:
        """Return |normal|, which is |∇f| everywhere."""
        return math.hypot(*self.normal)


@dataclass(frozen=True)
class SphereDistance(Field):
    """f(p) = |p − centre| − radius, the signed distance to a sphere; the gradient at its centre is 0."""

    centre: Vector
    radius: float

    def value(self, points: F64) -> F64:
        """Signed distance at `points` [world]."""
        distance: F64 = _distance(points, self.centre)[0] - self.radius
        return distance

    def gradient(self, points: F64) -> F64:
        """Return the unit vector away from the centre."""
        return _distance(points, self.centre)[1]

    def lipschitz(self) -> float:
        """Return 1, by the triangle inequality: distances to one point differ by no more than the way."""
        return 1.0


@dataclass(frozen=True)
class GaussianShell(Field):
    """f(p) = amplitude · exp(−(|p − centre| − radius)² / (2 width²)), a fuzzy sphere."""

    centre: Vector
    radius: float
    width: float
    amplitude: float = 1.0

    def __post_init__(self) -> None:
        if not self.width > 0:
            raise InputError(f"width {self.width} must be > 0.")

    def value(self, points: F64) -> F64:
        """Shell at `points`."""
        scaled = (_distance(points, self.centre)[0] - self.radius) / self.width
        shell: F64 = self.amplitude * np.exp(-0.5 * scaled**2)
        return shell

    def gradient(self, points: F64) -> F64:
        """Gradient at `points`; 0 at the centre, where the field has a small cone."""
        distance, direction = _distance(points, self.centre)
        scaled = (distance - self.radius) / self.width
        slope = -self.amplitude / self.width * scaled * np.exp(-0.5 * scaled**2)
        gradient: F64 = slope[..., None] * direction
        return gradient

    def lipschitz(self) -> float:
        """Return |amplitude| e^(−1/2) / width: |s| exp(−s²/2) is largest where the scaled distance s is ±1."""
        return abs(self.amplitude) * math.exp(-0.5) / self.width


@dataclass(frozen=True)
class MarschnerLobb(Field):
    r"""The Marschner–Lobb test signal, meant for the box [−1, 1]³, in [0, 1].

    Notes
    -----
    :math:`f = \frac{1 - \sin(\pi z / 2) + \alpha\,(1 + \rho_r(\sqrt{x^2 + y^2}))}{2 (1 + \alpha)}` with
    :math:`\rho_r(r) = \cos(2\pi f_M \cos(\pi r / 2))` [1]_.

    References
    ----------
    .. [1] S. Marschner, R. Lobb, "An evaluation of reconstruction filters for volume rendering",
       IEEE Visualization 1994.
    """

    frequency: float = 6.0
    alpha: float = 0.25

    def value(self, points: F64) -> F64:
        """Signal at `points`."""
        x, y, z = np.moveaxis(np.asarray(points, dtype=np.float64), -1, 0)
        ripple = np.cos(math.tau * self.frequency * np.cos(0.5 * np.pi * np.hypot(x, y)))
        signal: F64 = (1 - np.sin(0.5 * np.pi * z) + self.alpha * (1 + ripple)) / (2 * (1 + self.alpha))
        return signal

    def gradient(self, points: F64) -> F64:
        """Gradient at `points`; smooth on the axis too, as sin(πr/2)/r is taken as a sinc."""
        x, y, z = np.moveaxis(np.asarray(points, dtype=np.float64), -1, 0)
        r = np.hypot(x, y)
        phase = math.tau * self.frequency * np.cos(0.5 * np.pi * r)
        slope_over_r = np.sin(phase) * math.tau * self.frequency * (0.5 * np.pi) ** 2 * np.sinc(0.5 * r)
        across = self.alpha * slope_over_r
        along = -0.5 * np.pi * np.cos(0.5 * np.pi * z)
        gradient: F64 = np.stack([across * x, across * y, along], axis=-1) / (2 * (1 + self.alpha))
        return gradient

    def lipschitz(self) -> float:
        """Return hypot(α π² f_M, π / 2) / (2 (1 + α)).

        Across the axis |dρ_r/dr| = 2π f_M (π / 2) |sin(πr/2) sin(2π f_M cos(πr/2))| <= π² f_M, along it
        |d sin(πz/2)/dz| <= π / 2; the two are perpendicular. The sines of the first do not reach 1 together,
        but nearly so where f_M is large.
        """
        across, along = self.alpha * np.pi**2 * self.frequency, 0.5 * np.pi
        return math.hypot(across, along) / abs(2 * (1 + self.alpha))


@dataclass(frozen=True)
class Gyroid(Field):
    """f(p) = sin kx cos ky + sin ky cos kz + sin kz cos kx, k = 2π / period (A. Schoen's gyroid is f ≈ 0)."""

    period: float = 1.0

    def value(self, points: F64) -> F64:
        """Field at `points`, in [−1.5, 1.5]."""
        sine, cosine = self._waves(points)
        total: F64 = (sine * np.roll(cosine, -1, axis=-1)).sum(axis=-1)
        return total

    def gradient(self, points: F64) -> F64:
        """Gradient at `points`."""
        sine, cosine = self._waves(points)
        wave_number = math.tau / self.period
        slope: F64 = wave_number * (cosine * np.roll(cosine, -1, axis=-1) - np.roll(sine, 1, axis=-1) * sine)
        return slope

    def lipschitz(self) -> float:
        """Return √3 |k|.

        With X = kx and so on, (df/dx)² / k² = (cos X cos Y − sin Z sin X)² <= cos² Y + sin² Z (Cauchy and
        Schwarz, cos² X + sin² X = 1); the sum over the axes is 3. Attained at the origin.
        """
        return math.sqrt(3.0) * math.tau / abs(self.period)

    def _waves(self, points: F64) -> tuple[F64, F64]:
        phase = math.tau / self.period * np.asarray(points, dtype=np.float64)
        return np.sin(phase), np.cos(phase)


@dataclass(frozen=True)
class PlaneWaves(Field):
    """f(p) = Σ a_k cos(q_k · p + φ_k); the q_k are angular wave vectors [radian/world]."""

    wave_vectors: tuple[Vector, ...]
    amplitudes: tuple[float, ...]
    phases: tuple[float, ...]

    def __post_init__(self) -> None:
        if not len(self.wave_vectors) == len(self.amplitudes) == len(self.phases):
            raise InputError(
                f"{len(self.wave_vectors)} wave vectors, {len(self.amplitudes)} amplitudes and "
                f"{len(self.phases)} phases must be equally many."
            )

    def value(self, points: F64) -> F64:
        """Sum of the waves at `points`."""
        total: F64 = np.cos(self._phase(points)) @ np.asarray(self.amplitudes, dtype=np.float64)
        return total

    def gradient(self, points: F64) -> F64:
        """Gradient of the sum at `points`."""
        heights = -np.sin(self._phase(points)) * np.asarray(self.amplitudes, dtype=np.float64)
        slope: F64 = heights @ np.asarray(self.wave_vectors, dtype=np.float64)
        return slope

    def lipschitz(self) -> float:
        """Return Σ |a_k| |q_k|, by the triangle inequality; attained by a single wave."""
        return sum(abs(a) * math.hypot(*q) for a, q in zip(self.amplitudes, self.wave_vectors, strict=True))

    def _phase(self, points: F64) -> F64:
        phase: F64 = np.asarray(points) @ np.asarray(self.wave_vectors).T + np.asarray(self.phases)
        return phase


def _distance(points: F64, centre: Vector) -> tuple[F64, F64]:
    """Distance from `centre` and the unit vector away from it (0 at the centre)."""
    offset = np.asarray(points, dtype=np.float64) - np.asarray(centre)
    distance: F64 = np.sqrt((offset**2).sum(axis=-1))
    return distance, offset / np.where(distance > 0, distance, 1.0)[..., None]

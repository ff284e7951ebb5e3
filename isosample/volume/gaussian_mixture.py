"""Sums of Gaussians, and the one that stands in for the nucleon data set."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from isosample.errors import InputError
from isosample.volume.field import Field

if TYPE_CHECKING:
    from isosample.volume.grid import F64

    Vector = tuple[float, float, float]


@dataclass(frozen=True)
class GaussianMixture(Field):
    """f(p) = Σ a_k exp(−|p − c_k|² / (2 w_k²)).

    Attributes
    ----------
    centres : tuple of K triples
        [world]
    widths, amplitudes : tuples of K floats
        Standard deviations [world], > 0, and heights.
    """

    centres: tuple[Vector, ...]
    widths: tuple[float, ...]
    amplitudes: tuple[float, ...]

    def __post_init__(self) -> None:
        if not len(self.centres) == len(self.widths) == len(self.amplitudes):
            raise InputError(
                f"{len(self.centres)} centres, {len(self.widths)} widths and {len(self.amplitudes)} "
                "amplitudes must be equally many."
            )
        if not all(width > 0 for width in self.widths):
            raise InputError(f"widths {self.widths} must be > 0.")

    def value(self, points: F64) -> F64:
        """Sum of the Gaussians at `points`."""
        total = np.zeros(np.shape(points)[:-1])
        for centre, width, amplitude in zip(self.centres, self.widths, self.amplitudes, strict=True):
            total += amplitude * _bell((np.asarray(points) - centre) / width)
        return total

    def gradient(self, points: F64) -> F64:
        """Gradient of the sum at `points`."""
        total = np.zeros(np.shape(points))
        for centre, width, amplitude in zip(self.centres, self.widths, self.amplitudes, strict=True):
            scaled = (np.asarray(points) - centre) / width
            total -= (amplitude / width) * _bell(scaled)[..., None] * scaled
        return total

    def lipschitz(self) -> float:
        """Return Σ |a_k| e^(−1/2) / w_k.

        |∇ exp(−s²/2)| = (s / w) exp(−s²/2), s = |p − c| / w, is stationary at s = 1 only; the triangle
        inequality does the rest. Attained by a single Gaussian.
        """
        return sum(abs(a) / w for a, w in zip(self.amplitudes, self.widths, strict=True)) * math.exp(-0.5)


def nucleon_like() -> GaussianMixture:
    """Return two bodies on an axis with a ring of six between them, in the box [0, 40]³, values about 0 to 1.

    A stand-in for the nucleon data set (two-body density, 41³ samples): at 0.5 the ring's isosurface is a
    torus with bulges and the bodies' are spheres; at low values all of them merge.
    """
    bodies = ((20.0, 20.0, 9.0), (20.0, 20.0, 31.0))
    angles = [math.tau * k / 6 for k in range(6)]
    ring = tuple((20 + 9.5 * math.cos(angle), 20 + 9.5 * math.sin(angle), 20.0) for angle in angles)
    return GaussianMixture((*bodies, *ring), (4.0,) * 2 + (4.2,) * 6, (0.95,) * 2 + (0.6,) * 6)


def _bell(scaled: F64) -> F64:
    """exp(−|s|²/2) over the last axis."""
    bell: F64 = np.exp(-0.5 * (scaled**2).sum(axis=-1))
    return bell

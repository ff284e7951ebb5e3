"""Pieces of rays on which a field is the cubic of its values and slopes at both ends."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

F64 = npt.NDArray[np.float64]
I64 = npt.NDArray[np.int64]
Bool = npt.NDArray[np.bool_]


class Pieces(NamedTuple):
    """Pieces of rays: row of the ray, ray parameter, value and slope (data units per world unit) at both ends."""

    ray: I64
    ends: F64  # (P, 2)
    values: F64  # (P, 2)
    slopes: F64  # (P, 2)

    def rows(self, chosen: Bool | I64) -> Pieces:
        """Some of the pieces."""
        return Pieces(self.ray[chosen], self.ends[chosen], self.values[chosen], self.slopes[chosen])

    @classmethod
    def joined(cls, parts: list[Pieces]) -> Pieces:
        """All pieces of several lists."""
        return cls(
            np.concatenate([part.ray for part in parts]),
            np.concatenate([part.ends for part in parts]),
            np.concatenate([part.values for part in parts]),
            np.concatenate([part.slopes for part in parts]),
        )


def halves(pieces: Pieces, middle: F64, value: F64, slope: F64) -> Pieces:
    """First halves of all pieces, then second halves."""

    def split(column: F64, at_middle: F64) -> F64:
        front = np.stack([column[:, 0], at_middle], axis=1)
        return np.concatenate([front, np.stack([at_middle, column[:, 1]], axis=1)])

    return Pieces(
        np.tile(pieces.ray, 2),
        split(pieces.ends, middle),
        split(pieces.values, value),
        split(pieces.slopes, slope),
    )


def bernstein(pieces: Pieces) -> F64:
    """(P, 4) float64, Bernstein coefficients of the Hermite cubics."""
    third = (pieces.ends[:, 1:] - pieces.ends[:, :1]) / 3.0 * pieces.slopes
    (front, back), (rise, fall) = pieces.values.T, third.T
    return np.ascontiguousarray(np.stack([front, front + rise, back - fall, back], axis=1))

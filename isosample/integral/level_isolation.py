"""Proof that nothing visible hides between the ends of a piece of a ray, from a bound of the field's slope."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import numpy.typing as npt

if TYPE_CHECKING:
    from isosample.integral.band_table import BandTable
    from isosample.integral.ray_pieces import Pieces

F64 = npt.NDArray[np.float64]
I64 = npt.NDArray[np.int64]
Bool = npt.NDArray[np.bool_]


class Isolation(NamedTuple):
    """What must not hide in a piece: the levels of the transfer function with all that is visible there.

    Attributes
    ----------
    bound : float
        Of the field's slope [data units / world].
    levels : (K,) float64
        Ascending, less the base.
    extinction : (K + 1, 2) float64
        By band, at its lower and its upper end [1/world].
    peak : (K + 1, K + 1) float64
        ``peak[i, j]`` is the largest extinction on either side of the levels i to j − 1; 0 for none.
    surfaces, steps : (K + 1,) int64
        Number of isosurfaces and of steps of the extinction or colour among the levels below the i-th.
    tolerance, agreement : float
        What a hidden optical depth [1] and a hidden excursion [data units] may amount to.
    """

    bound: float
    levels: F64
    extinction: F64
    peak: F64
    surfaces: I64
    steps: I64
    tolerance: float
    agreement: float

    @classmethod
    def build(cls, bound: float, bands: BandTable, tolerance: float, agreement: float) -> Isolation:
        """What the bands show, for a field with that bound of its slope."""
        beside = np.maximum(bands.extinction[:-1, 1], bands.extinction[1:, 0])
        count = len(beside)
        peak = np.zeros((count + 1, count + 1))
        for first in range(count):
            peak[first, first + 1 :] = np.maximum.accumulate(beside[first:])
        jumps = (bands.extinction[:-1, 1] != bands.extinction[1:, 0]) | (
            (bands.color[:-1, 1] != bands.color[1:, 0]).any(axis=1) & (beside > 0.0)
        )
        surfaces, steps = (np.append(0, np.cumsum(which)) for which in (bands.level_visible, jumps))
        levels = bands.edges[1:-1]
        return cls(bound, levels, bands.extinction, peak, surfaces, steps, tolerance, agreement)

    def mirrored(self) -> Isolation:
        """The same for the field times −1, but for the steps, which `_above` does not ask for."""
        return self._replace(
            levels=-self.levels[::-1],
            extinction=self.extinction[::-1, ::-1],
            peak=self.peak[::-1, ::-1].T,
            surfaces=self.surfaces[-1] - self.surfaces[::-1],
        )

    def hides(self, pieces: Pieces, floor: F64) -> Bool:
        """(P,) bool, whether a piece may reach something visible that lies beyond both of its ends.

        Also whether it may cross an isosurface or a step, between its ends, more often than it must.
        """
        low, high = np.minimum(*pieces.values.T), np.maximum(*pieces.values.T)
        length = pieces.ends[:, 1] - pieces.ends[:, 0]
        over = np.maximum(0.5 * (self.bound * length - (high - low)), 0.0)
        least = np.maximum(self.agreement, floor)
        flat = low == high
        hidden = self._above(high, over, length, flat, over > least)
        hidden |= self.mirrored()._above(-low, over, length, flat, over > least)
        first = np.searchsorted(self.levels, low, side="right")
        final = np.maximum(np.searchsorted(self.levels, high, side="left"), first)
        many = self.surfaces[final] > self.surfaces[first]
        many |= (length * self.peak[0, -1] > self.tolerance) & (self.steps[final] > self.steps[first])
        hidden |= many & (over > least)
        return hidden

    def _above(self, top: F64, over: F64, length: F64, flat: Bool, surfaces_hide: Bool) -> Bool:
        """Whether the levels from `top` to `top + over` weigh too much; a flat piece has reached its own."""
        first = np.searchsorted(self.levels, top, side="left")
        first[flat] = np.searchsorted(self.levels, top[flat], side="right")
        final = np.searchsorted(self.levels, top + over, side="right")
        hidden = final > first
        (some,) = np.nonzero(hidden)
        first, final, reach = first[some], final[some], top[some] + over[some]
        edges = np.append(self.levels, np.inf)
        at_low, at_high = self.extinction[final].T  # of the band of the highest value; final >= 1
        share = (reach - edges[final - 1]) / (edges[final] - edges[final - 1])
        extinction = np.maximum(self.peak[first, final], at_low + share * (at_high - at_low))
        surface = surfaces_hide[some] & (self.surfaces[final] > self.surfaces[first])
        hidden[some] = surface | (length[some] * extinction > self.tolerance)
        return hidden

"""How the samples of a volume spread over its values, and values between which there is something of both."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from isosample.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Mapping

    from isosample.volume.grid import Volume

BINS = 1024


@dataclass(frozen=True, slots=True, kw_only=True)
class SampleShares:
    """Histogram of a volume's samples, in bins of equal width.

    Attributes
    ----------
    low, high : float
        Lower edge of the first bin and upper edge of the last, in data units.
    counts : tuple of int
        Samples in each.

    Raises
    ------
    InputError
        If there is no bin, or the edges do not ascend.
    """

    low: float
    high: float
    counts: tuple[int, ...]

    def __post_init__(self) -> None:
        if not self.counts or not self.low < self.high:
            raise InputError(f"{len(self.counts)} bins from {self.low!r} to {self.high!r} are no histogram.")

    @classmethod
    def of(cls, volume: Volume) -> SampleShares:
        """Look at every finite sample of a volume, block by block."""
        from isosample.volume.statistics import histogram

        counts, edges = histogram(volume, BINS)
        return cls(low=float(edges[0]), high=float(edges[-1]), counts=tuple(counts.tolist()))

    def spaced(self, start: float, stop: float, count: int) -> list[float]:
        """Return so many values between two, spaced half by value and half by samples.

        Parameters
        ----------
        start, stop : float
            In data units, ascending.
        count : int
            >= 0.

        Returns
        -------
        values : list of float
            Ascending; between two of them lie as much of the range from `start` to `stop` and of the samples in it,
            taken together. Where there are no samples, evenly spaced.
        """
        shares = np.arange(1, count + 1) / (count + 1)
        edges = np.linspace(self.low, self.high, len(self.counts) + 1)
        below = np.concatenate([[0.0], np.cumsum(self.counts, dtype=np.float64)])
        places = np.array([start, *edges[(edges > start) & (edges < stop)], stop])
        passed = np.interp(places, edges, below)
        evenly = (places - start) / (stop - start)
        total = passed[-1] - passed[0]
        sampled = (passed - passed[0]) / total if total > 0.0 else evenly
        values: list[float] = np.interp(shares, 0.5 * evenly + 0.5 * sampled, places).tolist()
        return values

    def to_dict(self) -> dict[str, Any]:
        """Return the histogram, JSON-ready; `from_dict` gives back an equal one."""
        return {"low": self.low, "high": self.high, "counts": list(self.counts)}

    @classmethod
    def from_dict(cls, document: Mapping[str, Any]) -> SampleShares:
        """Histogram from the content of `to_dict`."""
        counts = tuple(int(count) for count in document["counts"])
        return cls(low=float(document["low"]), high=float(document["high"]), counts=counts)

"""Macrocells: small blocks of cells with bounds of the field in them, by which a ray caster skips what is not seen."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, cast

import numpy as np
import numpy.typing as npt

from isosample.defaults import MACROCELLS
from isosample.errors import InputError
from isosample.volume.lazy import lazily
from isosample.volume.reconstruction import GridSpline
from isosample.volume.value_ranges import ranges_meet

if TYPE_CHECKING:
    from isosample.volume.grid import F64, SampleArray, Volume
    from isosample.volume.lazy import LazySamples, Triple
    from isosample.volume.reconstruction import Reconstruction

    Bools = npt.NDArray[np.bool_]
    Bytes = npt.NDArray[np.uint8]
    Layers = SampleArray | LazySamples

LARGEST_LEAP = 15
LARGEST_MULTIPLIER = 16


@dataclass(frozen=True, eq=False)
class MacrocellGrid:
    """Bounds of the field in every macrocell.

    Attributes
    ----------
    low, high : (MZ, MY, MX) float64
        Bounds of the reconstruction in the macrocell, in data units; (inf, -inf) where no sample is finite. Of a
        trilinear field they are reached.
    cells : int
        Cells along an edge of a macrocell; the last one of an axis may have fewer.
    volume : Volume
    reconstruction : Reconstruction

    Notes
    -----
    Macrocell (i, j, k) holds the cells from `cells` · (i, j, k) on. Only `build`, and the first look at `deviation`,
    read the samples.
    """

    low: F64
    high: F64
    cells: int
    volume: Volume
    reconstruction: Reconstruction

    @classmethod
    def build(
        cls,
        volume: Volume,
        reconstruction: Reconstruction,
        count: int = MACROCELLS,
        *,
        spline: GridSpline | None = None,
        known: MacrocellGrid | None = None,
    ) -> MacrocellGrid:
        """Bound the field of a volume.

        Parameters
        ----------
        volume : Volume
        reconstruction : Reconstruction
        count : int
            Macrocells along the longest axis, at most; >= 1.
        spline : GridSpline, optional
            Of this volume and reconstruction, if it is at hand.
        known : MacrocellGrid, optional
            Returned as it is if it bounds the same: this very volume, reconstruction and size of the macrocells.

        Raises
        ------
        InputError
            If `count` is below 1, or the reconstruction is smooth and the volume has no such spline.
        """
        if count < 1:
            raise InputError(f"{count} macrocells along an axis are impossible; ask for at least 1.")
        cells = max(1, -(-(max(volume.size_xyz) - 1) // count))
        if known is not None and known._bounds(volume, reconstruction, cells):
            return known
        shape = _grid_shape(volume, cells)
        if not reconstruction.smooth:
            low, high = _ranges(lazily(volume.array), shape, cells, cells + 1)
            return cls(low, high, cells, volume, reconstruction)
        fitted = GridSpline.build(volume, reconstruction) if spline is None else spline
        low, high = _ranges(fitted.coefficients, shape, cells, cells + 3)
        beyond = 0.5 * (fitted.absolute_sum**3 - 1.0) * (high - low)  # negative weights reach out of the hull
        return cls(low - beyond, high + beyond, cells, volume, reconstruction)

    def _bounds(self, volume: Volume, reconstruction: Reconstruction, cells: int) -> bool:
        return self.volume is volume and (self.reconstruction, self.cells) == (reconstruction, cells)

    def occupancy(self, intervals: npt.ArrayLike) -> Bools:
        """Tell which macrocells show something; the volume is not read.

        Parameters
        ----------
        intervals : (N, 2) array_like of float
            Closed intervals of the values that can be seen, in data units, in any order; they may overlap.

        Returns
        -------
        occupied : (MZ, MY, MX) bool

        Raises
        ------
        InputError
            If the array has another shape, or an interval ends before it begins.
        """
        return ranges_meet(self.low, self.high, intervals)

    def leaps(self, occupied: Bools) -> Bytes:
        """How far one may leap from every macrocell in each of eight octants of directions.

        Parameters
        ----------
        occupied : (MZ, MY, MX) bool

        Returns
        -------
        leaps : (8, MZ, MY, MX) uint8
            0 where occupied; else d >= 1, with which the d macrocells from this one on along every axis, d³ in all,
            are empty, as is what is beyond the grid: at most 15. In the octant of number n they ascend along x where n
            has the bit 1, along y where it has the bit 2, along z where it has the bit 4; else they descend.
        """
        found = np.zeros((8, *occupied.shape), dtype=np.uint8)
        border = LARGEST_LEAP - 1
        empty = np.pad(~occupied, border, constant_values=True)
        for leap in range(1, LARGEST_LEAP + 1):
            if leap > 1:  # `empty` tells of cubes of `leap` macrocells, by their first one
                empty = _both(_both(_both(empty, 0), 1), 2)
            for octant in range(8):
                starts = [border if octant >> axis & 1 else border - (leap - 1) for axis in (2, 1, 0)]
                z, y, x = (slice(a, a + n) for a, n in zip(starts, occupied.shape, strict=True))
                found[octant] += empty[z, y, x]
        return found

    @cached_property
    def deviation(self) -> F64:
        """(MZ, MY, MX) float64, m of eq. 8 of Knoll et al. 2010.

        Largest standard deviation of the eight corners of a cell in the macrocell, over that of the volume's samples;
        0 where no cell has eight finite corners, and in a constant volume.
        """
        spread = _standard_deviation(self.volume)
        if spread == 0.0:
            return np.zeros(self.low.shape)
        low, high = self.volume.value_range
        width = max(high - low, np.finfo(np.float64).tiny)
        found = np.empty(self.low.shape)
        samples = lazily(self.volume.array)
        for k in range(len(found)):
            block = _normalised(samples[k * self.cells : (k + 1) * self.cells + 1], low, width)
            largest = np.fmax.reduce(_cell_deviations(block), axis=0)
            found[k] = _over_windows(
                np.fmax, largest, _grid_shape(self.volume, self.cells), self.cells, self.cells
            )
        return np.where(np.isnan(found), 0.0, found) / spread

    @property
    def multipliers(self) -> Bytes:
        """(MZ, MY, MX) uint8, steps that may be taken as one: M = 2 / m + 1, rounded, at most 16."""
        m = self.deviation
        most = LARGEST_MULTIPLIER
        whole = np.rint(2.0 / np.maximum(m, 2.0 / most) + 1.0)
        return cast("Bytes", np.minimum(whole, most).astype(np.uint8))


def _grid_shape(volume: Volume, cells: int) -> Triple:
    """Macrocells along z, y, x."""
    x, y, z = (max(1, -(-(count - 1) // cells)) for count in volume.size_xyz)
    return (z, y, x)


def _both(empty: Bools, axis: int) -> Bools:
    """Whether a place and the next along an axis are empty; one place less than given."""
    places = np.moveaxis(empty, axis, 0)
    both: Bools = np.moveaxis(places[:-1] & places[1:], 0, axis)
    return both


def _ranges(samples: Layers, shape: Triple, cells: int, width: int) -> tuple[F64, F64]:
    """Smallest and largest finite sample in windows of `width` that begin at every `cells`-th sample."""
    low, high = np.empty(shape), np.empty(shape)
    for k in range(shape[0]):
        block = np.asarray(samples[k * cells : k * cells + width])
        for ufunc, found, nothing in ((np.minimum, low, np.inf), (np.maximum, high, -np.inf)):
            rows = ufunc.reduce(block, axis=0)
            if rows.dtype.kind == "f" and not np.isfinite(rows).all():
                rows = ufunc.reduce(np.where(np.isfinite(block), block, nothing), axis=0)
            found[k] = _over_windows(ufunc, rows, shape, cells, width)
    return low, high


def _over_windows(ufunc: np.ufunc, rows: SampleArray, shape: Triple, cells: int, width: int) -> SampleArray:
    """Reduce a layer (Y, X) over windows of `width` squared that begin at every `cells`-th place; the last are cut."""
    reduced = rows
    for axis, count in enumerate(shape[1:]):
        starts, last = cells * np.arange(count), rows.shape[axis] - 1
        taken = [np.take(reduced, np.minimum(starts + n, last), axis=axis) for n in range(width)]
        reduced = ufunc.reduce(np.stack(taken), axis=0)
    return reduced


def _standard_deviation(volume: Volume) -> float:
    """Of all finite samples, in units of the volume's range; 0 for a constant volume."""
    low, high = volume.value_range
    if low == high:
        return 0.0
    count, total, squares = 0, 0.0, 0.0
    for block in volume.blocks():
        values = _normalised(block, low, high - low)
        finite = values[~np.isnan(values)]
        count += finite.size
        total += float(finite.sum())
        squares += float(finite @ finite)
    mean = total / count
    return float(np.sqrt(max(squares / count - mean * mean, 0.0)))


def _normalised(samples: SampleArray, low: float, width: float) -> F64:
    """Samples as float64 in units of the range; NaN where they are not finite."""
    values = np.array(samples, dtype=np.float64)
    values[~np.isfinite(values)] = np.nan
    values -= low
    values /= width
    return values


def _cell_deviations(block: F64) -> F64:
    """Standard deviation of the corners of every cell of a block; an axis of one sample has one cell."""
    sums, squares = block, block * block
    for axis in range(3):
        sums, squares = _pair_sums(sums, axis), _pair_sums(squares, axis)
    deviations: F64 = np.sqrt(np.maximum(squares / 8.0 - (sums / 8.0) ** 2, 0.0))
    return deviations


def _pair_sums(values: F64, axis: int) -> F64:
    """Sums of neighbours along an axis."""
    lines = np.moveaxis(values, axis, 0)
    sums: F64 = lines[:-1] + lines[1:] if len(lines) > 1 else 2.0 * lines
    return np.moveaxis(sums, 0, axis)

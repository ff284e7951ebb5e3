"""Bricks: blocks of cells with the range of their samples, the unit of extraction, caching and culling."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from isosample.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from isosample.volume.grid import F64, SampleArray, Volume

BRICK_CELLS = 32  # 35³ samples of float64 are 343 kB: a brick stays in a second-level cache

Triple = tuple[int, int, int]


@dataclass(frozen=True, slots=True)
class Brick:
    """A block of cells, named by its place in the grid of bricks.

    Attributes
    ----------
    index : 3 ints
        Place of the brick (bx, by, bz) in the grid of bricks.
    start, stop : 3 ints
        First and last sample (x, y, z), both included; neighbouring bricks share their border samples.
    """

    index: Triple
    start: Triple
    stop: Triple

    @property
    def size_xyz(self) -> Triple:
        """Number of samples along x, y, z."""
        x, y, z = (last - first + 1 for first, last in zip(self.start, self.stop, strict=True))
        return (x, y, z)

    @property
    def slices(self) -> tuple[slice, slice, slice]:
        """Selects the brick's samples from an array indexed ``[z, y, x]``."""
        x, y, z = (slice(first, last + 1) for first, last in zip(self.start, self.stop, strict=True))
        return (z, y, x)


def bricks_of(size_xyz: Triple, cells: int = BRICK_CELLS) -> list[Brick]:
    """Return the bricks that cover a grid, x fastest; each cell lies in exactly one brick.

    Parameters
    ----------
    size_xyz : 3 ints
        Number of samples along x, y, z, >= 1. An axis with a single sample has no cells; its bricks hold
        that one sample, so that every sample lies in some brick.
    cells : int
        Cells per brick along each axis, >= 1; the last brick of an axis may have fewer.

    Returns
    -------
    bricks : list of Brick

    Raises
    ------
    InputError
        If a size or `cells` is below 1.
    """
    if cells < 1:
        raise InputError(f"bricks of {cells} cells are impossible; ask for at least 1 cell per axis.")
    if min(size_xyz) < 1:
        raise InputError(f"size_xyz {size_xyz} must be >= 1 along every axis.")
    x_spans, y_spans, z_spans = (_spans(count, cells) for count in size_xyz)
    return [
        Brick(index=(bx, by, bz), start=(x[0], y[0], z[0]), stop=(x[1], y[1], z[1]))
        for (bz, z), (by, y), (bx, x) in itertools.product(
            enumerate(z_spans), enumerate(y_spans), enumerate(x_spans)
        )
    ]


def brick_ranges(volume: Volume, bricks: Sequence[Brick]) -> F64:
    """Smallest and largest finite sample of each brick.

    Parameters
    ----------
    volume : Volume
        Sliced brick by brick where its samples stay in a file, so that a chunk of the file is read for every brick
        that it meets; `scan_volume` reads each once.
    bricks : sequence of Brick
        All inside the volume.

    Returns
    -------
    ranges : (B, 2) float64
        Row `b` is (min, max) of brick `b` in data units; (+inf, -inf) where no sample is finite. Integers
        beyond 2**53 are rounded outward, so that a range never excludes a sample.

    Raises
    ------
    InputError
        If a brick reaches outside the volume.
    """
    for brick in bricks:
        if min(brick.start) < 0 or any(
            last >= n for last, n in zip(brick.stop, volume.size_xyz, strict=True)
        ):
            raise InputError(
                f"brick {brick.index} ends at sample {brick.stop}, outside {volume.name} "
                f"of {volume.size_xyz} samples. Make the bricks with bricks_of(volume.size_xyz)."
            )
    ranges = finite_ranges(volume, bricks)
    if ranges is not None:
        return ranges
    found = [finite_range(volume.array[brick.slices]) for brick in bricks]
    return np.array(found, dtype=np.float64).reshape(-1, 2)


def finite_ranges(volume: Volume, bricks: Sequence[Brick]) -> F64 | None:
    """Return `brick_ranges` of bricks inside a volume; None if kernels cannot tell, or not all samples are finite."""
    samples = compilable(volume.array)
    if samples is None or (
        samples.dtype.itemsize == 8 and samples.dtype.kind in "iu"
    ):  # these may be rounded
        return None
    from isosample.volume.range_kernels import block_ranges

    firsts = np.array([brick.start for brick in bricks], dtype=np.int64).reshape(-1, 3)
    stops = np.array([brick.stop for brick in bricks], dtype=np.int64).reshape(-1, 3) + 1
    ranges = np.empty((len(bricks), 2))
    return ranges if block_ranges(samples, firsts, stops, ranges) else None


def compilable(samples: object) -> SampleArray | None:
    """Return samples as a compiled kernel can read them, where they are in memory; else None."""
    fits = (
        isinstance(samples, np.ndarray)
        and samples.flags.c_contiguous
        and samples.dtype.isnative
        and samples.dtype.itemsize <= 8
        and samples.dtype != np.float16
    )
    return np.asarray(samples) if fits else None


def _spans(sample_count: int, cells: int) -> list[tuple[int, int]]:
    """First and last sample of each brick along one axis."""
    last_sample = sample_count - 1
    return [(first, min(first + cells, last_sample)) for first in range(0, max(last_sample, 1), cells)]


def finite_range(samples: SampleArray) -> tuple[float, float]:
    """Smallest and largest finite sample, rounded outward as in `brick_ranges`, or (+inf, -inf)."""
    low, high = samples.min(), samples.max()
    if not (np.isfinite(low) and np.isfinite(high)):  # min and max carry NaN through
        finite = samples[np.isfinite(samples)]
        if finite.size == 0:
            return np.inf, -np.inf
        low, high = finite.min(), finite.max()
    return _rounded_outward(low, -np.inf), _rounded_outward(high, np.inf)


def _rounded_outward(value: np.generic, outward: float) -> float:
    """Return `value` as float64, moved to the next float64 towards `outward` if the conversion crossed it."""
    exact, rounded = value.item(), float(value)
    crossed = rounded > exact if outward < 0 else rounded < exact  # Python compares int with float exactly
    return float(np.nextafter(rounded, outward)) if crossed else rounded

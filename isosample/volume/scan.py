"""One look at every sample of a volume: range, digest and non-finite samples of every brick."""

from __future__ import annotations

import hashlib
import os
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from isosample.volume.bricks import BRICK_CELLS, bricks_of, finite_range
from isosample.volume.windows import HALO, brick_windows

if TYPE_CHECKING:
    from collections.abc import Callable

    from isosample.volume.bricks import Brick
    from isosample.volume.grid import F64, Volume

SCAN_BUDGET = 512 << 20  # bytes of samples in memory during a scan without a stated budget
DIGEST_BYTES = 32

Digests = npt.NDArray[np.uint8]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class BrickScan:
    """What one look at every sample tells.

    Attributes
    ----------
    brick_cells : int
        Cells per brick along each axis; the bricks are those of `bricks_of`, B of them.
    ranges : (B, 2) float64
        As `brick_ranges` gives.
    digests : (B, 32) uint8
        sha256 of each brick's samples with one sample around them, of their type, and of the brick's place in a
        volume of this size: two bricks with the same digest have the same surfaces, vertex for vertex.
    nonfinite_counts : 2 ints
        Number of NaN samples and number of infinite samples.
    """

    brick_cells: int
    ranges: F64
    digests: Digests
    nonfinite_counts: tuple[int, int]

    @property
    def content(self) -> str:
        """Digest of all samples, their type and number, hexadecimal; without spacing and placement."""
        return hashlib.sha256(self.digests.tobytes()).hexdigest()

    @property
    def value_range(self) -> tuple[float, float]:
        """Smallest and largest finite sample; (inf, -inf) where none is."""
        return float(self.ranges[:, 0].min()), float(self.ranges[:, 1].max())

    def tell(self, volume: Volume) -> None:
        """Let a volume know its range and its non-finite samples, so that it does not look for itself."""
        low, high = self.value_range
        if low <= high:  # else the volume's own search raises
            vars(volume)["value_range"] = volume.checked_range(low, high)
        vars(volume)["nonfinite_counts"] = self.nonfinite_counts


def scan_volume(
    volume: Volume,
    brick_cells: int = BRICK_CELLS,
    *,
    budget_bytes: int = SCAN_BUDGET,
    progress: Callable[[int, int], None] | None = None,
) -> BrickScan:
    """Look at every sample of a volume once.

    Parameters
    ----------
    volume : Volume
    brick_cells : int
        Cells per brick along each axis, >= 1.
    budget_bytes : int
        Samples in memory at once, where they are not there already.
    progress : callable, optional
        Called with (bricks done, bricks in all).

    Raises
    ------
    InputError
        If `brick_cells` is below 1, or the budget is too small for a single layer of a single brick.
    """
    bricks = bricks_of(volume.size_xyz, brick_cells)
    ranges = np.empty((len(bricks), 2))
    digests = np.empty((len(bricks), DIGEST_BYTES), dtype=np.uint8)
    counts = np.zeros(2, dtype=np.int64)
    done = 0
    with ThreadPoolExecutor(max_workers=os.cpu_count()) as pool:
        for window in brick_windows(volume, bricks, budget_bytes=budget_bytes):
            look = partial(_look_at, window.volume)
            found = pool.map(look, [bricks[row] for row in window.rows])
            for row, (span, digest, nonfinite) in zip(window.rows, found, strict=True):
                ranges[row], digests[row] = span, np.frombuffer(digest, dtype=np.uint8)
                counts += nonfinite
            done += len(window.rows)
            if progress is not None:
                progress(done, len(bricks))
    nan_count, infinity_count = counts.tolist()
    return BrickScan(
        brick_cells=brick_cells,
        ranges=ranges,
        digests=digests,
        nonfinite_counts=(nan_count, infinity_count),
    )


def _look_at(volume: Volume, brick: Brick) -> tuple[tuple[float, float], bytes, tuple[int, int]]:
    """Range, digest and non-finite samples of one brick; border samples count for the brick behind them."""
    start = [max(first - HALO, 0) for first in brick.start]
    stop = [min(last + HALO, count - 1) + 1 for last, count in zip(brick.stop, volume.size_xyz, strict=True)]
    z, y, x = (slice(*ends) for ends in zip(start[::-1], stop[::-1], strict=True))
    samples = volume.array[z, y, x]
    padded = np.ascontiguousarray(
        samples, dtype=samples.dtype.newbyteorder("<")
    )  # digests know one order of bytes
    head = f"{padded.dtype.str} {volume.size_xyz} {brick.start} {brick.stop};"
    digest = hashlib.sha256(head.encode())
    digest.update(padded.reshape(-1).view(np.uint8).data)
    inner = tuple(
        slice(first - low, last - low + 1)
        for first, last, low in zip(brick.start[::-1], brick.stop[::-1], start[::-1], strict=True)
    )
    nonfinite = (0, 0)
    if padded.dtype.kind == "f" and not np.isfinite(padded).all():
        own = tuple(
            slice(part.start, part.stop if last == count - 1 else part.stop - 1)
            for part, last, count in zip(inner, brick.stop[::-1], volume.size_xyz[::-1], strict=True)
        )
        samples = padded[own]
        nonfinite = (int(np.count_nonzero(np.isnan(samples))), int(np.count_nonzero(np.isinf(samples))))
    return finite_range(padded[inner]), digest.digest(), nonfinite

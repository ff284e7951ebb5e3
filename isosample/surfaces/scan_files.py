"""The scan of a volume in its cache folder, so that a file that has not changed is not looked through again."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from isosample.errors import CacheError
from isosample.surfaces.cache_files import Arrays, read_arrays, write_arrays
from isosample.volume.scan import BrickScan

if TYPE_CHECKING:
    from pathlib import Path


def scan_path(folder: Path, brick_cells: int) -> Path:
    """Return where a cache folder keeps the scan for bricks of so many cells."""
    return folder / f"scan-{brick_cells}.npz"


def write_scan(folder: Path, identity: str, scan: BrickScan) -> None:
    """Write a scan, whole or not at all.

    Parameters
    ----------
    folder : Path
        Made if absent.
    identity : str
        What `identity_of` the samples gave.
    scan : BrickScan

    Raises
    ------
    CacheError
        If the file cannot be written.
    """
    arrays: Arrays = {
        "ranges": scan.ranges,
        "digests": scan.digests,
        "nonfinite": np.array(scan.nonfinite_counts, dtype=np.int64),
    }
    write_arrays(scan_path(folder, scan.brick_cells), {"identity": identity}, arrays)


def read_scan(folder: Path, identity: str | None, brick_cells: int) -> BrickScan | None:
    """Return the scan of a file that has not changed since; None where there is none that can be used."""
    if identity is None:
        return None
    try:
        arrays, _ = read_arrays(scan_path(folder, brick_cells), {"identity": identity})
    except CacheError:
        return None  # of another file, an older version, or damaged: looking again gives the same
    nan_count, infinity_count = arrays["nonfinite"].astype(np.int64).tolist()
    return BrickScan(
        brick_cells=brick_cells,
        ranges=arrays["ranges"].astype(np.float64),
        digests=arrays["digests"].astype(np.uint8),
        nonfinite_counts=(nan_count, infinity_count),
    )

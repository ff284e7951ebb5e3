"""Rays in world space and in sample indices, checked, and the part of them inside the box and the clip planes."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from isosample.errors import InputError
from isosample.integral.checks import last_axis

if TYPE_CHECKING:
    from collections.abc import Sequence

F64 = npt.NDArray[np.float64]
Plane = tuple[float, float, float, float]

UNIT_TOLERANCE = 1e-9  # by how much a direction's length may differ from 1
# Cells: a ray that drifts less than this along an axis is parallel to it; one this far outside is inside.
GRAZING = 1e-12


def rays_in_index(index_from_world: F64, last: F64, starts: F64, ways: F64) -> tuple[F64, F64]:
    """Origins and directions in sample indices; a direction that hardly drifts along an axis is parallel to it."""
    o, d = starts @ index_from_world[:3, :3].T + index_from_world[:3, 3], ways @ index_from_world[:3, :3].T
    reach = (np.abs(o).max(axis=1) + last.max()) / np.abs(d).max(axis=1)
    return o, np.where(np.abs(d) * reach[:, None] <= GRAZING, 0.0, d)


def checked_rays(origins: npt.ArrayLike, directions: npt.ArrayLike) -> tuple[F64, F64]:
    """(N, 3) float64 origins and unit directions, or an `InputError`."""
    starts, ways = last_axis(origins, "origins", 3), last_axis(directions, "directions", 3)
    if starts.ndim != 2 or starts.shape != ways.shape:
        raise InputError(
            f"origins {starts.shape} and directions {ways.shape} must both be (N, 3). Flatten the picture."
        )
    for name, vectors in (("origins", starts), ("directions", ways)):
        wrong = np.flatnonzero(~np.isfinite(vectors).all(axis=1))
        if wrong.size:
            raise InputError(f"{name}[{wrong[0]}] is {vectors[wrong[0]].tolist()}; expected finite numbers.")
    lengths = np.linalg.norm(ways, axis=1)
    wrong = np.flatnonzero(np.abs(lengths - 1.0) > UNIT_TOLERANCE)
    if wrong.size:
        raise InputError(
            f"directions[{wrong[0]}] has length {lengths[wrong[0]]!r}; expected 1. Divide by the length."
        )
    return starts, ways


def box_intervals(origins: F64, directions: F64, last: F64, nearest: float = 0.0) -> F64:
    """(N, 2) float64, ray parameters at which rays enter and leave the box from 0 to `last`; t >= nearest.

    The numbers are those of `ray_cells.plane_distance`, bit for bit. Rays beside the box, and rays that lie
    in no plane but touch it, get an empty interval.
    """
    parallel = directions == 0.0
    slopes = np.where(parallel, 1.0, directions)
    near, far = (0.0 - origins) / slopes, (last - origins) / slopes
    beside = parallel & ((origins < -GRAZING) | (origins > last + GRAZING))
    first = np.where(parallel, -np.inf, np.minimum(near, far)).max(axis=1, initial=nearest)
    final = np.where(parallel, np.inf, np.maximum(near, far)).min(axis=1)
    return np.stack([first, np.where(beside.any(axis=1), -np.inf, final)], axis=1)


def clipped(intervals: F64, origins: F64, directions: F64, planes: Sequence[Plane]) -> F64:
    """Intervals of the ray parameter, cut to the kept side of every plane.

    Raises
    ------
    InputError
        If a plane is not four finite numbers with a normal that is not zero.
    """
    first, final = intervals[:, 0].copy(), intervals[:, 1].copy()
    for plane in planes:
        numbers = np.asarray(plane, dtype=np.float64)
        if numbers.shape != (4,) or not np.isfinite(numbers).all() or not numbers[:3].any():
            raise InputError(
                f"clip plane {plane!r} must be (nx, ny, nz, d), finite, with a normal that is not zero."
            )
        height, slope = origins @ numbers[:3] + numbers[3], directions @ numbers[:3]
        crossing = -height / np.where(slope == 0.0, 1.0, slope)
        first = np.where(slope > 0.0, np.maximum(first, crossing), first)
        final = np.where(slope < 0.0, np.minimum(final, crossing), final)
        final = np.where((slope == 0.0) & (height < 0.0), -np.inf, final)
    return np.stack([first, final], axis=1)

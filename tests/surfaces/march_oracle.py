"""Marching cubes of one isovalue in plain numpy, over a whole volume at once: an independent check of the kernels.

It shares the case table and the rounding rules with the package, and nothing else.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from isosample.surfaces.case_tables import EDGE_AXIS, EDGE_LOWER_CORNER, EDGES, FACE_CORNERS, case_table
from isosample.surfaces.positions import POSITION_STEPS, SMALLEST_FRACTION, round_gradients

F64 = npt.NDArray[np.float64]
I64 = npt.NDArray[np.int64]
U8 = npt.NDArray[np.uint8]
Bool = npt.NDArray[np.bool_]


class OracleMesh(NamedTuple):
    """Index positions (V, 3), gradients (V, 3), keys (V,) ascending, triangles (T, 3) of keys."""

    positions: F64
    gradients: F64
    keys: I64
    triangles: I64


class Cells(NamedTuple):
    """Cells that the isosurface meets: linear index of the first sample, and the case number."""

    samples: I64
    cases: I64


def march_oracle(array: npt.NDArray[np.generic], isovalue: float) -> OracleMesh:
    """Return the isosurface in a volume; cells with a corner that is not finite are left out."""
    values = array.astype(np.float64)
    finite = np.isfinite(values)
    values[~finite] = np.nan
    gradients = np.stack([difference(values, 2 - axis) for axis in range(3)], axis=-1)
    usable = finite[:-1] & finite[1:]
    usable = usable[:, :-1] & usable[:, 1:]
    usable = usable[:, :, :-1] & usable[:, :, 1:]
    values[~finite] = 0.0
    size = values.size
    cells = active_cells(values, usable, isovalue)
    numbers, names_of_triangles = triangle_corners(cells, values.shape)
    names = np.unique(names_of_triangles)
    axes, samples = names // size, names % size
    on_edge = int(np.searchsorted(names, 3 * size))
    positions, slopes = edge_vertices(values, gradients, isovalue, axes[:on_edge], samples[:on_edge])
    if on_edge < names.size:
        inner = centre_vertices(cells, numbers, names, positions, slopes, values.shape)
        positions, slopes = np.concatenate([positions, inner[0]]), np.concatenate([slopes, inner[1]])
    order, triangles = key_of(names, size), key_of(names_of_triangles, size)
    rows = np.argsort(order)
    return OracleMesh(positions[rows], slopes[rows], order[rows], triangles)


def key_of(names: I64, size: int) -> I64:
    """Key of a vertex named axis · size + sample."""
    axes, samples = names // size, names % size
    keys: I64 = np.where(axes < 3, axes + 3 * samples, 3 * size + samples)
    return keys


def difference(values: F64, axis: int) -> F64:
    """Return the derivative per sample step: central, one-sided at the border and next to NaN, 0 between two."""
    along = np.moveaxis(values, axis, 0)
    gap = np.full_like(along[:1], np.nan)
    ahead, behind = np.concatenate([along[1:], gap]), np.concatenate([gap, along[:-1]])
    slope = 0.5 * (ahead - behind)
    one_sided = np.isnan(slope)
    slope[one_sided] = (ahead - along)[one_sided]
    one_sided &= np.isnan(ahead)
    slope[one_sided] = (along - behind)[one_sided]
    slope[one_sided & np.isnan(behind)] = 0.0
    return np.moveaxis(slope, 0, axis)


def active_cells(values: F64, usable: Bool, isovalue: float) -> Cells:
    """Find the cells with corners on both sides, and their cases."""
    inside = (values >= isovalue).view(np.uint8)
    pairs = inside[:, :, :-1] | inside[:, :, 1:] << 1
    quads = pairs[:, :-1] | pairs[:, 1:] << 2
    signs = quads[:-1] | quads[1:] << 4
    found = np.flatnonzero((signs != 0) & (signs != 255) & usable)
    samples = np.ravel_multi_index(np.unravel_index(found, signs.shape), values.shape).astype(np.int64)
    signs_found: U8 = signs.ravel()[found].astype(np.uint8)
    decisions = face_decisions(values, isovalue, samples, signs_found)
    return Cells(samples, case_table().case_of[signs_found, decisions].astype(np.int64))


def face_decisions(values: F64, isovalue: float, samples: I64, signs: U8) -> U8:
    """Bit `f` is set where the inside corners of ambiguous face `f` are joined."""
    decisions = np.zeros(signs.size, dtype=np.uint8)
    ambiguous = case_table().ambiguous_faces[signs]
    rows = np.flatnonzero(ambiguous)
    heights = values.ravel()[samples[rows, None] + corner_offsets(values.shape)] - isovalue
    for face, ring in enumerate(FACE_CORNERS):
        a, b, c, d = heights[:, ring].T
        scale = np.abs(heights[:, ring]).max(axis=1)
        scale[scale == 0.0] = 1.0  # a face of samples equal to the isovalue is not ambiguous
        saddle = (a / scale) * (c / scale) - (b / scale) * (d / scale)
        joined = np.where(a >= 0, saddle >= 0, saddle <= 0)
        decisions[rows] |= joined.astype(np.uint8) << np.uint8(face)
    return decisions & ambiguous


def triangle_corners(cells: Cells, shape: tuple[int, ...]) -> tuple[I64, I64]:
    """Return the names of a cell's vertices 0 to 12, relative to its first sample, and of all triangles."""
    table = case_table()
    size = int(np.prod(shape))
    on_edges = EDGE_AXIS * size + corner_offsets(shape)[EDGE_LOWER_CORNER]
    numbers = np.append(on_edges, 3 * size).astype(np.int64)
    count = table.triangle_count[cells.cases]
    shift = table.triangle_start[cells.cases] - (np.cumsum(count) - count)
    rows = np.arange(count.sum()) + np.repeat(shift, count)
    names: I64 = numbers[table.triangles[rows]] + np.repeat(cells.samples, count)[:, None]
    return numbers, names


def edge_vertices(values: F64, gradients: F64, isovalue: float, axes: I64, samples: I64) -> tuple[F64, F64]:
    """Positions [voxel] and gradients where the isosurface cuts the grid edges."""
    _, y, x = values.shape
    far = samples + np.array([1, x, x * y])[axes]
    low = values.ravel()[samples]
    fraction = (isovalue - low) / (values.ravel()[far] - low)
    fraction = np.clip(fraction, SMALLEST_FRACTION, 1.0 - SMALLEST_FRACTION)
    fraction = np.rint(fraction * POSITION_STEPS) / POSITION_STEPS
    positions = first_corners(samples, values.shape)
    positions[np.arange(axes.size), axes] += fraction
    nodes = gradients.reshape(-1, 3)
    mixed = nodes[samples] + fraction[:, None] * (nodes[far] - nodes[samples])
    return positions, round_gradients(mixed)


def centre_vertices(
    cells: Cells, numbers: I64, names: I64, positions: F64, gradients: F64, shape: tuple[int, ...]
) -> tuple[F64, F64]:
    """Means of the positions and gradients around every centre vertex, ordered by cell."""
    around = case_table().centre_edges[cells.cases]
    rows = np.flatnonzero(around.any(axis=1))
    around, samples = around[rows], cells.samples[rows]
    corner = first_corners(samples, shape)
    offset, gradient = np.zeros((rows.size, 3)), np.zeros((rows.size, 3))
    for edge in range(EDGES):
        has = np.flatnonzero(around[:, edge])
        vertex = np.searchsorted(names, samples[has] + numbers[edge])
        offset[has] += positions[vertex] - corner[has]
        gradient[has] += gradients[vertex]
    count = around.sum(axis=1, keepdims=True)
    return corner + np.rint(offset / count * POSITION_STEPS) / POSITION_STEPS, round_gradients(
        gradient / count
    )


def corner_offsets(shape: tuple[int, ...]) -> I64:
    """(8,) int64, linear index of each corner of a cell relative to the first."""
    corner = np.arange(8)
    offsets: I64 = (corner & 1) + shape[2] * ((corner >> 1 & 1) + shape[1] * (corner >> 2))
    return offsets


def first_corners(samples: I64, shape: tuple[int, ...]) -> F64:
    """(N, 3) float64, index coordinates x, y, z of linear indices."""
    return np.stack(np.unravel_index(samples, shape)[::-1], axis=1).astype(np.float64)

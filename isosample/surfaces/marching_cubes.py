"""Marching cubes over the samples of one brick, vectorised over the cells that the isosurface meets."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from isosample.surfaces.brick_samples import gradients_at
from isosample.surfaces.case_tables import (
    EDGE_AXIS,
    EDGE_LOWER_CORNER,
    EDGES,
    FACE_CORNERS,
    case_table,
)
from isosample.surfaces.positions import POSITION_STEPS, SMALLEST_FRACTION

if TYPE_CHECKING:
    from isosample.surfaces.brick_samples import BrickSamples
    from isosample.surfaces.mesh import I32, I64
    from isosample.volume.grid import F64

U8 = npt.NDArray[np.uint8]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LocalMesh:
    """A mesh in a brick's own numbering.

    Attributes
    ----------
    positions : (V, 3) float64
        Index coordinates (x, y, z) relative to the brick's first sample, multiples of 2**-19 [voxel].
    gradients : (V, 3) float64
        Derivative per sample step along x, y, z [data units / voxel].
    axes : (V,) int64
        Axis of the grid edge that holds the vertex; 3 for a vertex inside a cell.
    samples : (V,) int64
        Linear index in the brick of the edge's lower sample, or of the cell's first sample.
    triangles : (T, 3) int32
        Counter-clockwise in index coordinates (x, y, z) seen from the side of falling values.
    """

    positions: F64
    gradients: F64
    axes: I64
    samples: I64
    triangles: I32


@dataclass(frozen=True, slots=True, eq=False)
class _ActiveCells:
    """Cells that the isosurface meets: linear index of the first sample, and the case number."""

    samples: I64
    cases: I64


def march_levels(brick: BrickSamples, isovalues: F64) -> list[LocalMesh]:
    """Return the isosurfaces in one brick, one per isovalue; see `march`."""
    return [march(brick, isovalue) for isovalue in isovalues.tolist()]


def march(brick: BrickSamples, isovalue: float) -> LocalMesh:
    """Return the isosurface in one brick, watertight inside it, in the brick's own numbering.

    Parameters
    ----------
    brick : BrickSamples
    isovalue : float
        In data units; a sample equal to it counts as inside.

    Returns
    -------
    mesh : LocalMesh
        Empty (0 vertices) if the isosurface does not meet the brick.

    Notes
    -----
    A vertex lies where the field along its grid edge takes the isovalue, kept 2**-19 voxel away from the two
    samples and rounded to 2**-19 voxel. The first moves it by at most 2**-19 voxel, and only where a sample
    is (almost) equal to the isovalue; without it such a sample would collapse triangles. Its gradient is that
    of a smooth reconstruction there, or central differences interpolated along the edge. A vertex inside a
    cell lies at the mean of those around it, with the mean of their gradients.

    Ambiguous faces are decided by the bilinear interpolant's saddle (Nielson and Hamann, "The asymptotic
    decider", Visualization 1991). Tunnels inside a cell (the interior test of marching cubes 33) are not
    made: the surface is a watertight manifold, but two sheets that the trilinear interpolant joins strictly
    inside one cell stay apart there.
    """
    cells = _active_cells(brick, isovalue)
    numbers, corner_of_row = _triangle_corners(cells, brick.values.shape)
    size = brick.values.size
    used = np.zeros(4 * size, dtype=np.bool_)
    used[corner_of_row] = True
    names = np.flatnonzero(used)
    vertex_of_name = np.empty(4 * size, dtype=np.int32)
    vertex_of_name[names] = np.arange(names.size, dtype=np.int32)
    axes, samples = names // size, names % size
    on_edge = np.searchsorted(names, 3 * size)
    positions, gradients = _edge_vertices(brick, isovalue, axes[:on_edge], samples[:on_edge])
    if on_edge < names.size:
        inner = _centre_vertices(cells, numbers, vertex_of_name, positions, gradients, brick.values.shape)
        positions, gradients = np.concatenate([positions, inner[0]]), np.concatenate([gradients, inner[1]])
    return LocalMesh(
        positions=positions,
        gradients=gradients,
        axes=axes,
        samples=samples,
        triangles=vertex_of_name[corner_of_row],
    )


def _active_cells(brick: BrickSamples, isovalue: float) -> _ActiveCells:
    """Find the cells with corners on both sides, and their cases."""
    inside = (brick.values >= isovalue).view(np.uint8)
    pairs = inside[:, :, :-1] | inside[:, :, 1:] << 1
    quads = pairs[:, :-1] | pairs[:, 1:] << 2
    signs = quads[:-1] | quads[1:] << 4
    meets = signs + np.uint8(1) > 1  # neither 0 nor 255: the sum wraps
    if brick.usable_cells is not None:
        meets &= brick.usable_cells
    found = np.flatnonzero(meets)
    samples = _linear_index(_coordinates(found, signs.shape), brick.values.shape)
    signs_found: U8 = signs.ravel()[found].astype(np.uint8)
    decisions = _face_decisions(brick.values, isovalue, samples, signs_found)
    return _ActiveCells(samples, case_table().case_of[signs_found, decisions].astype(np.int64))


def _face_decisions(values: F64, isovalue: float, samples: I64, signs: U8) -> U8:
    """Bit `f` is set where the inside corners of ambiguous face `f` are joined.

    With the isovalue subtracted, a and c on one diagonal and b and d on the other, the saddle of the bilinear
    interpolant is (a c − b d) / (a + c − b − d). The products are the same in both cells at the face.
    """
    decisions = np.zeros(signs.size, dtype=np.uint8)
    ambiguous = case_table().ambiguous_faces[signs]
    rows = np.flatnonzero(ambiguous)
    if rows.size == 0:
        return decisions
    corners = samples[rows, None] + _corner_offsets(values.shape)
    heights = values.ravel()[corners] - isovalue
    for face, ring in enumerate(FACE_CORNERS):
        a, b, c, d = heights[:, ring].T
        scale = np.abs(heights[:, ring]).max(axis=1)
        scale[scale == 0.0] = 1.0  # a face of samples equal to the isovalue is not ambiguous
        saddle = (a / scale) * (c / scale) - (b / scale) * (d / scale)
        joined = np.where(a >= 0, saddle >= 0, saddle <= 0)
        decisions[rows] |= joined.astype(np.uint8) << np.uint8(face)
    return decisions & ambiguous


def _triangle_corners(cells: _ActiveCells, shape: tuple[int, ...]) -> tuple[I64, I64]:
    """Return the names of a cell's vertices 0 to 12, relative to its first sample, and of all triangles.

    A vertex is named axis · (sample count) + (lower sample), with axis 3 for the centre of a cell.
    """
    table = case_table()
    size = int(np.prod(shape))
    on_edges = EDGE_AXIS * size + _corner_offsets(shape)[EDGE_LOWER_CORNER]
    numbers = np.append(on_edges, 3 * size).astype(np.int64)
    count = table.triangle_count[cells.cases]
    shift = table.triangle_start[cells.cases] - (np.cumsum(count) - count)
    rows = np.arange(count.sum()) + np.repeat(shift, count)
    names: I64 = numbers[table.triangles[rows]] + np.repeat(cells.samples, count)[:, None]
    return numbers, names


def _edge_vertices(brick: BrickSamples, isovalue: float, axes: I64, samples: I64) -> tuple[F64, F64]:
    """Positions [voxel] and gradients where the isosurface cuts the grid edges."""
    _, y, x = brick.values.shape
    far = samples + np.array([1, x, x * y])[axes]
    values = brick.values.ravel()
    low = values[samples]
    fraction = (isovalue - low) / (values[far] - low)
    positions = _coordinates(samples, brick.values.shape)[::-1].T.astype(np.float64)
    if brick.smooth:
        _take_roots(brick, isovalue, positions, axes, low >= isovalue, fraction)
    np.clip(fraction, SMALLEST_FRACTION, 1.0 - SMALLEST_FRACTION, out=fraction)
    fraction = np.rint(fraction * POSITION_STEPS) / POSITION_STEPS
    positions[np.arange(axes.size), axes] += fraction
    if brick.smooth:
        return positions, gradients_at(brick, positions)
    nodes = brick.gradients.reshape(-1, 3)
    near_gradient = nodes[samples]
    gradients = near_gradient + fraction[:, None] * (nodes[far] - near_gradient)
    return positions, gradients


def _take_roots(
    brick: BrickSamples,
    isovalue: float,
    lowers: F64,
    axes: I64,
    low_inside: npt.NDArray[np.bool_],
    fraction: F64,
) -> None:
    """Replace the roots of the linear interpolant by those of the spline, in place."""
    from isosample.surfaces.root_kernels import edge_roots

    np.clip(fraction, 0.0, 1.0, out=fraction)
    starts = lowers + brick.origin
    edge_roots(brick.coefficients, brick.kernel, isovalue, starts, axes, low_inside, fraction)


def _centre_vertices(
    cells: _ActiveCells,
    numbers: I64,
    vertex_of_name: I32,
    positions: F64,
    gradients: F64,
    shape: tuple[int, ...],
) -> tuple[F64, F64]:
    """Means of the positions (rounded) and gradients around every centre vertex, ordered by cell."""
    around = case_table().centre_edges[cells.cases]
    rows = np.flatnonzero(around.any(axis=1))
    around, samples = around[rows], cells.samples[rows]
    first_corner = _coordinates(samples, shape)[::-1].T.astype(np.float64)
    offset, gradient = np.zeros((rows.size, 3)), np.zeros((rows.size, 3))
    for edge in range(EDGES):  # a fixed order of sums: the same bits in every brick
        has = np.flatnonzero(around[:, edge])
        vertex = vertex_of_name[samples[has] + numbers[edge]]
        offset[has] += positions[vertex] - first_corner[has]
        gradient[has] += gradients[vertex]
    count = around.sum(axis=1, keepdims=True)
    return first_corner + np.rint(offset / count * POSITION_STEPS) / POSITION_STEPS, gradient / count


def _corner_offsets(shape: tuple[int, ...]) -> I64:
    """(8,) int64, linear index of each corner of a cell relative to the first."""
    corner = np.arange(8)
    offsets: I64 = (corner & 1) + shape[2] * ((corner >> 1 & 1) + shape[1] * (corner >> 2))
    return offsets


def _coordinates(linear: I64, shape: tuple[int, ...]) -> I64:
    """(3, N) int64, rows z, y, x of linear indices."""
    return np.stack(np.unravel_index(linear, shape))


def _linear_index(coordinates: I64, shape: tuple[int, ...]) -> I64:
    z, y, x = coordinates
    linear: I64 = x + shape[2] * (y + shape[1] * z)
    return linear

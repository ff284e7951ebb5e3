"""Marching cubes over the samples of one brick, for all isovalues at once."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import numpy.typing as npt

from isosample.surfaces.brick_samples import gradients_at
from isosample.surfaces.case_tables import march_table
from isosample.surfaces.positions import POSITION_STEPS, SMALLEST_FRACTION
from isosample.surfaces.scratch import SCRATCH

if TYPE_CHECKING:
    from isosample.surfaces.brick_samples import BrickSamples
    from isosample.surfaces.mesh import F32, I32, I64
    from isosample.volume.grid import F64

MOST_LEVELS = 30_000  # at once: ranks are 16-bit integers
ALL_CELLS = np.zeros((0, 0, 0), dtype=np.uint8)
MOST_VERTICES = 13  # of a cell
TOGETHER = 1 << 16  # triangles whose arrays are one: below a megabyte the allocator uses memory again
NO_NODES = np.zeros((0, 0, 0, 4))
ALL_FRESH = np.zeros((0, 0, 0), dtype=np.int16)


class LocalMesh(NamedTuple):
    """The piece of one isosurface in one brick, its vertices named in the whole volume.

    Attributes
    ----------
    positions : (V, 3) float32
        Index coordinates (x, y, z) relative to the brick's first sample, multiples of 2**-19 [voxel].
    gradients : (V, 3) float32
        Derivative per sample step along x, y, z [data units / voxel], rounded as `positions.round_gradients` does.
    keys : (V,) int64
        As `BrickMesh.edge_keys`.
    triangles : (T, 3) int32
        Counter-clockwise in index coordinates (x, y, z) seen from the side of falling values.

    Notes
    -----
    Vertices are numbered as they are first met, cell by cell, x fastest. The arrays of one call share their memory.
    """

    positions: F32
    gradients: F32
    keys: I64
    triangles: I32


def march_levels(brick: BrickSamples, isovalues: F64) -> list[LocalMesh]:
    """Return the isosurfaces in one brick, watertight inside it, one per isovalue.

    Parameters
    ----------
    brick : BrickSamples
        Of at most 62 cells along each axis.
    isovalues : (L,) float64
        Strictly ascending, in data units; a sample equal to one counts as inside.

    Returns
    -------
    meshes : list of LocalMesh
        Empty (0 vertices) where an isosurface does not meet the brick.

    Notes
    -----
    A cell is looked at once for all isovalues that cross it; see `march_kernels`.

    A vertex lies where the field along its grid edge takes the isovalue, kept 2**-19 voxel away from the two
    samples and rounded to 2**-19 voxel: within 1e-6 voxel of the root, and 2e-6 where a sample is (almost) equal to
    the isovalue, which without that distance would collapse triangles. Its gradient is that of a smooth
    reconstruction there, or central differences interpolated along the edge. A vertex inside a cell lies at the
    mean of those around it, with the mean of their gradients.

    Ambiguous faces are decided by the bilinear interpolant's saddle (Nielson and Hamann, "The asymptotic
    decider", Visualization 1991). Tunnels inside a cell (the interior test of marching cubes 33) are not
    made: the surface is a watertight manifold, but two sheets that the trilinear interpolant joins strictly
    inside one cell stay apart there.
    """
    meshes: list[LocalMesh] = []
    for first in range(0, len(isovalues), MOST_LEVELS):
        levels = np.ascontiguousarray(isovalues[first : first + MOST_LEVELS], dtype=np.float64)
        meshes += _march(brick, levels)
    if brick.smooth:
        pairs = zip(meshes, isovalues.tolist(), strict=True)
        meshes = [_onto_spline(brick, isovalue, mesh) for mesh, isovalue in pairs]
    return meshes


def _march(brick: BrickSamples, levels: F64) -> list[LocalMesh]:
    """March a brick of the trilinear field."""
    from isosample.surfaces import march_kernels, numbering_kernels, vertex_kernels

    planes, rows, columns = brick.padded.shape
    values, table = brick.padded.reshape(-1), march_table()
    ranks = SCRATCH.room("ranks", values.size, np.int16)
    march_kernels.count_ranks(values, levels, ranks)
    cell_shape = (planes - 3, rows - 3, columns - 3)
    capacity = math.prod(cell_shape)
    cells = SCRATCH.room("cells", capacity, np.int32)
    lows, highs = SCRATCH.room("lows and highs", (2, capacity), np.int16)
    usable, fresh_edges = ALL_CELLS, ALL_FRESH
    if brick.usable_cells is not None:
        usable, fresh_edges = brick.usable_cells.view(np.uint8), SCRATCH.room("fresh", cell_shape, np.int16)
        numbering_kernels.find_fresh_edges(usable, table.lower_corner, fresh_edges)
    pair_start = np.empty(len(levels) + 1, dtype=np.int64)
    extremes = SCRATCH.room("extremes", (2, columns), np.int16)
    cell_count = march_kernels.crossed_cells(
        ranks.reshape(brick.padded.shape), usable, extremes, cells, lows, highs, pair_start
    )
    pairs = SCRATCH.room("pairs", int(pair_start[-1]), np.int32)
    triangle_counts = np.empty(len(levels), dtype=np.int64)
    centre_count = march_kernels.sort_by_level(
        values,
        ranks,
        columns,
        columns * rows,
        levels,
        table.ambiguous_faces,
        table.case_of,
        table.triangle_count,
        cells[:cell_count],
        lows[:cell_count],
        highs[:cell_count],
        pair_start,
        pairs,
        triangle_counts,
    )
    rings = SCRATCH.room("rings", (centre_count, numbering_kernels.RING), np.int32)
    slots = SCRATCH.room("slots", numbering_kernels.SLOT_PLANES * columns * rows, np.int32)
    nodes = NO_NODES
    if (
        vertex_kernels.NODES_PER_VERTEX * int(triangle_counts.sum()) > 2 * capacity
    ):  # two triangles per vertex
        nodes = SCRATCH.room("nodes", (planes - 2, rows - 2, columns - 2, 4), np.float64)
        vertex_kernels.fill_nodes(brick.padded, nodes)
    meshes: list[LocalMesh] = []
    for part in _parts(triangle_counts):
        triangle_start = _starts(triangle_counts[part])
        pair_range = pair_start[part.start : part.stop + 1]
        most_vertices = MOST_VERTICES * int(pair_range[-1] - pair_range[0]) + 1
        codes = SCRATCH.room("codes", most_vertices, np.int32)
        triangles = np.empty((triangle_start[-1], 3), dtype=np.int32)
        vertex_start = np.empty(len(triangle_start), dtype=np.int64)
        ring_count = numbering_kernels.number_vertices(
            columns,
            columns * rows,
            table,
            fresh_edges,
            pairs,
            pair_range,
            slots,
            codes,
            rings,
            triangles,
            vertex_start,
        )
        vertex_count = int(vertex_start[-1])
        positions = np.empty((vertex_count, 3), dtype=np.float32)
        gradients = np.empty((vertex_count, 3), dtype=np.float32)
        keys = np.empty(vertex_count, dtype=np.int64)
        vertex_kernels.put_vertices(
            brick.padded,
            nodes,
            levels[part],
            codes,
            rings[:ring_count],
            vertex_start,
            brick.start,
            brick.size_xyz,
            positions,
            gradients,
            keys,
        )
        vertices, faces = vertex_start.tolist(), triangle_start.tolist()
        meshes += [
            LocalMesh(
                positions=positions[vertices[k] : vertices[k + 1]],
                gradients=gradients[vertices[k] : vertices[k + 1]],
                keys=keys[vertices[k] : vertices[k + 1]],
                triangles=triangles[faces[k] : faces[k + 1]],
            )
            for k in range(len(faces) - 1)
        ]
    return meshes


def _parts(triangle_counts: I64) -> list[slice]:
    """Ranges of levels with about `TOGETHER` triangles each."""
    parts, first, total = [], 0, 0
    for level, count in enumerate(triangle_counts.tolist()):
        if total and total + count > TOGETHER:
            parts.append(slice(first, level))
            first, total = level, 0
        total += count
    return [*parts, slice(first, len(triangle_counts))]


def _starts(counts: I64) -> I64:
    """(L + 1,) int64, where each of some consecutive ranges begins, and where the last one ends."""
    starts = np.zeros(len(counts) + 1, dtype=np.int64)
    np.cumsum(counts, out=starts[1:])
    return starts


def _onto_spline(brick: BrickSamples, isovalue: float, mesh: LocalMesh) -> LocalMesh:
    """Return the mesh with the vertices of grid edges moved to where the spline takes the isovalue."""
    if not len(mesh.keys):
        return mesh
    from isosample.surfaces.root_kernels import edge_roots

    positions = mesh.positions.astype(np.float64)
    on_edge = mesh.keys < 3 * brick.sample_count
    rows, axes = np.flatnonzero(on_edge), mesh.keys[on_edge] % 3
    lowers = np.floor(positions[rows])
    x, y, z = lowers.astype(np.int64).T
    low_inside = brick.values[z, y, x] >= isovalue
    fractions = positions[rows, axes] - lowers[np.arange(len(rows)), axes]
    edge_roots(brick.coefficients, brick.kernel, isovalue, lowers + brick.origin, axes, low_inside, fractions)
    np.clip(fractions, SMALLEST_FRACTION, 1.0 - SMALLEST_FRACTION, out=fractions)
    lowers[np.arange(len(rows)), axes] += _rounded(fractions)
    positions[rows] = lowers
    _settle_means(positions, mesh.triangles, ~on_edge)
    gradients = gradients_at(brick, positions)
    return LocalMesh(
        positions=positions.astype(np.float32),
        gradients=gradients.astype(np.float32),
        keys=mesh.keys,
        triangles=mesh.triangles,
    )


def _settle_means(positions: F64, triangles: I32, inner: npt.NDArray[np.bool_]) -> None:
    """Put every vertex inside a cell to the mean of those around it, each of which follows it in one triangle."""
    fans = triangles[inner[triangles[:, 0]]]
    for axis in range(3):
        total = np.bincount(fans[:, 0], positions[fans[:, 1], axis], minlength=len(positions))
        count = np.bincount(fans[:, 0], minlength=len(positions))
        positions[inner, axis] = _rounded(total[inner] / count[inner])


def _rounded(coordinates: F64) -> F64:
    """Return the nearest multiples of 2**-19."""
    rounded: F64 = np.rint(coordinates * POSITION_STEPS) / POSITION_STEPS
    return rounded

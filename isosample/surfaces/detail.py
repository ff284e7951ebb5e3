r"""Levels of detail: coarser meshes of an isosurface, brick by brick.

Detail 0 is the mesh as extracted, detail d the same with fewer triangles, each within :math:`2^{d-6}` voxel of the
isosurface where it was looked at: 1/32 for d = 1 to 1/2 for d = 5. Vertices are moved onto neighbours (half-edge
collapses, Hoppe et al., "Mesh optimization", SIGGRAPH 1993), those first whose removal the gradients at the vertices
say bends the surface least, and none is moved before the field was looked at, at places less than a voxel apart,
inside the triangles that this makes. So a bump that is a voxel wide cannot get lost below a large triangle.

- Every vertex that is left was a vertex before. It lies on the isosurface and keeps its gradient, bit for bit, which
  edge collapses to the places that minimise a quadric (Garland and Heckbert 1997) would have to mend afterwards.
- The border of a brick's mesh stays as it is. So bricks fit together whatever the detail of each, without a crack.
- The topology is kept.

Triangles differ in size by far more than those of detail 0. They are put in order by it, within blocks so small that
what lies together stays together: processors that take several at a time wait for the largest of them.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    import numpy.typing as npt

    from isosample.surfaces.brick_samples import BrickSamples
    from isosample.surfaces.refine import NamedMesh

    F64 = npt.NDArray[np.float64]
    I32 = npt.NDArray[np.int32]
    I64 = npt.NDArray[np.int64]

MOST_DETAILS = 5
FEWEST_TRIANGLES = 16  # smaller meshes are left as they are
WORTHWHILE = 0.75  # of the triangles: where more are left, there is no such detail
ORDERED = 64  # triangles of a block that is put in order


def detail_tolerance(detail: int) -> float:
    """Largest distance from the isosurface that a detail adds [voxel]; 0 for detail 0."""
    return 2.0 ** (detail - 1 - MOST_DETAILS) if detail else 0.0


def coarsened(mesh: NamedMesh, brick: BrickSamples, isovalue: float, detail: int) -> NamedMesh | None:
    """Return a mesh at some detail.

    Parameters
    ----------
    mesh : NamedMesh
        Detail 0.
    brick : BrickSamples
    isovalue : float
    detail : int
        1 to `MOST_DETAILS`.

    Returns
    -------
    coarser : NamedMesh or None
        None where more than three quarters of the triangles would be left.

    Notes
    -----
    The distance is abs(field − isovalue) / abs(gradient) at the points of `residual_kernels.largest_distance`.
    Triangles that no collapse touched are as far away as they were.
    """
    from isosample.surfaces.collapse_kernels import collapse

    if len(mesh.triangles) < FEWEST_TRIANGLES:
        return None
    triangles = mesh.triangles.copy()
    collapse(
        brick.coefficients,
        brick.kernel,
        brick.smooth,
        brick.origin,
        isovalue,
        mesh.positions,
        mesh.gradients,
        triangles,
        detail_tolerance(detail),
    )
    left = triangles[triangles[:, 0] >= 0]
    if len(left) > WORTHWHILE * len(mesh.triangles):
        return None
    left = left[order_by_size(mesh.positions, left)]
    used = np.unique(left)
    number = np.zeros(len(mesh.positions), dtype=np.int32)
    number[used] = np.arange(len(used), dtype=np.int32)
    return mesh._replace(
        positions=mesh.positions[used],
        gradients=mesh.gradients[used],
        keys=mesh.keys[used],
        triangles=number[left],
    )


def order_by_size(positions: F64, triangles: I32) -> I64:
    """(T,) int64, triangles from small to large, block by block; parameters as of a `NamedMesh`."""
    corners = positions[triangles]
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    block = np.arange(len(triangles)) // ORDERED
    order: I64 = np.lexsort((area, block))
    return order

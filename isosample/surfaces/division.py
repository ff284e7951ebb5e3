"""Red-green division: a triangle with one, two or three divided sides becomes two, three or four triangles."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

if TYPE_CHECKING:
    from isosample.surfaces.mesh import I32
    from isosample.volume.grid import F64

I64 = npt.NDArray[np.int64]

WHOLE = -1  # stands for the new vertex of a side that is not divided

# Children as columns of (a, b, c, vertex of ab, vertex of bc, vertex of ca); all keep the sense of rotation.
_ONE = ((0, 3, 2), (3, 1, 2))  # ab is divided
_TWO_FROM_A = ((3, 1, 4), (0, 3, 4), (0, 4, 2))  # ab and bc are: the diagonal from a
_TWO_FROM_C = ((3, 1, 4), (0, 3, 2), (3, 4, 2))  # … or from c
_THREE = ((0, 3, 5), (3, 1, 4), (4, 2, 5), (3, 4, 5))


def divide_triangles(triangles: I32, new_vertices: I64, positions: F64) -> tuple[I32, I64]:
    """Return the triangles that take the place of triangles with divided sides, in the order of their parents.

    Parameters
    ----------
    triangles : (T, 3) int32
    new_vertices : (T, 3) int64
        Vertex that divides the side ab, bc, ca of each triangle, `WHOLE` for none.
    positions : (V, 3) float64
        Of old and new vertices; with two divided sides the shorter diagonal is drawn.

    Returns
    -------
    children : (T', 3) int32
    parents : (T',) int64
        Row of each child's parent.
    """
    divided = new_vertices != WHOLE
    count = divided.sum(axis=1)
    rows = np.concatenate([triangles, new_vertices], axis=1)
    # Turn the triangle so that with one divided side it is ab, with two ca is the whole one.
    turn = np.where(
        count == 1, divided.argmax(axis=1), np.where(count == 2, (~divided).argmax(axis=1) + 1, 0)
    )
    columns = (np.arange(3) + turn[:, None]) % 3
    rows = np.take_along_axis(rows, np.concatenate([columns, columns + 3], axis=1), axis=1)
    from_a = _square(positions, rows[:, 0], rows[:, 4]) <= _square(positions, rows[:, 3], rows[:, 2])
    cases = (
        (count == 0, ((0, 1, 2),)),
        (count == 1, _ONE),
        ((count == 2) & from_a, _TWO_FROM_A),
        ((count == 2) & ~from_a, _TWO_FROM_C),
        (count == 3, _THREE),
    )
    parents, children = [], []
    for chosen, pattern in cases:
        found = np.flatnonzero(chosen)
        parents.append(np.repeat(found, len(pattern)))
        children.append(rows[found][:, pattern].reshape(-1, 3))
    order = np.argsort(np.concatenate(parents), kind="stable")
    return np.concatenate(children)[order].astype(np.int32), np.concatenate(parents)[order]


def _square(positions: F64, first: I64, second: I64) -> F64:
    """Squared distance of vertices, exact for positions in a brick; whatever where a row means none."""
    x, y, z = (positions[first] - positions[second]).T
    square: F64 = x * x + y * y + z * z
    return square

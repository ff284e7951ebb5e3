"""A mesh as triangles and, per vertex, a linked list of corners: rings of neighbours, and collapses; compiled.

Corner 3 t + i is vertex i of triangle t; `first` holds a corner of every vertex, `following` the next corner of the
same vertex, −1 at the end. Triangles that are gone have −1 at their first corner.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from isosample.compiled import compiled

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt

    I32 = npt.NDArray[np.int32]

NONE = -1
LARGEST_RING = 48  # neighbours that a vertex may have or get


@compiled
def ordered_ring(vertex: int, triangles: I32, first: I32, following: I32, ring: I32) -> int:
    """Put the neighbours of a vertex into `ring`, in turn; return how many, 0 if they are no single closed ring.

    Triangle n at the vertex has the neighbours n and n + 1. Corners of triangles that are gone leave the list.
    """
    before, corner, size = NONE, first[vertex], 0
    while corner != NONE:
        t = corner // 3
        if triangles[t, 0] == NONE:
            if before == NONE:
                first[vertex] = following[corner]
            else:
                following[before] = following[corner]
        else:
            size += 1
            before = corner
        corner = following[corner]
    if size < 3 or size > LARGEST_RING:
        return 0
    t = first[vertex] // 3
    start = after(triangles, t, vertex)
    here = start
    for n in range(size):
        ring[n] = here
        here = after_neighbour(vertex, here, triangles, first, following)
        if here == NONE or (here == start) != (n == size - 1):
            return 0
    return size


@compiled
def after(triangles: I32, t: int, vertex: int) -> int:
    """The corner of a triangle that comes after a vertex."""
    if triangles[t, 0] == vertex:
        return int(triangles[t, 1])
    return int(triangles[t, 2] if triangles[t, 1] == vertex else triangles[t, 0])


@compiled
def after_neighbour(vertex: int, neighbour: int, triangles: I32, first: I32, following: I32) -> int:
    """The third corner of the only triangle with the side (vertex, neighbour); −1 if there is not just one."""
    found = NONE
    corner = first[vertex]
    while corner != NONE:
        t = corner // 3
        if after(triangles, t, vertex) == neighbour:
            if found != NONE:
                return NONE
            found = after(triangles, t, neighbour)
        corner = following[corner]
    return found


@compiled
def keeps_topology(
    vertex: int,
    ring: I32,
    size: int,
    onto: int,
    triangles: I32,
    first: I32,
    following: I32,
    marked: I32,
    mark: int,
) -> bool:
    """Whether the two ends of a side have no common neighbours but the two opposite it, and none gets too many."""
    target = ring[onto]
    left, right = ring[(onto + size - 1) % size], ring[(onto + 1) % size]
    corner, degree = first[target], 0
    while corner != NONE:
        t = corner // 3
        corner = following[corner]
        if triangles[t, 0] == NONE:
            continue
        degree += 1
        a = after(triangles, t, target)
        b = after(triangles, t, a)
        if a == vertex or b == vertex:
            continue
        if (marked[a] == mark and a != left and a != right) or (
            marked[b] == mark and b != left and b != right
        ):
            return False
        if size == 3 and marked[a] == mark and marked[b] == mark:
            return False  # the triangle that would be made is there already
    return degree + size - 4 <= LARGEST_RING


@compiled
def fan_of(ring: I32, size: int, onto: int, fan: I32) -> int:
    """Put the triangles that a collapse makes into `fan`; return how many."""
    for n in range(size - 2):
        fan[n, 0] = ring[onto]
        fan[n, 1] = ring[(onto + n + 1) % size]
        fan[n, 2] = ring[(onto + n + 2) % size]
    return size - 2


@compiled
def move_onto(vertex: int, target: int, triangles: I32, first: I32, following: I32) -> None:
    """Make the target the corner of all triangles at the vertex; the two that have both are gone."""
    corner = first[vertex]
    while corner != NONE:
        t, following_corner = corner // 3, following[corner]
        if triangles[t, 0] == target or triangles[t, 1] == target or triangles[t, 2] == target:
            triangles[t, 0] = NONE
        else:
            triangles[t, corner % 3] = target
            following[corner] = first[target]
            first[target] = corner
        corner = following_corner
    first[vertex] = NONE

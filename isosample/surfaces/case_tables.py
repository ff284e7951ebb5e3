"""Marching-cubes case table with a free choice on every ambiguous face, generated from the cell's topology.

A cell has 8 corners, each inside (value >= isovalue) or outside. A face whose diagonal corners are inside
and whose others are outside is ambiguous: its two inside corners are joined or separated, which the caller
decides from the four values of the face alone, so both cells at the face agree. The curves that the faces
carry close into loops; each loop is triangulated. No triangle side lies in a face except as a piece of such
a curve, so the sides of neighbouring cells match one to one: meshes are watertight by construction.

Numbering (bit = 1 at the far end): corner = x + 2 y + 4 z; edge = 4 · axis + the two other coordinates of its
corners, lower axis first; face = 2 · axis + side. Triangles wind counter-clockwise seen from outside values.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from itertools import combinations, pairwise
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

EDGES = 12
CENTRE_BIT = 7  # of `MarchTable.triangle_count`
CENTRE = 12  # vertex number of a loop's centre, behind the 12 edges
Loop = tuple[int, ...]
Triangle = tuple[int, int, int]


def _other_axes(axis: int) -> tuple[int, int]:
    return ((1, 2), (0, 2), (0, 1))[axis]


def _edge_lower_corner(edge: int) -> int:
    axis, rest = divmod(edge, 4)
    first, second = _other_axes(axis)
    return (rest & 1) << first | (rest >> 1) << second


def _face_corners(face: int) -> tuple[int, int, int, int]:
    """Corners of a face, counter-clockwise seen from outside the cell."""
    axis, side = divmod(face, 2)
    first, second = (axis + 1) % 3, (axis + 2) % 3
    base, u, v = side << axis, 1 << first, 1 << second
    ring = (base, base + u, base + u + v, base + v)
    return ring if side else (ring[0], ring[3], ring[2], ring[1])


def _diagonal_costs() -> list[list[float]]:
    """Squared distance of every two edges' middles, infinite where they share a face."""
    middle = (EDGE_LOWER_CORNER[:, None] >> np.arange(3) & 1).astype(np.float64)
    middle[np.arange(EDGES), EDGE_AXIS] = 0.5
    share_face = ((middle[:, None] == middle) & (middle != 0.5)).any(axis=2)
    distance = ((middle[:, None] - middle) ** 2).sum(axis=2)
    costs: list[list[float]] = np.where(share_face, np.inf, distance).tolist()
    return costs


EDGE_AXIS = np.repeat(np.arange(3), 4)
EDGE_LOWER_CORNER = np.array([_edge_lower_corner(edge) for edge in range(EDGES)])
FACE_CORNERS = np.array([_face_corners(face) for face in range(6)])
EDGE_OF_CORNERS = {
    frozenset((_edge_lower_corner(edge), _edge_lower_corner(edge) + (1 << edge // 4))): edge
    for edge in range(EDGES)
}
DIAGONAL_COST = _diagonal_costs()


@dataclass(frozen=True, slots=True, kw_only=True)
class CaseTable:
    """Triangles of every (signs, face decisions) case.

    Attributes
    ----------
    ambiguous_faces : (256,) uint8
        Bit `f` is set where face `f` is ambiguous for these corner signs (bit `c` = corner `c` inside).
    case_of : (256, 64) int16
        Case number for corner signs and face decisions (bit `f` = inside corners of face `f` joined);
        decisions about faces that are not ambiguous are ignored.
    triangle_start, triangle_count : (C,) int64
        Range of the case's rows in `triangles`.
    triangles : (N, 3) int8
        Edge numbers, or `CENTRE` for the centre vertex, of which a cell has at most one.
    centre_edges : (C, 12) bool
        Edges whose vertices surround the centre vertex; all False where the case has none.
    """

    ambiguous_faces: npt.NDArray[np.uint8]
    case_of: npt.NDArray[np.int16]
    triangle_start: npt.NDArray[np.int64]
    triangle_count: npt.NDArray[np.int64]
    triangles: npt.NDArray[np.int8]
    centre_edges: npt.NDArray[np.bool_]


@cache
def case_table() -> CaseTable:
    """Return the table, generated once per process."""
    ambiguous = np.array([_ambiguous_faces(signs) for signs in range(256)], dtype=np.uint8)
    case_of = np.empty((256, 64), dtype=np.int16)
    numbers: dict[tuple[int, int], int] = {}
    for signs in range(256):
        for decisions in range(64):
            key = (signs, decisions & int(ambiguous[signs]))
            case_of[signs, decisions] = numbers.setdefault(key, len(numbers))
    cases = [_triangulate_case(signs, decisions) for signs, decisions in numbers]
    counts = np.array([len(triangles) for triangles, _ in cases], dtype=np.int64)
    centre_edges = np.zeros((len(cases), EDGES), dtype=np.bool_)
    for number, (_, centre_loop) in enumerate(cases):
        centre_edges[number, list(centre_loop)] = True
    return CaseTable(
        ambiguous_faces=ambiguous,
        case_of=case_of,
        triangle_start=np.cumsum(counts) - counts,
        triangle_count=counts,
        triangles=np.array([row for triangles, _ in cases for row in triangles], dtype=np.int8),
        centre_edges=centre_edges,
    )


class MarchTable(NamedTuple):
    """The case table in the form that compiled kernels read.

    Attributes
    ----------
    ambiguous_faces : (256,) uint8
    case_of : (256, 64) int16
    triangle_count : (C,) uint8
        In the lower bits; bit `CENTRE_BIT` is set where the case has a centre vertex.
    triangle_start : (C + 1,) int32
        The rows of a case begin here; those of the next one end it.
    triangles : (N, 3) uint8
    cut_edges : (C,) int16
        Bit `e` is set where edge `e` is cut.
    centre_edges : (C,) int16
        Bit `e` is set where edge `e` surrounds the centre vertex.
    lower_corner : (12,) int8
        Lower corner of each edge.
    fresh_edges : (8,) int16
        Bit `e` is set where no cell before this one has its edge `e`, cells being visited x fastest, for whether
        there are cells behind this one along x (bit 0 of the row), y and z.
    """

    ambiguous_faces: npt.NDArray[np.uint8]
    case_of: npt.NDArray[np.int16]
    triangle_count: npt.NDArray[np.uint8]
    triangle_start: npt.NDArray[np.int32]
    triangles: npt.NDArray[np.uint8]
    cut_edges: npt.NDArray[np.int16]
    centre_edges: npt.NDArray[np.int16]
    lower_corner: npt.NDArray[np.int8]
    fresh_edges: npt.NDArray[np.int16]


@cache
def march_table() -> MarchTable:
    """Return the table for kernels, made once per process."""
    table = case_table()
    case_count = len(table.triangle_count)
    signs_of = np.empty(case_count, dtype=np.int64)
    signs_of[table.case_of] = np.arange(256)[:, None]
    inside = (signs_of[:, None] >> np.arange(8) & 1).astype(np.bool_)
    cut = inside[:, EDGE_LOWER_CORNER] != inside[:, EDGE_LOWER_CORNER + (1 << EDGE_AXIS)]
    behind = np.arange(8)[:, None] >> np.arange(3) & 1
    near = (EDGE_LOWER_CORNER[:, None] >> np.arange(3) & 1) == 0  # edges shared with the cell behind
    near[np.arange(EDGES), EDGE_AXIS] = False
    bits = 1 << np.arange(EDGES)
    return MarchTable(
        ambiguous_faces=table.ambiguous_faces,
        case_of=table.case_of,
        triangle_count=(table.triangle_count | table.centre_edges.any(axis=1) << CENTRE_BIT).astype(np.uint8),
        triangle_start=np.append(table.triangle_start, len(table.triangles)).astype(np.int32),
        triangles=table.triangles.astype(np.uint8),
        cut_edges=(cut @ bits).astype(np.int16),
        centre_edges=(table.centre_edges @ bits).astype(np.int16),
        lower_corner=EDGE_LOWER_CORNER.astype(np.int8),
        fresh_edges=((behind @ near.T == 0) @ bits).astype(np.int16),
    )


def loops_of(signs: int, decisions: int) -> list[Loop]:
    """Return the closed curves that the surface draws on the cell's faces, as rings of edge numbers.

    Notes
    -----
    Walking a face counter-clockwise, a face edge enters the inside or leaves it; a curve runs from an
    entering edge to a leaving one, with the inside on its right. An edge enters in one of its two faces and
    leaves in the other, so the curves chain into loops.
    """
    following: dict[int, int] = {}
    for face in range(6):
        following.update(_face_curves(face, signs, bool(decisions >> face & 1)))
    loops: list[Loop] = []
    while following:
        ring = [min(following)]
        while (after := following.pop(ring[-1])) != ring[0]:
            ring.append(after)
        loops.append(tuple(ring))
    return loops


def _face_curves(face: int, signs: int, joined: bool) -> dict[int, int]:
    """Map each edge that enters the inside to the edge where its curve on this face leaves."""
    ring = _face_corners(face)
    inside = [bool(signs >> corner & 1) for corner in ring]
    edges = [EDGE_OF_CORNERS[frozenset((ring[i], ring[(i + 1) % 4]))] for i in range(4)]
    entering = [i for i in range(4) if not inside[i] and inside[(i + 1) % 4]]
    leaving = [i for i in range(4) if inside[i] and not inside[(i + 1) % 4]]
    if len(entering) < 2:
        return {edges[i]: edges[j] for i, j in zip(entering, leaving, strict=True)}
    turn = -1 if joined else 1  # joined: around the outside corner; separated: around the inside corner
    return {edges[i]: edges[(i + turn) % 4] for i in entering}


def _ambiguous_faces(signs: int) -> int:
    bits = 0
    for face in range(6):
        a, b, c, d = (signs >> corner & 1 for corner in _face_corners(face))
        bits |= (a == c and b == d and a != b) << face
    return bits


def _triangulate_case(signs: int, decisions: int) -> tuple[list[Triangle], Loop]:
    """Return the triangles of a case, and the loop that has a centre vertex (or an empty one)."""
    triangles: list[Triangle] = []
    centre_loop: Loop = ()
    for loop in loops_of(signs, decisions):
        found = _triangulate_loop(loop)
        if found is None:
            assert not centre_loop, "a cell has 12 edges: two loops that need a centre do not fit"
            centre_loop = loop
            found = [(CENTRE, a, b) for a, b in pairwise((*loop, loop[0]))]
        triangles += found
    return triangles, centre_loop


def _triangulate_loop(loop: Loop) -> list[Triangle] | None:
    """Return the triangulation with the shortest diagonals of which none lies in a face, or None.

    Dynamic programming over the polygon (Klincsek, "Minimal triangulations of polygonal domains", 1980).
    """
    n = len(loop)
    best: dict[tuple[int, int], tuple[float, list[Triangle]]] = {(i, i + 1): (0.0, []) for i in range(n - 1)}
    for i, j in sorted(combinations(range(n), 2), key=lambda ends: ends[1] - ends[0]):
        if j == i + 1:
            continue
        own_cost = 0.0 if (i, j) == (0, n - 1) else DIAGONAL_COST[loop[i]][loop[j]]
        options = [(best[i, k][0] + best[k, j][0] + own_cost, k) for k in range(i + 1, j)]
        cost, k = min(options)
        best[i, j] = cost, [*best[i, k][1], (loop[i], loop[k], loop[j]), *best[k, j][1]]
    cost, triangles = best[0, n - 1]
    return triangles if cost < float("inf") else None

"""Division of triangles with one, two or three divided sides."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from isosample.surfaces.division import WHOLE, divide_triangles

CORNERS = np.array([[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [0.5, 1.5, 0.0]])
MIDDLES = 0.5 * (CORNERS + CORNERS[[1, 2, 0]])


@pytest.mark.parametrize("divided", list(itertools.product([False, True], repeat=3)))
@pytest.mark.parametrize("turn", [0, 1, 2])
def test_children_cover_the_triangle_once_and_keep_its_sense(
    divided: tuple[bool, bool, bool], turn: int
) -> None:
    order = (np.arange(3) + turn) % 3
    new = np.array([[3 + order[side] if divided[order[side]] else WHOLE for side in range(3)]])
    positions = np.concatenate([CORNERS, MIDDLES])
    children, parents = divide_triangles(order[None].astype(np.int32), new, positions)
    assert len(children) == 1 + sum(divided)
    assert not parents.any()
    a, b, c = (positions[children[:, corner]] for corner in range(3))
    areas = 0.5 * np.cross(b - a, c - a)[:, 2]
    assert (areas > 0.1).all()
    assert areas.sum() == pytest.approx(1.5, abs=1e-15)
    assert set(children.ravel().tolist()) == {0, 1, 2, *(3 + side for side in range(3) if divided[side])}


def test_the_shorter_diagonal_is_drawn_and_children_follow_their_parents() -> None:
    """ab and bc are divided: the diagonals of a, m, n, c are a–n, 1.25 long, and m–c, 1.58 long."""
    positions = np.concatenate([CORNERS, MIDDLES])
    triangles = np.array([[0, 1, 2], [2, 0, 1]], dtype=np.int32)
    children, parents = divide_triangles(triangles, np.array([[3, 4, -1], [-1, -1, -1]]), positions)
    assert parents.tolist() == [0, 0, 0, 1]
    lengths = [np.linalg.norm(positions[0] - positions[4]), np.linalg.norm(positions[3] - positions[2])]
    drawn = {0, 4} if lengths[0] <= lengths[1] else {3, 2}
    assert sum(drawn <= set(child) for child in children[:3].tolist()) == 2

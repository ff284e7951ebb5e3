"""The generated case table: counts that the literature fixes, and the rule that makes meshes watertight."""

from __future__ import annotations

import numpy as np
import pytest

from isosample.surfaces.case_tables import (
    CENTRE,
    EDGE_AXIS,
    EDGE_LOWER_CORNER,
    FACE_CORNERS,
    case_table,
    loops_of,
)


def _faces_of_edge(edge: int) -> set[int]:
    ends = {int(EDGE_LOWER_CORNER[edge]), int(EDGE_LOWER_CORNER[edge]) + (1 << int(EDGE_AXIS[edge]))}
    return {face for face in range(6) if ends <= set(FACE_CORNERS[face].tolist())}


def test_every_edge_lies_in_two_faces() -> None:
    assert all(len(_faces_of_edge(edge)) == 2 for edge in range(12))


def test_a_corner_inside_is_cut_off_by_one_triangle() -> None:
    table = case_table()
    for corner in range(8):
        case = table.case_of[1 << corner, 0]
        assert table.triangle_count[case] == 1
        edges = table.triangles[table.triangle_start[case]]
        assert all(corner in (EDGE_LOWER_CORNER[e], EDGE_LOWER_CORNER[e] + (1 << e // 4)) for e in edges)


def test_cells_on_one_side_have_no_triangles() -> None:
    table = case_table()
    assert table.triangle_count[table.case_of[[0, 255], 0]].tolist() == [0, 0]


def test_the_checkerboard_cell_is_ambiguous_on_all_faces() -> None:
    corners_of_even_parity = sum(1 << c for c in range(8) if bin(c).count("1") % 2 == 0)
    table = case_table()
    assert table.ambiguous_faces[corners_of_even_parity] == 63
    assert table.triangle_count[table.case_of[corners_of_even_parity, 0]] == 4  # four corners, each cut off
    assert len(np.unique(table.case_of[corners_of_even_parity])) == 64


@pytest.mark.parametrize("decisions", [0, 63, 21])
def test_loops_pass_every_cut_edge_once(decisions: int) -> None:
    for signs in range(256):
        inside = [bool(signs >> corner & 1) for corner in range(8)]
        cut = {
            edge
            for edge in range(12)
            if inside[EDGE_LOWER_CORNER[edge]] != inside[EDGE_LOWER_CORNER[edge] + (1 << edge // 4)]
        }
        passed = [edge for loop in loops_of(signs, decisions) for edge in loop]
        assert len(passed) == len(cut)
        assert set(passed) == cut


def test_triangle_sides_lie_in_a_face_only_as_pieces_of_its_curves() -> None:
    table = case_table()
    for signs in range(256):
        for decisions in range(64):
            case = table.case_of[signs, decisions]
            start, count = table.triangle_start[case], table.triangle_count[case]
            loops = loops_of(signs, decisions & int(table.ambiguous_faces[signs]))
            curves = {(loop[i - 1], loop[i]) for loop in loops for i in range(len(loop))}
            rows = table.triangles[start : start + count].tolist()
            sides = {(row[i - 1], row[i]) for row in rows for i in range(3)}
            on_faces = {
                (a, b) for a, b in sides if CENTRE not in (a, b) and _faces_of_edge(a) & _faces_of_edge(b)
            }
            assert on_faces == curves
            assert {(b, a) for a, b in sides - curves} == sides - curves

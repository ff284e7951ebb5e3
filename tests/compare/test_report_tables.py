"""What the tables of a report say of the numbers in results.json."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import pytest

from compare.small_comparison import small_experiment
from isosample.compare.experiment import run_experiment
from isosample.compare.report_tables import facts, tables

if TYPE_CHECKING:
    from isosample.compare.report_tables import Table

pytestmark = pytest.mark.usefixtures("gl")


@pytest.fixture(scope="module")
def document(gl: object) -> dict[str, Any]:
    """Results of the small comparison: two cameras, a transfer function with one isosurface."""
    found = run_experiment(small_experiment()).results.to_dict()
    found["scene"] |= {"source": None, "transfer_function_source": None}
    return found


def table(document: dict[str, Any], name: str) -> Table:
    (found,) = [one for one in tables(document) if one.name == name]
    return found


def column(found: Table, heading: str) -> dict[str, list[str]]:
    """Cells under a heading, by method."""
    place = [name for name, _ in found.columns].index(heading)
    cells: dict[str, list[str]] = {}
    for method, _, row in found.rows:
        cells.setdefault(method, []).append(row[place])
    return cells


def test_an_isosurface_that_is_not_shown_is_one_however_many_cameras_miss_it(
    document: dict[str, Any],
) -> None:
    cells = column(table(document, "Skipped"), "isosurfaces not shown")
    assert cells["post-classified"] == ["1", "1"]
    assert {cell for method in cells if method != "post-classified" for cell in cells[method]} == {"–"}
    assert any("does not show 1 isosurface of" in one for one in document["verdict"]["sentences"])


def test_counts_and_their_nouns_agree(document: dict[str, Any]) -> None:
    volume = dict(facts(document)[0][1])
    assert volume["transfer function"] == "6 points, 1 isosurface"


def test_the_share_of_few_pixels_stands_beside_the_rmse(document: dict[str, Any]) -> None:
    cells = column(table(document, "Error"), "in 0.1 %")
    told = [f"{entry['summary']['worst_pixels_share']:.0%}" for entry in document["entries"]]
    assert [cell for row in cells.values() for cell in row] == told
    for entry in document["entries"]:  # of the squares of both cameras together
        squares = [view["errors"]["rmse"] ** 2 for view in entry["views"]]
        shares = [view["errors"]["worst_pixels_share"] for view in entry["views"]]
        expected = sum(a * b for a, b in zip(shares, squares, strict=True)) / sum(squares)
        assert entry["summary"]["worst_pixels_share"] == pytest.approx(expected, rel=1e-12)

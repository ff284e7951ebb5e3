"""What the tables of a report say of the numbers in results.json."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

import isosample
from compare.small_comparison import small_experiment
from isosample.compare.conventions import shown_share
from isosample.compare.experiment import run_experiment
from isosample.compare.report_tables import facts, tables
from isosample.rendering.camera import Projection
from isosample.rendering.reference_image import render_reference
from isosample.wording import percentage

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


def test_the_share_of_the_pixels_that_show_anything_stands_where_the_limits_are_explained(
    document: dict[str, Any],
) -> None:
    shares = document["reference"]["shown_share"]
    settings = dict(facts(document)[1][1])
    for number, share in enumerate(shares, start=1):
        assert 0.0 < share < 1.0
        assert settings[f"camera {number}"].endswith(f"; {percentage(share)} of the pixels show anything")
    half = document | {"reference": document["reference"] | {"shown_share": [0.3, 0.2]}}
    assert table(half, "Equal error").caption.endswith(
        "over whole pictures, and 25 % of their pixels show anything: it depends on the framing. Over those pixels "
        "alone it would be 2 times as large, but for what methods draw elsewhere."
    )
    whole = document | {"reference": document["reference"] | {"shown_share": [1.0, 1.0]}}
    assert table(whole, "Equal error").caption.endswith("The RMSE is over whole pictures.")


@pytest.mark.parametrize("background", [(0.0, 0.0, 0.0, 0.0), (0.1, 0.7, 0.3, 1.0), (0.9, 0.2, 0.1, 0.3)])
def test_a_pixel_shows_something_where_it_is_not_the_background(background: tuple[float, ...]) -> None:
    samples = np.zeros((6, 6, 6), np.float32)
    samples[:, :, 3:] = 1.0
    points = [
        isosample.ControlPoint(value, (1.0, 1.0, 1.0), extinction) for value, extinction in ((0.5, 0), (1, 1))
    ]
    volume, settings = isosample.Volume(samples), isosample.RenderSettings(background=background)
    # values above 0.5 fill 2.5 < x < 5, 0 < y < 5, and a pixel is half a unit wide: 5 x 10 pixels
    camera = isosample.Camera(
        projection=Projection.ORTHOGRAPHIC, eye=(2.5, 2.5, 20.0), target=(2.5, 2.5, 2.5), height=10.0
    )
    truth = render_reference(
        volume, isosample.TransferFunction(points), camera=camera, size=(20, 20), settings=settings
    )
    assert shown_share(truth.rgba, settings) == 5 * 10 / 400


def test_counts_and_their_nouns_agree(document: dict[str, Any]) -> None:
    volume = dict(facts(document)[0][1])
    assert volume["transfer function"] == "6 points, 1 isosurface"


def test_the_share_of_few_pixels_stands_beside_the_rmse(document: dict[str, Any]) -> None:
    cells = column(table(document, "Error"), "in 0.1 %")
    told = [percentage(entry["summary"]["worst_pixels_share"]) for entry in document["entries"]]
    assert [cell for row in cells.values() for cell in row] == told
    for entry in document["entries"]:  # of the squares of both cameras together
        squares = [view["errors"]["rmse"] ** 2 for view in entry["views"]]
        shares = [view["errors"]["worst_pixels_share"] for view in entry["views"]]
        expected = sum(a * b for a, b in zip(shares, squares, strict=True)) / sum(squares)
        assert entry["summary"]["worst_pixels_share"] == pytest.approx(expected, rel=1e-12)

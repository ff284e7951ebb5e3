from __future__ import annotations

import json
import math
from typing import TYPE_CHECKING, Any

import pytest

from isosample.errors import InputError
from isosample.transfer.transfer_function import ControlPoint, Isosurface, TransferFunction

if TYPE_CHECKING:
    from pathlib import Path

RED = [1.0, 0.0, 0.0]


def entry(value: float, **fields: Any) -> dict[str, Any]:
    return {"value": value, "color": RED, "extinction": 1.0, **fields}


def document(*points: dict[str, Any], **top: Any) -> dict[str, Any]:
    return {"points": list(points), **top}


def translucent(value: float, opacity: object) -> dict[str, Any]:
    return {"value": value, "color": RED, "opacity": opacity}


def test_a_transfer_function_survives_a_file_bit_for_bit(tmp_path: Path) -> None:
    tf = TransferFunction(
        [ControlPoint(0.1, (0.1, 0.2, 0.3), 0), ControlPoint(1 / 3, (1, 1, 1), 1e-7)],
        [Isosurface(0.7, (0, 0.5, 1), 1), Isosurface(0.2, (0, 0.5, 1), 0.1)],
    )
    path = tmp_path / "tf.json"
    tf.save(path)
    assert TransferFunction.load(path) == tf
    assert [file.name for file in tmp_path.iterdir()] == ["tf.json"]


def test_saving_replaces_a_file_and_an_absent_folder_is_an_input_error(tmp_path: Path) -> None:
    tf = TransferFunction([], [Isosurface(0.7, (0, 0.5, 1), 1)])
    path = tmp_path / "tf.json"
    path.write_text("old")
    tf.save(path)
    assert TransferFunction.load(path) == tf
    with pytest.raises(InputError, match=r"none/tf\.json cannot be written: No such file"):
        tf.save(tmp_path / "none" / "tf.json")


def test_opacity_over_the_unit_distance_becomes_extinction() -> None:
    tf = TransferFunction.from_dict(document(translucent(0, 0.5), translucent(1, 0), unit_distance=2))
    assert tf.points[0].extinction == pytest.approx(math.log(2) / 2, rel=2**-52)
    assert tf.points[1].extinction == 0


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (
            document(entry(0), entry(0.1), entry(0.5), entry(0.2)),
            "points[3].value 0.2 is below points[2].value 0.5; values must ascend",
        ),
        (document(entry(0), entry(1, extinction=-2)), "points[1].extinction -2 is negative"),
        (document(entry(0), entry(1, color=[1, 1])), "points[1].color [1, 1] must be three"),
        (document(entry(0), entry(1, color=[1, 1, 1.5])), "points[1].color [1.0, 1.0, 1.5] must lie in"),
        (document(entry(0), entry(1, color=[1, 1, "x"])), "points[1].color[2] 'x' must be a number"),
        (document(entry(0), entry(True)), "points[1].value True must be a number"),
        (document(entry(0), entry(1, opacity=0.5)), "points[1].extinction or opacity: exactly one"),
        (document({"value": 0, "color": RED}), "points[0].extinction or opacity: exactly one"),
        (document(translucent(0, 0.5), unit_distance=0), "unit_distance 0 must be > 0"),
        (document(translucent(0, 0.5)), "points[0].opacity 0.5 needs a top-level unit_distance"),
        (document(translucent(0, 1), unit_distance=1), "points[0].opacity 1 over a distance means infinite"),
        (document(translucent(0, 1.5), unit_distance=1), "points[0].opacity 1.5 must be >= 0 and < 1"),
        (
            document(entry(0), entry(1, colour=RED)),
            "points[1] has the unknown key 'colour'; did you mean 'color'?",
        ),
        (document({"value": 1, "extinction": 1}), "points[0] lacks ['color']"),
        (
            document(entry(0), pionts=[]),
            "the file has the unknown key 'pionts'; did you mean 'points'? Known are",
        ),
        (
            document(entry(0), a=1, b=2),
            "has unknown keys 'a', 'b'; known are isosurfaces, points, unit_distance.",
        ),
        (document(entry(0), intervals=[]), "unknown key 'intervals'; known are"),
        (document(entry(0)), "points holds one point, at 0; a slope needs two"),
        (document(entry(0), entry(0), entry(0)), "points[2].value 0.0 is the third at this value"),
        (document(), "both lists are empty"),
        ({"points": 3}, "points is 3; expected a list"),
        ([], "the file is []; expected an object"),
        (
            document(isosurfaces=[{"value": 1, "color": RED, "opacity": 0}]),
            "isosurfaces[0].opacity 0 must be > 0",
        ),
        (
            document(isosurfaces=[{"value": 1, "color": RED, "opacity": 0.5}] * 2),
            "isosurfaces has two entries at value 1.0",
        ),
        (document(entry(-1.5e308), entry(1.5e308)), "their difference overflows"),
    ],
)
def test_errors_name_the_file_the_entry_and_the_value(content: Any, message: str, tmp_path: Path) -> None:
    path = tmp_path / "tf.json"
    path.write_text(json.dumps(content))
    with pytest.raises(InputError) as caught:
        TransferFunction.load(path)
    assert str(caught.value).startswith("tf.json: ")
    assert message in str(caught.value)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('{"points": [{"value": NaN}]}', "NaN is no JSON number"),
        ('{"points": [{"value": -Infinity}]}', "-Infinity is no JSON number"),
        ('{"points": [{"value": 1e999, "color": [0, 0, 0], "extinction": 1}]}', "value inf must be finite"),
        ('{"points": [],\n "points": []}', "keys ['points'] are repeated"),
        ('{"points": [\n}', "line 2, column 1: Expecting value"),
        ('{"points": [' + "9" * 5000 + "]}", "a number cannot be read"),
        ("[" * 100_000, "nested too deeply"),
    ],
)
def test_what_is_no_clean_json_is_refused(text: str, message: str, tmp_path: Path) -> None:
    path = tmp_path / "tf.json"
    path.write_text(text)
    with pytest.raises(InputError) as caught:
        TransferFunction.load(path)
    assert message in str(caught.value)


def test_files_that_cannot_be_read_are_input_errors(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"none\.json cannot be read: No such file"):
        TransferFunction.load(tmp_path / "none.json")
    (tmp_path / "tf.json").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(InputError, match="is no text"):
        TransferFunction.load(tmp_path / "tf.json")

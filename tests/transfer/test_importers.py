from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from isosample.errors import InputError
from isosample.transfer.foreign_curves import TOLERANCE, linear_from_srgb
from isosample.transfer.importers import from_paraview, from_slicer
from isosample.transfer.transfer_function import TransferFunction

if TYPE_CHECKING:
    from pathlib import Path


def curve_point(x: float, content: float | list[float], **shape: float) -> dict[str, Any]:
    """Slicer's curve point; `content` is an opacity or a colour."""
    key = "color" if isinstance(content, list) else "y"
    return {"x": x, key: content, "midpoint": 0.5, "sharpness": 0.0, **shape}


def slicer_document(
    opacity: list[dict[str, Any]], color: list[dict[str, Any]] | None = None, **component: Any
) -> dict[str, Any]:
    """Volume property with one component."""
    color = color or [curve_point(0, [0.5, 0.5, 0.5])]
    parts = {"scalarOpacity": {"points": opacity}, "rgbTransferFunction": {"points": color}, **component}
    return {
        "@schema": "volume-property-schema-v1.0.0.json#",
        "volumeProperties": [{"isoSurfaceValues": [10.0, 90.0], "components": [parts]}],
    }


def paraview_document(**changes: Any) -> list[dict[str, Any]]:
    entry = {
        "ColorSpace": "RGB",
        "Name": "ramp",
        "RGBPoints": [0, 0, 0, 0, 100, 1, 1, 1],
        "Points": [0, 0, 0.5, 0, 100, 0.8, 0.5, 0],
        **changes,
    }
    return [{key: value for key, value in entry.items() if value is not None}]


def opacity_at(tf: TransferFunction, values: Any, unit_distance: float = 1.0) -> Any:
    return -np.expm1(-tf.evaluate(values)[1] * unit_distance)


def test_srgb_becomes_linear_light() -> None:
    # the standard's own landmarks: both ends, the linear toe, and 8-bit 188 = half of the light (0.5029)
    np.testing.assert_allclose(
        linear_from_srgb([0, 0.04045, 188 / 255, 1]), [0, 0.04045 / 12.92, 0.5029, 1], atol=5e-5
    )


def test_slicer_opacity_is_followed_to_within_the_tolerance() -> None:
    points = [curve_point(0, 0.0), curve_point(50, 0.9), curve_point(100, 0.2)]
    tf = from_slicer(slicer_document(points, scalarOpacityUnitDistance=2.5))
    values = np.linspace(0, 100, 777)
    expected = np.interp(values, [0, 50, 100], [0, 0.9, 0.2])
    # samples lie 50 / 400 apart or closer: between them the chord is off by less than a tenth of the rest
    np.testing.assert_allclose(opacity_at(tf, values, 2.5), expected, rtol=0, atol=1.1 * TOLERANCE)
    assert opacity_at(tf, 50.0, 2.5) == pytest.approx(0.9, rel=1e-12)  # a node is kept as it is
    assert len(tf.points) < 24


def test_slicer_curves_go_on_with_their_end_values() -> None:
    tf = from_slicer(slicer_document([curve_point(0, 0.0), curve_point(50, 0.5)]))
    np.testing.assert_allclose(opacity_at(tf, [50.0, 51.0, 1e6]), 0.5, rtol=1e-12)
    assert opacity_at(tf, -1.0) == 0


def test_slicer_colours_are_srgb_mixed_as_displayed() -> None:
    color = [curve_point(0, [0.0, 0.0, 1.0]), curve_point(100, [1.0, 0.0, 1.0])]
    tf = from_slicer(slicer_document([curve_point(0, 0.5)], color))
    values = np.linspace(0, 100, 101)
    red = tf.evaluate(values)[0][:, 0]
    np.testing.assert_allclose(red, linear_from_srgb(values / 100), rtol=0, atol=1.1 * TOLERANCE)


def test_slicer_points_at_one_value_are_a_step_and_need_no_order() -> None:
    points = [curve_point(80, 0.0), curve_point(0, 0.0), curve_point(40, 0.0), curve_point(40, 0.6)]
    tf = from_slicer(slicer_document(points))
    assert tf.evaluate(40.0, "left")[1] == 0
    assert -np.expm1(-tf.evaluate(40.0, "right")[1]) == pytest.approx(0.6, rel=1e-12)


@pytest.mark.parametrize(
    ("shape", "expected"),
    [
        ({"sharpness": 1.0, "midpoint": 0.25}, [0.0, 0.8, 0.8]),  # a step at the midpoint
        ({"midpoint": 0.25}, [0.8 * 0.4, 0.8 * 0.6, 0.8 * 5 / 6]),  # two straight pieces through a half
        # where 0.2, 0.4, 0.75 of the way: power 6, s = ½ 0.4⁶, ½ 0.8⁶, 1 − ½ 0.5⁶, then the Hermite
        # polynomial 3s² − 2s³ + ½(2s³ − 3s² + s) = 1.5 s² − s³ + ½ s
        (
            {"sharpness": 0.5},
            [0.8 * (1.5 * s**2 - s**3 + 0.5 * s) for s in (0.5 * 0.4**6, 0.5 * 0.8**6, 1 - 0.5**7)],
        ),
    ],
)
def test_midpoint_and_sharpness_have_the_shape_that_vtk_gives_them(
    shape: dict[str, float], expected: list[float]
) -> None:
    tf = from_slicer(slicer_document([curve_point(0, 0.0, **shape), curve_point(100, 0.8)]))
    # 32 straight pieces of a smooth curve add at most 0.8 · max|f''| / (8 · 32²), |f''| < 25: 0.0025
    np.testing.assert_allclose(opacity_at(tf, [20, 40, 75]), expected, rtol=0, atol=TOLERANCE + 0.0025)


def test_slicer_isosurfaces_are_taken_on_request_with_the_curves_look() -> None:
    points = [curve_point(0, 0.0), curve_point(50, 0.0), curve_point(100, 0.5)]
    document = slicer_document(points)
    assert from_slicer(document).isosurfaces == ()
    (surface,) = from_slicer(document, isosurfaces=True).isosurfaces
    assert surface.value == 90  # at 10 the opacity is 0
    assert surface.opacity == pytest.approx(0.4, rel=1e-12)
    assert surface.color[0] == pytest.approx(float(linear_from_srgb(0.5)), rel=1e-12)


def test_full_opacity_is_lowered_with_a_warning() -> None:
    with pytest.warns(UserWarning, match=r"tf.vp.json: opacities above 0.999 are lowered"):
        tf = from_slicer(slicer_document([curve_point(0, 0.0), curve_point(9, 1.0)]), source="tf.vp.json")
    assert opacity_at(tf, 9.0) == pytest.approx(0.999, rel=1e-12)


def test_a_gradient_opacity_is_left_out_with_a_warning() -> None:
    gradient = {"points": [curve_point(0, 0.0), curve_point(10, 1.0)]}
    with pytest.warns(UserWarning, match="gradientOpacity is not supported"):
        from_slicer(slicer_document([curve_point(0, 0.5)], gradientOpacity=gradient))
    from_slicer(slicer_document([curve_point(0, 0.5)], gradientOpacity={"points": [curve_point(0, 1.0)]}))


def test_paraview_maps_are_read() -> None:
    tf = from_paraview(paraview_document(), unit_distance=3.0)
    values = np.linspace(0, 100, 50)
    np.testing.assert_allclose(opacity_at(tf, values, 3.0), 0.008 * values, rtol=0, atol=1.1 * TOLERANCE)
    np.testing.assert_allclose(
        tf.evaluate(values)[0][:, 1], linear_from_srgb(values / 100), rtol=0, atol=1.1 * TOLERANCE
    )


def test_paraview_without_opacities_needs_them_given() -> None:
    document = paraview_document(Points=None)
    with pytest.raises(InputError, match=r"map.json: Points \(the opacities\) is missing"):
        from_paraview(document, source="map.json")
    tf = from_paraview(document, opacity=[(0, 0.0), (100, 0.5)])
    assert opacity_at(tf, 100.0) == pytest.approx(0.5, rel=1e-12)


def test_other_colour_spaces_pass_where_colours_are_dense() -> None:
    with pytest.raises(InputError, match="ColorSpace 'Diverging' is not supported"):
        from_paraview(paraview_document(ColorSpace="Diverging"))
    dense = [number for i in range(33) for number in (i * 100 / 32, i / 32, i / 32, i / 32)]
    tf = from_paraview(paraview_document(ColorSpace="Lab", RGBPoints=dense))
    assert tf.evaluate(50.0)[0][0] == pytest.approx(float(linear_from_srgb(0.5)), abs=TOLERANCE)


@pytest.mark.parametrize(
    ("document", "message"),
    [
        (paraview_document(RGBPoints=[0, 0, 0]), "RGBPoints has 3 numbers; expected a multiple of 4"),
        (paraview_document(Points=[0, 2, 0.5, 0]), r"\[2.0\] must be one opacity"),
        (paraview_document() * 2, "has 2 colour maps"),
    ],
)
def test_wrong_paraview_maps_name_what_is_wrong(document: Any, message: str) -> None:
    with pytest.raises(InputError, match=f"map.json: .*{message}"):
        from_paraview(document, source="map.json")


def test_wrong_slicer_files_name_the_entry() -> None:
    place = r"a.vp.json: volumeProperties\[0\].components\[0\].scalarOpacity.points\[1\]"
    with pytest.raises(InputError, match=rf"{place}.y is missing"):
        from_slicer(slicer_document([curve_point(0, 0.0), {"x": 3}]), source="a.vp.json")
    with pytest.raises(InputError, match=rf"{place}.midpoint 3 must"):
        from_slicer(
            slicer_document([curve_point(0, 0.0), curve_point(1, 0.0, midpoint=3.0)]), source="a.vp.json"
        )
    with pytest.raises(InputError, match="volumeProperties has 0 entries"):
        from_slicer({"volumeProperties": []})


def test_load_tells_the_three_formats_apart(tmp_path: Path) -> None:
    path = tmp_path / "tf.json"
    documents: list[Any] = [
        slicer_document([curve_point(0, 0.0), curve_point(100, 0.8)]),
        paraview_document(),
        paraview_document()[0],
        {"points": [{"value": v, "color": [1, 1, 1], "extinction": v * 0.0161} for v in (0, 100)]},
    ]
    for document in documents:
        path.write_text(json.dumps(document))
        assert opacity_at(TransferFunction.load(path), 100.0) == pytest.approx(0.8, abs=1e-3)

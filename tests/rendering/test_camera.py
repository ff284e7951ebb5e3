"""Cameras: the orbit's convention, what fits the picture, files, and every bad value refused."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from isosample.errors import InputError
from isosample.rendering.camera import Camera, Projection, UpAxis
from isosample.volume.geometry import Box

if TYPE_CHECKING:
    from pathlib import Path

BOX = Box(corner=np.array([1.0, 2.0, 3.0]), edges=np.diag([4.0, 6.0, 8.0]))


@pytest.mark.parametrize(
    ("azimuth", "elevation", "up_axis", "outward", "up", "right"),
    [
        (0, 0, UpAxis.Y, (0, 0, 1), (0, 1, 0), (1, 0, 0)),
        (90, 0, UpAxis.Y, (1, 0, 0), (0, 1, 0), (0, 0, -1)),
        (0, 90, UpAxis.Y, (0, 1, 0), (0, 0, -1), (1, 0, 0)),
        (0, 0, UpAxis.Z, (0, -1, 0), (0, 0, 1), (1, 0, 0)),
        (90, 0, UpAxis.Z, (1, 0, 0), (0, 0, 1), (0, 1, 0)),
        (0, 90, UpAxis.Z, (0, 0, 1), (0, 1, 0), (1, 0, 0)),
    ],
)
def test_the_orbit_starts_at_the_front_and_turns_right_and_up(
    azimuth: float,
    elevation: float,
    up_axis: UpAxis,
    outward: tuple[float, ...],
    up: tuple[float, ...],
    right: tuple[float, ...],
) -> None:
    rays = Camera.orbit(BOX, azimuth=azimuth, elevation=elevation, up_axis=up_axis).rays(1.0)
    assert np.allclose(rays.forward, np.negative(outward), atol=1e-15)
    assert np.allclose(rays.span_up / np.linalg.norm(rays.span_up), up, atol=1e-15)
    assert np.allclose(rays.span_right / np.linalg.norm(rays.span_right), right, atol=1e-15)


@pytest.mark.parametrize("patient", [False, True])
def test_orbits_and_the_default_start_at_the_front_of_a_patient_head_up(patient: bool) -> None:
    box = replace(BOX, patient_axes=patient)
    up = UpAxis.Z if patient else UpAxis.Y
    assert Camera.default(box, (300, 200)) == Camera.orbit(BOX, aspect=1.5, up_axis=up)
    assert Camera.orbit(box, azimuth=20.0) == Camera.orbit(BOX, azimuth=20.0, up_axis=up)
    for given in UpAxis:
        assert Camera.orbit(box, up_axis=given) == Camera.orbit(BOX, up_axis=given)
    if patient:  # LPS: the front is -y, the left side +x, the head +z
        rays = Camera.default(box, (200, 200)).rays(1.0)
        assert np.allclose(rays.forward, (0, 1, 0))
        assert np.allclose(rays.span_up / np.linalg.norm(rays.span_up), (0, 0, 1))
        assert np.allclose(rays.span_right / np.linalg.norm(rays.span_right), (1, 0, 0))


@pytest.mark.parametrize("projection", Projection)
@pytest.mark.parametrize("aspect", [0.5, 1.0, 2.0])
def test_the_bounding_sphere_touches_the_shorter_side(projection: Projection, aspect: float) -> None:
    camera = Camera.orbit(BOX, azimuth=20, elevation=30, projection=projection, aspect=aspect)
    rays = camera.rays(aspect)
    shorter = min(np.linalg.norm(rays.span_up), np.linalg.norm(rays.span_right))
    distance = np.linalg.norm(np.asarray(camera.eye) - BOX.centre)
    expected = (
        BOX.radius if projection is Projection.ORTHOGRAPHIC else np.tan(np.arcsin(BOX.radius / distance))
    )
    assert np.isclose(shorter, expected, rtol=1e-12)
    assert distance > BOX.radius


@pytest.mark.parametrize("projection", Projection)
def test_zoom_magnifies_about_the_centre(projection: Projection) -> None:
    plain = Camera.orbit(BOX, projection=projection).rays(1.5)
    zoomed = Camera.orbit(BOX, projection=projection, zoom=4.0).rays(1.5)
    assert np.allclose(zoomed.span_up * 4.0, plain.span_up)
    assert np.allclose(zoomed.eye, plain.eye)


def test_rays_go_through_pixel_centres_with_row_0_on_top() -> None:
    camera = Camera(
        projection=Projection.ORTHOGRAPHIC, eye=(0.0, 0.0, 5.0), target=(0.0, 0.0, 0.0), height=4.0
    )
    origins, directions = camera.rays(2.0).origins_and_directions(4, 2)
    assert np.allclose(origins[0, 0], [-3.0, 1.0, 5.0])
    assert np.allclose(origins[1, 3], [3.0, -1.0, 5.0])
    assert np.all(directions == [0.0, 0.0, -1.0])


def test_a_camera_file_round_trips(tmp_path: Path) -> None:
    for projection in Projection:
        camera = Camera.orbit(BOX, azimuth=12, projection=projection)
        path = tmp_path / "camera.json"
        path.write_text(json.dumps(camera.to_dict()))
        assert Camera.load(path) == camera


GOOD: dict[str, Any] = {"projection": "orthographic", "eye": [0, 0, 5], "target": [0, 0, 0], "height": 4}


@pytest.mark.parametrize(
    ("change", "named"),
    [
        ({"projection": "fisheye"}, "fisheye"),
        ({"height": 0}, "height 0"),
        ({"height": None}, "height None"),
        ({"height": float("nan")}, "height nan"),
        ({"height": "tall"}, "tall"),
        ({"height": 1e-300}, "height 1e-300"),
        ({"height": 10**400}, "height 1000"),
        ({"eye": [0, 0, 1e200]}, "1e\\+200"),
        ({"fov_y_degrees": 30}, "fov_y_degrees 30"),
        ({"projection": "perspective"}, "height 4 does not belong"),
        ({"eye": [0, 0]}, r"eye \[0, 0\]"),
        ({"eye": [0, 0, "far"]}, "far"),
        ({"eye": [0, 0, float("inf")]}, "inf"),
        ({"eye": [0, 0, 0]}, "eye and target"),
        ({"up": [0, 0, 1]}, r"up .* parallel"),
        ({"up": [0, 0, 0]}, r"up .* parallel"),
        ({"zoom": 2}, "the camera has the unknown key 'zoom'; known are eye, "),
        ({"fov_y": 30}, "unknown key 'fov_y'; did you mean 'fov_y_degrees'\\? Known are eye, "),
        ({"targets": [0, 0, 0]}, "unknown key 'targets'; did you mean 'target'"),
    ],
)
def test_a_bad_entry_is_named(change: dict[str, Any], named: str) -> None:
    entries = {
        key: value for key, value in (GOOD | change).items() if not (key == "height" and value is None)
    }
    with pytest.raises(InputError, match=named) as caught:
        Camera.from_dict(entries, source="camera.json")
    assert str(caught.value).startswith("camera.json: ")


@pytest.mark.parametrize("missing", ["projection", "eye", "target"])
def test_a_missing_entry_is_an_error(missing: str) -> None:
    with pytest.raises(InputError, match="a camera has the entries"):
        Camera.from_dict({key: value for key, value in GOOD.items() if key != missing})


def test_a_camera_file_that_cannot_be_read_is_an_input_error(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"absent\.json"):
        Camera.load(tmp_path / "absent.json")
    (tmp_path / "broken.json").write_text("{")
    with pytest.raises(InputError, match=r"broken.json is not JSON"):
        Camera.load(tmp_path / "broken.json")
    (tmp_path / "deep.json").write_text("[" * 100_000)
    with pytest.raises(InputError, match=r"deep\.json is not JSON"):
        Camera.load(tmp_path / "deep.json")
    (tmp_path / "list.json").write_text("[1]")
    with pytest.raises(InputError, match=r"list\.json: a camera has"):
        Camera.load(tmp_path / "list.json")


@pytest.mark.parametrize(
    "options", [{"zoom": 0.0}, {"zoom": float("nan")}, {"aspect": -1.0}, {"azimuth": float("inf")}]
)
def test_orbit_refuses_numbers_out_of_range(options: dict[str, float]) -> None:
    with pytest.raises(InputError):
        Camera.orbit(BOX, **options)  # type: ignore[arg-type]


def test_orbit_refuses_a_box_without_extent() -> None:
    with pytest.raises(InputError, match="no extent"):
        Camera.orbit(Box(corner=np.zeros(3), edges=np.zeros((3, 3))))

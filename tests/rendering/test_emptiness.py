"""Why a picture is empty: what the clip planes leave of a box, and what the camera sees of it."""

from __future__ import annotations

import numpy as np
import pytest

from isosample.rendering.camera import Camera, Projection
from isosample.rendering.emptiness import is_empty, why_empty
from isosample.rendering.image import Image
from isosample.rendering.settings import ClipPlane, RenderSettings
from isosample.volume.geometry import Box

BOX = Box(corner=np.array([10.0, 0.0, 0.0]), edges=np.diag([4.0, 2.0, 2.0]))  # x 10 to 14, y and z 0 to 2
SIZE = (40, 20)


def camera(
    eye: tuple[float, float, float], target: tuple[float, float, float], *, flat: bool = False
) -> Camera:
    if flat:
        return Camera(projection=Projection.ORTHOGRAPHIC, eye=eye, target=target, height=2.0)
    return Camera(projection=Projection.PERSPECTIVE, eye=eye, target=target, fov_y_degrees=30.0)


FRONT = camera((12.0, 1.0, 20.0), (12.0, 1.0, 0.0))


@pytest.mark.parametrize(
    ("view", "planes", "reason"),
    [
        (FRONT, [(1, 0, 0, -1e6)], "the clip planes leave nothing of the volume's box, 10, 0, 0 to 14, 2, 2"),
        (FRONT, [(1, 0, 0, -14)], "everything is cut away"),  # a face is left, and it shows nothing
        (FRONT, [(1, 0, 0, -12.1), (-1, 0, 0, 12)], "everything is cut away"),
        (FRONT, [(1, 1, 0, -15.9), (0, -1, 0, 1.8)], "everything is cut away"),
        (FRONT, [(1, 1, 0, -15.7), (0, -1, 0, 1.8)], "shows lies elsewhere"),  # a sliver of the edge is left
        (FRONT, [], "is in the view: what the transfer function shows lies elsewhere"),
        (FRONT, [(1, 0, 0, -13.9)], "is in the view, and the clip planes leave some of it"),
        (camera((12, 1, 20), (12, 1, 40)), [], "is behind the eye, (12, 1, 20)"),
        (camera((12, 1, 20), (12, 1, 40), flat=True), [], "is behind the eye, (12, 1, 20)"),
        (camera((12, 1, 20), (-20, 1, 0)), [], "is outside the view from (12, 1, 20) to (-20, 1, 0)"),
        (camera((12, 3.1, 20), (12, 3.1, 0), flat=True), [], "is outside the view"),  # y 2.1 to 4.1
        (camera((12, 2.9, 20), (12, 2.9, 0), flat=True), [], "is in the view"),
        (camera((7.9, 1, 20), (7.9, 1, 0), flat=True), [], "is outside the view"),  # x 5.9 to 9.9
        (camera((8.1, 1, 20), (8.1, 1, 0), flat=True), [], "is in the view"),
        (camera((10, 1, 20), (10, 1, 0), flat=True), [(1, 0, 0, -12.1)], "what the clip planes leave of"),
    ],
)
def test_the_reason_is_the_one_that_holds(
    view: Camera, planes: list[tuple[float, float, float, float]], reason: str
) -> None:
    settings = RenderSettings(clip_planes=tuple(ClipPlane(*plane) for plane in planes))
    assert reason in why_empty(BOX, view, SIZE, settings)


def test_a_perspective_view_ends_where_its_rays_do() -> None:
    """At the box's nearest face, 18 away, the picture reaches 18 tan 15° up: 4.823."""
    for up, reason in ((2.0 + 4.82, "is in the view"), (2.0 + 5.37, "is outside the view")):
        assert reason in why_empty(BOX, camera((12, up, 20), (12, up, 0)), SIZE, RenderSettings())


def test_a_turned_box_far_from_the_origin_is_judged_in_its_own_size() -> None:
    turn = np.array([[0.6, 0.8, 0.0], [-0.8, 0.6, 0.0], [0.0, 0.0, 1.0]])
    box = Box(corner=np.array([1e6, -1e6, 5.0]), edges=1e-3 * turn)
    view = Camera.orbit(box)
    normal, middle = turn[0], box.centre
    for reach, reason in ((0.49e-3, "is in the view"), (0.51e-3, "everything is cut away")):
        nx, ny, nz = normal.tolist()
        plane = ClipPlane(nx, ny, nz, float(-normal @ middle) - reach)
        assert reason in why_empty(box, view, (9, 9), RenderSettings(clip_planes=(plane,)))


def test_an_empty_picture_is_its_background() -> None:
    settings = RenderSettings(background=(0.3, 0.5, 0.7, 0.5))
    rgba = np.tile(np.array(settings.background_premultiplied, dtype=np.float32), (3, 4, 1))
    assert is_empty(Image(rgba), settings)
    assert not is_empty(Image(rgba), RenderSettings())
    rgba[2, 1, 0] += 1e-3
    assert not is_empty(Image(rgba), settings)

"""Why a picture shows nothing: everything is cut away, or the volume is not in the view."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    import numpy.typing as npt

    from isosample.rendering.camera import Camera
    from isosample.rendering.image import Image
    from isosample.rendering.settings import RenderSettings
    from isosample.volume.geometry import Box

    F64 = npt.NDArray[np.float64]

THINNEST = 1e-9  # of the box's radius: what is thinner shows nothing


def is_empty(image: Image, settings: RenderSettings) -> bool:
    """Tell whether a picture is its background and nothing else."""
    return bool((image.rgba == np.array(settings.background_premultiplied, dtype=np.float32)).all())


def why_empty(box: Box, camera: Camera, size: tuple[int, int], settings: RenderSettings) -> str:
    """Return why a picture is empty although the transfer function shows something of the volume's range.

    Parameters
    ----------
    box : Box
        Of the volume.
    camera : Camera
    size : (width, height)
        Pixels.
    settings : RenderSettings
        With the clip planes.

    Returns
    -------
    reason : str
        One sentence without a full stop, with the numbers that are wrong.
    """
    inside, left = _box_half_spaces(box), _clip_half_spaces(box, settings)
    view = _view_half_spaces(box, camera, size[0] / size[1])
    corners = box.corners()
    low, high = (
        ", ".join(f"{part:.6g}" for part in end) for end in (corners.min(axis=0), corners.max(axis=0))
    )
    where = f"the volume's box, {low} to {high}"
    if not _share_a_point(inside, left):
        return f"the picture is empty, for everything is cut away: the clip planes leave nothing of {where}"
    if not _share_a_point(inside, view[:1]):
        return f"the picture is empty, for {where}, is behind the eye, {_point(camera.eye)}"
    if not _share_a_point(inside, view):
        ends = f"from {_point(camera.eye)} to {_point(camera.target)}"
        return f"the picture is empty, for {where}, is outside the view {ends}"
    if not _share_a_point(inside, left, view):
        return f"the picture is empty, for what the clip planes leave of {where}, is outside the view"
    cut = ", and the clip planes leave some of it" if settings.clip_planes else ""
    return (
        f"the picture is empty, though {where}, is in the view{cut}: what the transfer function shows lies elsewhere, "
        "or is too faint"
    )


def _box_half_spaces(box: Box) -> F64:
    """(6, 4) half-spaces: n · p + d >= 0, n of unit length, p in radii of the box from its centre."""
    normals = np.linalg.inv(box.edges).T  # row a: how fast the place along edge a grows
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    halves = 0.5 / lengths / box.radius
    units = normals / lengths
    return np.concatenate([np.hstack([units, halves]), np.hstack([-units, halves])])


def _clip_half_spaces(box: Box, settings: RenderSettings) -> F64:
    """(P, 4) half-spaces that the clip planes keep, as `_box_half_spaces`."""
    planes = np.array([plane.about(box.centre) for plane in settings.clip_planes]).reshape(-1, 4)
    return planes / [1.0, 1.0, 1.0, box.radius]


def _view_half_spaces(box: Box, camera: Camera, aspect: float) -> F64:
    """(5, 4) half-spaces that the rays of a picture lie in, the first in front of the eye, as `_box_half_spaces`."""
    rays = camera.rays(aspect)
    eye = (rays.eye - box.centre) / box.radius
    planes = [np.array([*rays.forward, -rays.forward @ eye])]
    for span in (rays.span_right, rays.span_up):
        length = np.linalg.norm(span)
        for side in (span / length, -span / length):
            normal = (length * rays.forward if rays.perspective else 0.0) + side
            offset = -normal @ eye + (0.0 if rays.perspective else length / box.radius)
            planes.append(np.array([*normal, offset]) / np.linalg.norm(normal))
    return np.stack(planes)


def _share_a_point(*half_spaces: F64) -> bool:
    """Whether half-spaces have a ball in common: the widest is found by a linear programme."""
    from scipy.optimize import linprog

    planes = np.concatenate(half_spaces)
    # Widest r with n · p + d >= r, p in the cube of two radii about the centre, which holds the box.
    found = linprog(
        [0.0, 0.0, 0.0, -1.0],
        A_ub=np.hstack([-planes[:, :3], np.ones((len(planes), 1))]),
        b_ub=planes[:, 3],
        bounds=[(-2.0, 2.0)] * 3 + [(None, 1.0)],
    )
    return bool(found.status == 0 and found.x[3] > THINNEST)


def _point(position: tuple[float, float, float]) -> str:
    return "(" + ", ".join(f"{part:.6g}" for part in position) + ")"

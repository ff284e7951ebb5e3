"""An eye far away costs no accuracy (parallel rays), or is refused (perspective)."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from isosample.errors import InputError
from isosample.rendering.camera import Camera, Projection
from rendering.scenes import picture, ramp_tf
from rendering.test_closed_forms import ramp_volume

if TYPE_CHECKING:
    import moderngl


def test_parallel_rays_do_not_depend_on_the_distance_of_the_eye(gl: moderngl.Context) -> None:
    volume, _ = ramp_volume((1.0, 1.0, 1.0), 0.0)
    tf = ramp_tf(*volume.value_range, (0.02, 0.3))
    centre, direction = volume.box.centre, np.array([0.6, 0.0, 0.8])
    near, far = (
        picture(
            gl,
            volume,
            tf,
            Camera(
                projection=Projection.ORTHOGRAPHIC,
                eye=tuple(centre + distance * direction),
                target=tuple(centre),
                height=20.0,
            ),
        )[0]
        for distance in (20.0, 1e9)
    )
    # The direction itself is rounded to 1e-16 · 1e9 / 20 of a radian in float64, below float32's rounding.
    assert np.abs(near - far).max() < 1e-5


def test_a_perspective_eye_too_far_away_is_refused(gl: moderngl.Context) -> None:
    volume, _ = ramp_volume((1.0, 1.0, 1.0), 0.0)
    eye = tuple(volume.box.centre + np.array([0.0, 0.0, 1e8]))
    camera = Camera(
        projection=Projection.PERSPECTIVE, eye=eye, target=tuple(volume.box.centre), fov_y_degrees=1e-5
    )
    with pytest.raises(InputError, match="times the radius"):
        picture(gl, volume, ramp_tf(*volume.value_range, (0.02, 0.3)), camera)

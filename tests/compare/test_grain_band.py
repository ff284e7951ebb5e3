"""The band of wood grain follows from the picture and the volume; a picture that has none is compared without."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

import isosample
from compare.small_comparison import small_experiment
from isosample.compare.conventions import grain_band_of
from isosample.compare.experiment import run_experiment
from isosample.compare.report_tables import facts
from isosample.compare.results import write_results

if TYPE_CHECKING:
    from pathlib import Path


pytestmark = pytest.mark.usefixtures("gl")


HALF_VOXELS = isosample.Volume(np.zeros((9, 9, 9), np.float32), spacing=(0.5, 1.0, 0.75))  # 4 x 8 x 6
CENTRE = (2.0, 4.0, 3.0)


def seen_from_afar(**size: float) -> isosample.Camera:
    """A camera 9 in front of the centre of the box; orthographic with a height, else perspective."""
    kind = isosample.Projection.ORTHOGRAPHIC if "height" in size else isosample.Projection.PERSPECTIVE
    eye = (CENTRE[0], CENTRE[1], CENTRE[2] + 9.0)
    return isosample.Camera(projection=kind, eye=eye, target=CENTRE, **size)  # type: ignore[arg-type]


def test_the_grain_band_is_that_of_one_voxel_and_stays_below_the_finest_frequency() -> None:
    camera = seen_from_afar(height=10.0)
    band = grain_band_of(camera, (100, 100), HALF_VOXELS)  # pixels of 0.1, a fifth of a voxel
    expected = (0.2 * math.tan(math.radians(15)), 0.2 * math.tan(math.radians(60)))
    assert band == pytest.approx(expected)
    assert grain_band_of(camera, (10, 10), HALF_VOXELS) == (0.25, 0.5)
    window = 2 * math.degrees(math.atan(5.0 / 9.0))  # as high in the middle of the box
    assert grain_band_of(seen_from_afar(fov_y_degrees=window), (100, 100), HALF_VOXELS) == pytest.approx(
        expected
    )


def test_the_grain_band_does_not_depend_on_how_far_the_target_is() -> None:
    far = seen_from_afar(fov_y_degrees=30.0)
    near = replace(far, target=(far.eye[0], far.eye[1], far.eye[2] - 0.01))
    band = grain_band_of(far, (64, 64), HALF_VOXELS)
    assert band is not None
    assert grain_band_of(near, (64, 64), HALF_VOXELS) == pytest.approx(band)


def test_a_picture_of_less_than_a_voxel_has_no_grain_band() -> None:
    # The steps repeat tan 60° x (height / 64) / 0.5 times per pixel at most: less than once per picture below
    # a height of 0.5 / tan 60° = 0.2887.
    assert grain_band_of(seen_from_afar(height=0.29), (64, 64), HALF_VOXELS) is not None
    assert grain_band_of(seen_from_afar(height=0.28), (64, 64), HALF_VOXELS) is None
    away = seen_from_afar(fov_y_degrees=30.0)
    away = replace(away, target=(away.eye[0], away.eye[1], away.eye[2] + 1.0))
    assert grain_band_of(away, (64, 64), HALF_VOXELS) is None


@pytest.mark.parametrize("height", [None, 0.2])
def test_a_comparison_with_a_target_at_the_eye_or_without_a_grain_band_runs_to_its_end(
    height: float | None, tmp_path: Path
) -> None:
    size = {"fov_y_degrees": 30.0} if height is None else {"height": height}
    kind = isosample.Projection.PERSPECTIVE if height is None else isosample.Projection.ORTHOGRAPHIC
    camera = isosample.Camera(projection=kind, eye=(5.5, 6.0, 40.0), target=(5.5, 6.0, 39.999), **size)  # type: ignore[arg-type]
    asked = replace(small_experiment(methods=("pre-integrated",)), cameras=(camera,), repeat=1)
    found = run_experiment(asked).results.to_dict()
    write_results(found, tmp_path / "results.json")
    grains = [entry["summary"]["wood_grain"] for entry in found["entries"]]
    assert [grain is None for grain in grains] == [height is not None] * len(grains)
    told = dict(
        facts(found | {"scene": found["scene"] | {"source": "", "transfer_function_source": ""}})[1][1]
    )
    assert ("none, the picture shows too little" in told["wood grain"]) == (height is not None)
    assert "tilts of 15° to 60°" in told["wood grain"]

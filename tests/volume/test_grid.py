"""The volume keeps its samples as they are and places them exactly."""

from __future__ import annotations

import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from isosample.errors import InputError
from isosample.volume.geometry import GridGeometry
from isosample.volume.grid import Volume

ROTATION_Z = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])  # x index runs along +y
MIRROR_Y = np.diag([1.0, -1.0, 1.0])


def test_world_position_is_origin_plus_direction_times_scaled_index() -> None:
    geometry = GridGeometry(size_xyz=(4, 5, 6), spacing=(2, 3, 4), origin=(10, 20, 30), direction=ROTATION_Z)
    # index (1, 1, 1) is scaled to (2, 3, 4), turned to (-3, 2, 4), moved by the origin
    np.testing.assert_array_equal(geometry.world_from_index @ [1, 1, 1, 1], [7, 22, 34, 1])


def test_box_goes_from_the_first_to_the_last_sample() -> None:
    geometry = GridGeometry(size_xyz=(4, 5, 6), spacing=(2, 3, 4), origin=(1, 1, 1))
    np.testing.assert_array_equal(geometry.box.corner, [1, 1, 1])
    np.testing.assert_array_equal(geometry.box.edges, np.diag([6, 12, 20]))
    assert geometry.box.radius == pytest.approx(np.linalg.norm([3, 6, 10]), rel=1e-15)


@pytest.mark.parametrize("direction", [np.eye(3), ROTATION_Z, MIRROR_Y])
def test_a_linear_fields_world_gradient_follows_from_its_index_gradient(direction: np.ndarray) -> None:
    geometry = GridGeometry(size_xyz=(2, 2, 2), spacing=(0.5, 2, 8), direction=direction)
    world_gradient = np.array([3.0, -1.0, 2.0])
    index_gradient = world_gradient @ geometry.world_from_index[:3, :3]  # chain rule, exact: powers of two
    np.testing.assert_array_equal(
        geometry.world_gradient_from_index_gradient @ index_gradient, world_gradient
    )


def test_a_left_handed_direction_is_accepted() -> None:
    volume = Volume(np.zeros((2, 3, 4)), spacing=(1, 2, 3), direction=MIRROR_Y)
    np.testing.assert_array_equal(volume.box.edges[1], [0, -4, 0])


@given(
    spacing=st.tuples(*[st.floats(1e-3, 1e3)] * 3),
    origin=st.tuples(*[st.floats(-1e6, 1e6)] * 3),
    size=st.tuples(*[st.integers(1, 9)] * 3),
)
def test_a_geometry_survives_json_bit_for_bit(
    spacing: tuple[float, float, float], origin: tuple[float, float, float], size: tuple[int, int, int]
) -> None:
    geometry = GridGeometry(
        size_xyz=size, spacing=spacing, origin=origin, direction=ROTATION_Z, patient_axes=size[0] > 4
    )
    copy = GridGeometry.from_dict(json.loads(json.dumps(geometry.to_dict())))
    assert copy == geometry
    assert hash(copy) == hash(geometry)


def test_geometries_differ_when_one_number_differs() -> None:
    one = GridGeometry(size_xyz=(2, 2, 2))
    assert one != GridGeometry(size_xyz=(2, 2, 2), spacing=(1, 1, np.nextafter(1, 2)))
    assert one != GridGeometry(size_xyz=(2, 2, 2), direction=MIRROR_Y)


def test_a_dictionary_with_a_missing_entry_is_refused_by_name() -> None:
    entries = GridGeometry(size_xyz=(2, 2, 2)).to_dict()
    del entries["origin"]
    with pytest.raises(InputError, match=r"'origin'.*got \['direction', 'size_xyz', 'spacing'\]"):
        GridGeometry.from_dict(entries)


def test_a_volume_delegates_to_its_geometry() -> None:
    volume = Volume(np.zeros((2, 3, 4)), spacing=(1, 2, 3), origin=(4, 5, 6), direction=ROTATION_Z)
    assert volume.geometry == GridGeometry(
        size_xyz=(4, 3, 2), spacing=(1, 2, 3), origin=(4, 5, 6), direction=ROTATION_Z
    )
    np.testing.assert_array_equal(volume.world_from_index, volume.geometry.world_from_index)
    assert volume.in_index_frame().geometry == GridGeometry(size_xyz=(4, 3, 2), spacing=(1, 2, 3))


def test_a_volume_keeps_the_callers_samples_uncopied() -> None:
    samples = np.arange(24, dtype=np.int16).reshape(2, 3, 4)
    assert Volume(samples).array is samples


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"spacing": (1, 0, 1)}, r"spacing \(1\.0, 0\.0, 1\.0\) must be > 0"),
        ({"spacing": (1, np.nan, 1)}, "three finite numbers"),
        ({"origin": (1, 2)}, "origin.*three finite numbers"),
        ({"direction": [[1, 0.3, 0], [0, 1, 0], [0, 0, 1]]}, "not orthonormal; sheared.*--frame index"),
        ({"direction": np.full((3, 3), np.nan)}, "3 by 3 matrix of finite numbers"),
        ({"direction": "up"}, "3 by 3 matrix of finite numbers"),
    ],
)
def test_an_impossible_placement_is_refused(arguments: dict[str, object], message: str) -> None:
    with pytest.raises(InputError, match=message):
        Volume(np.zeros((2, 2, 2)), **arguments)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("array", "message"),
    [
        (np.zeros((2, 2)), "three axes"),
        (np.zeros((2, 2, 2), dtype=complex), "integers, floats or bool"),
        (np.zeros((2, 0, 2)), "at least one sample"),
        ([[[1.0]]], "needs a numpy array"),
    ],
)
def test_an_array_that_is_no_volume_is_refused(array: np.ndarray, message: str) -> None:
    with pytest.raises(InputError, match=message):
        Volume(array)


def test_the_value_range_ignores_samples_that_are_not_finite() -> None:
    samples = np.array([[[np.nan, -2.0, np.inf, 5.0, -np.inf]]])
    volume = Volume(samples)
    assert volume.value_range == (-2.0, 5.0)
    assert volume.nonfinite_counts == (1, 2)


def test_a_volume_without_any_finite_sample_is_refused_when_its_range_is_asked() -> None:
    with pytest.raises(InputError, match="no finite sample"):
        _ = Volume(np.full((1, 1, 2), np.nan)).value_range


def test_a_mask_is_a_volume_of_0_and_1_in_the_same_memory() -> None:
    mask = np.random.default_rng(3).random((4, 5, 6)) < 0.5
    for array in (mask, mask[::2, :, ::-1], np.asfortranarray(mask)):
        volume = Volume(array)
        assert volume.array.dtype == np.uint8
        assert np.shares_memory(volume.array, array)
        assert np.array_equal(volume.array, array.astype(np.uint8))
        assert volume.value_range == (0.0, 1.0)


def test_a_volume_shows_itself_in_one_line_without_reading_samples(monkeypatch: pytest.MonkeyPatch) -> None:
    volume = Volume(np.zeros((8, 9, 10), dtype=np.int16), spacing=(0.5, 0.5, 1.25), name="head.nrrd")
    monkeypatch.setattr(Volume, "blocks", None)
    assert repr(volume) == "Volume('head.nrrd': 10 x 9 x 8 (x, y, z) int16, spacing (0.5, 0.5, 1.25))"

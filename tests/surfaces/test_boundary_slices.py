"""The faces of a volume: own dtype, exact at samples, bilinear between them."""

from __future__ import annotations

import numpy as np
import pytest
from mesh_checks import index_grid

from isosample.errors import InputError
from isosample.surfaces.boundary import BoundarySlices
from isosample.volume.grid import Volume
from isosample.volume.reconstruction import GridSpline, Reconstruction


def test_faces_are_the_outer_samples_in_their_own_dtype() -> None:
    array = np.random.default_rng(0).integers(0, 4000, (4, 5, 6)).astype(">u2")
    boundary = BoundarySlices.from_volume(Volume(array))
    expected = [array[:, :, 0], array[:, :, -1], array[:, 0], array[:, -1], array[0], array[-1]]
    for face, samples in zip(boundary.faces, expected, strict=True):
        assert face.dtype == array.dtype
        assert np.array_equal(face, samples)
        assert not np.shares_memory(face, array)


def test_values_follow_a_bilinear_field_exactly() -> None:
    x, y, z = index_grid((6, 5, 4))
    field = 1.0 + 2.0 * x - 3.0 * y + 0.5 * z + 0.25 * x * y - 0.125 * y * z + x * z
    boundary = BoundarySlices.from_volume(Volume(field))
    rng = np.random.default_rng(1)
    last = (5.0, 4.0, 3.0)
    for axis in range(3):
        others = [a for a in range(3) if a != axis]
        u, v = (rng.uniform(0, last[a], 50) for a in others)
        u[0], v[0] = last[others[0]], last[others[1]]
        for side in (0, 1):
            point = [u, v]
            point.insert(axis, np.full(50, side * last[axis]))
            px, py, pz = point
            exact = 1.0 + 2.0 * px - 3.0 * py + 0.5 * pz + 0.25 * px * py - 0.125 * py * pz + px * pz
            # 8 roundings on terms below 40: 8 · 2**-53 · 40 < 1e-13
            assert np.abs(boundary.value(axis, side, u, v) - exact).max() < 1e-13


@pytest.mark.parametrize("reconstruction", [member for member in Reconstruction if member.smooth])
def test_a_smooth_face_is_the_spline_there(reconstruction: Reconstruction) -> None:
    volume = Volume(np.random.default_rng(3).standard_normal((4, 5, 6)))
    spline = GridSpline.build(volume, reconstruction)
    boundary = BoundarySlices.from_volume(volume, spline)
    rng, last = np.random.default_rng(4), (5.0, 4.0, 3.0)
    for axis in range(3):
        others = [a for a in range(3) if a != axis]
        u, v = (rng.uniform(0, last[a], 50) for a in others)
        u[0], v[0], u[1], v[1] = last[others[0]], last[others[1]], 0.0, 0.0
        for side in (0, 1):
            point = [u, v]
            point.insert(axis, np.full(50, side * last[axis]))
            exact, _ = spline.evaluate(np.stack(point, axis=1))
            scale = np.abs(spline.coefficients).max()
            # 3 · 16 products and sums either way, weights add up to at most (4/3)³
            assert np.abs(boundary.value(axis, side, u, v) - exact).max() < 100 * 2.0**-53 * 2.4 * scale
            assert boundary.face(axis, side).dtype == np.float64
    with pytest.raises(InputError, match="range 0 to 5"):
        boundary.value(2, 0, np.array([5.1]), np.array([0.0]))


def test_coordinates_outside_a_face_are_refused() -> None:
    boundary = BoundarySlices.from_volume(Volume(np.zeros((3, 3, 3))))
    with pytest.raises(InputError, match="range 0 to 2"):
        boundary.value(0, 0, np.array([2.1]), np.array([0.0]))
    with pytest.raises(InputError, match=r"\(3, 0\)"):
        boundary.face(3, 0)


def test_faces_that_do_not_fit_together_are_refused() -> None:
    face = np.zeros((3, 3))
    with pytest.raises(InputError, match="six faces"):
        BoundarySlices(faces=(face,) * 5)
    with pytest.raises(InputError, match="are"):
        BoundarySlices(faces=(face,) * 5 + (np.zeros((3, 4)),))

"""The field on the GPU is that of the samples, in every reconstruction, up to the border, within its roundings."""

from __future__ import annotations

import shutil
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest
from shaders.twins import DIVISION, UNIT, assert_within, gamma, wrong_shader

from isosample.errors import CapacityError, InputError
from isosample.gl.context import is_software
from isosample.gl.shader_source import shader_root
from isosample.integral.trilinear import trilinear
from isosample.rendering.device_volume import DeviceVolume
from isosample.rendering.frame import uniform_dtype
from isosample.rendering.raycast_settings import Filtering
from isosample.rendering.scene import ValueScale
from isosample.surfaces.field_kernels import interpolated_gradient
from isosample.volume.grid import Volume
from isosample.volume.reconstruction import GridSpline, Reconstruction
from rendering.field_probe import probe

if TYPE_CHECKING:
    from pathlib import Path

    import moderngl
    import numpy.typing as npt

    from isosample.volume.grid import F64

    F32 = npt.NDArray[np.float32]

MASKED = 1e20  # MASKED_VALUE
SMOOTH = [kind for kind in Reconstruction if kind.smooth]
SHAPES = [(2, 2, 2), (5, 6, 7), (31, 40, 23)]
FLAT = [(1, 3, 2), (4, 1, 3), (3, 2, 1), (1, 1, 1)]  # no smooth field


def random_volume(shape: tuple[int, ...], seed: int = 1) -> Volume:
    return Volume(np.random.default_rng(seed).uniform(-20.0, 30.0, shape))


def places_in(shape: tuple[int, ...], count: int = 1500) -> F32:
    """Random index coordinates, some of them on samples and on the box's faces, of which all corners are there."""
    rng, last = np.random.default_rng(2), np.array(shape[::-1]) - 1.0
    places = rng.random((count, 3)) * last
    places[::3] = np.round(places[::3])
    places[1::7, 0], places[2::7, 1], places[3::7, 2] = last[0], 0.0, last[2]
    places[:8] = last * ((np.arange(8)[:, None] >> np.arange(3)) & 1)
    return np.minimum(places, last).astype(np.float32)


def scale_of(volume: Volume) -> ValueScale:
    return ValueScale(*volume.value_range)


def trilinear_twin(volume: Volume, places: F32) -> F64:
    """Normalised values in float64; a single sample along an axis is repeated."""
    samples = np.pad(scale_of(volume).normalise(volume.array), ((0, 1),) * 3, mode="edge")
    cell = np.clip(np.floor(places).astype(int), 0, np.maximum(np.array(volume.size_xyz) - 2, 0))
    corner = np.arange(8)
    x, y, z = (cell[:, axis, None] + ((corner >> axis) & 1) for axis in range(3))
    corners = samples[z, y, x]
    return trilinear(corners[:, :4], corners[:, 4:], places.astype(np.float64) - cell)


def trilinear_slopes(volume: Volume, places: F32) -> F64:
    """Normalised gradients of the surfaces' own kernel; samples outside the grid are NaN."""
    array = volume.array.astype(np.float64)
    samples = (np.where(np.isfinite(array), array, np.nan) - scale_of(volume).low) * scale_of(
        volume
    ).inverse_width
    padded = np.pad(samples, ((1, 2),) * 3, constant_values=np.nan)
    return np.array([interpolated_gradient(padded, *map(float, place)) for place in places])


def spline_twin(volume: Volume, places: F32, reconstruction: Reconstruction) -> tuple[F64, F64, float, float]:
    """Normalised values and gradients, and bounds of their roundings in float32.

    With R and R' the largest absolute sums of the polynomials of a weight and of its slope, S and S' those of the four
    weights and of the four slopes, and C the largest coefficient: a weight has 7 roundings (kernel, `tap_weights`),
    a slope 6. Along three axes 4 weights each are off, the others weigh S; the sums take 12 roundings (two dot
    products of two, three sums, one dot product of four), the coefficient one.
    """
    spline, scale = GridSpline.build(volume, reconstruction), scale_of(volume)
    values, gradients = spline.evaluate(places)
    kernel, powers = spline.kernel, np.arange(4)
    u = np.linspace(0.0, 1.0, 257)
    slopes = np.polynomial.polynomial.polyval(u, (kernel * powers)[:, 1:].T)
    r, r_slope = np.abs(kernel).sum(axis=1).max(), np.abs(kernel * powers).sum(axis=1).max()
    s, s_slope = spline.absolute_sum, np.abs(slopes).sum(axis=0).max()
    c = np.abs(scale.normalise(spline.coefficients)).max()
    value_bound = c * (12.0 * gamma(7) * r * s**2 + gamma(13) * s**3)
    slope_bound = c * (
        4.0 * gamma(6) * r_slope * s**2 + 8.0 * gamma(7) * r * s * s_slope + gamma(13) * s_slope * s**2
    )
    assert value_bound < 1e-4 * c
    assert slope_bound < 1e-3 * c
    normalised = (values - scale.low) * scale.inverse_width
    return normalised, gradients * scale.inverse_width, float(value_bound), float(slope_bound)


def assert_trilinear(gl: moderngl.Context, shape: tuple[int, ...], root: Path | None = None) -> None:
    volume, places = random_volume(shape), places_in(shape)
    values, gradients = probe(gl, volume, places, root=root)
    # A sample's rounding and nine of the interpolation; the fraction is exact. Values in [0, 1].
    assert_within(values, trilinear_twin(volume, places), gamma(10))
    # A slope: two samples, a difference, a division; then the interpolation of numbers of at most 1.
    assert_within(gradients, trilinear_slopes(volume, places), gamma(2 + DIVISION + 9) * 2.0)


def assert_smooth(
    gl: moderngl.Context, shape: tuple[int, ...], reconstruction: Reconstruction, root: Path | None = None
) -> None:
    volume, places = random_volume(shape), places_in(shape)
    values, gradients = probe(gl, volume, places, reconstruction, root=root)
    expected, slopes, value_bound, slope_bound = spline_twin(volume, places, reconstruction)
    assert_within(values, expected, value_bound)
    assert_within(gradients, slopes, slope_bound)


@pytest.mark.parametrize("shape", SHAPES + FLAT)
def test_the_trilinear_field_is_that_of_the_samples(gl: moderngl.Context, shape: tuple[int, ...]) -> None:
    assert_trilinear(gl, shape)


@pytest.mark.parametrize("reconstruction", SMOOTH)
@pytest.mark.parametrize("shape", SHAPES)
def test_smooth_fields_are_those_of_the_spline(
    gl: moderngl.Context, shape: tuple[int, ...], reconstruction: Reconstruction
) -> None:
    assert_smooth(gl, shape, reconstruction)


@pytest.mark.parametrize(
    ("right", "wrong"),
    [
        (".wzxy", ".xyzw"),
        ("equal(cell, ivec3(0))", "equal(cell, ivec3(1))"),
        ("left.x, here.x, left.z", "left.y, here.x, left.z"),
        ("front.xy, here.xy", "front.zw, here.xy"),
    ],
)
def test_a_wrong_trilinear_shader_is_found(
    gl: moderngl.Context, tmp_path: Path, right: str, wrong: str
) -> None:
    with pytest.raises(AssertionError):
        assert_trilinear(gl, (5, 6, 7), wrong_field(tmp_path, right, wrong))


@pytest.mark.parametrize(
    ("right", "wrong"),
    [
        ("weights_x.xy, weights_y.zw", "weights_x.xy, weights_y.xy"),
        ("cell + ivec3(0, 0, 3), weights_x, weights_y)", "cell + ivec3(0, 0, 2), weights_x, weights_y)"),
        ("dot(slopes_z,", "dot(weights_z,"),
    ],
)
def test_a_wrong_smooth_shader_is_found(gl: moderngl.Context, tmp_path: Path, right: str, wrong: str) -> None:
    with pytest.raises(AssertionError):
        assert_smooth(gl, (5, 6, 7), Reconstruction.CUBIC, wrong_field(tmp_path, right, wrong))


def wrong_field(folder: Path, right: str, wrong: str) -> Path:
    shutil.copytree(shader_root(), folder, dirs_exist_ok=True)
    return wrong_shader(folder, "pass/field.glsl", right, wrong)


@pytest.mark.parametrize("reconstruction", Reconstruction)
def test_the_texture_unit_filters_nearly_as_well_as_the_shader(
    gl: moderngl.Context, reconstruction: Reconstruction
) -> None:
    """On software renderers fractions are rounded as texture coordinates of N texels are: to some 2^-24 N.

    On GPUs fractions may have 8 bits: linear fetches are off by 1/512 of the difference of neighbours along every
    axis. Gradients are computed in the shader all the same.
    """
    shape = (31, 40, 23)
    volume, places = random_volume(shape), places_in(shape)
    values, gradients = probe(gl, volume, places, reconstruction)
    found, slopes = probe(gl, volume, places, reconstruction, Filtering.HARDWARE)
    if reconstruction.smooth:
        spline = GridSpline.build(volume, reconstruction)
        weight, bound = spline.absolute_sum**3, spline_twin(volume, places, reconstruction)[2]
        apart = np.ptp(scale_of(volume).normalise(spline.coefficients))
        # The place of a pair adds a weight (7 roundings of up to 5), a sum and a division, of a fraction that is a
        # quotient by at least the smallest sum of a pair.
        u = np.linspace(0.0, 1.0, 257)
        taps = np.polynomial.polynomial.polyval(u, spline.kernel.T)
        smallest = (
            (taps[1] + taps[2]).min()
            if weight > 1.0
            else min((taps[0] + taps[1]).min(), (taps[2] + taps[3]).min())
        )
        place = (2.0 * 7.0 * np.abs(spline.kernel).sum(axis=1).max() + 1.0 + DIVISION) / smallest
    else:
        weight, bound, apart, place = 1.0, gamma(10), np.float64(1.0), 0.0
    # A texture coordinate: half a texel more, a division by N, N times, half a texel less; of up to N + 2 texels.
    coordinate = (3 + DIVISION) * (max(shape) + 2.0)
    fraction = (coordinate + place) * UNIT if is_software(gl) else 1.0 / 512.0 + (coordinate + place) * UNIT
    limit = 2.0 * bound + 3.0 * weight * apart * fraction
    difference = np.abs(found.astype(np.float64) - values).max()
    assert 0.0 < difference <= limit
    assert limit < (2e-4 if is_software(gl) else 0.02) * weight * float(apart)
    assert np.array_equal(slopes, gradients)


def test_masked_samples_mask_their_cells_alone(gl: moderngl.Context) -> None:
    """Cells that touch a sample that is not finite are above every limit; the others are as if it were not there."""
    shape = (6, 7, 8)
    volume = random_volume(shape)
    damaged = volume.array.copy()
    damaged[3, 2, 4], damaged[0, 0, 0], damaged[5, 6, 7] = np.nan, np.inf, -np.inf
    places = places_in(shape)
    weights = np.zeros(len(places))
    for x, y, z in ((4, 2, 3), (0, 0, 0), (7, 6, 5)):
        weights += np.prod(np.maximum(1.0 - np.abs(places - np.array([x, y, z])), 0.0), axis=1)
    touching = weights > 0.0
    values, gradients = probe(gl, replace(volume, array=damaged), places, scale=scale_of(volume))
    assert touching.any()
    assert (values[touching] > MASKED).all()
    assert_within(values[~touching], trilinear_twin(volume, places)[~touching], gamma(10))
    expected = trilinear_slopes(replace(volume, array=damaged), places[~touching])
    assert_within(gradients[~touching], expected, gamma(2 + DIVISION + 9) * 2.0)


def test_integers_and_large_offsets_keep_their_accuracy(gl: moderngl.Context) -> None:
    """A thousandth on top of a million: normalised in float64, float32 holds the rest to its last bit."""
    samples = np.random.default_rng(4).random((5, 6, 7))
    places = places_in((5, 6, 7))
    volume = Volume(1e6 + 1e-3 * samples)
    assert_within(probe(gl, volume, places)[0], trilinear_twin(volume, places), gamma(10))
    whole = Volume(np.round(samples * 65535).astype(np.uint16))
    assert_within(probe(gl, whole, places)[0], trilinear_twin(whole, places), gamma(10))


def test_large_volumes_are_uploaded_in_parts(gl: moderngl.Context, monkeypatch: pytest.MonkeyPatch) -> None:
    volume, places = random_volume((5, 6, 7)), places_in((5, 6, 7))
    whole = probe(gl, volume, places)
    monkeypatch.setattr("isosample.rendering.device_volume.UPLOAD_SAMPLES", 90)  # two layers
    for filtering in Filtering:
        parts = probe(gl, volume, places, filtering=filtering)
        assert np.abs(parts[0] - whole[0]).max() < 1e-5
        assert np.array_equal(parts[1], whole[1])


def test_the_blocks_say_what_the_shader_needs(gl: moderngl.Context) -> None:
    volume = random_volume((3, 4, 5))
    for reconstruction in Reconstruction:
        for filtering in Filtering:
            device = DeviceVolume(gl, volume, scale_of(volume), reconstruction, filtering)
            block = np.zeros(1, dtype=uniform_dtype("Raycast"))
            device.fill(block[0])
            smooth = int(reconstruction.smooth)
            assert block["samples"][0].tolist() == [5, 4, 3]
            partition = block["kernel"][0].astype(np.float64).sum(axis=0)
            assert (
                np.abs(partition - [smooth, 0, 0, 0]).max() <= 4 * 4 * UNIT
            )  # four numbers below 4, rounded
            shader = filtering is Filtering.SHADER
            negative = smooth and GridSpline.build(volume, reconstruction).absolute_sum > 1.0
            assert device.constants() == {
                "RECONSTRUCTION": smooth,
                "FILTERING": 0 if shader else 2 if negative else 1,
            }
            device.release()


@pytest.mark.parametrize("filtering", Filtering)
def test_volumes_beyond_the_driver_are_refused(gl: moderngl.Context, filtering: Filtering) -> None:
    limit = "GL_MAX_ARRAY_TEXTURE_LAYERS" if filtering is Filtering.SHADER else "GL_MAX_3D_TEXTURE_SIZE"
    volume = Volume(np.zeros((gl.info[limit] + 1, 1, 1), dtype=np.uint8))
    with pytest.raises(CapacityError, match=rf"1 x 1 x {gl.info[limit] + 1} samples .* Crop or downsample"):
        DeviceVolume(gl, volume, ValueScale(0.0, 1.0), Reconstruction.TRILINEAR, filtering)


def test_a_smooth_field_of_samples_that_are_not_finite_is_refused(gl: moderngl.Context) -> None:
    with pytest.raises(InputError, match="4 NaN"):
        DeviceVolume(
            gl, Volume(np.full((2, 2, 2), [1.0, np.nan])), ValueScale(0.0, 1.0), Reconstruction.CUBIC
        )

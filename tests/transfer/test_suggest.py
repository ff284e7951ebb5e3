"""The suggested transfer function: deterministic, inside the range, blind to the surroundings, never opaque fog."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

import isosample
from isosample.errors import InputError
from isosample.transfer.transfer_function import TransferFunction
from isosample.volume.grid import Volume

if TYPE_CHECKING:
    from pathlib import Path

SCANS = [
    ("nucleon.nhdr", {}),
    ("engine.tif", {}),
    ("vessels_mra.nii.gz", {}),
    ("fetal_t2.nrrd", {}),
    ("HeadMRVolume.mhd", {}),
    ("brain_thick_slices.nrrd", {}),
    ("hydrogen.vti", {}),
    ("aneurism.raw.gz", {"shape": (256, 256, 256), "dtype": "uint8"}),
]


def two_materials() -> Volume:
    """Air around a ball of tissue with a dense core, with a little noise."""
    z, y, x = np.mgrid[-1:1:40j, -1:1:40j, -1:1:40j]
    radius = np.sqrt(x * x + y * y + z * z)
    samples = np.where(radius < 0.3, 900.0, np.where(radius < 0.7, 300.0, 0.0))
    return Volume(samples + np.random.default_rng(8).normal(0.0, 5.0, samples.shape))


def test_the_same_volume_gets_the_same_suggestion() -> None:
    assert TransferFunction.suggest(two_materials()) == TransferFunction.suggest(two_materials())


def test_the_surroundings_are_invisible_and_the_materials_are_not() -> None:
    tf = TransferFunction.suggest(two_materials())
    low, high = two_materials().value_range
    assert float(tf.evaluate(0.0)[1]) == 0.0
    values = np.linspace(30.0, high, 2000)
    assert np.any(tf.evaluate(values)[1] > 0)
    assert min(point.value for point in tf.points) >= low
    assert max(point.value for point in tf.points) <= high


def test_the_suggestion_does_not_depend_on_units_of_length_or_value() -> None:
    volume = two_materials()
    scaled = Volume(volume.array.astype(np.float64) * 10.0 + 50.0, spacing=(3.0, 3.0, 3.0))
    first, second = TransferFunction.suggest(volume), TransferFunction.suggest(scaled)
    for one, other in zip(first.points, second.points, strict=True):
        assert other.value == pytest.approx(one.value * 10.0 + 50.0, rel=1e-9)
        assert other.extinction == pytest.approx(one.extinction / 3.0, rel=1e-9)


def test_a_constant_volume_has_no_suggestion() -> None:
    with pytest.raises(InputError, match="constant"):
        TransferFunction.suggest(Volume(np.full((4, 4, 4), 3.0)))


def test_a_volume_that_is_constant_but_for_rounding_has_no_suggestion() -> None:
    samples = np.full((4, 4, 4), 3.0)
    samples[1, 2, 3] = np.nextafter(3.0, 4.0)
    with pytest.raises(InputError, match="3 but for rounding"):
        TransferFunction.suggest(Volume(samples))


@pytest.mark.parametrize("label_count", [2, 3, 6, 9, 15, 16, 40])
def test_masks_and_labels_show_their_borders_but_not_their_surroundings(label_count: int) -> None:
    # shells of one label each around the highest; most samples are surroundings of label 0
    x = np.abs(np.mgrid[-1:1:41j, -1:1:41j, -1:1:41j]).max(axis=0)
    labels = np.clip(np.floor((1 - x) * 2 * label_count) - 1, 0, label_count - 1).astype(np.uint8)
    tf = TransferFunction.suggest(Volume(labels))
    assert float(tf.evaluate(0.0)[1]) == 0.0
    assert float(tf.evaluate(label_count - 1.0)[1]) > 0.0
    _, between = tf.evaluate(np.linspace(0.0, label_count - 1.0, 200))
    assert np.count_nonzero(np.diff((between > 0).astype(int)) == 1) == 3  # separate layers


def test_a_label_next_to_the_surroundings_is_visible_where_labels_are_skipped() -> None:
    labels = np.zeros((8, 8, 8), dtype=np.uint8)
    labels[2:6, 2:6, 2:6] = 1
    labels[3:5, 3:5, 3:5] = 3
    extinction_outside, extinction_inside = (
        TransferFunction.suggest(Volume(labels)).evaluate(values)[1]
        for values in (np.linspace(0.0, 1.0, 100), np.linspace(1.0, 3.0, 100))
    )
    assert np.any(extinction_outside > 0)
    assert np.any(extinction_inside > 0)


def test_samples_in_16_bits_get_the_layers_of_the_same_samples_in_8() -> None:
    coarse = np.clip(two_materials().array.astype(np.float64) / 5.0, 0, 255).astype(np.uint8)
    # 20 values for each: a finer histogram (4000 bins at most) of the same shape
    fine = coarse.astype(np.uint16) * 20 + np.random.default_rng(9).integers(0, 20, coarse.shape, np.uint16)
    values_8, values_16 = (
        np.array([point.value for point in TransferFunction.suggest(Volume(samples)).points])
        for samples in (coarse, fine)
    )
    bin_width = 20.0 * float(coarse.max()) / 256
    assert np.abs(values_16 - (20.0 * values_8 + 9.5)).max() < 2 * bin_width


@pytest.mark.gl
@pytest.mark.volumes
@pytest.mark.parametrize(("name", "reading"), SCANS, ids=[name for name, _ in SCANS])
def test_a_scan_shows_structure_neither_nothing_nor_a_box(
    real_volumes: Path, name: str, reading: dict[str, object]
) -> None:
    volume = isosample.open_volume(real_volumes / name, **reading)  # type: ignore[arg-type]
    camera = isosample.Camera.orbit(volume.box, azimuth=30, elevation=20)
    image = isosample.render(volume, camera=camera, size=(64, 64), per_slope=2)
    alpha = image.rgba[..., 3]
    assert 0.01 < (alpha > 0.05).mean() < 0.75
    shown = image.rgba[alpha > 0.05]
    assert (shown[:, :3] / shown[:, 3:]).std(axis=0).max() > 0.02  # more than one colour


@pytest.mark.parametrize("dtype", [np.uint8, np.int16, np.float32])
@pytest.mark.parametrize("label_count", [2, 3, 9])
def test_masks_and_labels_get_a_suggestion_too(dtype: type[np.generic], label_count: int) -> None:
    z, y, x = np.mgrid[-1:1:20j, -1:1:20j, -1:1:20j]
    labels = np.floor(label_count * np.exp(-3 * (x * x + y * y + z * z)) * 0.999).astype(dtype)
    tf = TransferFunction.suggest(Volume(labels))
    assert float(tf.evaluate(0.0)[1]) == 0.0
    assert any(point.extinction > 0 for point in tf.points)

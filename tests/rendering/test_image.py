"""Pictures and their files: encodings, whole files only, every bad path refused."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import PIL.Image
import pytest

from isosample.errors import InputError
from isosample.rendering import image
from isosample.rendering.image import Image, srgb_from_linear

if TYPE_CHECKING:
    from pathlib import Path


def picture() -> Image:
    rng = np.random.default_rng(2)
    alpha = rng.random((5, 7, 1), dtype=np.float32)
    return Image(np.concatenate([rng.random((5, 7, 3), dtype=np.float32) * alpha, alpha], axis=-1))


def test_srgb_encodes_the_standards_fixed_points() -> None:
    # IEC 61966-2-1: the linear piece ends at 0.0031308; 0.5 encodes to 0.735357.
    linear = np.array([0.0, 0.0031308, 0.5, 1.0])
    assert np.allclose(srgb_from_linear(linear), [0.0, 12.92 * 0.0031308, 0.7353569830524495, 1.0], atol=1e-7)
    steps = srgb_from_linear(np.linspace(0.0, 1.0, 10_001))
    assert np.all(np.diff(steps) > 0)


def test_npy_is_the_array_bit_by_bit(tmp_path: Path) -> None:
    image = picture()
    image.save(tmp_path / "p.npy")
    found = np.load(tmp_path / "p.npy")
    assert found.dtype == np.float32
    assert np.array_equal(found, image.rgba)


def test_png_holds_straight_srgb_with_linear_alpha(tmp_path: Path) -> None:
    rgba = np.zeros((1, 4, 4), dtype=np.float32)
    rgba[0, 1] = [0.5, 0.0, 0.25, 1.0]
    rgba[0, 2] = [0.25, 0.0, 0.0, 0.5]  # straight 0.5
    rgba[0, 3] = [2.0, 0.0, 0.0, 1.0]  # a highlight saturates
    path = Image(rgba).save(tmp_path / "p.PNG")
    found = np.asarray(PIL.Image.open(path))
    assert found.shape == (1, 4, 4)
    half, quarter = (round(255 * float(srgb_from_linear(np.array(v)))) for v in (0.5, 0.25))
    assert found[0].tolist() == [[0, 0, 0, 0], [half, 0, quarter, 255], [half, 0, 0, 128], [255, 0, 0, 255]]


@pytest.mark.parametrize("name", ["p.jpg", "p", "p.npz"])
def test_an_unknown_suffix_is_refused(tmp_path: Path, name: str) -> None:
    with pytest.raises(InputError, match="unknown image suffix"):
        picture().save(tmp_path / name)
    assert list(tmp_path.iterdir()) == []


def test_a_folder_that_is_not_there_is_an_error_and_leaves_nothing(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"absent.* cannot be written"):
        picture().save(tmp_path / "absent" / "p.png")
    assert list(tmp_path.iterdir()) == []


def test_a_failed_write_leaves_the_old_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "p.npy"
    picture().save(path)
    before = path.read_bytes()

    def full_disk(*_: object, **__: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(image, "write_array", full_disk)
    with pytest.raises(InputError, match="No space left"):
        picture().save(path)
    assert path.read_bytes() == before
    assert [p.name for p in tmp_path.iterdir()] == ["p.npy"]


def test_a_picture_shows_itself_in_one_line_and_as_a_png_in_notebooks(tmp_path: Path) -> None:
    assert repr(picture()) == "Image(7 x 5)"
    made = Image(
        picture().rgba, {"method": "data-centric", "seconds": {"plan": 0.25, "render": 1.0}, "x": [1] * 99}
    )
    assert repr(made) == "Image(7 x 5, data-centric, 1.25 s)"
    made.save(tmp_path / "p.png")
    assert made._repr_png_() == (tmp_path / "p.png").read_bytes()

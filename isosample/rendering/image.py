"""A rendered picture: premultiplied linear RGBA, its statistics, and files of it."""

from __future__ import annotations

import io
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, Any

import numpy as np
import numpy.typing as npt

from isosample.defaults import IMAGE_SUFFIXES
from isosample.errors import InputError
from isosample.files import replacing, write_array


@dataclass(frozen=True, slots=True, eq=False)
class Image:
    """A picture and how it came about.

    Attributes
    ----------
    rgba : (H, W, 4) float32
        Premultiplied linear RGBA, row 0 on top.
    stats : dict
        What was extracted, drawn and skipped, and seconds by stage; JSON-ready.
    """

    rgba: npt.NDArray[np.float32]
    stats: dict[str, Any] = field(default_factory=dict)

    def __repr__(self) -> str:
        """One line: size, method and seconds, as far as they are known."""
        height, width = self.rgba.shape[:2]
        known = [f"{width} x {height}", *([self.stats["method"]] if "method" in self.stats else [])]
        if "seconds" in self.stats:
            known.append(f"{sum(self.stats['seconds'].values()):.3g} s")
        return f"Image({', '.join(known)})"

    def _repr_png_(self) -> bytes:
        """Return the picture as a PNG file, which notebooks show."""
        file = io.BytesIO()
        self.write(file, ".png")
        return file.getvalue()

    def srgb8(self) -> npt.NDArray[np.uint8]:
        """(H, W, 4) uint8: straight sRGB with linear alpha, as PNG stores it; colours above 1 saturate."""
        alpha = np.clip(self.rgba[..., 3:], 0.0, 1.0)
        straight = np.divide(
            self.rgba[..., :3], alpha, out=np.zeros_like(self.rgba[..., :3]), where=alpha > 0
        )
        encoded = srgb_from_linear(np.clip(straight, 0.0, 1.0))
        eight_bit: npt.NDArray[np.uint8] = np.rint(255.0 * np.concatenate([encoded, alpha], axis=-1)).astype(
            np.uint8
        )
        return eight_bit

    def save(self, path: str | Path) -> Path:
        """Write the picture; the file appears whole or not at all.

        Parameters
        ----------
        path : str or Path
            ``.png`` (8-bit sRGB, straight alpha) or ``.npy`` (the float32 array as it is).

        Raises
        ------
        InputError
            If the suffix is another, or the file cannot be written.
        """
        path = Path(path)
        check_image_path(path)
        with replacing(path) as file:
            self.write(file, path.suffix)
        return path

    def write(self, file: IO[bytes], suffix: str) -> None:
        """Write the picture into an open file, in the format of a suffix that `save` knows."""
        if suffix.lower() == ".npy":
            write_array(file, self.rgba)
        else:
            import PIL.Image

            PIL.Image.fromarray(self.srgb8()).save(file, format="PNG")


def srgb_from_linear(linear: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Encode linear light in [0, 1] as sRGB (IEC 61966-2-1)."""
    curve = 1.055 * np.power(np.maximum(linear, 0.0031308), 1.0 / 2.4) - 0.055
    encoded: npt.NDArray[Any] = np.where(linear <= 0.0031308, 12.92 * linear, curve)
    return encoded


def check_image_path(path: Path) -> None:
    """Raise `InputError` unless `path` has a known suffix, so that a long run does not end in one."""
    if path.suffix.lower() not in IMAGE_SUFFIXES:
        raise InputError(
            f"cannot write {path}: unknown image suffix {path.suffix!r}; use {' or '.join(IMAGE_SUFFIXES)}."
        )

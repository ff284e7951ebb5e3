"""Differences between pictures in false colours, on scales that all pictures of a comparison share."""

from __future__ import annotations

import io
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from isosample.rendering.image import Image

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from isosample.volume.grid import F64

U8 = npt.NDArray[np.uint8]

# sRGB anchors at equal distances, dark to bright in even steps of lightness ("inferno" of S. van der Walt, N. Smith)
ERROR_COLORS = (
    "#000004",
    "#1b0c41",
    "#4a0c6b",
    "#781c6d",
    "#a52c60",
    "#cf4446",
    "#ed6925",
    "#fb9b06",
    "#f7d13d",
)
# blue below, red above, light in the middle (C. Brewer's RdBu)
DIFFERENCE_COLORS = ("#2166ac", "#67a9cf", "#d1e5f0", "#f7f7f7", "#fddbc7", "#ef8a62", "#b2182b")
DECADES = 4  # of the scale
LEAST_TOP = 1e-6  # float32 pictures tell no more
LUMINANCE = (0.2126, 0.7152, 0.0722)  # of linear sRGB primaries, ITU-R BT.709


@dataclass(frozen=True, slots=True)
class Scale:
    """A logarithmic scale from `low` to `high` [RGBA], both powers of ten."""

    low: float
    high: float

    @classmethod
    def up_to(cls, errors: Iterable[float]) -> Scale:
        """The scale whose top is the power of ten above the largest of some errors."""
        top = max([LEAST_TOP, *errors])
        exponent = math.ceil(math.log10(top) - 1e-9)
        return cls(10.0 ** (exponent - DECADES), 10.0**exponent)

    @property
    def ticks(self) -> list[float]:
        """The powers of ten, from low to high."""
        exponent = round(math.log10(self.high))
        return [10.0**power for power in range(exponent - DECADES, exponent + 1)]

    def share(self, errors: F64) -> F64:
        """Place of errors >= 0 on the scale, 0 to 1; what lies beyond is shown at its end."""
        held = np.clip(errors, self.low, self.high)
        shares: F64 = np.log10(held / self.low) / DECADES
        return shares


def error_png(image: npt.ArrayLike, truth: npt.ArrayLike, scale: Scale) -> bytes:
    """PNG of the largest difference of a component, dark where there is none.

    Parameters
    ----------
    image, truth : (H, W, 4) array_like of float
        Premultiplied linear RGBA.
    scale : Scale
    """
    errors = np.abs(np.subtract(image, truth, dtype=np.float64)).max(axis=-1)
    return _palette_png(scale.share(errors), ERROR_COLORS)


def difference_png(image: npt.ArrayLike, truth: npt.ArrayLike, scale: Scale) -> bytes:
    """PNG of the difference of luminance: blue where the picture is darker than the truth, red where brighter.

    Parameters
    ----------
    image, truth : (H, W, 4) array_like of float
        Premultiplied linear RGBA.
    scale : Scale
        Of the amount, on either side.
    """
    difference = np.subtract(image, truth, dtype=np.float64)[..., :3] @ np.array(LUMINANCE)
    return _palette_png(0.5 + 0.5 * np.sign(difference) * scale.share(np.abs(difference)), DIFFERENCE_COLORS)


def shown(rgba: npt.NDArray[np.float32], backdrop: Sequence[float]) -> U8:
    """(H, W, 3) uint8 sRGB of a picture over an opaque linear colour."""
    light = rgba[..., :3] + (1.0 - rgba[..., 3:]) * np.asarray(backdrop)
    opaque = np.concatenate([light, np.ones_like(rgba[..., 3:])], axis=-1)
    return Image(opaque.astype(np.float32)).srgb8()[..., :3]


def gradient_css(colors: Sequence[str]) -> str:
    """A CSS gradient along a colour bar."""
    return f"linear-gradient(to right, {', '.join(colors)})"


def _palette_png(shares: F64, anchors: Sequence[str]) -> bytes:
    """Eight-bit PNG with a palette."""
    import PIL.Image

    picture = PIL.Image.fromarray(np.rint(255.0 * shares).astype(np.uint8), mode=None)
    picture.putpalette(_palette(anchors).tobytes())
    file = io.BytesIO()
    picture.save(file, format="PNG", optimize=True)
    return file.getvalue()


def _palette(anchors: Sequence[str]) -> U8:
    """(256, 3), straight lines between the anchors."""
    corners = np.array([[int(color[place : place + 2], 16) for place in (1, 3, 5)] for color in anchors])
    places = np.linspace(0.0, 1.0, len(anchors))
    channels = [np.interp(np.linspace(0.0, 1.0, 256), places, corners[:, channel]) for channel in range(3)]
    palette: U8 = np.rint(np.stack(channels, axis=1)).astype(np.uint8)
    return palette

"""A picture and the truth, checked to be comparable, and which of their pixels count."""

from __future__ import annotations

from enum import Enum
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from isosample.errors import InputError

if TYPE_CHECKING:
    from isosample.volume.grid import F64

    Mask = npt.NDArray[np.bool_]

LARGEST_COMPONENT = float(np.finfo(np.float32).max)  # pictures are float32; differences then never overflow


class Pixels(Enum):
    """Which pixels a measure counts.

    Attributes
    ----------
    ALL
        Every pixel.
    VISIBLE
        Those whose alpha is above 0 in the picture, in the truth, or in both: an empty surround does not
        dilute the error, and a surface that only one of the two shows is not overlooked.
    """

    ALL = "all"
    VISIBLE = "visible"


def image_pair(image: npt.ArrayLike, truth: npt.ArrayLike) -> tuple[F64, F64]:
    """The two pictures in float64, known to be comparable.

    Parameters
    ----------
    image, truth : (H, W, 4) array_like of float
        Premultiplied linear RGBA, row 0 on top; H, W >= 1.

    Returns
    -------
    image, truth : (H, W, 4) float64
        The same values.

    Raises
    ------
    InputError
        If a picture is not of that shape or not floating-point, if the shapes differ (names both), or if a
        component is not finite or beyond float32 (names its row, column and channel).
    """
    pair = _picture(image, "image"), _picture(truth, "truth")
    if pair[0].shape != pair[1].shape:
        raise InputError(
            f"the image has shape {pair[0].shape} and the truth {pair[1].shape}; expected equal shapes. "
            "Render both at one size."
        )
    return pair


def counted_pixels(image: F64, truth: F64, pixels: Pixels) -> Mask:
    """Which pixels count.

    Parameters
    ----------
    image, truth : (H, W, 4) float64
        Pictures from `image_pair`.
    pixels : Pixels
        The choice.

    Returns
    -------
    counted : (H, W) bool
        True where a pixel counts; at least one does.

    Raises
    ------
    InputError
        If none counts.
    """
    if pixels is Pixels.ALL:
        return np.ones(image.shape[:2], dtype=np.bool_)
    counted: Mask = (image[..., 3] > 0) | (truth[..., 3] > 0)
    if not counted.any():
        raise InputError(
            f"none of {counted.size} pixels has an alpha above 0 in either picture; expected at least one. "
            "Count all pixels, or render what the transfer function shows."
        )
    return counted


def _picture(values: npt.ArrayLike, name: str) -> F64:
    array: npt.NDArray[Any] = np.asarray(values)
    if array.ndim != 3 or array.shape[2] != 4 or array.size == 0:
        raise InputError(
            f"the {name} has shape {array.shape}; expected (H, W, 4). Pass premultiplied linear RGBA."
        )
    if not np.issubdtype(array.dtype, np.floating):
        raise InputError(
            f"the {name} is {array.dtype}; expected floating-point. "
            "Compare .npy pictures, which are linear, not 8-bit ones."
        )
    picture: F64 = array.astype(np.float64)
    beyond = ~(np.abs(picture) <= LARGEST_COMPONENT)
    if beyond.any():
        row, column, channel = (int(i) for i in np.argwhere(beyond)[0])
        raise InputError(
            f"the {name} is {picture[row, column, channel]} at row {row}, column {column}, "
            f"channel {channel}; expected a finite float32. "
            "Find what rendered it: no score is given for such a picture."
        )
    return picture

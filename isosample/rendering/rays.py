"""The rays of a picture, as the shaders see them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

F64 = npt.NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True)
class Rays:
    """The camera as the shaders see it, for an image of a given aspect.

    A pixel at image-plane position (x, y) in [-1, 1]² has, with o = x·span_right + y·span_up, the ray
    eye + o + t·forward (orthographic) or eye + t·normalize(forward + o) (perspective).

    Attributes
    ----------
    eye, forward, span_right, span_up : (3,) float64
        World space; `forward` is a unit vector, the spans are half the image's width and height: in world
        units (orthographic), or at distance 1 in front of the eye (perspective).
    perspective : bool
    """

    eye: F64
    forward: F64
    span_right: F64
    span_up: F64
    perspective: bool

    def origins_and_directions(self, width: int, height: int) -> tuple[F64, F64]:
        """Origin and unit direction of the ray through every pixel centre.

        Returns
        -------
        origins, directions : (height, width, 3) float64
            Row 0 is the top of the picture.
        """
        x = 2.0 * (np.arange(width) + 0.5) / width - 1.0
        y = 1.0 - 2.0 * (np.arange(height) + 0.5) / height
        offset = x[None, :, None] * self.span_right + y[:, None, None] * self.span_up
        if self.perspective:
            directions = self.forward + offset
            directions /= np.linalg.norm(directions, axis=-1, keepdims=True)
            return np.broadcast_to(self.eye, offset.shape).copy(), directions
        return self.eye + offset, np.broadcast_to(self.forward, offset.shape).copy()

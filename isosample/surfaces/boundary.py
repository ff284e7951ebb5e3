"""The field on the six faces of a volume: what a ray needs where it enters and leaves the box."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from isosample.errors import InputError
from isosample.surfaces.mask_faces import MaskFaces
from isosample.volume.lazy import lazily
from isosample.volume.spline_weights import spline_weights

if TYPE_CHECKING:
    from isosample.volume.grid import F64, SampleArray, Volume
    from isosample.volume.reconstruction import GridSpline


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class BoundarySlices:
    """The six faces of a volume's samples, in the volume's own dtype, or of its smooth reconstruction.

    Attributes
    ----------
    faces : 6 arrays
        In the order x = 0, x = last, both (Z, Y); y = 0, y = last, both (Z, X); z = 0, z = last, both (Y, X).
        With a kernel: `GridSpline.face_coefficients`, float64, one more on each side of a face.
    mask_faces : MaskFaces or None
        Border of the valid cells where samples are not finite; None where all are.
    kernel : (4, 4) float64 or None
        Kernel of the spline as in `GridSpline`; None: bilinear interpolation of samples.

    Raises
    ------
    InputError
        If there are not six two-dimensional faces of matching shapes and one dtype.
    """

    faces: tuple[SampleArray, ...]
    mask_faces: MaskFaces | None = None
    kernel: F64 | None = None

    def __post_init__(self) -> None:
        if len(self.faces) != 6 or len({face.dtype for face in self.faces}) != 1:
            raise InputError(f"a volume has six faces of one dtype, got {len(self.faces)} arrays.")
        (z, y), x = self.faces[0].shape, self.faces[2].shape[-1]
        expected = [(z, y)] * 2 + [(z, x)] * 2 + [(y, x)] * 2
        shapes = [face.shape for face in self.faces]
        if shapes != expected:
            raise InputError(f"the faces of a volume of {z, y, x} samples are {expected}, got {shapes}.")

    @classmethod
    def from_volume(cls, volume: Volume, spline: GridSpline | None = None) -> BoundarySlices:
        """Copy the six faces out of a volume, which may be memory-mapped, or out of its reconstruction."""
        if spline is not None:
            sides = [(axis, side) for axis in range(3) for side in (0, 1)]
            return cls(faces=tuple(spline.face_coefficients(*place) for place in sides), kernel=spline.kernel)
        a = lazily(volume.array)
        views = (a[:, :, 0], a[:, :, -1], a[:, 0, :], a[:, -1, :], a[0], a[-1])
        faces = tuple(np.array(view, order="C") for view in views)
        return cls(faces=faces, mask_faces=MaskFaces.from_volume(volume))

    def face(self, axis: int, side: int) -> SampleArray:
        """Return the face across `axis` (0 = x, 1 = y, 2 = z) at its first (0) or last (1) sample."""
        if axis not in (0, 1, 2) or side not in (0, 1):
            raise InputError(f"face ({axis}, {side}) does not exist; axis is 0, 1 or 2, side is 0 or 1.")
        return self.faces[2 * axis + side]

    def value(self, axis: int, side: int, u: F64, v: F64) -> F64:
        """Bilinear interpolant on a face, or the bicubic spline there.

        Parameters
        ----------
        axis, side : int
            As for `face`.
        u, v : (...) float64
            Index coordinates along the two other axes, the lower axis first (y, z on an x face; x, z on a y
            face; x, y on a z face), from 0 to the last sample.

        Returns
        -------
        value : (...) float64
            In data units; NaN where a sample that counts is not finite.

        Raises
        ------
        InputError
            If a coordinate lies outside the face.
        """
        face = self.face(axis, side)
        u, v = np.asarray(u, dtype=np.float64), np.asarray(v, dtype=np.float64)
        if self.kernel is not None:
            return _bicubic(face, self.kernel, u, v)
        column, right = _split(u, face.shape[1])
        row, up = _split(v, face.shape[0])
        next_column = np.minimum(column + 1, face.shape[1] - 1)
        next_row = np.minimum(row + 1, face.shape[0] - 1)
        samples = face.astype(np.float64)
        lower = samples[row, column] * (1.0 - right) + samples[row, next_column] * right
        upper = samples[next_row, column] * (1.0 - right) + samples[next_row, next_column] * right
        value: F64 = lower * (1.0 - up) + upper * up
        return value


def _bicubic(face: SampleArray, kernel: F64, u: F64, v: F64) -> F64:
    """Spline with one coefficient more on each side than there are samples."""
    coefficients = face.astype(np.float64)
    column, right = _split(u, coefficients.shape[1] - 2)
    row, up = _split(v, coefficients.shape[0] - 2)
    along, across = spline_weights(kernel, right), spline_weights(kernel, up)
    value: F64 = np.zeros(np.broadcast(u, v).shape)
    for b in range(4):
        line = sum(along[a] * coefficients[row + b, column + a] for a in range(4))
        value = value + across[b] * line
    return value


def _split(coordinate: F64, count: int) -> tuple[np.ndarray[tuple[int, ...], np.dtype[np.intp]], F64]:
    """Return the lower sample of each coordinate and the fraction of the way to the next one."""
    if not np.all((coordinate >= 0) & (coordinate <= count - 1)):
        raise InputError(f"face coordinates {coordinate!r} leave the range 0 to {count - 1} of the samples.")
    lower = np.minimum(np.floor(coordinate).astype(np.intp), max(count - 2, 0))
    return lower, coordinate - lower

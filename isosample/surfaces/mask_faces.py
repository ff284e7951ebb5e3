"""The border of the valid cells of a volume with non-finite samples: where rays enter and leave the field."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from isosample.errors import InputError

if TYPE_CHECKING:
    from isosample.volume.grid import SampleArray, Volume

I32 = npt.NDArray[np.int32]
I8 = npt.NDArray[np.int8]
Bool = npt.NDArray[np.bool_]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MaskFaces:
    """Cell faces that separate a valid cell (eight finite corners) from a masked one or from the outside.

    Attributes
    ----------
    starts : (F, 3) int32
        Sample (x, y, z) at the lowest corner of the face.
    axes : (F,) int8
        Axis across which the face lies: 0 = x, 1 = y, 2 = z.
    outward : (F,) int8
        +1 if the valid cell is on the lower side of the face, −1 if it is on the upper side.
    values : (F, 4) in the volume's dtype
        Samples at the corners, the lower of the face's two axes fastest; all finite.

    Raises
    ------
    InputError
        If the shapes do not belong together.
    """

    starts: I32
    axes: I8
    outward: I8
    values: SampleArray

    def __post_init__(self) -> None:
        count = len(self.starts)
        shapes = (self.starts.shape, self.axes.shape, self.outward.shape, self.values.shape)
        if shapes != ((count, 3), (count,), (count,), (count, 4)):
            raise InputError(f"mask faces of shapes {shapes} do not belong together.")

    @classmethod
    def from_volume(cls, volume: Volume) -> MaskFaces | None:
        """Border of the valid cells, or None where every sample is finite: then the box is the border."""
        if sum(volume.nonfinite_counts) == 0:
            return None
        valid = valid_cells(volume.array)
        parts = [_faces_across(axis, valid, volume.array) for axis in range(3)]
        starts, outward, values = (np.concatenate(column) for column in zip(*parts, strict=True))
        axes = np.repeat(np.arange(3, dtype=np.int8), [len(part[0]) for part in parts])
        return cls(starts=starts, axes=axes, outward=outward, values=values)


def valid_cells(samples: SampleArray) -> Bool:
    """(Z − 1, Y − 1, X − 1) bool, True for cells whose eight corners are finite."""
    finite = np.isfinite(samples)
    for axis in range(3):
        low = [slice(None)] * 3
        high = [slice(None)] * 3
        low[axis], high[axis] = slice(None, -1), slice(1, None)
        finite = finite[tuple(low)] & finite[tuple(high)]
    valid: Bool = finite
    return valid


def _faces_across(axis: int, valid: Bool, samples: SampleArray) -> tuple[I32, I8, SampleArray]:
    """Starts, outward signs and corner samples of the faces across one axis."""
    array_axis = 2 - axis
    border = [(1, 1) if a == array_axis else (0, 0) for a in range(3)]
    padded = np.moveaxis(np.pad(valid, border), array_axis, 0)
    places = np.argwhere(np.moveaxis(padded[1:] != padded[:-1], 0, array_axis))  # (F, 3) z, y, x
    lower_valid = np.moveaxis(padded[:-1], 0, array_axis)[tuple(places.T)]
    u_axis, v_axis = (2 - a for a in range(3) if a != axis)
    corners = []
    for v_step in (0, 1):
        for u_step in (0, 1):
            corner = places.copy()
            corner[:, u_axis] += u_step
            corner[:, v_axis] += v_step
            corners.append(samples[tuple(corner.T)])
    outward = np.where(lower_valid, 1, -1).astype(np.int8)
    return places[:, ::-1].astype(np.int32), outward, np.stack(corners, axis=1)

"""The border of the valid cells of a volume with non-finite samples: where rays enter and leave the field."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from isosample.errors import InputError
from isosample.volume.lazy import chunks_of, lazily

if TYPE_CHECKING:
    from isosample.volume.grid import SampleArray, Volume

I32 = npt.NDArray[np.int32]
I8 = npt.NDArray[np.int8]
Bool = npt.NDArray[np.bool_]

SLAB_BYTES = 16 << 20  # samples that are looked at together


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
        array = lazily(volume.array)
        cells = array.shape[0] - 1
        step = max(chunks_of(array)[0], SLAB_BYTES // max(1, array[0].nbytes))
        parts: list[list[tuple[I32, I8, SampleArray]]] = [[], [], []]
        for low in range(0, cells, step):
            high = min(low + step, cells)
            first = max(low - 1, 0)  # cells on both sides of the slab tell where its faces are
            samples = array[first : min(high + 1, cells) + 1]
            valid = valid_cells(samples)
            for axis in range(3):
                starts, outward, values = _faces_across(axis, valid, samples)
                starts[:, 2] += first
                last = high + (axis == 2 and high == cells)
                own = (low <= starts[:, 2]) & (starts[:, 2] < last)
                parts[axis].append((starts[own], outward[own], values[own]))
        columns = zip(*itertools.chain(*parts), strict=True)
        all_starts, all_outward, all_values = (np.concatenate(column) for column in columns)
        axes = np.repeat(
            np.arange(3, dtype=np.int8), [sum(len(part[0]) for part in found) for found in parts]
        )
        return cls(starts=all_starts, axes=axes, outward=all_outward, values=all_values)


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

"""A regular grid of scalars in its own dtype."""

from __future__ import annotations

import os
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from isosample.errors import InputError
from isosample.volume.geometry import GridGeometry
from isosample.volume.lazy import LazySamples, blocks_of

if TYPE_CHECKING:
    from collections.abc import Iterator

    from isosample.volume.geometry import Box

F64 = npt.NDArray[np.float64]
SampleArray = npt.NDArray[np.generic]

EXACT_INTEGERS = 2.0**53  # float64 holds every integer up to here
SCAN_BYTES = 64 << 20  # a memory-mapped volume is scanned in blocks of about this size


@dataclass(frozen=True, eq=False)
class Volume:
    """A regular grid of scalar samples with its placement in world space.

    Parameters
    ----------
    array : (Z, Y, X) integer, floating point or bool
        Samples, indexed ``[z, y, x]``; kept in their own dtype, never copied; a mask of bool counts as uint8. May
        be memory-mapped, or `LazySamples`, which stay in their file until they are sliced.
    spacing : 3 floats
        Distance between samples along x, y, z [world], > 0.
    origin : 3 floats
        World position of sample ``[0, 0, 0]``.
    direction : (3, 3) float64
        Orthonormal; column `a` is the world direction of index axis `a` (x, y, z).
    name : str
        Used in messages and picture titles.
    patient_axes : bool
        Whether the world's axes are a patient's, so that pictures begin at the front, head up; see `GridGeometry`.

    Attributes
    ----------
    geometry : GridGeometry
        Size, spacing, origin and direction, without the samples.

    Raises
    ------
    InputError
        If the array is not three-dimensional and real, an axis is empty, a spacing is not positive and
        finite, or the direction is not orthonormal.

    Notes
    -----
    world = origin + direction · (spacing · index), samples at cell corners: the box goes from the first to
    the last sample.
    """

    array: SampleArray
    spacing: tuple[float, float, float] = (1.0, 1.0, 1.0)
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0)
    direction: F64 = field(default_factory=lambda: np.eye(3))
    name: str = "array"
    patient_axes: bool = False
    geometry: GridGeometry = field(init=False, repr=False)

    def __post_init__(self) -> None:
        array = self.array
        if not isinstance(array, np.ndarray | LazySamples):
            raise InputError(
                f"a volume needs a numpy array, got {type(array).__name__}. Pass numpy.asarray(...)."
            )
        if array.dtype == np.bool_ and not self.stays_in_file:
            array = array.view(np.uint8)  # a mask: 0 and 1 in the same memory
            object.__setattr__(self, "array", array)
        if array.ndim != 3:
            raise InputError(
                f"{self.name} has shape {array.shape}; a volume has three axes [z, y, x]. "
                "Choose one channel or one time step, for instance array[0]."
            )
        if array.dtype.kind not in "iuf":
            raise InputError(
                f"{self.name} holds {array.dtype}; a volume needs integers, floats or bool (a mask). Convert "
                "with .astype()."
            )
        if 0 in array.shape:
            raise InputError(f"{self.name} has shape {array.shape}; every axis needs at least one sample.")
        geometry = GridGeometry(
            size_xyz=array.shape[::-1],
            spacing=self.spacing,
            origin=self.origin,
            direction=self.direction,
            patient_axes=self.patient_axes,
        )
        object.__setattr__(self, "geometry", geometry)
        for name in ("spacing", "origin", "direction"):
            object.__setattr__(self, name, getattr(geometry, name))

    def __repr__(self) -> str:
        """One line that reads no sample."""
        size = " x ".join(str(count) for count in self.size_xyz)
        spacing = ", ".join(f"{length:.6g}" for length in self.spacing)
        return f"Volume({self.name!r}: {size} (x, y, z) {self.array.dtype}, spacing ({spacing}))"

    @property
    def size_xyz(self) -> tuple[int, int, int]:
        """Number of samples along x, y, z."""
        return self.geometry.size_xyz

    @property
    def world_from_index(self) -> F64:
        """(4, 4) float64, maps homogeneous sample indices (x, y, z, 1) to world positions."""
        return self.geometry.world_from_index

    @property
    def world_gradient_from_index_gradient(self) -> F64:
        """(3, 3) float64, maps a gradient per sample index to a gradient per world unit (covariant)."""
        return self.geometry.world_gradient_from_index_gradient

    @property
    def box(self) -> Box:
        """The oriented box from the first to the last sample [world]."""
        return self.geometry.box

    @cached_property
    def value_range(self) -> tuple[float, float]:
        """Smallest and largest finite sample, in data units.

        Raises
        ------
        InputError
            If no sample is finite, or integers are so large that float64 no longer tells neighbours apart.
        """
        return self.checked_range(*self._seen[:2])

    def checked_range(self, low: float, high: float) -> tuple[float, float]:
        """Return the range of the samples, or raise as `value_range` does."""
        if low > high:
            raise InputError(f"{self.name} has no finite sample; there is nothing to render.")
        if self.array.dtype.kind in "iu" and max(-low, high) > EXACT_INTEGERS:
            raise InputError(
                f"{self.name} holds integers up to {max(-low, high):.17g}; above 2^53 neighbours become one value. "
                "Subtract an offset first, or convert with .astype(float) if that is meant."
            )
        return low, high

    @cached_property
    def nonfinite_counts(self) -> tuple[int, int]:
        """Number of NaN samples and number of infinite samples."""
        return self._seen[2:] if self.array.dtype.kind == "f" else (0, 0)

    @cached_property
    def _seen(self) -> tuple[float, float, int, int]:
        """Smallest and largest finite sample, or (inf, -inf), and the number of NaN and infinite samples."""
        low, high, nan_count, infinity_count = np.inf, -np.inf, 0, 0
        for block in self.blocks():
            ends = np.array([block.min(), block.max()], dtype=np.float64)  # these carry NaN through
            if not np.isfinite(ends).all():
                nan_count += int(np.count_nonzero(np.isnan(block)))
                infinity_count += int(np.count_nonzero(np.isinf(block)))
                finite = block[np.isfinite(block)]
                ends = np.array([finite.min(initial=np.inf), finite.max(initial=-np.inf)], dtype=np.float64)
            low, high = min(low, float(ends[0])), max(high, float(ends[1]))
        return low, high, nan_count, infinity_count

    def in_index_frame(self) -> Volume:
        """Return the same samples in the volume's own axes: spacing kept, origin and direction dropped."""
        return Volume(self.array, spacing=self.spacing, name=self.name)

    @property
    def stays_in_file(self) -> bool:
        """Whether the samples are read when they are sliced; false also for a memory-mapped array."""
        return isinstance(self.array, LazySamples)

    def in_memory(self) -> Volume:
        """Return the same volume with its samples in memory, in their own type; memory-mapped ones stay mapped."""
        if not isinstance(self.array, LazySamples):
            return self
        loaded = replace(self, array=np.asarray(self.array))
        known = {name: vars(self)[name] for name in ("value_range", "nonfinite_counts") if name in vars(self)}
        vars(loaded).update(known)
        return loaded

    def blocks(self, block_bytes: int = SCAN_BYTES) -> Iterator[SampleArray]:
        """Yield blocks of about `block_bytes` that hold every sample once, each part of a file being read once."""
        return blocks_of(self.array, block_bytes)


def check_is_volume(volume: object) -> None:
    """Raise `InputError` unless something is a `Volume`; an array or a path are told how to become one."""
    if isinstance(volume, Volume):
        return
    if isinstance(volume, np.ndarray):
        raise InputError(
            f"volume is an array of shape {volume.shape}; expected a Volume. Pass "
            "isosample.Volume(array), with its spacing."
        )
    if isinstance(volume, str | os.PathLike):
        raise InputError(
            f"volume is {os.fspath(volume)!r}; expected a Volume. Pass isosample.open_volume({os.fspath(volume)!r})."
        )
    raise InputError(
        f"volume is {volume!r:.80}; expected a Volume. Pass isosample.Volume(array) or isosample.open_volume(path)."
    )

"""The placement of a grid in world space, and the oriented box that it fills there."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from isosample.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Mapping

F64 = npt.NDArray[np.float64]

ORTHONORMAL_TOLERANCE = 1e-4  # direction cosines are written with 5 to 7 digits in most file formats


@dataclass(frozen=True, kw_only=True)
class Box:
    """An oriented box: one corner and three edge vectors, all in world units.

    Attributes
    ----------
    corner : (3,) float64
        World position of the first sample.
    edges : (3, 3) float64
        Row `a` is the edge along index axis `a` (x, y, z), from the first to the last sample.
    patient_axes : bool
        As of `GridGeometry`.
    """

    corner: F64
    edges: F64
    patient_axes: bool = False

    def __post_init__(self) -> None:
        for name in ("corner", "edges"):
            array = np.array(getattr(self, name), dtype=np.float64)
            array.flags.writeable = False  # all who ask a geometry for its box get the same one
            object.__setattr__(self, name, array)

    @cached_property
    def centre(self) -> F64:
        """(3,) float64, the middle of the box [world]."""
        middle: F64 = self.corner + 0.5 * self.edges.sum(axis=0)
        middle.flags.writeable = False
        return middle

    @cached_property
    def radius(self) -> float:
        """Radius of the bounding sphere about the centre [world]."""
        return float(np.linalg.norm(self.corners() - self.centre, axis=1).max())

    def corners(self) -> F64:
        """(8, 3) float64, the corners [world]; bit `a` of the row number selects the far end of edge `a`."""
        bits = (np.arange(8)[:, None] >> np.arange(3)) & 1
        corners: F64 = self.corner + bits @ self.edges
        return corners


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class GridGeometry:
    """The placement of a grid in world space, without its samples.

    Parameters
    ----------
    size_xyz : 3 ints
        Number of samples along x, y, z, >= 1.
    spacing : 3 floats
        Distance between samples along x, y, z [world], > 0.
    origin : 3 floats
        World position of the first sample.
    direction : (3, 3) float64
        Orthonormal, of either handedness; column `a` is the world direction of index axis `a` (x, y, z).
    patient_axes : bool
        Whether the world's axes are a patient's: x to the left, y to the back, z to the head (LPS).

    Attributes
    ----------
    box : Box
        The oriented box from the first to the last sample [world].

    Raises
    ------
    InputError
        If a size is below 1, a spacing is not positive and finite, or the direction is not orthonormal.
    """

    size_xyz: tuple[int, int, int]
    spacing: tuple[float, float, float] = (1.0, 1.0, 1.0)
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0)
    direction: F64 = field(default_factory=lambda: np.eye(3))
    patient_axes: bool = False
    box: Box = field(init=False, repr=False)

    def __post_init__(self) -> None:
        size = _three_floats(self.size_xyz, "size_xyz")
        if min(size) < 1 or any(n != int(n) for n in size):
            raise InputError(f"size_xyz {self.size_xyz!r} must be three whole numbers >= 1 (x, y, z).")
        object.__setattr__(self, "size_xyz", tuple(int(n) for n in size))
        object.__setattr__(self, "spacing", _three_floats(self.spacing, "spacing"))
        object.__setattr__(self, "origin", _three_floats(self.origin, "origin"))
        object.__setattr__(self, "direction", _orthonormal(self.direction))
        if min(self.spacing) <= 0:
            raise InputError(
                f"spacing {self.spacing} must be > 0 along every axis; use origin and direction to flip."
            )
        x, y, z = (count - 1 for count in self.size_xyz)
        object.__setattr__(self, "box", self.box_of((0, 0, 0), (x, y, z)))

    def __eq__(self, other: object) -> bool:
        return isinstance(other, GridGeometry) and self.to_dict() == other.to_dict()

    def __hash__(self) -> int:
        return hash((self.size_xyz, self.spacing, self.origin, tuple(self.direction.ravel().tolist())))

    @property
    def world_from_index(self) -> F64:
        """(4, 4) float64, maps homogeneous sample indices (x, y, z, 1) to world positions."""
        matrix = np.eye(4)
        matrix[:3, :3] = self.direction * np.asarray(self.spacing)
        matrix[:3, 3] = self.origin
        return matrix

    @property
    def world_gradient_from_index_gradient(self) -> F64:
        """(3, 3) float64, maps a gradient per sample index to a gradient per world unit (covariant)."""
        matrix: F64 = self.direction / np.asarray(self.spacing)
        return matrix

    @property
    def left_handed(self) -> bool:
        """Whether the axes x, y, z of the samples are a left-handed system in world space."""
        (a, b, c), (d, e, f), (g, h, i) = self.direction.tolist()
        return bool(a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g) < 0.0)

    def box_of(self, first: tuple[int, int, int], last: tuple[int, int, int]) -> Box:
        """The oriented box between two samples (x, y, z) of the grid [world]."""
        matrix = self.world_from_index
        edges: F64 = (matrix[:3, :3] * np.subtract(last, first, dtype=np.float64)).T
        return Box(
            corner=np.asarray(self.origin, dtype=np.float64)
            + matrix[:3, :3] @ np.asarray(first, dtype=np.float64),
            edges=np.ascontiguousarray(edges),
            patient_axes=self.patient_axes,
        )

    def to_dict(self) -> dict[str, Any]:
        """Plain lists and numbers, ready for JSON; `from_dict` gives the same geometry back, bit for bit."""
        return {
            "size_xyz": list(self.size_xyz),
            "spacing": list(self.spacing),
            "origin": list(self.origin),
            "direction": self.direction.tolist(),
            **({"patient_axes": True} if self.patient_axes else {}),
        }

    @classmethod
    def from_dict(cls, entries: Mapping[str, Any]) -> GridGeometry:
        """Return the geometry that `to_dict` wrote.

        Raises
        ------
        InputError
            If an entry is missing, unknown, or not what the constructor accepts.
        """
        expected = {"size_xyz", "spacing", "origin", "direction"}
        if set(entries) - {"patient_axes"} != expected:
            raise InputError(
                f"a grid geometry has the entries {sorted(expected)}, got {sorted(entries)}. "
                "Write it with GridGeometry.to_dict()."
            )
        return cls(**entries)


def _three_floats(values: object, what: str) -> tuple[float, float, float]:
    """Return three finite floats, or raise naming `what`."""
    try:
        numbers = np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError):
        numbers = np.empty(0)
    if numbers.shape != (3,) or not np.isfinite(numbers).all():
        raise InputError(f"{what} {values!r} must be three finite numbers (x, y, z).")
    return (float(numbers[0]), float(numbers[1]), float(numbers[2]))


def _orthonormal(matrix: object) -> F64:
    """Return a (3, 3) float64 copy of a matrix with orthonormal columns, or raise."""
    try:
        direction = np.array(matrix, dtype=np.float64)
    except (TypeError, ValueError):
        direction = np.empty(0)
    if direction.shape != (3, 3) or not np.isfinite(direction).all():
        one_line = " ".join(repr(matrix).split())
        raise InputError(f"direction {one_line} must be a 3 by 3 matrix of finite numbers.")
    if not np.allclose(direction.T @ direction, np.eye(3), atol=ORTHONORMAL_TOLERANCE):
        raise InputError(
            f"direction {direction.tolist()} is not orthonormal; sheared grids are not supported. "
            "Resample the volume, or drop the direction (--frame index)."
        )
    direction.setflags(write=False)
    return direction

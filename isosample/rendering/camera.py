"""The camera: where the rays of a picture start and where they go."""

from __future__ import annotations

import dataclasses
import enum
import json
import math
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from isosample.errors import InputError
from isosample.rendering.rays import Rays
from isosample.wording import about_unknown_keys

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from isosample.volume.geometry import Box

F64 = npt.NDArray[np.float64]
Vector = tuple[float, float, float]

DEFAULT_FOV_Y_DEGREES = 30.0
LARGEST, SMALLEST = 1e30, 1e-30  # what float32 can square, or nearly
PARALLEL_LIMIT = 1e-6  # sine of the smallest angle between the view direction and `up`


class UpAxis(enum.Enum):
    """World axis that points up in the pictures of an orbiting camera: z for scans in patient coordinates."""

    Y = "y"
    Z = "z"


class Projection(enum.Enum):
    """How rays leave the image plane."""

    ORTHOGRAPHIC = "orthographic"
    PERSPECTIVE = "perspective"


@dataclass(frozen=True, slots=True, kw_only=True)
class Camera:
    """An orthographic or perspective camera.

    Parameters
    ----------
    projection : Projection
    eye, target, up : 3 floats
        World space. The picture's centre looks from `eye` to `target`; `up` points up in the picture.
    height : float, optional
        Orthographic: height of the window [world], > 0.
    fov_y_degrees : float, optional
        Perspective: vertical angle of view, between 0 and 180.

    Raises
    ------
    InputError
        If a number is not finite, eye and target coincide, `up` is parallel to the view, or the size is
        missing, out of range, or that of the other projection.
    """

    projection: Projection
    eye: Vector
    target: Vector
    up: Vector = (0.0, 1.0, 0.0)
    height: float | None = None
    fov_y_degrees: float | None = None

    def __post_init__(self) -> None:
        for name in ("eye", "target", "up"):
            object.__setattr__(self, name, _vector(getattr(self, name), f"camera {name}"))
        if self.projection is Projection.ORTHOGRAPHIC:
            _check_size(self.height, "height", LARGEST, self.fov_y_degrees, "fov_y_degrees", "orthographic")
        else:
            _check_size(self.fov_y_degrees, "fov_y_degrees", 180.0, self.height, "height", "perspective")
        view = np.subtract(self.target, self.eye)
        if not np.any(view):
            raise InputError(f"camera eye and target are both {self.eye}; move one of them.")
        lengths = float(np.linalg.norm(view) * np.linalg.norm(self.up))
        if np.linalg.norm(np.cross(view, self.up)) <= PARALLEL_LIMIT * lengths:
            raise InputError(
                f"camera up {self.up} is parallel to the view direction; choose another up vector."
            )

    @classmethod
    def orbit(
        cls,
        box: Box,
        *,
        azimuth: float = 0.0,
        elevation: float = 0.0,
        zoom: float = 1.0,
        projection: Projection = Projection.ORTHOGRAPHIC,
        aspect: float = 1.0,
        up_axis: UpAxis | None = None,
    ) -> Camera:
        """Camera on a sphere about the centre of a box, such that the box's bounding sphere fits the picture.

        Parameters
        ----------
        box : Box
            Usually `volume.box`, or `visible_box` of the volume and its transfer function.
        azimuth, elevation : float
            Degrees. At 0, 0 the eye is in front: with +y up on +z, looking along −z, with +x to the right; azimuth
            turns the eye towards +x, elevation upwards.
        zoom : float
            Magnification, > 0; 1 fits the bounding sphere.
        projection : Projection
        aspect : float
            Width / height of the picture; below 1 the window grows so that the sphere still fits.
        up_axis : UpAxis, optional
            With Z, at 0, 0 the eye is on −y looking along +y with +z up and +x to the right: the front of a
            patient in LPS coordinates. By default Z for a box in patient axes, else Y, as on the command line.

        Raises
        ------
        InputError
            If zoom or aspect is not positive, an angle is not finite, or the box has no extent.
        """
        for name, number in (("zoom", zoom), ("aspect", aspect)):
            if not (math.isfinite(number) and number > 0):
                raise InputError(f"{name} {number} must be a finite number > 0.")
        if not (math.isfinite(azimuth) and math.isfinite(elevation)):
            raise InputError(f"azimuth {azimuth} and elevation {elevation} must be finite angles in degrees.")
        radius = box.radius
        if radius == 0:
            raise InputError(
                "the volume's box has no extent; a picture needs at least two samples along an axis."
            )
        outward, up = _orbit_frame(math.radians(azimuth), math.radians(elevation))
        if (_up_axis(box) if up_axis is None else up_axis) is UpAxis.Z:
            outward, up = (vector[[0, 2, 1]] * [1.0, -1.0, 1.0] for vector in (outward, up))
        fit = radius / min(aspect, 1.0) / zoom
        half_fov = math.radians(DEFAULT_FOV_Y_DEGREES) / 2
        distance = 2.0 * radius
        if projection is Projection.PERSPECTIVE:
            # The sphere touches the cone of the narrower half-angle; zoom narrows the view, the eye stays.
            narrow = math.atan(math.tan(half_fov) * min(aspect, 1.0))
            distance = radius / math.sin(narrow)
        eye = _vector(box.centre + distance * outward, "eye")
        common: dict[str, Any] = {
            "eye": eye,
            "target": _vector(box.centre, "target"),
            "up": _vector(up, "up"),
        }
        if projection is Projection.ORTHOGRAPHIC:
            return cls(projection=projection, height=2.0 * fit, **common)
        fov = 2.0 * math.degrees(math.atan(math.tan(half_fov) / zoom))
        return cls(projection=projection, fov_y_degrees=fov, **common)

    @classmethod
    def default(cls, box: Box, size: tuple[int, int]) -> Camera:
        """Camera of a picture of (width, height) pixels for which none is given: `orbit` from the front."""
        return cls.orbit(box, aspect=size[0] / size[1])

    def rays(self, aspect: float) -> Rays:
        """Rays of this camera for a picture of width / height = `aspect`."""
        # In Python's own numbers: NumPy takes ten times as long for three of them.
        forward = _unit([target - eye for target, eye in zip(self.target, self.eye, strict=True)])
        right = _unit(_cross(forward, self.up))
        up = _cross(right, forward)
        half = self._half_height()
        return Rays(
            eye=np.array(self.eye),
            forward=np.array(forward),
            span_right=half * aspect * np.array(right),
            span_up=half * np.array(up),
            perspective=self.projection is Projection.PERSPECTIVE,
        )

    def _half_height(self) -> float:
        if self.height is not None:
            return self.height / 2.0
        assert self.fov_y_degrees is not None  # checked in __post_init__
        return math.tan(math.radians(self.fov_y_degrees) / 2.0)

    def to_dict(self) -> dict[str, Any]:
        """Camera file content, see `from_dict`."""
        entries: dict[str, Any] = {
            "projection": self.projection.value,
            "eye": list(self.eye),
            "target": list(self.target),
            "up": list(self.up),
        }
        if self.projection is Projection.ORTHOGRAPHIC:
            return entries | {"height": self.height}
        return entries | {"fov_y_degrees": self.fov_y_degrees}

    @classmethod
    def from_dict(cls, entries: Mapping[str, Any], source: str = "camera") -> Camera:
        """Camera from ``{"projection", "eye", "target", "up", "height" | "fov_y_degrees"}``.

        Raises
        ------
        InputError
            If an entry is missing, unknown or out of range; the message starts with `source`.
        """
        known = {one.name for one in dataclasses.fields(cls)}
        named = entries if isinstance(entries, dict) else {}
        if unknown := sorted(str(key) for key in named.keys() - known):
            raise InputError(f"{source}: the camera {about_unknown_keys(unknown, known)}")
        if not {"projection", "eye", "target"} <= named.keys():
            raise InputError(
                f"{source}: a camera has the entries projection, eye, target, up, and height (orthographic) "
                f"or fov_y_degrees (perspective); got {', '.join(named) or repr(entries)[:80]}."
            )
        try:
            projection = Projection(entries["projection"])
        except ValueError as error:
            raise InputError(
                f"{source}: projection {entries['projection']!r} must be 'orthographic' or 'perspective'."
            ) from error
        try:
            return cls(**(dict(entries) | {"projection": projection}))
        except InputError as error:
            raise InputError(f"{source}: {error}") from error

    @classmethod
    def load(cls, path: str | Path) -> Camera:
        """Camera from a JSON file, see `from_dict`."""
        try:
            entries = json.loads(Path(path).read_text(encoding="utf-8"))
        except OSError as error:
            raise InputError(f"cannot read camera file {path}: {error.strerror}.") from error
        except (ValueError, RecursionError) as error:
            raise InputError(f"camera file {path} is not JSON: {error}.") from error
        return cls.from_dict(entries, source=str(path))


def _up_axis(box: Box) -> UpAxis:
    """Return the axis that points up where nothing is said about it."""
    return UpAxis.Z if box.patient_axes else UpAxis.Y


def _orbit_frame(azimuth: float, elevation: float) -> tuple[F64, F64]:
    """Unit vectors from the centre to the eye and up in the picture, radians."""
    sin_a, cos_a = math.sin(azimuth), math.cos(azimuth)
    sin_e, cos_e = math.sin(elevation), math.cos(elevation)
    return np.array([sin_a * cos_e, sin_e, cos_a * cos_e]), np.array([-sin_a * sin_e, cos_e, -cos_a * sin_e])


def _cross(a: Sequence[float], b: Sequence[float]) -> list[float]:
    return [a[i - 2] * b[i - 1] - a[i - 1] * b[i - 2] for i in range(3)]


def _unit(vector: Sequence[float]) -> list[float]:
    length = math.hypot(*vector)
    return [part / length for part in vector]


def _vector(values: object, what: str) -> Vector:
    try:
        numbers = np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        numbers = np.empty(0)
    if numbers.shape != (3,) or not np.all(np.abs(numbers) < LARGEST):
        raise InputError(f"{what} {values!r} must be three numbers (x, y, z) below {LARGEST:g}.")
    return (float(numbers[0]), float(numbers[1]), float(numbers[2]))


def _check_size(
    size: object, name: str, limit: float, other: object, other_name: str, projection: str
) -> None:
    """Raise unless `size` is a number in (0, limit) and the other projection's size is absent."""
    if other is not None:
        raise InputError(
            f"{other_name} {other!r} does not belong to the {projection} projection; give {name}."
        )
    if not isinstance(size, (int, float)) or not SMALLEST < size < limit:
        raise InputError(
            f"{name} {size!r} must be a number between {SMALLEST:g} and {limit:g} for the {projection} projection."
        )

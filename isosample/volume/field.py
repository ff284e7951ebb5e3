"""A closed-form scalar field with its gradient, and its samples on a grid."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from isosample.errors import InputError
from isosample.volume.grid import Volume

if TYPE_CHECKING:
    from collections.abc import Sequence

    from isosample.volume.grid import F64


class Field(ABC):
    """A scalar field known everywhere, with its gradient."""

    @abstractmethod
    def value(self, points: F64) -> F64:
        """Field at `points`.

        Parameters
        ----------
        points : (..., 3) float64
            World positions (x, y, z).

        Returns
        -------
        values : (...) float64
        """

    @abstractmethod
    def gradient(self, points: F64) -> F64:
        """Return the gradient at `points`, (..., 3) float64, per world unit; see `value`."""

    def lipschitz(self) -> float | None:
        """Upper bound of |∇f| over all of space [data units per world unit]; None where none is known.

        With a bound L, f stays within (f(a) + f(b)) / 2 ± L |b − a| / 2 between two points of a line: no
        feature, however narrow, can hide from an integrator that knows L.
        """
        return None


def sample_field(
    field: Field,
    size_xyz: tuple[int, int, int],
    *,
    lower: Sequence[float],
    upper: Sequence[float],
    dtype: npt.DTypeLike = np.float32,
    name: str | None = None,
) -> Volume:
    """Sample a field on a grid whose first and last samples are the corners of a box.

    Parameters
    ----------
    field : Field
    size_xyz : 3 ints
        Number of samples along x, y, z, >= 2.
    lower, upper : 3 floats
        World positions of the first and the last sample; `lower` < `upper` along every axis.
    dtype : numpy dtype
        Integers are rounded to nearest.
    name : str, optional
        Default: the name of the field's class.

    Returns
    -------
    volume : Volume

    Raises
    ------
    InputError
        If a size or the box is degenerate, or a value does not fit an integer `dtype`.
    """
    low, high = np.asarray(lower, dtype=np.float64), np.asarray(upper, dtype=np.float64)
    if low.shape != (3,) or high.shape != (3,) or min(size_xyz) < 2 or not (low < high).all():
        raise InputError(
            f"cannot sample {size_xyz} points from {tuple(lower)} to {tuple(upper)}; "
            "give at least 2 per axis, and lower < upper along every axis."
        )
    title = type(field).__name__ if name is None else name
    x, y, z = (
        np.linspace(start, stop, count) for start, stop, count in zip(low, high, size_xyz, strict=True)
    )
    samples = np.empty(size_xyz[::-1], dtype=dtype)
    plane = np.empty((y.size, x.size, 3))
    plane[..., 0], plane[..., 1] = x, y[:, None]
    for k, height in enumerate(z):
        plane[..., 2] = height
        samples[k] = _converted(field.value(plane), samples.dtype, title)
    spacing = (high - low) / (np.array(size_xyz) - 1)
    return Volume(samples, spacing=tuple(spacing.tolist()), origin=tuple(low.tolist()), name=title)


def _converted(values: F64, dtype: np.dtype[Any], title: str) -> F64:
    """Round values for an integer type; raise where they do not fit."""
    if dtype.kind not in "iu":
        return values
    limits, rounded = np.iinfo(dtype), np.rint(values)
    if rounded.min() < limits.min or rounded.max() > limits.max:
        raise InputError(
            f"{title} has values from {values.min():g} to {values.max():g}; {dtype} holds {limits.min} to "
            f"{limits.max}. Scale the field or choose a float."
        )
    return rounded

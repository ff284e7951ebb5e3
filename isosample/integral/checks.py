"""Checks of array arguments: what is out of range is named with its first index."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from isosample.errors import InputError

if TYPE_CHECKING:
    import numpy.typing as npt

    from isosample.volume.grid import F64


def at_least_zero(values: npt.ArrayLike, name: str) -> F64:
    """Finite values >= 0 as float64.

    Parameters
    ----------
    values : (...) array_like of float
        Any shape.
    name : str
        What the values are, for the message.

    Returns
    -------
    checked : (...) float64
        The same values.

    Raises
    ------
    InputError
        If a value is negative, infinite or not a number (names its first index).
    """
    return within(values, name, 0.0, np.finfo(np.float64).max, "finite and >= 0")


def within(values: npt.ArrayLike, name: str, low: float, high: float, expected: str = "") -> F64:
    """Values in [`low`, `high`] as float64.

    Parameters
    ----------
    values : (...) array_like of float
        Any shape.
    name : str
        What the values are, for the message.
    low, high : float
        Accepted range, both ends included.
    expected : str
        The range in words; by default its two ends.

    Returns
    -------
    checked : (...) float64
        The same values.

    Raises
    ------
    InputError
        If a value is outside or not a number (names its first index).
    """
    array = np.asarray(values, dtype=np.float64)
    wrong = ~((array >= low) & (array <= high))
    if wrong.any():
        index = tuple(int(i) for i in np.argwhere(wrong)[0])
        place = f" at index {', '.join(map(str, index))}" if index else ""
        raise InputError(
            f"{name} is {array[index]:g}{place}; expected {expected or f'{low:g} to {high:g}'}. "
            "Correct the value before the call."
        )
    return array


def last_axis(values: npt.ArrayLike, name: str, length: int) -> F64:
    """Vectors of `length` components as float64.

    Parameters
    ----------
    values : (..., length) array_like of float
        Vectors along the last axis.
    name : str
        What the vectors are, for the message.
    length : int
        Number of components.

    Returns
    -------
    checked : (..., length) float64
        The same values.

    Raises
    ------
    InputError
        If the last axis has another length.
    """
    array = np.asarray(values, dtype=np.float64)
    if array.shape[-1:] != (length,):
        raise InputError(
            f"{name} has shape {array.shape}; expected (..., {length}). Put the components on the last axis."
        )
    return array

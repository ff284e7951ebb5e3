"""Weights of the four taps of a grid's spline, of numbers or arrays; `spline_kernels` has them compiled."""

from __future__ import annotations

from typing import TYPE_CHECKING, TypeVar

if TYPE_CHECKING:
    from isosample.volume.grid import F64

    Number = TypeVar("Number", float, F64)


def spline_weights(kernel: F64, u: Number) -> tuple[Number, Number, Number, Number]:
    """Weights of the four taps at a fraction in [0, 1]; their sum is 1."""
    return (
        kernel[0, 0] + u * (kernel[0, 1] + u * (kernel[0, 2] + u * kernel[0, 3])),
        kernel[1, 0] + u * (kernel[1, 1] + u * (kernel[1, 2] + u * kernel[1, 3])),
        kernel[2, 0] + u * (kernel[2, 1] + u * (kernel[2, 2] + u * kernel[2, 3])),
        kernel[3, 0] + u * (kernel[3, 1] + u * (kernel[3, 2] + u * kernel[3, 3])),
    )

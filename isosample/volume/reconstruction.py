"""The continuous field that a grid of samples stands for: trilinear, or a tensor-product cubic spline.

The compiled functions, which other kernels may call, are in `spline_kernels`; how coefficients are found, in
`spline_fit`.

>>> spline = GridSpline.build(volume, Reconstruction.CUBIC)
>>> values, gradients = spline.evaluate(points_index)
"""

from __future__ import annotations

import enum
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from isosample.errors import InputError
from isosample.volume.spline_fit import extrapolate_along, fit_along

if TYPE_CHECKING:
    import numpy.typing as npt

    from isosample.volume.grid import Volume

    F64 = npt.NDArray[np.float64]


class Reconstruction(enum.Enum):
    """How a field is made of samples.

    `cubic` and `catmull-rom` pass through the samples, `bspline` and `bc21` smooth them. The fields of `cubic` and
    `bspline` have two continuous derivatives, the other two have one. `cubic` keeps cubics, `catmull-rom` parabolas,
    `bspline` linear fields; `bc21` keeps constants alone: a ramp comes out as stairs, off by up to 0.29 of the step
    between samples and not even monotone. All but `cubic` depend on the samples nearby alone.
    """

    TRILINEAR = "trilinear"
    CUBIC = "cubic"  # interpolating cubic spline with not-a-knot ends
    BSPLINE = "bspline"  # uniform cubic B-spline whose coefficients are the samples
    BC21 = "bc21"  # the kernel of Mitchell and Netravali's family with B = 2, C = 1
    CATMULL_ROM = "catmull-rom"  # the interpolating kernel of that family, B = 0, C = 1/2

    @property
    def smooth(self) -> bool:
        """Whether the field has a continuous gradient."""
        return self is not Reconstruction.TRILINEAR

    @property
    def interpolates(self) -> bool:
        """Whether the field passes through the samples."""
        return self not in (Reconstruction.BSPLINE, Reconstruction.BC21)


@dataclass(frozen=True, slots=True, eq=False)
class GridSpline:
    r"""A smooth reconstruction of a volume: coefficients, and the kernel that weighs them.

    Attributes
    ----------
    coefficients : (Z + 2, Y + 2, X + 2) float64
        Coefficient [k + 1, j + 1, i + 1] belongs to sample (i, j, k); one more lies on each side of the grid.
    kernel : (4, 4) float64
        Weight `m` (0 to 3, of the samples i − 1 to i + 2) at the fraction u behind sample i is
        Σ_n kernel[m, n] uⁿ, the same along x, y and z.
    absolute_sum : float
        Largest Σ_m |weight m| along one axis; 1 where no weight is negative.

    Notes
    -----
    The weights are :math:`k(u + 1 - m)` for the kernel of [1]_,

    .. math::
        6 k(x) = (12 - 9B - 6C) |x|^3 + (-18 + 12B + 6C) |x|^2 + (6 - 2B), \quad |x| < 1

        6 k(x) = (-B - 6C) |x|^3 + (6B + 30C) |x|^2 + (-12B - 48C) |x| + (8B + 24C), \quad 1 \le |x| < 2

    with (B, C) = (1, 0), the uniform cubic B-spline, (2, 1), and (0, 1/2). `bspline` and `bc21` take the samples as
    coefficients, those beside the grid being extrapolated linearly; so does `catmull-rom`, but extrapolated by the
    parabola through the last three samples [3]_ (linearly where there are two). `cubic` uses the B-spline with
    the coefficients for which it passes through the samples; the two conditions that are missing along every
    axis are that differences of order min(4, n) vanish at both ends of n samples: the spline is one cubic
    over the first two cells and over the last two ("not-a-knot" [2]_), a parabola for n = 3, a line for n = 2.

    References
    ----------
    .. [1] D. P. Mitchell, A. N. Netravali, "Reconstruction filters in computer graphics", SIGGRAPH 1988, eq. 8.
    .. [2] C. de Boor, "A practical guide to splines", 1978, chapter IV.
    .. [3] R. G. Keys, "Cubic convolution interpolation for digital image processing", IEEE TASSP 29(6), 1981.
    """

    coefficients: F64
    kernel: F64
    absolute_sum: float

    @classmethod
    def build(cls, volume: Volume, reconstruction: Reconstruction) -> GridSpline:
        """Fit the spline to a volume.

        Raises
        ------
        InputError
            If the reconstruction is trilinear, an axis has fewer than two samples, or a sample is not finite.
        """
        kernel, absolute_sum = spline_kernel(reconstruction)
        check_smooth(volume, reconstruction)
        coefficients = np.zeros([count + 2 for count in volume.array.shape])
        coefficients[1:-1, 1:-1, 1:-1] = volume.array
        for axis in (2, 1, 0):
            if reconstruction is Reconstruction.CUBIC:
                fit_along(coefficients, axis)
            else:
                extrapolate_along(coefficients, axis, parabola=reconstruction is Reconstruction.CATMULL_ROM)
        coefficients.setflags(write=False)
        return cls(coefficients, kernel, absolute_sum)

    def evaluate(self, points: npt.ArrayLike) -> tuple[F64, F64]:
        """Values and gradients at points.

        Parameters
        ----------
        points : (N, 3) array_like of float
            Index coordinates (x, y, z), from 0 to the last sample along each axis.

        Returns
        -------
        values : (N,) float64
            In data units.
        gradients : (N, 3) float64
            Derivatives along x, y, z per sample step.

        Raises
        ------
        InputError
            If the array has another shape or a point is not inside the grid.
        """
        from isosample.volume.spline_kernels import spline_values_gradients

        places = np.ascontiguousarray(points, dtype=np.float64)
        if places.ndim != 2 or places.shape[1] != 3:
            raise InputError(f"points have shape {places.shape}; expected (N, 3): index coordinates x, y, z.")
        last = np.array(self.coefficients.shape[::-1]) - 3.0
        outside = np.flatnonzero(~((places >= 0.0) & (places <= last)).all(axis=1))
        if outside.size:
            raise InputError(
                f"points[{outside[0]}] is {places[outside[0]].tolist()}; the samples go from 0 to "
                f"{last.tolist()} (x, y, z)."
            )
        values, gradients = np.empty(len(places)), np.empty((len(places), 3))
        spline_values_gradients(self.coefficients, self.kernel, places, values, gradients)
        return values, gradients

    def samples(self) -> F64:
        """(Z, Y, X) float64, the reconstruction at the grid points: for `cubic` the samples, up to rounding."""
        result = self.coefficients
        for axis in range(3):
            result = self._at_samples(result, axis)
        return np.ascontiguousarray(result)

    @property
    def value_range(self) -> tuple[float, float]:
        """Bounds of the reconstruction, up to rounding; rarely reached."""
        low, high = float(self.coefficients.min()), float(self.coefficients.max())
        beyond = 0.5 * (self.absolute_sum**3 - 1.0) * (high - low)
        return low - beyond, high + beyond

    def face_coefficients(self, axis: int, side: int) -> F64:
        """Coefficients of the bicubic spline on a face of the box.

        Parameters
        ----------
        axis, side : int
            The face across `axis` (0 = x, 1 = y, 2 = z) at its first (0) or last (1) sample.

        Returns
        -------
        coefficients : (V + 2, U + 2) float64
            Of the two other axes, the higher axis first ((Z + 2, Y + 2) on an x face); same kernel.

        Raises
        ------
        InputError
            If there is no such face.
        """
        if axis not in (0, 1, 2) or side not in (0, 1):
            raise InputError(f"face ({axis}, {side}) does not exist; axis is 0, 1 or 2, side is 0 or 1.")
        row = 2 - axis
        ends = slice(0, 3) if side == 0 else slice(-3, None)
        three = np.moveaxis(self.coefficients, row, 0)[ends]
        return np.ascontiguousarray(self._at_samples(three, 0)[0])

    def _at_samples(self, coefficients: F64, axis: int) -> F64:
        """Weigh three neighbours along an axis, as at a sample; the fourth has no weight there."""
        lines = np.moveaxis(coefficients, axis, 0)
        before, at, after = self.kernel[:3, 0]
        weighed: F64 = at * lines[1:-1] + (before * lines[:-2] + after * lines[2:])
        return np.moveaxis(weighed, 0, axis)


def spline_kernel(reconstruction: Reconstruction) -> tuple[F64, float]:
    """Kernel and absolute sum of a smooth reconstruction, see `GridSpline`.

    Raises
    ------
    InputError
        If the reconstruction is trilinear.
    """
    if not reconstruction.smooth:
        raise InputError(
            f"the {reconstruction.value} reconstruction is no spline; take one of "
            f"{[other.value for other in Reconstruction if other.smooth]}."
        )
    if reconstruction is Reconstruction.BC21:
        # The outer weights, (1 − u)² (1 − 4u) / 3 and its mirror image, are both lowest, −1/12, at u = 1/2.
        sixths, absolute_sum = [[2, -12, 18, -8], [2, 0, 12, -12], [2, 12, -24, 12], [0, 0, -6, 8]], 4.0 / 3.0
    elif reconstruction is Reconstruction.CATMULL_ROM:
        # The outer weights, −u (1 − u)² / 2 and its mirror image, sum to −1/8 at u = 1/2.
        sixths, absolute_sum = [[0, -3, 6, -3], [6, 0, -15, 9], [0, 3, 12, -9], [0, 0, -3, 3]], 1.25
    else:
        sixths, absolute_sum = [[1, -3, 3, -1], [4, 0, -6, 3], [1, 3, 3, -3], [0, 0, 0, 1]], 1.0
    kernel = np.array(sixths) / 6.0
    kernel.setflags(write=False)
    return kernel, absolute_sum


def check_smooth(volume: Volume, reconstruction: Reconstruction) -> None:
    """Raise an `InputError` where a volume has no smooth reconstruction: too thin, or samples that are not finite.

    Every coefficient of a spline depends on samples around it (of `cubic` on all), so that a hole cannot be left out.
    """
    if min(volume.size_xyz) < 2:
        raise InputError(
            f"{volume.name} has {volume.size_xyz} samples (x, y, z); the {reconstruction.value} reconstruction "
            "needs two along every axis."
        )
    nan_count, infinity_count = volume.nonfinite_counts
    if nan_count or infinity_count:
        raise InputError(
            f"{volume.name} has {nan_count} NaN and {infinity_count} infinite samples; the {reconstruction.value} "
            "reconstruction needs finite ones. Replace them first, or take the trilinear reconstruction, which "
            "can mask them."
        )

"""How far the triangles of a mesh are from the isosurface of the chosen reconstruction."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from isosample.surfaces.brick_samples import BrickSamples
    from isosample.surfaces.mesh import F32, I32
    from isosample.volume.grid import F64


@dataclass(frozen=True, slots=True, kw_only=True)
class MeshError:
    """Distance of the points of a mesh from the isosurface, abs(field − isovalue) / abs(gradient).

    Attributes
    ----------
    area : float
        Of the triangles [voxel²].
    flat_rms, flat_largest : float
        Of the triangles themselves [voxel]; the mean square is weighted by area.
    curved_rms, curved_largest : float
        After the quadratic correction [voxel].
    """

    area: float = 0.0
    flat_rms: float = 0.0
    flat_largest: float = 0.0
    curved_rms: float = 0.0
    curved_largest: float = 0.0


def combined(errors: Sequence[MeshError]) -> MeshError:
    """Return the error of several meshes together; 0 of none."""
    area = sum(error.area for error in errors)
    if area == 0.0:
        return MeshError()

    def rms(values: list[float]) -> float:
        squares = (error.area * value**2 for error, value in zip(errors, values, strict=True))
        return math.sqrt(sum(squares) / area)

    return MeshError(
        area=area,
        flat_rms=rms([error.flat_rms for error in errors]),
        flat_largest=max(error.flat_largest for error in errors),
        curved_rms=rms([error.curved_rms for error in errors]),
        curved_largest=max(error.curved_largest for error in errors),
    )


def measure(
    brick: BrickSamples, isovalue: float, positions: F64, gradients: F32, triangles: I32
) -> tuple[F32, MeshError]:
    r"""Sample the field inside the triangles of a mesh.

    Parameters
    ----------
    brick : BrickSamples
    isovalue : float
    positions : (V, 3) float64
        In the brick's index coordinates [voxel].
    gradients : (V, 3) float32
        Per sample step.
    triangles : (T, 3) int32

    Returns
    -------
    residuals : (V, 2) float32
        Largest abs(field − isovalue) inside the triangles around each vertex: flat, and corrected.
    error : MeshError

    Notes
    -----
    Seven points per triangle, those of Radon's rule of degree 5 [1]_: near the middles of the sides, near the
    corners, and the centroid. The correction takes the field inside a triangle to be quadratic with the gradients
    G at its corners, so that at a point p with the gradient :math:`\bar G = \sum \lambda_i G_i`

    .. math:: f(p) - v \approx \tfrac12 \sum_i \lambda_i G_i \cdot (p - p_i),

    and moves the point along :math:`\bar G` by that over :math:`|\bar G|`, at most half a voxel. Where the
    moved point leaves the field (the volume, or samples that are masked) it stays in the triangle's cell.

    Distances divide by the gradient of the field at the point; they are cut at a cell's diagonal, since where
    the gradient (almost) vanishes the quotient says nothing. What lies between the seven points is not seen.

    References
    ----------
    .. [1] J. Radon, "Zur mechanischen Kubatur", Monatshefte für Mathematik 52, 1948.
    """
    from isosample.surfaces.residual_kernels import triangle_residuals

    residuals = np.zeros((len(positions), 2))
    sums = np.zeros(5)
    triangle_residuals(
        brick.coefficients,
        brick.kernel,
        brick.smooth,
        brick.origin,
        isovalue,
        positions,
        gradients.astype(np.float64),
        triangles,
        residuals,
        sums,
    )
    area, flat, flat_largest, curved, curved_largest = sums.tolist()
    weight = 1.0 / area if area > 0.0 else 0.0
    error = MeshError(
        area=area,
        flat_rms=math.sqrt(flat * weight),
        flat_largest=flat_largest,
        curved_rms=math.sqrt(curved * weight),
        curved_largest=curved_largest,
    )
    return round_residuals(residuals), error


def round_residuals(residuals: F64) -> F32:
    """Return numbers >= 0 as float32 of 8 bits of mantissa besides the leading one, rounded up: what a cache keeps.

    They grow by less than 2^-8 of themselves; numbers too large for float32 become infinite.
    """
    with np.errstate(over="ignore", under="ignore"):
        nearest = residuals.astype(np.float32)
        low = nearest.astype(np.float64) < residuals
        nearest[low] = np.nextafter(nearest[low], np.float32(np.inf))
    bits = nearest.view(np.uint32)
    rounded: F32 = (bits + np.uint32(0x7FFF) & np.uint32(0xFFFF8000)).view(np.float32)
    return rounded

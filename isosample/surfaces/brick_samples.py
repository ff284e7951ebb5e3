"""The samples of one brick, made ready for extraction: float64, with a border, non-finite ones masked."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from isosample.surfaces.positions import round_gradients
from isosample.surfaces.scratch import SCRATCH
from isosample.volume.bricks import compilable

if TYPE_CHECKING:
    from isosample.volume.bricks import Brick
    from isosample.volume.grid import F64, Volume
    from isosample.volume.reconstruction import GridSpline

NO_KERNEL = np.zeros((4, 4))
NO_KERNEL.setflags(write=False)
ORIGIN = np.zeros(3)
ORIGIN.setflags(write=False)

Triple = tuple[int, int, int]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class BrickSamples:
    """What the kernels need of one brick, for every isovalue.

    Attributes
    ----------
    padded : (Z + 2, Y + 2, X + 2) float64
        The field at the samples in data units with one sample more on each side; NaN outside the volume and
        where masked.
    usable_cells : (Z - 1, Y - 1, X - 1) bool or None
        Cells whose eight corners are all samples, not masked; None = all.
    coefficients : (…) float64
        Of the trilinear field: `padded`. Of a smooth one: those of the spline, of the whole volume.
    kernel : (4, 4) float64
        The kernel of the spline.
    smooth : bool
        Which of the two it is.
    origin : (3,) float64
        Added to the brick's own index coordinates it gives those of the coefficients.
    start : 3 ints
        First sample (x, y, z) of the brick.
    size_xyz : 3 ints
        Number of samples of the whole volume.
    """

    padded: F64
    usable_cells: npt.NDArray[np.bool_] | None
    coefficients: F64
    kernel: F64
    smooth: bool
    origin: F64
    start: Triple
    size_xyz: Triple

    @property
    def values(self) -> F64:
        """(Z, Y, X) float64, the samples of the brick itself, a view."""
        return self.padded[1:-1, 1:-1, 1:-1]

    @property
    def sample_count(self) -> int:
        """Samples of the whole volume: keys of vertices inside cells begin at three times as many."""
        x, y, z = self.size_xyz
        return x * y * z


def load_brick(volume: Volume, brick: Brick, *, passing: bool = False) -> BrickSamples:
    """Read one brick with a border of one sample.

    Parameters
    ----------
    volume : Volume
    brick : Brick
    passing : bool
        True: the samples are lost when the same thread reads the next passing brick.

    Notes
    -----
    Gradients are central differences of these, one-sided next to the volume's border or a non-finite sample, and
    zero along an axis on which neither neighbour is finite. The border of one sample makes the gradient at a
    sample the same in all bricks that hold it.
    """
    padded, all_finite = _padded_samples(volume, brick, passing=passing)
    usable: npt.NDArray[np.bool_] | None = None
    if not all_finite:
        finite = np.isfinite(padded[1:-1, 1:-1, 1:-1])
        usable = finite[:-1] & finite[1:]
        usable = usable[:, :-1] & usable[:, 1:]
        usable = usable[:, :, :-1] & usable[:, :, 1:]
    return BrickSamples(
        padded=padded,
        usable_cells=usable,
        coefficients=padded,
        kernel=NO_KERNEL,
        smooth=False,
        origin=ORIGIN,
        start=brick.start,
        size_xyz=volume.size_xyz,
    )


def spline_brick(nodes: Volume, spline: GridSpline, brick: Brick) -> BrickSamples:
    """Return one brick of a smooth reconstruction, given also at the samples (`nodes`), all finite."""
    padded, _ = _padded_samples(nodes, brick)
    return BrickSamples(
        padded=padded,
        usable_cells=None,
        coefficients=spline.coefficients,
        kernel=spline.kernel,
        smooth=True,
        origin=np.array(brick.start, dtype=np.float64),
        start=brick.start,
        size_xyz=nodes.size_xyz,
    )


def gradients_at(brick: BrickSamples, positions: F64) -> F64:
    """(N, 3) float64, gradients at places in the brick's coordinates: the spline's, or interpolated differences.

    They are rounded as `round_gradients` does.
    """
    from isosample.surfaces.field_kernels import vertex_gradients

    found = np.empty_like(positions)
    vertex_gradients(brick.coefficients, brick.kernel, brick.smooth, brick.origin, positions, found)
    return round_gradients(found)


def _padded_samples(volume: Volume, brick: Brick, *, passing: bool = False) -> tuple[F64, bool]:
    """Brick samples with a border of one sample, float64, and whether those that were read are finite.

    NaN stands outside the volume and for samples that are not finite.
    """
    x, y, z = brick.size_xyz
    shape = (z + 2, y + 2, x + 2)
    plain = compilable(volume.array)
    if plain is not None:
        from isosample.volume.range_kernels import fill_padded

        padded = SCRATCH.room("padded", shape, np.float64) if passing else np.empty(shape)
        corner = (brick.start[0] - 1, brick.start[1] - 1, brick.start[2] - 1)
        all_finite = fill_padded(plain, corner, padded)
        read_only = padded.view()
        read_only.setflags(write=False)
        return read_only, all_finite
    source: list[slice] = []
    inside: list[slice] = []
    for axis in (2, 1, 0):
        first, last = brick.start[axis] - 1, brick.stop[axis] + 1
        low, high = max(first, 0), min(last, volume.size_xyz[axis] - 1)
        source.append(slice(low, high + 1))
        inside.append(slice(low - first, high - first + 1))
    samples = volume.array[source[0], source[1], source[2]]
    padded = np.empty(shape) if samples.shape == shape else np.full(shape, np.nan)
    padded[inside[0], inside[1], inside[2]] = samples
    all_finite = bool(np.isfinite(samples.min()) and np.isfinite(samples.max()))  # NaN is carried through
    if not all_finite:
        padded[np.isinf(padded)] = np.nan
    padded.setflags(write=False)
    return padded, all_finite

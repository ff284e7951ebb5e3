"""Ground truth of the volume-rendering integral of a closed-form field, in float64.

Along a ray the field is replaced by cubic Hermite pieces, from its values and gradients, which are halved until they
agree with it, and, where the field's slope has a known bound, until nothing visible can hide between their
ends; the pieces are then integrated as the cells of a grid are.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from isosample.errors import CapacityError, InputError
from isosample.integral.band_table import BandTable, Optics, PanelRules
from isosample.integral.box_rays import box_intervals, checked_rays, clipped
from isosample.integral.field_pieces import MAX_PIECES, resolved_pieces
from isosample.integral.level_isolation import Isolation
from isosample.integral.ray_pieces import bernstein
from isosample.integral.reference import DEFAULT_TOLERANCE, offset_of, run_in_blocks

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from isosample.integral.box_rays import Plane
    from isosample.integral.reference import Progress
    from isosample.transfer.transfer_function import TransferFunction
    from isosample.volume.field import Field
    from isosample.volume.geometry import Box

F64 = npt.NDArray[np.float64]


def integrate_field_rays(
    field: Field,
    transfer_function: TransferFunction,
    box: Box,
    origins: npt.ArrayLike,
    directions: npt.ArrayLike,
    *,
    clip_planes: Sequence[Plane] = (),
    tolerance: float = DEFAULT_TOLERANCE,
    progress: Progress | None = None,
) -> F64:
    """Radiance and opacity of rays through a closed-form field inside a box.

    Parameters
    ----------
    field : Field
        Value and gradient at world positions, and the bound of its slope if it has one.
    transfer_function : TransferFunction
    box : Box
        The field counts inside it only.
    origins, directions : (N, 3) array_like of float
        World space, directions of unit length. Only what lies in front of the origin counts.
    clip_planes, progress
        As for `integrate_rays`.
    tolerance : float
        1e-13 to 1e-2; see the notes for what it holds for.

    Returns
    -------
    rgba : (N, 4) float64
        Premultiplied linear RGBA, without background.

    Raises
    ------
    InputError
        As `integrate_rays`; also if the box has no extent, the field is not finite on a ray or the bound of
        its slope is not a number >= 0 or is contradicted by its values.
    CapacityError
        If a ray needs more than 2²² pieces.

    Notes
    -----
    A change of the field by the agreement tolerance / (length of the ray · largest |dτ/dv| + largest |dc/dv|)
    changes depth and colour by at most the tolerance. A ray is cut into 64 equal pieces; a piece is halved
    until the cubic of its ends agrees, in value and in slope, with the field at its middle to within 8 times
    that; the two halves, whose cubics err by 1/16 as much, are then used. This is verification at points.

    Where ``field.lipschitz()`` gives a bound L, the field on a piece [a, b] keeps within
    (f(a) + f(b)) / 2 ± L (b − a) / 2, and a piece is halved as long as that interval reaches a control point, a
    step or an isosurface beyond both f(a) and f(b), or f(a) and f(b) lie on two sides of a step or an
    isosurface (which could be crossed more than once). It is left when the interval reaches

    - no isosurface, or is wider than [f(a), f(b)] by the agreement at most: every crossing of an isosurface
      is found, but for pairs of crossings that a change of the field by the agreement removes; and
    - no extinction τ with τ (b − a) > tolerance: what hides in one piece adds less than the tolerance to the
      optical depth, so that no visible range, however narrow the feature that reaches it, is missed.

    Not guaranteed, even so: a feature between two points whose values keep within the bands (the ranges between
    levels of the transfer function) that the ends of its piece show is verified at points only, and so is
    all of a field without a bound: there a feature narrower than 1/128 of the ray's way through the box may be
    missed. The proof is in real numbers; the rounding of positions, about 1e-16 of them times L, is not in it.
    At a step and at an isosurface the crossing moves by the error of the field divided by its slope, so that
    the error grows where a ray nearly touches them. A ray that keeps within L · s of an isosurface over a
    length l needs about l / s pieces.
    """
    starts, ways = checked_rays(origins, directions)
    matrix, last = _unit_from_world(box), np.ones(3)
    intervals = box_intervals((starts - box.corner) @ matrix.T, ways @ matrix.T, last)
    intervals = clipped(intervals, starts, ways, clip_planes)
    base, bands = _centred_bands(transfer_function)
    reach = float(np.linalg.norm(box.edges, axis=1).sum())
    optics = Optics(bands, PanelRules.for_tolerance(tolerance), 1)
    agreement = tolerance / _sensitivity(bands, reach)
    bound = _checked_bound(field)
    isolation = None if bound is None else Isolation.build(bound, bands, tolerance, agreement)
    rgba = np.zeros((len(starts), 4))

    def work(rows: slice) -> None:
        from isosample.integral.ray_cells import integrate_piece_block

        line = (starts[rows], ways[rows])
        pieces = resolved_pieces(field, base, line, intervals[rows], agreement, isolation)
        if pieces is None:
            _work_on_halves(work, rows, field)
            return
        first = np.searchsorted(pieces.ray, np.arange(len(line[0]) + 1))
        lengths = np.ascontiguousarray(pieces.ends[:, 1] - pieces.ends[:, 0])
        integrate_piece_block((first, bernstein(pieces), lengths), optics, rgba[rows])

    run_in_blocks(work, len(starts), progress)
    return rgba


def _work_on_halves(work: Callable[[slice], None], rows: slice, field: Field) -> None:
    """Work on fewer rays at once; raise where it is one already."""
    if rows.stop - rows.start <= 1:
        raise CapacityError(
            f"ray {rows.start} runs so close to a visible value of {type(field).__name__} that more than "
            f"{MAX_PIECES} pieces do not prove what it meets. Shift the ray or the transfer function a little."
        )
    middle = (rows.start + rows.stop) // 2
    work(slice(rows.start, middle))
    work(slice(middle, rows.stop))


def _checked_bound(field: Field) -> float | None:
    """Bound of the field's slope, if it has one."""
    bound = field.lipschitz()
    if bound is not None and not 0.0 <= bound < np.inf:
        raise InputError(
            f"{type(field).__name__} bounds its slope by {bound!r}; expected a finite number >= 0, or None."
        )
    return bound


def _unit_from_world(box: Box) -> F64:
    """(3, 3) float64, maps world offsets from the box's corner to [0, 1] along its edges."""
    if abs(np.linalg.det(box.edges)) == 0.0:
        raise InputError(f"the box with edges {box.edges.tolist()} has no extent; give it three edges.")
    return np.asarray(np.linalg.inv(box.edges.T), dtype=np.float64)


def _centred_bands(transfer_function: TransferFunction) -> tuple[float, BandTable]:
    """What to subtract from the field, and the bands less that."""
    values = [point.value for point in transfer_function.points]
    values += [surface.value for surface in transfer_function.isosurfaces]
    base = offset_of(min(values), max(values))
    return base, BandTable.from_transfer_function(transfer_function, base)


def _sensitivity(bands: BandTable, reach: float) -> float:
    """Largest change of a component of the picture per change of the field by one data unit, >= 1."""
    inner = slice(1, -1)
    width = np.diff(bands.edges)[inner]
    shown = bands.extinction[inner].max(axis=1, initial=0.0) > 0
    by_depth = np.abs(np.diff(bands.extinction[inner], axis=1)[:, 0]) / width
    by_color = np.abs(np.diff(bands.color[inner], axis=1)[:, 0]).max(axis=1, initial=0.0) / width
    return max(1.0, float(((reach * by_depth + by_color) * shown).max(initial=0.0)))

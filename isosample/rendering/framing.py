"""What a picture is framed by: the box of a volume, or the box of what the transfer function shows of it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from isosample.errors import InputError
from isosample.transfer.transfer_function import check_is_transfer_function
from isosample.transfer.visible_values import visible_intervals
from isosample.volume.grid import check_is_volume
from isosample.volume.macrocells import MacrocellGrid
from isosample.volume.reconstruction import Reconstruction
from isosample.volume.scan import SCAN_BUDGET
from isosample.volume.shown_cells import shown_span
from isosample.volume.value_ranges import ranges_cross

if TYPE_CHECKING:
    from collections.abc import Callable

    from isosample.transfer.transfer_function import TransferFunction
    from isosample.volume.geometry import Box
    from isosample.volume.grid import Volume
    from isosample.volume.macrocells import Bools
    from isosample.volume.scan import BrickScan
    from isosample.volume.shown_cells import Span


def visible_box(
    volume: Volume,
    transfer_function: TransferFunction,
    *,
    reconstruction: Reconstruction = Reconstruction.TRILINEAR,
    progress: Callable[[int, int], None] | None = None,
) -> Box:
    """Smallest box of whole cells that holds all that a transfer function shows of a volume.

    For `Camera.orbit`, in place of `volume.box`: what is visible fills the picture, and the eye keeps its distance
    from the middle of it on all of a turn. Clip planes, light and opacity have no part in it.

    Parameters
    ----------
    volume : Volume
    transfer_function : TransferFunction
    reconstruction : Reconstruction
        Of the picture.
    progress : callable, optional
        Called with (bricks done, bricks in all).

    Returns
    -------
    box : Box
        Of the cells in which the trilinear field has extinction, or crosses an isosurface of the transfer function. A
        smooth reconstruction may show something beyond, where it differs from that field. Where it alone can show
        anything, as it reaches values that no sample has: of the macrocells whose bounds of it (`MacrocellGrid`) meet
        such values.

    Raises
    ------
    InputError
        If the transfer function shows nothing of the volume, an argument is of another type, or the volume has no such
        reconstruction.
    """
    span = visible_span(volume, transfer_function, reconstruction=reconstruction, progress=progress)
    if span is None:
        raise nothing_to_fit(volume.name, volume.value_range)
    return volume.geometry.box_of(*span)


def visible_span(
    volume: Volume,
    transfer_function: TransferFunction,
    *,
    reconstruction: Reconstruction = Reconstruction.TRILINEAR,
    scan: BrickScan | None = None,
    budget_bytes: int = SCAN_BUDGET,
    progress: Callable[[int, int], None] | None = None,
) -> Span | None:
    """First and last sample (x, y, z) of `visible_box`; None where nothing is visible. As of `shown_span`."""
    check_is_volume(volume)
    check_is_transfer_function(transfer_function)
    intervals = visible_intervals(transfer_function, isosurfaces=False)
    levels = [surface.value for surface in transfer_function.isosurfaces]
    span = shown_span(
        volume, intervals, levels=levels, scan=scan, budget_bytes=budget_bytes, progress=progress
    )
    if span is not None or not reconstruction.smooth:
        return span
    grid = MacrocellGrid.build(volume, reconstruction)  # which may reach beyond all samples
    return _span_of(grid, grid.occupancy(intervals) | ranges_cross(grid.low, grid.high, levels))


def _span_of(grid: MacrocellGrid, occupied: Bools) -> Span | None:
    """First and last sample (x, y, z) of the smallest box around some macrocells; None around none."""
    if not occupied.any():
        return None
    places = np.argwhere(occupied)[:, ::-1]
    x, y, z = (grid.cells * places.min(axis=0)).tolist()
    ends = grid.cells * (places.max(axis=0) + 1)
    u, v, w = np.minimum(ends, np.subtract(grid.volume.size_xyz, 1)).tolist()
    return (x, y, z), (u, v, w)


def nothing_to_fit(name: str, value_range: tuple[float, float]) -> InputError:
    """Return the error of a picture that is to be filled by what is visible, where nothing is."""
    low, high = value_range
    return InputError(
        f"the transfer function shows nothing of {name}, whose values go from {low:g} to {high:g}: there is "
        "nothing to fit into the picture. Frame the volume's box (--fit volume), or change the transfer function."
    )

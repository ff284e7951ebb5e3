"""Pre-integration tables: what a stretch of a ray adds, by the values at its two ends and its length.

Along a stretch the value runs linearly. A stretch from node i to node i + k of the table runs through k intervals of
values in equal lengths d/k; what intervals of that length add is composited for all i at once, with two compositions
per entry (a running product over windows [3]_), so that a table of n by n entries takes O(n²) operations.

Importing this module imports numba.

References
----------
.. [1] K. Engel, M. Kraus, T. Ertl, "High-quality pre-integrated volume rendering using hardware-accelerated pixel
   shading", Graphics Hardware, 2001.
.. [2] E. Lum, B. Wilson, K.-L. Ma, "High-quality lighting and efficient pre-integration for volume rendering",
   VisSym, 2004.
.. [3] M. van Herk, "A fast algorithm for local minimum and maximum filters on rectangular and octagonal kernels",
   Pattern Recognition Letters 13(7), 1992.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import numpy.typing as npt

from isosample.compiled import compiled
from isosample.errors import InputError
from isosample.transfer.table_sizes import check_table

if TYPE_CHECKING:
    from isosample.transfer.value_bands import ValueBands

F32 = npt.NDArray[np.float32]
F64 = npt.NDArray[np.float64]
I64 = npt.NDArray[np.int64]

SPENT = 40.0  # optical depth behind which nothing is seen: exp(-40) = 4e-18
NODES = (0.069431844202973712, 0.33000947820757187, 0.66999052179242813, 0.93056815579702629)
WEIGHTS = (0.17392742256872693, 0.32607257743127307, 0.32607257743127307, 0.17392742256872693)


class ValuePieces(NamedTuple):
    """The transfer function between 0 and 1, cut at the nodes of a table and at its own levels.

    Attributes
    ----------
    starts : (n,) int64
        First piece of every interval between two nodes; the last entry is the number of pieces P.
    parts : (P,) float64
        Width of a piece in widths of its interval.
    optics : (P, 2, 4) float64
        Straight linear RGB and extinction at its lower and upper end.
    impulses : (P, 4) float64
        Straight linear RGB and opacity of an isosurface at its upper end.
    """

    starts: I64
    parts: F64
    optics: F64
    impulses: F64

    @classmethod
    def of(cls, bands: ValueBands, size: int) -> ValuePieces:
        """Pieces of a transfer function for `size` nodes."""
        nodes = np.linspace(0.0, 1.0, size)
        inner = bands.levels[(bands.levels > 0.0) & (bands.levels <= 1.0)]
        cuts = np.unique(np.concatenate([nodes, inner]))
        low, high = cuts[:-1], cuts[1:]
        middle = np.searchsorted(bands.levels, 0.5 * (low + high), side="right")
        impulses = np.zeros((len(low), 4))
        shown = (bands.impulses[:, 3] > 0.0) & (bands.levels > 0.0) & (bands.levels <= 1.0)
        impulses[np.searchsorted(high, bands.levels[shown])] = bands.impulses[shown]
        return cls(
            starts=np.searchsorted(low, nodes).astype(np.int64),
            parts=(high - low) * (size - 1),
            optics=np.stack([bands.within(middle, low), bands.within(middle, high)], axis=1),
            impulses=impulses,
        )


def length_table(bands: ValueBands, size: int, length: float) -> F32:
    """Table for stretches of one length.

    Parameters
    ----------
    bands : ValueBands
    size : int
        Nodes along an edge, at the normalised values 0 … 1.
    length : float
        [world]

    Returns
    -------
    table : (size, size, 4) float32
        ``table[back, front]``: premultiplied linear RGB and opacity of a stretch from node `front` to node `back`,
        with its own attenuation, isosurfaces included.

    Raises
    ------
    InputError
        If there are less than two nodes, or the length is not above 0.
    CapacityError
        If the table takes more than `table_sizes.LARGEST_TABLE_BYTES`.
    """
    table: F32 = length_tables(bands, size, np.array([length]))[0]
    return table


def length_tables(bands: ValueBands, size: int, lengths: npt.ArrayLike) -> F32:
    """Tables (L, size, size, 4) float32 for L lengths; otherwise as `length_table`."""
    ways = np.asarray(lengths, dtype=np.float64)
    if size < 2 or not (ways > 0.0).all() or not np.isfinite(ways).all():
        raise InputError(
            f"a table of {size} nodes for lengths {ways.tolist()}; expected two nodes, lengths above 0."
        )
    check_table(size, len(ways))
    pieces = ValuePieces.of(bands, size)
    constant = bands.evaluate(np.linspace(0.0, 1.0, size))
    tables = np.zeros((len(ways), size, size, 4), dtype=np.float32)
    for table, way in zip(tables, ways, strict=True):
        _fill_table(*pieces, constant, float(way), table)
    return tables


def value_integrals(bands: ValueBands, cells: int) -> F32:
    """Integrals of emission and extinction over the normalised value, from which the mean along any stretch follows.

    Parameters
    ----------
    bands : ValueBands
    cells : int
        Parts of [0, 1], at least 1.

    Returns
    -------
    integrals : (3, cells, 4) float32
        Of premultiplied linear RGB and extinction [1/world]: the integral from 0 to the lower end of every cell; what
        rounding took from that, so that differences of integrals are known where they are small; and the mean over the
        cell. Isosurfaces are left out.

    Raises
    ------
    InputError
        If there is no cell.
    """
    if cells < 1:
        raise InputError(f"integrals over {cells} cells; expected at least 1.")
    pieces = ValuePieces.of(bands, cells + 1)
    low, high = pieces.optics[:, 0], pieces.optics[:, 1]
    emission = low[:, :3] * (2.0 * low[:, 3:] + high[:, 3:]) + high[:, :3] * (low[:, 3:] + 2.0 * high[:, 3:])
    means = np.concatenate([emission / 6.0, 0.5 * (low[:, 3:] + high[:, 3:])], axis=1)
    over_cells = np.add.reduceat(pieces.parts[:, None] * means, pieces.starts[:-1])
    before = np.cumsum(over_cells, axis=0) - over_cells
    exact = before / cells
    rounded = exact.astype(np.float32)
    return np.stack([rounded, (exact - rounded).astype(np.float32), over_cells.astype(np.float32)])


@compiled
def _weights(x0: float, x1: float) -> tuple[float, float]:
    """Weights of the front and back colour, as `segment_weights` of ``integral/optics.py``, to 5e-7."""
    opacity = -math.expm1(-0.5 * (x0 + x1))
    front, u = 0.0, 0.0
    slope = x1 - x0
    while u < 1.0 and u * (x0 + 0.5 * u * slope) < SPENT:
        here = x0 + slope * u
        discriminant = here * here + slope
        end = 1.0
        if discriminant > 0.0:
            end = min(1.0, u + 1.0 / max(here + math.sqrt(discriminant), 1e-300))
        for i in range(4):
            node = u + (end - u) * NODES[i]
            front -= (end - u) * WEIGHTS[i] * math.expm1(-node * (x0 + 0.5 * node * slope))
        u = end
    front = min(front + (1.0 - u), opacity)
    return front, opacity - front


@compiled
def _append(total: F64, red: float, green: float, blue: float, opacity: float) -> None:
    """Composite something behind what `total` holds."""
    through = 1.0 - total[3]
    total[0] += through * red
    total[1] += through * green
    total[2] += through * blue
    total[3] += through * opacity


@compiled
def _append_piece(total: F64, front: F64, back: F64, way: float) -> None:
    if front[3] <= 0.0 and back[3] <= 0.0:
        return
    near, far = _weights(front[3] * way, back[3] * way)
    _append(
        total,
        near * front[0] + far * back[0],
        near * front[1] + far * back[1],
        near * front[2] + far * back[2],
        near + far,
    )


@compiled
def _append_impulse(total: F64, impulse: F64) -> None:
    opacity = impulse[3]
    if opacity > 0.0:
        _append(total, opacity * impulse[0], opacity * impulse[1], opacity * impulse[2], opacity)


@compiled
def _cross_interval(
    first: int, stop: int, parts: F64, optics: F64, impulses: F64, way: float, rising: bool, total: F64
) -> None:
    """What one interval of values adds, crossed in a length."""
    total[:] = 0.0
    for i in range(stop - first):
        if rising:
            piece = first + i
            _append_piece(total, optics[piece, 0], optics[piece, 1], parts[piece] * way)
            _append_impulse(total, impulses[piece])
        else:
            piece = stop - 1 - i
            _append_impulse(total, impulses[piece])
            _append_piece(total, optics[piece, 1], optics[piece, 0], parts[piece] * way)


@compiled
def _over(front: F64, back: F64, result: F64) -> None:
    through = 1.0 - front[3]
    for i in range(4):
        result[i] = front[i] + through * back[i]


@compiled
def _running(items: F64, count: int, backward: bool, before: F64, after: F64) -> None:
    """Products of the items from the start of their block of `count` to each, and from each to its end.

    With `backward` a later item stands in front of an earlier one.
    """
    for i in range(len(items)):
        if i % count == 0:
            before[i] = items[i]
        elif backward:
            _over(items[i], before[i - 1], before[i])
        else:
            _over(before[i - 1], items[i], before[i])
    for i in range(len(items) - 1, -1, -1):
        if i % count == count - 1 or i == len(items) - 1:
            after[i] = items[i]
        elif backward:
            _over(after[i + 1], items[i], after[i])
        else:
            _over(items[i], after[i + 1], after[i])


@compiled
def _fill_table(
    starts: I64, parts: F64, optics: F64, impulses: F64, constant: F64, length: float, table: F32
) -> None:
    """Fill in ``table[back, front]``."""
    size = len(starts)
    items, before, after = np.empty((size - 1, 4)), np.empty((size - 1, 4)), np.empty((size - 1, 4))
    total = np.zeros(4)
    for i in range(size):
        total[:] = 0.0
        _append_piece(total, constant[i], constant[i], length)
        table[i, i] = total
    for count in range(1, size):
        for direction in range(2):
            rising = direction == 0
            for i in range(size - 1):
                _cross_interval(
                    starts[i], starts[i + 1], parts, optics, impulses, length / count, rising, items[i]
                )
            _running(items, count, not rising, before, after)
            for i in range(size - count):
                last = i + count - 1
                if i % count == 0:
                    total[:] = before[last]
                elif rising:
                    _over(after[i], before[last], total)
                else:
                    _over(before[last], after[i], total)
                if rising:
                    table[i + count, i] = total
                else:
                    table[i, i + count] = total

"""A transfer function for a first picture, from the histogram of a volume alone."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from isosample.errors import InputError
from isosample.transfer.control_points import ControlPoint
from isosample.transfer.transfer_function import TransferFunction
from isosample.volume.grid import check_is_volume

if TYPE_CHECKING:
    from isosample.transfer.control_points import Color
    from isosample.volume.grid import Volume

F64 = npt.NDArray[np.float64]

BIN_COUNT = 256
ROUNDING_ULP = 4 * BIN_COUNT  # a narrower range has no room for as many bins in float64
LABEL_COUNT = 32  # no more bins than this are taken for labels, masks or other lone values
LAYER_COUNT = 3
COLORS: tuple[Color, ...] = ((0.05, 0.22, 0.60), (0.80, 0.16, 0.06), (0.95, 0.80, 0.52))  # outer to inner
OPTICAL_DEPTHS = (0.35, 0.9, 2.5)  # mean over the silhouette of each layer, outer to inner
MODE_SHARE = 0.02  # a bin beside the background's mode belongs to it down to this share of its count
TAIL_SHARE = 1e-4  # share of the foreground's samples above the value where layers end
WIDTH_SHARE = 0.4  # half-width of a layer, as a share of the distance to its neighbours
MAX_DEPTH_PER_SAMPLE = 4.0  # bounds extinction where a layer holds hardly any sample


def suggest_transfer_function(volume: Volume) -> TransferFunction:
    """Transfer function that makes a first picture of a volume.

    Parameters
    ----------
    volume : Volume
        Any scan or simulation; the low values are taken for its surroundings.

    Returns
    -------
    transfer_function : TransferFunction
        Three layers: an outer translucent tent, a denser one, and a dense core that reaches to the maximum,
        with nothing visible between them. The same volume always gives the same function.

    Raises
    ------
    InputError
        If all samples are equal (but for rounding), or none is finite.

    Notes
    -----
    Samples about the lowest mode, where it is the highest one, are the surroundings. Above them the layers lie
    at the borders of four classes of values whose variance within classes is least [1]_, with counts
    replaced by their square roots, so that small and large materials both have a say.

    A layer of peak extinction τ that holds the volume V and whose silhouette has the area A has the mean
    optical depth ½ τ V / A; A is that of a ball as large as all samples at or above the layer. So τ follows
    the box's units and its size, and thin layers become as visible as thick ones.

    References
    ----------
    .. [1] N. Otsu, "A threshold selection method from gray-level histograms", IEEE Trans. SMC 9(1), 1979.
    """
    from isosample.volume.statistics import histogram

    check_is_volume(volume)
    low, high = volume.value_range
    if high - low <= ROUNDING_ULP * np.spacing(max(abs(low), abs(high))):
        raise InputError(
            f"{volume.name} is constant ({low:g}{' but for rounding' if high > low else ''}); "
            "no transfer function suggests itself. Give one (--tf)."
        )
    counts, edges = histogram(volume, bins=BIN_COUNT)
    return _transfer_function(counts.astype(np.float64), edges, volume)


def _transfer_function(counts: F64, edges: F64, volume: Volume) -> TransferFunction:
    """Three layers for a volume whose samples have this histogram."""
    counts, edges = _even_bins(counts, edges, volume.value_range)
    start, stop = _foreground(counts)
    centres = _class_borders(np.sqrt(counts[start:stop])) + start
    centre_values = np.interp(centres, np.arange(len(edges)), edges)
    gaps = np.diff([edges[start], *centre_values, edges[stop]])
    half_widths = WIDTH_SHARE * np.minimum(gaps[:-1], gaps[1:])
    points: list[ControlPoint] = []
    for layer, (centre, half_width) in enumerate(zip(centre_values, half_widths, strict=True)):
        span = (centre - half_width, centre + half_width if layer < LAYER_COUNT - 1 else edges[-1])
        extinction = _layer_extinction(counts, edges, span, OPTICAL_DEPTHS[layer], volume.spacing)
        corners = [(span[0], 0.0), (centre, extinction)]
        corners.append((span[1], extinction if layer == LAYER_COUNT - 1 else 0.0))
        points += [ControlPoint(float(value), COLORS[layer], float(tau)) for value, tau in corners]
    return TransferFunction(points)


def _even_bins(counts: F64, edges: F64, value_range: tuple[float, float]) -> tuple[F64, F64]:
    """Count anew in `BIN_COUNT` bins of equal width over the range, so that all kinds of samples are alike.

    A few values are labels and stay where they are; the samples of more bins are spread evenly over each,
    because the empty bins of a comb would be taken for the end of the surroundings.
    """
    even_edges = np.linspace(*value_range, BIN_COUNT + 1)
    if len(counts) <= LABEL_COUNT:
        middles = np.clip(0.5 * (edges[:-1] + edges[1:]), *value_range)
        return np.histogram(middles, even_edges, weights=counts)[0], even_edges
    cumulative = np.concatenate([[0.0], np.cumsum(counts)])
    return np.diff(np.interp(even_edges, np.clip(edges, *value_range), cumulative)), even_edges


def _foreground(counts: F64) -> tuple[int, int]:
    """Half-open range of the bins above the surroundings' mode and below the sparse tail, >= 8 bins wide."""
    count = len(counts)
    mode = int(counts.argmax())
    start = 0
    if mode < count // 3:
        below = np.flatnonzero(counts[mode:] < MODE_SHARE * counts[mode])
        start = mode + int(below[0]) if below.size else mode
    above = np.cumsum(counts[::-1])[::-1]  # samples at or above each bin
    tail = np.flatnonzero(above > TAIL_SHARE * above[start]) if above[start] > 0 else np.array([count - 1])
    stop = int(tail[-1]) + 1
    if stop - start < 8:
        return (min(start, count - 8), count)
    return start, stop


def _class_borders(weights: F64) -> F64:
    """(LAYER_COUNT,) borders between classes of bins with the least variance within classes, ascending.

    Dynamic programming over the number of classes; a border lies between two bins. Empty bins weigh a little,
    so that the result is unique and a histogram of a few spikes is split evenly.
    """
    weights = weights + 1e-3 * max(float(weights.mean()), 1e-12)
    bins = np.arange(len(weights), dtype=np.float64) + 0.5
    mass, first, second = (
        np.concatenate([[0.0], np.cumsum(weights * power)]) for power in (np.ones_like(bins), bins, bins**2)
    )
    index = np.arange(len(weights) + 1)
    begin, end = index[:, None], index[None, :]
    class_mass = mass[end] - mass[begin]
    with np.errstate(divide="ignore", invalid="ignore"):
        spread = (second[end] - second[begin]) - (first[end] - first[begin]) ** 2 / class_mass
    spread[end <= begin] = np.inf
    best, choices = spread[0], []
    for _ in range(LAYER_COUNT):
        total = best[:, None] + spread
        choices.append(total.argmin(axis=0))
        best = total.min(axis=0)
    borders = [len(weights)]
    for choice in reversed(choices):
        borders.append(int(choice[borders[-1]]))
    return np.array(borders[:0:-1], dtype=np.float64)


def _layer_extinction(
    counts: F64,
    edges: F64,
    span: tuple[float, float],
    optical_depth: float,
    spacing: tuple[float, float, float],
) -> float:
    """Peak extinction [1/world] of a layer over the values `span` that has the mean `optical_depth`."""
    cumulative = np.concatenate([[0.0], np.cumsum(counts)])
    below_low, below_high = np.interp(span, edges, cumulative)
    voxel = float(np.prod(spacing))
    above_volume = (cumulative[-1] - below_low) * voxel
    layer_volume = (below_high - below_low) * voxel
    silhouette = np.pi * (0.75 / np.pi * above_volume) ** (2 / 3)
    limit = MAX_DEPTH_PER_SAMPLE / min(spacing)
    return float(min(2 * optical_depth * silhouette / layer_volume, limit)) if layer_volume > 0 else limit

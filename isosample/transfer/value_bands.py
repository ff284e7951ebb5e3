"""The transfer function in normalised values, band by band: what lookups on the GPU and their tables are made from."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import numpy.typing as npt

if TYPE_CHECKING:
    from isosample.transfer.transfer_function import TransferFunction

F32 = npt.NDArray[np.float32]
F64 = npt.NDArray[np.float64]

LOWEST, HIGHEST = -4.0, 5.0  # normalised values that a reconstruction of samples in [0, 1] can come near to
CLOSING = 2.0**-24  # by which the last control point is raised at least: half the spacing of float32 at 1


class ValueBands(NamedTuple):
    """The transfer function between its levels, for values in units of the volume's range.

    Attributes
    ----------
    levels : (K,) float64
        Never descending float32 numbers in [`LOWEST`, `HIGHEST`]: control points and isosurfaces. A value equal
        to a level belongs to the band above; the last control point is one float32 number higher than it is
        (`CLOSING` at least), so that its own value belongs to the band below (`TransferFunction.evaluate`). Levels
        that are one float32 number, but have extinction between them, are moved apart, down by one such number each.
    ends : (K + 1, 2) float64
        Lower and upper end of every band; the outer ones end at `LOWEST` and `HIGHEST`.
    optics : (K + 1, 2, 4) float64
        Straight linear RGB and extinction [1/world] at the two ends, linear between them. The extinction is scaled by
        what rounding did to the width of the band, so that its integral is kept, however narrow it is.
    impulses : (K, 4) float64
        Straight linear RGB and opacity of a crossing of each level; 0 where it is no isosurface.
    """

    levels: F64
    ends: F64
    optics: F64
    impulses: F64

    @classmethod
    def of(cls, transfer_function: TransferFunction, origin: float, inverse_width: float) -> ValueBands:
        """Bands of a transfer function, for values (v − `origin`) · `inverse_width`."""
        surfaces = {surface.value: surface for surface in transfer_function.isosurfaces}
        points = [point.value for point in transfer_function.points]
        last = points[-1] if points else None
        below, above = origin + LOWEST / inverse_width, origin + HIGHEST / inverse_width
        values = [value for value in sorted({*points, *surfaces}) if below < value < above]
        numbers: list[np.float32] = []
        data_values: list[float] = []
        impulses: list[tuple[float, ...]] = []
        for value in values:
            number = np.float32((value - origin) * inverse_width)
            if value in surfaces:
                impulses.append((*surfaces[value].color, surfaces[value].opacity))
                numbers.append(number)
                data_values.append(value)
            if value == last or value not in surfaces:
                impulses.append((0.0, 0.0, 0.0, 0.0))
                numbers.append(_closing(number) if value == last else number)
                data_values.append(value)
        edges = np.array([below, *data_values, above])
        optics = _optics(transfer_function, edges)
        levels = _levels(np.array(numbers, dtype=np.float32), optics)
        ends = np.array([LOWEST, *levels, HIGHEST])
        _keep_integrals(optics, np.diff(edges) * inverse_width, np.diff(ends))
        return cls(
            levels=levels,
            ends=np.stack([ends[:-1], ends[1:]], axis=-1),
            optics=optics,
            impulses=np.array(impulses).reshape(-1, 4),
        )

    def evaluate(self, values: npt.ArrayLike) -> F64:
        """Straight linear RGB and extinction at normalised values.

        Parameters
        ----------
        values : (...) array_like of float
            Any; beyond the outermost ends as at them.

        Returns
        -------
        optics : (..., 4) float64
        """
        values = np.asarray(values, dtype=np.float64)
        return self.within(np.searchsorted(self.levels, values, side="right"), values)

    def within(self, bands: npt.NDArray[np.intp], values: F64) -> F64:
        """The same, of the bands that hold the values (or end at them)."""
        low, high = self.ends[bands, 0], self.ends[bands, 1]
        width = high - low
        part = np.clip(np.where(width > 0.0, values - low, 0.0) / np.where(width > 0.0, width, 1.0), 0.0, 1.0)
        optics: F64 = self.optics[bands, 0] + part[..., None] * (
            self.optics[bands, 1] - self.optics[bands, 0]
        )
        return optics


def _closing(number: np.float32) -> np.float32:
    """The next float32 number, not a subnormal one."""
    return np.float32(number + max(np.spacing(abs(number)), np.float32(CLOSING)))


def _levels(numbers: F32, optics: F64) -> F64:
    """Levels from rounded values: never descending, and apart where there is extinction between two.

    Levels move down, so that values equal to a control point stay above it.
    """
    levels = np.maximum.accumulate(
        numbers
    )  # the last control point is raised, past an isosurface close to it
    visible = optics[1:-1, :, 3].max(axis=1, initial=0.0) > 0.0
    for i in range(len(visible) - 1, -1, -1):
        highest = np.nextafter(levels[i + 1], np.float32(-np.inf)) if visible[i] else levels[i + 1]
        levels[i] = min(levels[i], highest)
    # No value of a volume is as far out as these two, past which levels close to them may have moved.
    return np.clip(levels, LOWEST, HIGHEST).astype(np.float64)


def _optics(transfer_function: TransferFunction, edges: F64) -> F64:
    """(K + 1, 2, 4) optics at the ends of the bands; one between two levels of one value has the limit from below."""
    color_low, extinction_low = transfer_function.evaluate(edges[:-1], side="right")
    color_high, extinction_high = transfer_function.evaluate(edges[1:], side="left")
    closing = edges[:-1] == edges[1:]
    color_low[closing], extinction_low[closing] = color_high[closing], extinction_high[closing]
    return np.stack(
        [
            np.concatenate([color_low, extinction_low[:, None]], axis=-1),
            np.concatenate([color_high, extinction_high[:, None]], axis=-1),
        ],
        axis=1,
    )


def _keep_integrals(optics: F64, exact_widths: F64, widths: F64) -> None:
    """Scale the extinction of every band by what rounding did to its width."""
    kept = (widths > 0.0) & (exact_widths > 0.0)
    optics[kept, :, 3] *= (exact_widths[kept] / widths[kept])[:, None]

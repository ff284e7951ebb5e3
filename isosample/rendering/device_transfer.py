"""The transfer function on the GPU, as the ray caster reads it: bands and levels, and the tables of its methods."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from isosample.errors import CapacityError
from isosample.gl.context import limits
from isosample.rendering.frame import shared_constants, storage_dtype
from isosample.rendering.raycast_settings import (
    Classification,
    Crossings,
    Integration,
    PeakMode,
    PeakWeight,
    Quadrature,
    TransferLookup,
)
from isosample.transfer.peaks import find_peaks, peak_table
from isosample.transfer.value_bands import HIGHEST, LOWEST, ValueBands

if TYPE_CHECKING:
    import moderngl

    from isosample.rendering.raycast_settings import RaycastSettings
    from isosample.rendering.scene import ValueScale
    from isosample.transfer.transfer_function import TransferFunction

    F64 = npt.NDArray[np.float64]

METHODS = {
    Classification.POST_CLASSIFIED: 0,
    Classification.PRE_INTEGRATED: 1,
    Classification.PEAK_FINDING: 2,
}
QUADRATURES = {Quadrature.RIEMANN: 0, Quadrature.TRAPEZOID: 1}
INTEGRATIONS = {Integration.EXACT: 0, Integration.TABLE_2D: 1, Integration.TABLE_3D: 2}
PEAK_MODES = {PeakMode.BOTH: 0, PeakMode.XOR: 1, PeakMode.PEAK_ONLY: 2, PeakMode.DVR_ONLY: 3}
PEAK_WEIGHTS = {PeakWeight.PAPER: 0, PeakWeight.INTEGRAL: 1}
CROSSINGS = {Crossings.SECANT: 0, Crossings.EXACT: 1}
LOOKUPS = {TransferLookup.EXACT: 0, TransferLookup.TEXTURE: 1}
LEAST_WIDTH = 1e-30  # of a band that has an inside; the inverse is a float32 number


class DeviceTransfer:
    """Buffers and textures of one transfer function for one method.

    Parameters
    ----------
    ctx : moderngl.Context
    transfer_function : TransferFunction
    scale : ValueScale
        Of the volume.
    settings : RaycastSettings
    base_length : float
        Length of the stretches that a pre-integration table is made for [world].

    Raises
    ------
    CapacityError
        If a table is larger than the driver's storage blocks or textures.
    """

    def __init__(
        self,
        ctx: moderngl.Context,
        transfer_function: TransferFunction,
        scale: ValueScale,
        settings: RaycastSettings,
        base_length: float,
    ) -> None:
        self._settings, self._base_length = settings, base_length
        self._bands = ValueBands.of(transfer_function, scale.low, scale.inverse_width)
        self._intervals = visible_intervals(transfer_function)
        self.not_shown = self._count_hidden(transfer_function)
        peaks = (
            shown_peaks(transfer_function, scale) if self._finds_peaks else np.zeros(0, storage_dtype("Peak"))
        )
        self._peak_count = len(peaks)
        records = {
            "BANDS": band_records(self._bands),
            "LEVELS": level_records(self._bands, peaks, settings.peak_weight),
            "BAND_STARTS": band_starts(self._bands.levels, shared_constants()["BAND_START_COUNT"]),
            "PEAKS": _at_least_one(peaks),
        }
        _check_sizes(records, limits(ctx).storage_block_bytes)
        self._buffers = {name: ctx.buffer(table) for name, table in records.items()}
        self._textures: dict[str, moderngl.Texture] = {}
        if self._finds_peaks and settings.crossings is Crossings.SECANT:
            table = peak_table(peaks["value"], settings.peak_bins)
            texture = ctx.texture(table.shape[1::-1], 4, table, dtype="u2")
            texture.filter = (ctx.NEAREST, ctx.NEAREST)
            self._textures["PEAK_TABLE"] = texture

    def bind(self) -> None:
        """Bind what the programs with `constants` read."""
        for name, buffer in self._buffers.items():
            buffer.bind_to_storage_buffer(shared_constants()[f"BINDING_{name}"])
        for name, texture in self._textures.items():
            texture.use(shared_constants()[f"UNIT_{name}"])

    def constants(self) -> dict[str, int]:
        """Compile-time constants of the ray caster's entry files that the classification chooses."""
        settings = self._settings
        return {
            "TRANSFER": LOOKUPS[settings.transfer_lookup],
            "METHOD": METHODS[settings.classification],
            "QUADRATURE": QUADRATURES[settings.quadrature],
            "INTEGRATION": INTEGRATIONS[settings.integration],
            "PEAK_MODE": PEAK_MODES[settings.peak_mode],
            "PEAK_WEIGHT": PEAK_WEIGHTS[settings.peak_weight],
            "CROSSINGS": CROSSINGS[settings.crossings],
            "PEAKS": settings.peaks,
        }

    def fill(self, block: np.void) -> None:
        """Fill in the members of a struct Raycast that tell of the transfer function."""
        block["band_count"] = len(self._bands.ends)
        block["peak_count"] = self._peak_count
        block["root_iterations"] = self._settings.root_iterations

    def visible_intervals(self) -> F64:
        """(N, 2) float64, closed intervals of data values that can be seen, isosurfaces as points; ascending."""
        return self._intervals

    def release(self) -> None:
        """Free every buffer and texture."""
        for buffer in self._buffers.values():
            buffer.release()
        for texture in self._textures.values():
            texture.release()
        self._buffers, self._textures = {}, {}

    @property
    def _finds_peaks(self) -> bool:
        return self._settings.classification is Classification.PEAK_FINDING

    def _count_hidden(self, transfer_function: TransferFunction) -> dict[str, int]:
        """What of the transfer function the method cannot show."""
        hidden = len(transfer_function.isosurfaces)
        return {"isosurfaces": hidden} if hidden and not self._shows_isosurfaces() else {}

    def _shows_isosurfaces(self) -> bool:
        if self._settings.classification is Classification.PEAK_FINDING:
            return self._settings.peak_mode is not PeakMode.DVR_ONLY
        return self._settings.classification is Classification.PRE_INTEGRATED


def visible_intervals(transfer_function: TransferFunction) -> F64:
    """(N, 2) float64, closed intervals of data values with extinction, and isosurfaces as points.

    Ascending by their lower ends; neighbouring slopes are one interval each.
    """
    slopes = [(slope.low.value, slope.high.value) for slope in transfer_function.slopes() if slope.visible]
    points = [(surface.value, surface.value) for surface in transfer_function.isosurfaces]
    return np.array(sorted([*slopes, *points]), dtype=np.float64).reshape(-1, 2)


def band_records(bands: ValueBands) -> npt.NDArray[np.void]:
    """(K + 1,) struct Band; ends and widths are those of the float32 numbers that the shader compares.

    The extinction is scaled by what rounding did to the width, so that narrow peaks keep their integral.
    """
    records = np.zeros(len(bands.ends), dtype=storage_dtype("Band"))
    records["low"], records["high"] = bands.optics[:, 0], bands.optics[:, 1]
    records["value_low"], records["value_high"] = bands.ends[:, 0], bands.ends[:, 1]
    width = bands.ends[:, 1] - bands.ends[:, 0]
    stretched = bands.widths / np.where(width > 0.0, width, 1.0)
    for end in ("low", "high"):
        records[end][:, 3] *= stretched.astype(np.float32)
    records["extinction_max"] = np.maximum(records["low"][:, 3], records["high"][:, 3])
    wide = width > LEAST_WIDTH
    records["inverse_width"] = np.where(wide, 1.0, 0.0) / np.where(wide, width, 1.0)
    return records


def level_records(bands: ValueBands, peaks: npt.NDArray[np.void], weight: PeakWeight) -> npt.NDArray[np.void]:
    """(max(K, 1),) struct Level, for walks through the bands.

    The sheet of a level that is a peak of the extinction is what the paper composites there: its colour and the
    opacity of its extinction over a length of 1; with the weight `INTEGRAL` it is a mark, with red 1 and opacity 0.
    """
    records = np.zeros(max(len(bands.levels), 1), dtype=storage_dtype("Level"))
    records["impulse"][: len(bands.levels)] = bands.impulses
    for peak in peaks[peaks["isosurface"] == 0]:
        level = int(np.abs(bands.levels - peak["value"]).argmin())
        opacity = -np.expm1(-float(peak["color"][3]))
        records["sheet"][level] = (
            (1, 0, 0, 0) if weight is PeakWeight.INTEGRAL else (*peak["color"][:3], opacity)
        )
    return records


def shown_peaks(transfer_function: TransferFunction, scale: ValueScale) -> npt.NDArray[np.void]:
    """(P,) struct Peak, of those that values of the volume can come near to, ascending."""
    found = [
        peak
        for peak in find_peaks(transfer_function)
        if LOWEST < (peak.value - scale.low) * scale.inverse_width < HIGHEST
    ]
    records = np.zeros(len(found), dtype=storage_dtype("Peak"))
    for record, peak in zip(records, found, strict=True):
        places = scale.normalise(np.array([peak.value, peak.low, peak.high]))
        record["value"], record["low"], record["high"] = np.clip(places, LOWEST, HIGHEST)
        record["color"] = (*peak.color, peak.strength)
        record["isosurface"] = peak.isosurface
    return records


def band_starts(levels: F64, count: int) -> npt.NDArray[np.uint32]:
    """(count + 1,) uint32: the band of a value in bin i of [0, 1] is one of entry i to entry i + 1.

    The outer bins hold all values beyond them.
    """
    starts = np.searchsorted(levels, np.arange(count + 1) / count, side="right")
    starts[0], starts[-1] = 0, len(levels)
    return starts.astype(np.uint32)


def _at_least_one(records: npt.NDArray[np.void]) -> npt.NDArray[np.void]:
    """The records, or one of zeros: a buffer cannot be empty."""
    return records if len(records) else np.zeros(1, dtype=records.dtype)


def _check_sizes(records: dict[str, npt.NDArray[np.generic]], block_bytes: int) -> None:
    for name, table in records.items():
        if table.nbytes > block_bytes:
            raise CapacityError(
                f"the ray caster's table of {name.lower()} takes {table.nbytes} bytes; this driver's storage blocks "
                f"hold {block_bytes}. Use a transfer function of fewer points."
            )

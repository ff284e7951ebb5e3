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
from isosample.rendering.transfer_records import (
    band_records,
    band_starts,
    level_records,
    shown_peaks,
    visible_intervals,
)
from isosample.transfer.peaks import peak_table
from isosample.transfer.table_sizes import layer_lengths
from isosample.transfer.value_bands import ValueBands

if TYPE_CHECKING:
    import moderngl

    from isosample.rendering.raycast_settings import RaycastSettings
    from isosample.rendering.scene import ValueScale
    from isosample.transfer.transfer_function import TransferFunction

    F32 = npt.NDArray[np.float32]
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
TRANSFER_SIZE = 8192  # entries of the sampled transfer function, as Knoll et al. 2009 have it


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
        self._textures: dict[str, moderngl.Texture | moderngl.Texture3D] = {}
        try:
            self._make_textures(ctx, peaks)
        except CapacityError:
            self.release()
            raise

    def _make_textures(self, ctx: moderngl.Context, peaks: npt.NDArray[np.void]) -> None:
        """Make the textures that the method reads."""
        settings, textures = self._settings, self._textures
        if settings.transfer_lookup is TransferLookup.TEXTURE:
            row = self._bands.evaluate(np.linspace(0.0, 1.0, TRANSFER_SIZE)).astype(np.float32)
            textures["TRANSFER"] = new_texture(ctx, row[None])
        if self._finds_peaks and settings.crossings is Crossings.SECANT:
            textures["PEAK_TABLE"] = new_texture(ctx, peak_table(peaks["value"], settings.peak_bins))
        if settings.classification is Classification.PRE_INTEGRATED:
            table = pre_integrated(self._bands, settings, self._base_length)
            if table is not None:
                textures["PRE_INTEGRATION"] = new_texture(ctx, table)

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
        block["transfer_size"] = TRANSFER_SIZE
        lengths = table_lengths(self._settings, self._base_length)
        block["table_layers"], block["table_length"] = len(lengths), lengths[0]
        block["table_ratio"] = np.log(lengths[1] / lengths[0]) if len(lengths) > 1 else 0.0

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


def table_lengths(settings: RaycastSettings, base_length: float) -> F64:
    """(L,) float64, lengths of the stretches that the pre-integration table is made for [world]."""
    if settings.integration is Integration.TABLE_3D:
        return layer_lengths(base_length)
    return np.array([base_length])


def pre_integrated(bands: ValueBands, settings: RaycastSettings, base_length: float) -> F32 | None:
    """The table of the settings' integration: (n, n, 4), or (L, n, n, 4) for many lengths; None for none.

    Raises
    ------
    CapacityError
        If it takes too much memory.
    """
    from isosample.transfer.preintegration import length_tables

    if settings.integration is Integration.EXACT:
        return None
    tables = length_tables(bands, settings.table_size, table_lengths(settings, base_length))
    return tables if settings.integration is Integration.TABLE_3D else tables[0]


def new_texture(
    ctx: moderngl.Context, texels: npt.NDArray[np.float32] | npt.NDArray[np.uint16]
) -> moderngl.Texture | moderngl.Texture3D:
    """Texture of four components for `texelFetch`: (y, x, 4), or (z, y, x, 4); float32 or uint16.

    Raises
    ------
    CapacityError
        If the driver's textures are smaller.
    """
    deep = texels.ndim == 4
    largest = limits(ctx).texture_3d_size if deep else limits(ctx).texture_size
    size = texels.shape[-2::-1]
    if max(size) > largest:
        raise CapacityError(
            f"a table of {' x '.join(map(str, size))} entries is larger than this driver's textures, {largest}; use "
            "a smaller --table-size or --peak-bins."
        )
    kind = "f4" if texels.dtype == np.float32 else "u2"
    texture = (ctx.texture3d if deep else ctx.texture)(size, 4, np.ascontiguousarray(texels), dtype=kind)
    texture.filter = (ctx.NEAREST, ctx.NEAREST)
    return texture


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

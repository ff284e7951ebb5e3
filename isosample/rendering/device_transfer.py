"""The transfer function on the GPU, as the ray caster reads it, and the tables of its methods."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from isosample.errors import CapacityError
from isosample.gl.context import limits
from isosample.gl.memory import with_room
from isosample.rendering.frame import shared_constants
from isosample.rendering.raycast_settings import (
    Classification,
    Crossings,
    Integration,
    PeakMode,
    PeakWeight,
    Quadrature,
    TransferLookup,
)
from isosample.rendering.transfer_texture import (
    has_few_bands,
    looked_up_intervals,
    shown_peaks,
    transfer_texels,
)
from isosample.transfer.peaks import peak_table
from isosample.transfer.table_sizes import layer_lengths
from isosample.transfer.value_bands import ValueBands
from isosample.transfer.visible_values import visible_intervals

if TYPE_CHECKING:
    import moderngl

    from isosample.rendering.raycast_settings import RaycastSettings
    from isosample.rendering.scene import ValueScale
    from isosample.transfer.transfer_function import TransferFunction

    Floats = npt.NDArray[np.float32] | npt.NDArray[np.float16]
    F64 = npt.NDArray[np.float64]
    U16 = npt.NDArray[np.uint16]

SAMPLERS = {"TRANSFER": ("transfer", "sampler2D"), "PEAK_TABLE": ("peak_table", "usampler2D")}
TABLE_SAMPLERS = {
    Integration.TABLE_1D: ("integrals", "sampler2D"),
    Integration.TABLE_2D: ("length_table", "sampler2D"),
    Integration.TABLE_3D: ("length_tables", "sampler3D"),
}
REMEDY = "Use a smaller --table-size or --peak-bins."
METHODS = {
    Classification.POST_CLASSIFIED: 0,
    Classification.PRE_INTEGRATED: 1,
    Classification.PEAK_FINDING: 2,
}
QUADRATURES = {Quadrature.RIEMANN: 0, Quadrature.TRAPEZOID: 1}
INTEGRATIONS = {
    Integration.EXACT: 0,
    Integration.TABLE_2D: 1,
    Integration.TABLE_3D: 2,
    Integration.TABLE_1D: 3,
}
PEAK_MODES = {PeakMode.BOTH: 0, PeakMode.XOR: 1, PeakMode.PEAK_ONLY: 2, PeakMode.DVR_ONLY: 3}
PEAK_WEIGHTS = {PeakWeight.PAPER: 0, PeakWeight.INTEGRAL: 1}
CROSSINGS = {Crossings.SECANT: 0, Crossings.EXACT: 1}
LOOKUPS = {TransferLookup.EXACT: 0, TransferLookup.TEXTURE: 1}


class DeviceTransfer:
    """Textures of one transfer function for one method.

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
        If a table is larger than the driver's textures, or than memory it may take.
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
        self._few_bands = has_few_bands(self._bands)
        self._intervals = visible_intervals(transfer_function, isosurfaces=self._shows_isosurfaces)
        cells = lookup_cells(settings)
        if cells is not None:
            means = _integrates(settings, Integration.TABLE_1D)
            self._intervals = looked_up_intervals(self._intervals, scale, cells, whole_cells=means)
        hidden = 0 if self._shows_isosurfaces else len(transfer_function.isosurfaces)
        self.not_shown = {"isosurfaces": hidden} if hidden else {}
        finds = settings.classification is Classification.PEAK_FINDING
        self._peaks = shown_peaks(transfer_function, scale) if finds else []
        self._textures: dict[str, moderngl.Texture | moderngl.Texture3D] = {}
        try:
            for name, texels in self._tables().items():
                self._textures[name] = new_texture(ctx, texels)
        except BaseException:
            self.release()
            raise

    def bind(self) -> None:
        """Bind what the programs with `constants` read."""
        for name, texture in self._textures.items():
            texture.use(shared_constants()[f"UNIT_{name}"])

    def samplers(self) -> dict[str, str]:
        """Types of the textures by their names in the shaders."""
        table = TABLE_SAMPLERS.get(self._settings.integration, ("", ""))
        named = {**SAMPLERS, "PRE_INTEGRATION": table}
        return dict(named[unit] for unit in self._textures)

    def _tables(self) -> dict[str, Floats | U16]:
        """Texels of the textures that the method reads, by the names of their units."""
        settings, bands = self._settings, self._bands
        sampled = settings.transfer_lookup is TransferLookup.TEXTURE
        tables: dict[str, Floats | U16] = {
            "TRANSFER": transfer_texels(bands, self._peaks, settings.peak_weight, sampled=sampled)
        }
        if settings.classification is Classification.PEAK_FINDING and settings.crossings is Crossings.SECANT:
            values = np.array([peak.value for peak in self._peaks]).astype(np.float32)
            tables["PEAK_TABLE"] = peak_table(values, settings.peak_bins)
        if settings.classification is Classification.PRE_INTEGRATED:
            table = pre_integrated(bands, settings, self._base_length)
            if table is not None:
                tables["PRE_INTEGRATION"] = table
        return tables

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
            "FEW_BANDS": int(self._few_bands),
            "SURFACES": int(bool((self._bands.impulses[:, 3] > 0.0).any())),
        }

    def fill(self, block: np.void) -> None:
        """Fill in the members of a struct Raycast that tell of the transfer function."""
        block["band_count"] = len(self._bands.ends)
        lowest = self._bands.evaluate(0.0)
        block["lowest"] = (*(lowest[:3] * lowest[3]), lowest[3])
        block["root_iterations"] = self._settings.root_iterations
        lengths = table_lengths(self._settings, self._base_length)
        block["table_layers"], block["table_length"] = len(lengths), lengths[0]
        block["table_ratio"] = np.log(lengths[1] / lengths[0]) if len(lengths) > 1 else 0.0

    def visible_intervals(self) -> F64:
        """(N, 2) float64, closed intervals of data values at which something is seen; ascending by their lower ends.

        Isosurfaces are points; where values are looked up in a table, all are wider by a part of its cells.
        """
        return self._intervals

    def release(self) -> None:
        """Free every texture."""
        for texture in self._textures.values():
            texture.release()
        self._textures = {}

    @property
    def _shows_isosurfaces(self) -> bool:
        if self._settings.classification is Classification.PEAK_FINDING:
            return self._settings.peak_mode is not PeakMode.DVR_ONLY
        integrates = self._settings.classification is Classification.PRE_INTEGRATED
        return integrates and self._settings.integration is not Integration.TABLE_1D


def lookup_cells(settings: RaycastSettings) -> int | None:
    """Cells, over the volume's range, of the table in which a method looks values up; None where it needs none."""
    width = shared_constants()["BAND_START_COUNT"]
    if _integrates(settings, Integration.TABLE_1D):
        return shared_constants()["INTEGRAL_ROWS"] * width // 3
    if _integrates(settings, Integration.TABLE_2D, Integration.TABLE_3D):
        return settings.table_size - 1
    sampled = settings.transfer_lookup is TransferLookup.TEXTURE
    if sampled and settings.classification is not Classification.PRE_INTEGRATED:
        return shared_constants()["SAMPLED_ROWS"] * width - 1
    return None


def _integrates(settings: RaycastSettings, *tables: Integration) -> bool:
    """Whether a method pre-integrates, by one of these tables."""
    return settings.classification is Classification.PRE_INTEGRATED and settings.integration in tables


def table_lengths(settings: RaycastSettings, base_length: float) -> F64:
    """(L,) float64, lengths of the stretches that the pre-integration table is made for [world]."""
    if settings.integration is Integration.TABLE_3D:
        return layer_lengths(base_length)
    return np.array([base_length])


def pre_integrated(bands: ValueBands, settings: RaycastSettings, base_length: float) -> Floats | None:
    """The table of the settings' integration; None for none.

    Integrals over the value: (rows, BAND_START_COUNT, 4). By the values at both ends, in `table_dtype`: (n, n, 4), or
    (L, n, n, 4) for many lengths.

    Raises
    ------
    CapacityError
        If it takes too much memory.
    """
    from isosample.transfer.preintegration import length_tables, value_integrals

    if settings.integration is Integration.EXACT:
        return None
    if settings.integration is Integration.TABLE_1D:
        rows, width = (shared_constants()[name] for name in ("INTEGRAL_ROWS", "BAND_START_COUNT"))
        return value_integrals(bands, rows * width // 3).reshape(rows, width, 4)
    tables = length_tables(bands, settings.table_size, table_lengths(settings, base_length))
    tables = tables if settings.integration is Integration.TABLE_3D else tables[0]
    return tables.astype(settings.table_dtype.value, copy=False)


def new_texture(ctx: moderngl.Context, texels: Floats | U16) -> moderngl.Texture | moderngl.Texture3D:
    """Texture of four components whose single texels are read: (y, x, 4), or (z, y, x, 4); float32, float16 or uint16.

    Raises
    ------
    CapacityError
        If the driver's textures are smaller, or it has no room.
    """
    deep = texels.ndim == 4
    largest = limits(ctx).texture_3d_size if deep else limits(ctx).texture_size
    size = texels.shape[-2::-1]
    table = f"a table of {' x '.join(map(str, size))} entries"
    if max(size) > largest:
        raise CapacityError(f"{table} is larger than this driver's textures, {largest}. {REMEDY}")
    kind = f"{texels.dtype.kind}{texels.dtype.itemsize}"
    make = ctx.texture3d if deep else ctx.texture
    texture = with_room(
        ctx, make(size, 4, np.ascontiguousarray(texels), dtype=kind), table, texels.nbytes, REMEDY
    )
    texture.filter = (ctx.NEAREST, ctx.NEAREST)
    return texture

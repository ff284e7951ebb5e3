"""The scene as the GPU takes it: surfaces, boundary and transfer function in normalised float32 arrays."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from isosample.errors import InputError
from isosample.rendering.chunk_stream import CHUNK_DTYPE, StoredSource, merged, streamed
from isosample.rendering.chunk_stream import VERTEX_DTYPE as VERTEX_DTYPE
from isosample.rendering.chunk_stream import LevelRange as LevelRange
from isosample.surfaces.stored_surfaces import StoredSurfaces
from isosample.volume.reconstruction import Reconstruction

if TYPE_CHECKING:
    from isosample.rendering.chunk_stream import Source
    from isosample.surfaces.extract import SurfaceSet
    from isosample.surfaces.mask_faces import MaskFaces
    from isosample.transfer.isovalue_plan import IsovaluePlan
    from isosample.volume.geometry import GridGeometry

F32 = npt.NDArray[np.float32]
F64 = npt.NDArray[np.float64]
U32 = npt.NDArray[np.uint32]

LARGEST_LENGTH = 1e15  # [world]; its square, and that of its inverse, are float32 numbers
LARGEST_DEPTH = 1e25
MASK_DTYPE = np.dtype([("start", "<f4", 3), ("face", "<i4"), ("values", "<f4", 4)])


@dataclass(frozen=True, slots=True)
class ValueScale:
    """Maps data values to the unit interval of the volume's range, in float64.

    The shaders see only normalised values, so an offset of the data (temperatures in kelvin, pressures in
    pascal) costs no float32 accuracy. A constant volume maps to 0.
    """

    low: float
    high: float

    @property
    def inverse_width(self) -> float:
        """1 / (high − low), or 1 for a constant volume."""
        return 1.0 / (self.high - self.low) if self.high > self.low else 1.0

    def normalise(self, values: npt.NDArray[np.generic]) -> F64:
        """Values (any shape) in data units, as float64 in units of the range."""
        scaled: F64 = (values.astype(np.float64) - self.low) * self.inverse_width
        return scaled


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Scene:
    """Surfaces, boundary and transfer function of one volume, ready for upload.

    Attributes
    ----------
    geometry : GridGeometry
    vertices : (V,) `VERTEX_DTYPE`
        Position: world minus the box's centre [world]. Gradient: of the normalised value per world unit,
        times the radius of the box's bounding sphere (dimensionless, so that it fits a half float).
    indices : (3T,) uint32
    levels : tuple of LevelRange
        Only levels that have triangles, ascending.
    boundary : (B,) float32
        Normalised samples of the six faces (none with a mask), x low, x high, y low, …; the lower of a
        face's two axes runs fastest.
    mask : (F,) `MASK_DTYPE` or None
        Faces of the border of the valid cells; None where every sample is finite and the box is the border.
    band_values : (K + 1, 2) float32, band_optics : (K + 1, 2, 4) float32
        Ends of every band (normalised) and the colour and extinction there (straight linear RGB, [1/world]).
    level_optics : (K, 2, 4) float32
        Per level the impulse (straight linear RGB, opacity) and the sheet (straight linear RGB, area in
        extinction times normalised value); 0 for none.
    residuals : (V, 2) float32
        How far the field is from the isovalue near every vertex [normalised], on the flat and on the curved
        triangles.
    face_kernel : (4, 4) float32 or None
        Weights of the taps where `boundary` holds spline coefficients; see `GridSpline`.
    plan : IsovaluePlan
    reconstruction : Reconstruction
    source : Source or None
        What gives the pieces of the levels where `vertices`, `indices` and `residuals` are empty, because they
        stay on disk.
    """

    geometry: GridGeometry
    vertices: npt.NDArray[np.void]
    indices: U32
    levels: tuple[LevelRange, ...]
    boundary: F32
    mask: npt.NDArray[np.void] | None
    band_values: F32
    band_optics: F32
    level_optics: F32
    residuals: F32
    face_kernel: F32 | None
    plan: IsovaluePlan
    reconstruction: Reconstruction = Reconstruction.TRILINEAR
    source: Source | None = None

    @property
    def smooth(self) -> bool:
        """Whether the surfaces are those of a smooth reconstruction."""
        return self.reconstruction.smooth

    @property
    def triangle_count(self) -> int:
        """Triangles over all levels, at the finest detail."""
        chunks = self.chunks()
        return int(chunks["index_count"][chunks["detail"] == 0].sum()) // 3

    def chunks(self) -> npt.NDArray[np.void]:
        """(C,) `CHUNK_DTYPE`, the pieces of all levels."""
        pieces = [part.pieces(len(self.vertices)) for part in self.levels]
        return np.concatenate([np.empty(0, dtype=CHUNK_DTYPE), *pieces])

    @classmethod
    def build(cls, surfaces: SurfaceSet | StoredSurfaces, plan: IsovaluePlan) -> Scene:
        """Scene of extracted surfaces and the plan they were extracted for; of stored ones, nothing is loaded yet.

        Raises
        ------
        InputError
            If the surfaces lack an isovalue of the plan, or the box or an extinction is of a size that float32
            cannot work with.
        CapacityError
            If there are more vertices than 32-bit indices can name.
        """
        _check_details(surfaces)
        rows = _rows_of_plan(surfaces, plan)
        _check_magnitudes(surfaces.geometry.box.radius, plan)
        scale = ValueScale(*surfaces.value_range)
        if isinstance(surfaces, StoredSurfaces):
            vertices, indices, residuals, levels = streamed(surfaces, rows)
            source: Source | None = StoredSource(surfaces, scale)
        else:
            vertices, indices, residuals, levels = merged(surfaces, rows, scale)
            source = None
        border = surfaces.boundary
        mask = None if border.mask_faces is None else _mask_records(border.mask_faces, scale)
        samples = [np.ravel(face) for face in border.faces] if mask is None else [np.zeros(0)]
        optics = np.concatenate([plan.band_color, plan.band_extinction[..., None]], axis=-1)
        return cls(
            geometry=surfaces.geometry,
            vertices=vertices,
            indices=indices,
            levels=levels,
            boundary=scale.normalise(np.concatenate(samples)).astype(np.float32),
            mask=mask,
            band_values=_band_values(plan, scale),
            band_optics=optics.astype(np.float32),
            level_optics=_level_optics(plan, scale),
            residuals=residuals,
            face_kernel=None if border.kernel is None else border.kernel.astype(np.float32),
            plan=plan,
            reconstruction=surfaces.settings.reconstruction,
            source=source,
        )


def _rows_of_plan(surfaces: SurfaceSet | StoredSurfaces, plan: IsovaluePlan) -> npt.NDArray[np.intp]:
    """Level of the surfaces for every isovalue of the plan; raise if one is missing."""
    rows = np.searchsorted(surfaces.isovalues, plan.isovalues)
    inside = np.minimum(rows, max(len(surfaces.isovalues) - 1, 0))
    found = (
        surfaces.isovalues[inside] == plan.isovalues if len(surfaces.isovalues) else np.zeros(len(rows), bool)
    )
    if not np.all(found):
        missing = plan.isovalues[~found]
        raise InputError(
            f"the surfaces lack {len(missing)} isovalue(s) that the transfer function needs, the first "
            f"{float(missing[0])!r}; extract them, or render with the transfer function they belong to."
        )
    return rows


def _check_details(surfaces: SurfaceSet | StoredSurfaces) -> None:
    """Raise unless the surfaces are whole and their details those of the same surfaces, one after the other."""
    parts: tuple[SurfaceSet | StoredSurfaces, ...] = surfaces.by_detail
    for expected, part in enumerate(parts):
        if part.settings != replace(surfaces.settings, detail=expected):
            raise InputError(
                f"surfaces with the settings {part.settings} stand where detail {expected} is expected; pass what "
                "extract_details gives."
            )
        if not np.array_equal(part.isovalues, surfaces.isovalues):
            raise InputError(
                f"detail {expected} has other isovalues than the finest surfaces; extract them together."
            )


def _check_magnitudes(radius: float, plan: IsovaluePlan) -> None:
    """Raise unless lengths, their squares, and optical depths stay well inside float32."""
    if not 1.0 / LARGEST_LENGTH <= radius <= LARGEST_LENGTH:
        raise InputError(
            f"the volume's bounding sphere has a radius of {radius:g} world units; {1.0 / LARGEST_LENGTH:g} to "
            f"{LARGEST_LENGTH:g} can be rendered. Give another --spacing."
        )
    thickest = float(plan.band_extinction.max(initial=0.0))
    if thickest * radius > LARGEST_DEPTH:
        raise InputError(
            f"an extinction of {thickest:g} over a radius of {radius:g} is an optical depth above {LARGEST_DEPTH:g}; "
            "lower the extinction."
        )


def _band_values(plan: IsovaluePlan, scale: ValueScale) -> F32:
    """Normalised ends of the bands; neighbours share the float32 of the isovalue between them."""
    levels = scale.normalise(plan.isovalues).astype(np.float32)
    low, high = scale.normalise(np.asarray(plan.value_range)).astype(np.float32)
    return np.stack([np.concatenate([[low], levels]), np.concatenate([levels, [high]])], axis=-1)


def _level_optics(plan: IsovaluePlan, scale: ValueScale) -> F32:
    """(K, 2, 4) float32, impulse and sheet of every level."""
    impulses = np.concatenate([plan.impulse_color, plan.impulse_opacity[:, None]], axis=-1)
    areas = plan.sheet_area[:, None] * scale.inverse_width
    sheets = np.concatenate([plan.sheet_color, areas], axis=-1)
    return np.stack([impulses, sheets], axis=1).astype(np.float32)


def _mask_records(faces: MaskFaces, scale: ValueScale) -> npt.NDArray[np.void]:
    """(F,) `MASK_DTYPE`, one instance per face; sample indices below 2^24 are exact in float32."""
    records = np.empty(len(faces.starts), dtype=MASK_DTYPE)
    records["start"] = faces.starts
    records["face"] = 2 * faces.axes.astype(np.int32) + (faces.outward > 0)
    records["values"] = scale.normalise(faces.values)
    return records

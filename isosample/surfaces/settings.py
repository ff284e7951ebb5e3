"""What decides about the meshes of a volume besides its samples, and the checks of what extraction is given."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Any

import numpy as np

from isosample.errors import InputError
from isosample.surfaces.detail import MOST_DETAILS
from isosample.surfaces.positions import LARGEST_BRICK_CELLS
from isosample.volume.bricks import BRICK_CELLS
from isosample.volume.grid import check_is_volume
from isosample.volume.reconstruction import Reconstruction, check_smooth

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from isosample.volume.grid import F64, Volume

REFINEMENTS = (1, 2, 4, 8)
FLATNESS = 1e-3  # default of `ExtractionSettings.flatness`, see `refine` for what it gives [voxel]
LEAST_FLATNESS, LARGEST_FLATNESS = 1e-5, 0.5
LARGEST_GROWTH = 4  # from one refinement to the next a triangle is divided into four at most
LARGEST_SPAN = float(np.finfo(np.float32).max)  # gradients are float32
# Coefficients of an interpolating cubic spline are at most 3 times the samples along each axis, and the
# slopes of its weights add up to at most 2: 3³ · 2 < 64.
SPLINE_STEEPNESS = 64.0
LATER = {"detail": 0, "flatness": FLATNESS}  # settings that the first cache folders did not have


@dataclass(frozen=True, slots=True, kw_only=True)
class ExtractionSettings:
    """What decides about the meshes, besides the samples and the isovalue.

    Attributes
    ----------
    brick_cells : int
        Cells per brick along each axis, 1 to 32.
    nan_masked : bool
        Whether cells with a non-finite corner are left out; otherwise such samples are an error.
    reconstruction : Reconstruction
        The field between the samples, on whose isosurface the vertices lie.
    refine : int
        Into how many pieces an edge of the marching-cubes mesh may be divided where the surface bends: 1, 2,
        4 or 8.
    detail : int
        0: meshes as extracted; 1 to 5: coarser ones, see `surfaces.detail`.
    flatness : float
        Edges whose middle is nearer to the isosurface are not divided [voxel]; 1e-5 to 0.5, of no effect where
        `refine` is 1, and then left out of `to_dict` and of the names of cached meshes.
    residuals : bool
        Whether the meshes carry their distance from the isosurface (`BrickMesh.residuals`, `error`).

    Raises
    ------
    InputError
        If a setting is none of these.
    """

    brick_cells: int = BRICK_CELLS
    nan_masked: bool = False
    reconstruction: Reconstruction = Reconstruction.TRILINEAR
    refine: int = 1
    residuals: bool = False
    detail: int = 0
    flatness: float = FLATNESS

    def __post_init__(self) -> None:
        if not 1 <= self.brick_cells <= LARGEST_BRICK_CELLS:
            raise InputError(
                f"bricks of {self.brick_cells} cells are not possible; choose 1 to {LARGEST_BRICK_CELLS}."
            )
        if not isinstance(self.reconstruction, Reconstruction):
            raise InputError(
                f"reconstruction {self.reconstruction!r} is none; take a member of Reconstruction, "
                "for instance Reconstruction.CUBIC."
            )
        if isinstance(self.refine, bool) or self.refine not in REFINEMENTS:
            raise InputError(
                f"refine {self.refine!r} is not possible; an edge can be divided into 1, 2, 4 or 8."
            )

        if not LEAST_FLATNESS <= self.flatness <= LARGEST_FLATNESS:
            raise InputError(
                f"flatness {self.flatness!r} must be from {LEAST_FLATNESS:g} to {LARGEST_FLATNESS:g} voxel."
            )
        if isinstance(self.detail, bool) or self.detail not in range(MOST_DETAILS + 1):
            raise InputError(f"detail {self.detail!r} is not possible; choose 0 (finest) to {MOST_DETAILS}.")

    @property
    def rounds(self) -> int:
        """How often triangles are divided: log2 of `refine`."""
        return self.refine.bit_length() - 1

    def as_keywords(self) -> dict[str, Any]:
        """The settings as keywords of `extract_surfaces`."""
        return {field.name: getattr(self, field.name) for field in fields(self)}

    def to_dict(self) -> dict[str, Any]:
        """Plain numbers and words, ready for JSON: the same of settings that give the same meshes."""
        entries = {**self.as_keywords(), "reconstruction": self.reconstruction.value}
        if self.refine == 1:
            entries["flatness"] = FLATNESS  # nothing is divided
        # Left out, as before there were such: those meshes are still right.
        for name, default in LATER.items():
            if entries[name] == default:
                del entries[name]
        return entries

    @classmethod
    def from_dict(cls, entries: Mapping[str, Any]) -> ExtractionSettings:
        """Return the settings that `to_dict` wrote.

        Raises
        ------
        InputError
            If an entry is missing, unknown or impossible.
        """
        expected = cls().to_dict().keys()
        names = [member.value for member in Reconstruction]
        if set(entries) - set(LATER) != expected or entries["reconstruction"] not in names:
            raise InputError(
                f"extraction settings have the entries {sorted(expected)} and a reconstruction of {names}, "
                f"got {dict(entries)}."
            )
        return cls(**{**entries, "reconstruction": Reconstruction(entries["reconstruction"])})


def check_isovalues(isovalues: Sequence[float] | F64) -> F64:
    """Return isovalues as a read-only (K,) float64 array, or raise InputError naming what is wrong."""
    try:
        levels = np.array(isovalues, dtype=np.float64)
    except (TypeError, ValueError):
        levels = np.array(np.nan)
    if levels.ndim != 1 or not np.isfinite(levels).all():
        raise InputError(f"isovalues {isovalues!r} must be a list of finite numbers.")
    if (np.diff(levels) <= 0).any():
        at = int(np.flatnonzero(np.diff(levels) <= 0)[0])
        raise InputError(
            f"isovalue {levels[at + 1]} at place {at + 1} does not exceed {levels[at]} before it; "
            "pass them in ascending order, each once."
        )
    levels.setflags(write=False)
    return levels


def check_volume(volume: Volume, settings: ExtractionSettings) -> None:
    """Raise InputError if a volume is none, has no cells, unexpected non-finite samples, or too wide a range."""
    check_is_volume(volume)
    if min(volume.size_xyz) < 2:
        raise InputError(
            f"{volume.name} has {volume.size_xyz} samples (x, y, z); "
            "a volume needs at least 2 samples along each axis to have surfaces."
        )
    if settings.reconstruction.smooth:
        check_smooth(volume, settings.reconstruction)
    nan_count, infinity_count = volume.nonfinite_counts
    if nan_count + infinity_count and not settings.nan_masked:
        raise InputError(
            f"{volume.name} has {nan_count} NaN and {infinity_count} infinite samples; surfaces need finite "
            "ones. Pass --nan masked (nan_masked=True) to leave out the cells that they touch."
        )
    low, high = volume.value_range
    steepness = SPLINE_STEEPNESS if settings.reconstruction.smooth else 1.0
    if high / 2 - low / 2 > LARGEST_SPAN / steepness / 2:
        raise InputError(
            f"{volume.name} ranges from {low} to {high}, more than float32 gradients can hold. "
            "Rescale the data."
        )

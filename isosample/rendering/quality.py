"""How many isovalues a picture gets and how fine its meshes are: what is asked for, planned and reached."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Literal

from isosample.defaults import DEFAULT_MAX_ISOVALUES, DEFAULT_PER_SLOPE
from isosample.errors import InputError
from isosample.surfaces.detail_sets import check_details
from isosample.surfaces.settings import REFINEMENTS
from isosample.transfer.isovalues import plan_isovalues
from isosample.transfer.sample_shares import SampleShares
from isosample.volume.reconstruction import GridSpline, Reconstruction
from isosample.volume.statistics import gradient_at_values

if TYPE_CHECKING:
    from isosample.surfaces.stored_surfaces import StoredSurfaces
    from isosample.surfaces.surface_set import SurfaceSet
    from isosample.transfer.isovalue_plan import IsovaluePlan
    from isosample.transfer.transfer_function import TransferFunction
    from isosample.volume.grid import Volume


@dataclass(frozen=True, slots=True, kw_only=True)
class Quality:
    """How many isovalues a picture gets, and how well its meshes follow the field.

    Attributes
    ----------
    per_slope : int or None
        Isovalues inside each visible slope of the transfer function; None: the default, or what the tolerance
        needs.
    tolerance : float or None
        Largest error of a component of a pixel, for all but a thousandth of the pixels; the isovalues and the
        refinement are then searched for. None: `per_slope` decides.
    max_isovalues : int
        At most so many isovalues for a tolerance.
    reconstruction : Reconstruction
        The field between the samples.
    refine : int, "auto" or None
        Into how many pieces an edge of the mesh may be divided: 1, 2, 4 or 8; with a tolerance the most that may be
        chosen. None: 1, or as many as the tolerance needs. "auto": as many as the meshes need to come within 0.01
        voxel (rms) of the isosurfaces, curved or not; with a tolerance as many as that needs.
    details : int
        0 to 5: so many coarser details are extracted too, for frames that are rendered again and again; see
        `surfaces.detail`.
    lit : bool
        Whether pictures will be lit (`RenderSettings.material`), see `plan_isovalues`. A tolerance is searched for
        without light all the same; what the lit pictures err is told with it.

    Raises
    ------
    InputError
        If two options contradict each other or one is out of range.
    """

    per_slope: int | None = None
    tolerance: float | None = None
    max_isovalues: int = DEFAULT_MAX_ISOVALUES
    reconstruction: Reconstruction = Reconstruction.TRILINEAR
    refine: int | Literal["auto"] | None = None
    details: int = 0
    lit: bool = False

    def __post_init__(self) -> None:
        if self.tolerance is not None and self.per_slope is not None:
            raise InputError(
                f"per_slope {self.per_slope} and tolerance {self.tolerance:g} both decide about the isovalues; "
                "leave out one of them."
            )
        if self.tolerance is not None and not self.tolerance > 0.0:
            raise InputError(f"tolerance {self.tolerance!r} must be above 0, for instance 1/255.")
        if self.max_isovalues < 1:
            raise InputError(f"max_isovalues {self.max_isovalues!r} must be a whole number >= 1.")
        if self.refine not in (None, "auto", *REFINEMENTS):
            raise InputError(
                f"refine {self.refine!r} must be one of {REFINEMENTS}, or 'auto' for as much as is needed."
            )
        check_details(self.details)

    @property
    def most_pieces(self) -> int | None:
        """What `refine` comes to: pieces of an edge, or None for as many as the meshes or the tolerance need."""
        if self.refine is None:
            return 1 if self.tolerance is None else None
        return None if self.refine == "auto" else self.refine


def plan_for(
    volume: Volume, transfer_function: TransferFunction, quality: Quality, *, spline: GridSpline | None = None
) -> IsovaluePlan:
    """Isovalues with so many per slope, of the range that the reconstruction can take.

    Parameters
    ----------
    volume : Volume
    transfer_function : TransferFunction
    quality : Quality
    spline : GridSpline, optional
        Of this volume and the quality's reconstruction, if it is at hand.
    """
    per_slope = DEFAULT_PER_SLOPE if quality.per_slope is None else quality.per_slope
    if quality.reconstruction.smooth and spline is None:
        spline = GridSpline.build(volume, quality.reconstruction)
    value_range = volume.value_range if spline is None else spline.value_range
    return plan_isovalues(
        transfer_function,
        value_range,
        per_slope=per_slope,
        gradients=partial(gradient_at_values, volume),
        lit=quality.lit,
        shares=shares_for_light(volume, transfer_function) if quality.lit else None,
    )


def shares_for_light(volume: Volume, transfer_function: TransferFunction) -> SampleShares | None:
    """How the samples spread, by a look at all of them; None without slopes of constant extinction and colour."""
    slopes = transfer_function.slopes()
    return SampleShares.of(volume) if any(one.visible and one.constant for one in slopes) else None


def mesh_distance(surfaces: SurfaceSet | StoredSurfaces) -> float:
    """Largest rms distance of a level's triangles from its isosurface [voxel].

    Of the flat triangles, also where crossings are moved onto the curved surface: which rays meet it is decided by
    the triangles, and once the insides are curved, outlines are what is left of the error.
    """
    return max((error.flat_rms for error in surfaces.mesh_errors if error is not None), default=0.0)

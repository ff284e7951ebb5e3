"""Isosurfaces with all their details, extracted one detail after the other."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any, TypeVar

from isosample.errors import InputError
from isosample.surfaces.detail import MOST_DETAILS
from isosample.surfaces.extract import extract_surfaces

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from isosample.surfaces.stored_surfaces import StoredSurfaces
    from isosample.surfaces.surface_set import SurfaceSet
    from isosample.volume.grid import F64, Volume

    Surfaces = TypeVar("Surfaces", SurfaceSet, StoredSurfaces)


def extract_details(
    volume: Volume, isovalues: Sequence[float] | F64, details: int = MOST_DETAILS, **options: Any
) -> SurfaceSet:
    """Return isosurfaces with coarser meshes, of which each picture takes the coarsest that it can (`screen_error`).

    Parameters
    ----------
    volume, isovalues, options
        As for `extract_surfaces`.
    details : int
        1 to 5 coarser details, see `isosample.surfaces.detail`; 0: none.

    Raises
    ------
    InputError
        As `extract_surfaces`, or if there cannot be so many.
    """
    return with_details(lambda detail: extract_surfaces(volume, isovalues, detail=detail, **options), details)


def with_details(extract: Callable[[int], Surfaces], details: int) -> Surfaces:
    """Return surfaces with so many coarser details; `extract` gives those of one detail.

    Raises
    ------
    InputError
        If `details` is not a whole number from 0 to `MOST_DETAILS`.
    """
    check_details(details)
    surfaces = extract(0)
    if details == 0:
        return surfaces
    return replace(surfaces, details=tuple(extract(detail) for detail in range(1, details + 1)))


def check_details(details: int) -> None:
    """Raise `InputError` unless there can be so many coarser details."""
    if isinstance(details, bool) or details not in range(MOST_DETAILS + 1):
        raise InputError(f"details {details!r} must be a whole number from 0 to {MOST_DETAILS}.")

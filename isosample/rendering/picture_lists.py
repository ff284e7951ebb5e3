"""The fragment lists of a picture as crossing lists in data and world units, with the ends of the rays."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from isosample.integral.box_rays import clipped
from isosample.integral.crossing_lists import BORDER, CrossingLists
from isosample.integral.ray import box_interval, face_tolerance, nearest_face
from isosample.integral.spline import spline_face_tolerance
from isosample.rendering.frame import shared_constants, shared_number

if TYPE_CHECKING:
    from isosample.rendering.fragment_lists import FragmentLists
    from isosample.rendering.settings import ClipPlane
    from isosample.surfaces.boundary import BoundarySlices
    from isosample.surfaces.extract import SurfaceSet
    from isosample.surfaces.stored_surfaces import StoredSurfaces
    from isosample.volume.geometry import Box

F64 = npt.NDArray[np.float64]
I64 = npt.NDArray[np.int64]


def crossing_lists(
    found: FragmentLists, surfaces: SurfaceSet | StoredSurfaces, origins: F64, directions: F64
) -> CrossingLists:
    """Lists of the covered pixels, one ray each in the order of `found.covered`.

    Parameters
    ----------
    found : FragmentLists
    surfaces : SurfaceSet
        What was rendered.
    origins, directions : (P, 3) float64
        Rays of the covered pixels [world]; directions of unit length.

    Returns
    -------
    lists : CrossingLists
        As the resolve pass walks them: with border points where the rays meet the box, unless cells are
        masked, whose border is in the lists already.
    """
    rows = np.searchsorted(found.covered, found.pixels)
    low, high = surfaces.value_range
    range_ = high - low if high > low else 1.0
    border = found.levels == shared_constants()["DOMAIN_LEVEL"]
    parts = [
        _Columns(
            ray=rows,
            distance=found.distances.astype(np.float64),
            level=np.where(border, BORDER, found.levels),
            rising=found.rising,
            slope=np.where(border, np.nan, found.slopes * (range_ / surfaces.geometry.box.radius)),
            residual=np.where(border, 0.0, np.abs(found.residuals) * range_),
            value=np.where(border, low + found.residuals.astype(np.float64) * range_, 0.0),
            tolerance=np.where(border, found.slopes.astype(np.float64) * range_, 0.0),
        )
    ]
    if surfaces.boundary.mask_faces is None:
        parts = _with_box(parts[0], surfaces, origins, directions)
    return _joined(parts, len(found.covered))


def visible_parts(origins: F64, directions: F64, clip_planes: tuple[ClipPlane, ...]) -> F64:
    """(P, 2) float64, the part of every ray in front of the eye and of all clip planes [world]."""
    everything = np.broadcast_to(np.array([0.0, np.inf]), (len(origins), 2))
    planes = [(plane.nx, plane.ny, plane.nz, plane.d) for plane in clip_planes]
    return clipped(everything, origins, directions, planes)


class _Columns(dict[str, npt.NDArray[np.generic]]):
    """Entries of crossing lists, in any order of the rays, with the ray of each."""


def _with_box(
    inside: _Columns, surfaces: SurfaceSet | StoredSurfaces, origins: F64, directions: F64
) -> list[_Columns]:
    """Entries between the two points where their ray meets the box, and those points; rays beside it have none."""
    box = surfaces.geometry.box
    unit_from_world = np.linalg.inv(box.edges.T)
    interval = box_interval((origins - box.corner) @ unit_from_world.T, directions @ unit_from_world.T)
    meets = np.flatnonzero(interval[:, 0] < interval[:, 1])
    rays = inside["ray"].astype(np.int64)
    kept = np.isin(rays, meets)
    rows = {name: column[kept] for name, column in inside.items()}
    rays = rays[kept]
    # As `node_between` of shaders/pass/weigh.glsl: rounding and curved surfaces may leave a crossing outside.
    rows["distance"] = np.clip(rows["distance"].astype(np.float64), interval[rays, 0], interval[rays, 1])
    ends = [
        _end(surfaces, origins[meets], directions[meets], meets, interval[meets, side], side == 0)
        for side in (0, 1)
    ]
    return [ends[0], _Columns(rows), ends[1]]


def _end(
    surfaces: SurfaceSet | StoredSurfaces,
    origins: F64,
    directions: F64,
    rays: I64,
    distance: F64,
    entering: bool,
) -> _Columns:
    """Border points of rays."""
    value, tolerance = border_values(surfaces, origins + distance[:, None] * directions)
    count = len(rays)
    return _Columns(
        ray=rays,
        distance=distance,
        level=np.full(count, BORDER),
        rising=np.full(count, entering),
        slope=np.full(count, np.nan),
        residual=np.zeros(count),
        value=value,
        tolerance=tolerance,
    )


def border_values(surfaces: SurfaceSet | StoredSurfaces, points: F64) -> tuple[F64, F64]:
    """Field on the surface of the box, and how far it may lie on the wrong side of an isovalue.

    Parameters
    ----------
    surfaces : SurfaceSet
    points : (N, 3) float64
        On the surface of the box [world].

    Returns
    -------
    values, tolerances : (N,) float64
        In data units; the tolerance as `ray.face_tolerance` or `spline.spline_face_tolerance` derives it.
    """
    geometry, boundary = surfaces.geometry, surfaces.boundary
    unit = np.clip((points - geometry.box.corner) @ np.linalg.inv(geometry.box.edges), 0.0, 1.0)
    index = unit * (np.array(geometry.size_xyz) - 1)
    faces = np.asarray(nearest_face(unit), dtype=np.int64)
    values, tolerances = np.zeros(len(points)), np.zeros(len(points))
    low, high = surfaces.value_range
    range_ = high - low if high > low else 1.0
    for face in np.unique(faces).tolist():
        rows = np.flatnonzero(faces == face)
        u, v = np.delete(index[rows], face // 2, axis=1).T
        values[rows] = boundary.value(face // 2, face % 2, u, v)
        corners = _corners(boundary, face, u, v)
        scaled = (corners - low) / range_
        derive = face_tolerance if boundary.kernel is None else spline_face_tolerance
        tolerances[rows] = derive(scaled) * range_
    return values, tolerances


def _corners(boundary: BoundarySlices, face: int, u: F64, v: F64) -> F64:
    """Samples around every point of a face, (N, 4), or coefficients of a smooth one, (N, 4, 4)."""
    stored = boundary.faces[face]
    more = 0 if boundary.kernel is None else 2
    column = np.minimum(u.astype(np.int64), stored.shape[1] - more - 2)
    row = np.minimum(v.astype(np.int64), stored.shape[0] - more - 2)
    reach = np.arange(2 + more)
    taps: F64 = stored[row[:, None, None] + reach[:, None], column[:, None, None] + reach].astype(np.float64)
    return taps if more else taps.reshape(-1, 4)


def _joined(parts: list[_Columns], rays: int) -> CrossingLists:
    """One list of all parts, by ray; within a ray in the order of the parts, which is that of the distances."""
    columns = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
    order = np.argsort(columns["ray"], kind="stable")
    sorted_ = {name: column[order] for name, column in columns.items()}
    first = np.searchsorted(sorted_.pop("ray"), np.arange(rays + 1))
    return CrossingLists(first=first, **sorted_)


def least_sheet_slope(value_range: tuple[float, float], box: Box) -> float:
    """Least |df/dt| by which a sheet's share is divided, as in ``shaders/pass/walk.glsl`` [data units / world].

    Parameters
    ----------
    value_range : 2 floats
        By which the shaders' values are normalised; without a finite sample (inf, -inf).
    box : Box
    """
    low, high = value_range
    return shared_number("LEAST_SHEET_SLOPE") * max(high - low, 0.0) / box.radius

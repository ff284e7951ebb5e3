"""Extraction with a cache folder: what is there is read, and what is not is extracted and added."""

from __future__ import annotations

import contextlib
import warnings
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from isosample.errors import CacheError, InputError
from isosample.surfaces.boundary import BoundarySlices
from isosample.surfaces.boundary_files import boundary_path, read_boundary, write_boundary
from isosample.surfaces.cache_levels import (
    Piece,
    ScannedField,
    extract_pieces,
    load_pieces,
    refuses_writing,
    rows_of,
    wanted_pieces,
)
from isosample.surfaces.field import ExtractedField, Field
from isosample.surfaces.settings import ExtractionSettings, check_isovalues, check_volume
from isosample.surfaces.store import MeshStore, full_disk_explained
from isosample.surfaces.surface_files import surface_key, write_rows
from isosample.surfaces.surface_set import ExtractionStatistics, SurfaceSet, count_per_level
from isosample.surfaces.volume_file import claim_folder, content_hash
from isosample.tally import EXTRACTIONS, tally
from isosample.volume.scan import scan_volume
from isosample.wording import counted

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from isosample.surfaces.mesh import BrickMesh
    from isosample.volume.grid import F64, Volume

# Of the largest sample: far above the rounding of a fit, far below what tells two volumes apart.
FIT_ROUNDING = 1e-9


def extract_with_cache(
    volume: Volume,
    isovalues: Sequence[float] | F64,
    folder: str | Path,
    *,
    settings: ExtractionSettings | None = None,
    budget_bytes: int | None = None,
    plain: bool = False,
    extracted: SurfaceSet | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> SurfaceSet:
    """Return the isosurfaces of a volume, of which those in the folder are read and the others added to it.

    Parameters
    ----------
    volume, isovalues, progress
        As for `extract_surfaces`.
    folder : path
        The volume's cache folder, made if absent. One that cannot be written is read, with a warning where
        something would have been added.
    settings : ExtractionSettings, optional
        What `extract_surfaces` has as keywords.
    budget_bytes : int, optional
        Largest size of all chunks in the folder; those that were used longest ago, and not by this call, make room.
    plain : bool
        Add chunks that need no decoding, four to six times as large and loaded several times as fast.
    extracted : SurfaceSet, optional
        What `extract_surfaces` gives for these isovalues and settings, if it is at hand: what the folder lacks is
        taken from it, and no spline is fitted.

    Returns
    -------
    surfaces : SurfaceSet
        The same, bit for bit, as `extract_surfaces` gives; ``statistics.levels_reused`` says of how many levels
        nothing was extracted, ``brick_visits`` how many (brick, isovalue) pairs were extracted now and
        ``chunks_reused`` how many were read.

    Raises
    ------
    InputError
        As `extract_surfaces`; also if `extracted` has other isovalues or settings, or cannot be of this volume: by its
        geometry, its range and, of a smooth reconstruction, its corners.
    CacheError
        If the folder belongs to another volume or format version, or cannot be written. What was extracted until
        then is kept: the same call goes on from there.
    """
    folder = Path(folder)
    settings = settings or ExtractionSettings()
    levels = check_isovalues(isovalues)
    scan = scan_volume(volume, settings.brick_cells)
    scan.tell(volume)
    check_volume(volume, settings)
    volume_hash = content_hash(volume, scan)
    if extracted is not None:
        _check_extracted(extracted, levels, volume, settings)
    field = Field(volume, settings) if extracted is None else ExtractedField(volume, settings, extracted)
    scanned = ScannedField(field=field, scan=scan, content_hash=volume_hash)
    claim_folder(folder, volume.geometry, volume_hash, volume.name)
    store = MeshStore(folder, budget_bytes=budget_bytes, plain=plain)
    pieces, unlisted = wanted_pieces(folder, scanned, levels)
    found = dict(zip(pieces, load_pieces(store, [piece.key for piece in pieces]), strict=True))
    missing = [piece for piece, mesh in found.items() if mesh is None]
    if missing and extracted is None:
        tally(EXTRACTIONS)
    found.update(extract_pieces(scanned, levels, missing, store, progress))
    meshes = {piece: mesh for piece, mesh in sorted(found.items()) if mesh is not None}
    surfaces = _surface_set(folder, scanned, levels, meshes, missing)
    try:
        with full_disk_explained():
            write_boundary(folder, volume_hash, surfaces)
            for level in unlisted:
                rows = rows_of({piece: mesh for piece, mesh in meshes.items() if piece.level == level})
                write_rows(folder, surface_key(volume_hash, float(levels[level]), settings), rows)
    except CacheError as error:
        if not refuses_writing(error):
            raise
        store.read_only = True
    _tell(store)
    return surfaces


def _surface_set(
    folder: Path,
    scanned: ScannedField,
    levels: F64,
    meshes: dict[Piece, BrickMesh],
    extracted: Sequence[Piece],
) -> SurfaceSet:
    """Put the meshes together, with the boundary of the folder where it is there."""
    boundary, value_range = _boundary(folder, scanned)
    bricks_total = len(scanned.bricks)
    shown = tuple(mesh for mesh in meshes.values() if len(mesh.triangles))
    return SurfaceSet(
        geometry=scanned.field.volume.geometry,
        isovalues=levels,
        meshes=shown,
        boundary=boundary,
        value_range=value_range,
        settings=scanned.settings,
        statistics=ExtractionStatistics(
            bricks_total=bricks_total,
            brick_visits=len(extracted),
            brick_visits_skipped=bricks_total * len(levels) - len(meshes),
            levels_reused=len(levels) - len({piece.level for piece in extracted}),
            chunks_reused=len(meshes) - len(extracted),
            triangles=count_per_level(levels, shown, "triangles"),
            vertices=count_per_level(levels, shown, "positions"),
        ),
    )


def _check_extracted(
    extracted: SurfaceSet, levels: F64, volume: Volume, settings: ExtractionSettings
) -> None:
    """Raise unless surfaces that are at hand are of this volume, and those that are asked for."""
    same_settings = extracted.settings.to_dict() == settings.to_dict()
    if not same_settings or not np.array_equal(extracted.isovalues, levels):
        raise InputError(
            f"the extracted surfaces have {len(extracted.isovalues)} isovalues and {extracted.settings}; "
            f"{len(levels)} isovalues with {settings} are asked for. Pass what extract_surfaces gives for these."
        )
    if extracted.geometry != volume.geometry or not _may_be_of(extracted, volume):
        raise InputError(
            f"the extracted surfaces are of a volume of {extracted.geometry} with values within "
            f"{extracted.value_range}; {volume.name} has {volume.geometry}, values {volume.value_range} or other "
            "samples at its corners. Pass what extract_surfaces gives for this volume."
        )


def _may_be_of(extracted: SurfaceSet, volume: Volume) -> bool:
    """Tell by range and corners whether surfaces can be of a volume of this geometry, without fitting a spline.

    The range of a spline holds that of the samples, and every reconstruction passes through the samples at the corners,
    both but for the rounding of the fit.
    """
    low, high = volume.value_range
    if not extracted.settings.reconstruction.smooth:
        return extracted.value_range == (low, high)
    slack = FIT_ROUNDING * max(abs(low), abs(high))
    lowest, highest = extracted.value_range
    y, z = ([0.0, count - 1.0] for count in volume.size_xyz[1:])
    u, v = np.meshgrid(y, z)
    own = BoundarySlices.from_volume(volume)
    off = [
        np.abs(own.value(0, side, u, v) - extracted.boundary.value(0, side, u, v)).max() for side in (0, 1)
    ]
    return lowest <= low + slack and high - slack <= highest and max(off) <= slack


def _tell(store: MeshStore) -> None:
    """Warn once about damaged chunks, and once about a folder that takes nothing more."""
    if store.damaged:
        warnings.warn(
            f"{counted(store.damaged, 'damaged chunk')} of {store.folder} {'was' if store.damaged == 1 else 'were'} "
            f"extracted again; the first: {store.notes[0]}",
            UserWarning,
            stacklevel=3,
        )
    if store.read_only:
        warnings.warn(
            f"{store.folder} cannot be written: what it lacks was extracted, and will be again the next time.",
            UserWarning,
            stacklevel=3,
        )


def _boundary(folder: Path, scanned: ScannedField) -> tuple[BoundarySlices, tuple[float, float]]:
    """Return faces and value range, read where they are there and whole."""
    if boundary_path(folder, scanned.settings).exists():
        with contextlib.suppress(CacheError):  # damaged: made anew, as if it were absent
            return read_boundary(folder, scanned.content_hash, scanned.settings, None)
    return scanned.field.boundary, scanned.field.value_range

"""The surfaces that a command works with, of a cache folder: no volume is needed."""

from __future__ import annotations

import contextlib
import time
from dataclasses import replace
from functools import partial
from itertools import takewhile
from typing import TYPE_CHECKING, Any

from isosample.cli.console import note
from isosample.cli.scenes import PreparedScene
from isosample.cli.sources import plan_for
from isosample.errors import CacheError

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from pathlib import Path

    from isosample.surfaces.cache import CachedScene, OpenedScene
    from isosample.surfaces.settings import ExtractionSettings
    from isosample.surfaces.stored_surfaces import StoredSurfaces
    from isosample.surfaces.surface_set import SurfaceSet
    from isosample.transfer.isovalue_plan import IsovaluePlan
    from isosample.transfer.transfer_function import TransferFunction
    from isosample.volume.grid import F64

LARGEST_IN_MEMORY = 256 << 20  # bytes of meshes; where there are more, they stay in the cache folder
NEAR_COUNT = 3  # isovalues that a message suggests


def scene_from_cache(
    folder: Path,
    given: TransferFunction | None,
    *,
    tf_path: Path | None = None,
    per_slope: int | None = None,
    nan_masked: bool = False,
    lit: bool = False,
) -> PreparedScene:
    """Return the scene of a cache folder, with its own transfer function or another one.

    Parameters
    ----------
    folder : Path
    given : TransferFunction or None
        None: the cache's own. The isovalues that another one needs must be in the cache.
    tf_path : Path or None
        Where `given` comes from.
    per_slope : int or None
        None: as the scene was planned, or the default with another transfer function.
    nan_masked : bool
        Take the surfaces that were extracted around masked samples, where the scene's own were not.
    lit : bool
        Whether pictures will be lit. Where the cache was not made for light, this is said, and its scene is as it is.

    Raises
    ------
    CacheError
        If the folder is damaged, of another version, or lacks a scene or an isovalue.
    """
    from isosample.surfaces.settings import ExtractionSettings

    start = time.perf_counter()
    own = _scene_of(folder) if (folder / "scene.json").exists() or given is None else None
    settings = own.surfaces.settings if own else ExtractionSettings()
    settings = replace(settings, nan_masked=nan_masked or settings.nan_masked)
    distance = None
    if own is not None and given is None and per_slope is None:
        surfaces, plan, tf = own.surfaces, own.plan, own.transfer_function
        if surfaces.settings == settings:
            distance = own.mesh_distance
        else:
            surfaces = _surfaces_of(folder, plan.isovalues, settings, len(own.surfaces.details))
    else:
        tf = given if given is not None else own.transfer_function  # type: ignore[union-attr]  # loaded above
        with _incompleteness_told(folder):
            plan = _plan_anew(folder, own, tf, settings, per_slope, lit=lit)
            surfaces = _surfaces_of(folder, plan.isovalues, settings, len(own.surfaces.details) if own else 0)
    if lit and plan.lacks_light:
        note(
            f"{folder} was made for pictures without light: it has no isovalues inside slopes of constant extinction "
            "and colour, and the light there is a guess. `isosample precompute --shading` with the same --cache and "
            "--tf adds them"
        )
    return PreparedScene(
        surfaces=surfaces,
        plan=plan,
        transfer_function=tf,
        name=folder.name,
        tf_origin=str(tf_path or folder),
        seconds={"load": time.perf_counter() - start},
        mesh_distance=distance,
        visible=own.visible if own is not None and tf == own.transfer_function else None,
    )


def _plan_anew(
    folder: Path,
    own: CachedScene | OpenedScene | None,
    tf: TransferFunction,
    settings: ExtractionSettings,
    per_slope: int | None,
    *,
    lit: bool,
) -> IsovaluePlan:
    """Return the isovalues of a transfer function; without those for light where the folder lacks them."""
    from isosample.surfaces.cache import lists_surfaces, open_surface_set

    value_range = own.surfaces.value_range if own else open_surface_set(folder, (), settings).value_range
    shares = None if own is None else own.plan.shares
    gradients = None if own is None else partial(mesh_gradients, own.surfaces)
    plan = plan_for(tf, value_range, per_slope, gradients, lit=lit, shares=shares if lit else None)
    if lit and not lists_surfaces(folder, plan.isovalues, settings):
        return plan_for(tf, value_range, per_slope, gradients, lit=False, shares=None)
    return plan


@contextlib.contextmanager
def _incompleteness_told(folder: Path) -> Iterator[None]:
    """Tell of a folder without a scene that it was not finished, whatever it turns out to lack."""
    from isosample.surfaces.cache_files import read_json, unfinished
    from isosample.surfaces.cache_folders import has_scene

    try:
        yield
    except CacheError as error:
        if has_scene(folder) or not (folder / "volume.json").exists():
            raise
        read_json(folder / "volume.json", "cache")  # one that is damaged tells of itself
        raise CacheError(unfinished(folder)) from error


def _scene_of(folder: Path) -> CachedScene | OpenedScene:
    """Return the scene of a cache folder, whose meshes stay there where they are too many."""
    from isosample.surfaces.cache import load_opened, open_cache

    opened = open_cache(folder)
    return opened if _are_many(opened.surfaces) else load_opened(opened)


def _surfaces_of(
    folder: Path, isovalues: Sequence[float] | F64, settings: ExtractionSettings, details: int
) -> SurfaceSet | StoredSurfaces:
    """Return surfaces of a cache folder, which stay there where they are too many, with the details of them all."""
    from isosample.surfaces.cache import lists_surfaces, open_surface_set
    from isosample.surfaces.cached_surfaces import in_memory

    opened = open_surface_set(folder, isovalues, settings)
    coarser = [replace(settings, detail=detail) for detail in range(1, details + 1)]
    there = list(takewhile(partial(lists_surfaces, folder, isovalues), coarser))
    if len(there) < details:  # of another transfer function, for which none were made
        note(
            f"{folder} lacks coarser meshes of some isovalues; {len(there)} of its scene's {details} details are used. "
            f"`isosample precompute --details {details}` with this transfer function adds them"
        )
    opened = replace(opened, details=tuple(open_surface_set(folder, isovalues, one) for one in there))
    return opened if _are_many(opened) else in_memory(opened)


def _are_many(surfaces: StoredSurfaces) -> bool:
    """Tell whether meshes, with their coarser details, take too much memory."""
    tables = [one.chunk_table for one in surfaces.by_detail]
    return sum(int(table["bytes"].sum()) for table in tables) > LARGEST_IN_MEMORY


def cached_surface(folder: Path, isovalue: float, *, nan_masked: bool = False) -> SurfaceSet:
    """Return one surface of a cache folder.

    Raises
    ------
    CacheError
        As `scene_from_cache`; a missing isovalue is told with those that are there.
    """
    from isosample.surfaces.cache import load_surface_set
    from isosample.surfaces.settings import ExtractionSettings
    from isosample.surfaces.surface_files import AbsentSurfaceError

    load_surface_set(folder, ())  # tells what is wrong with the folder itself
    scene = _stored_scene(folder) if (folder / "scene.json").exists() else {}
    settings = ExtractionSettings.from_dict(scene["settings"]) if scene else ExtractionSettings()
    settings = replace(settings, nan_masked=nan_masked or settings.nan_masked)
    try:
        return load_surface_set(folder, (isovalue,), settings)
    except AbsentSurfaceError as error:
        there = [float.fromhex(entry["isovalue"]) for entry in scene.get("surfaces", [])]
        if not there or isovalue in there:
            raise
        near = sorted(there, key=lambda value: abs(value - isovalue))[:NEAR_COUNT]
        raise CacheError(
            f"{folder} has no isosurface {isovalue!r}; the nearest of its {len(there)} are "
            f"{', '.join(repr(value) for value in near)}. Choose one of them, or name the volume."
        ) from error


def _stored_scene(folder: Path) -> dict[str, Any]:
    """Return the content of scene.json, checked against its digest."""
    from isosample.surfaces.cache_files import read_json

    return read_json(folder / "scene.json", "scene")


def mesh_gradients(surfaces: SurfaceSet | StoredSurfaces, values: Sequence[float]) -> list[float | None]:
    """Return typical gradient magnitudes at values from the nearest isosurfaces there are [data units/voxel]."""
    import numpy as np

    found: list[float | None] = []
    for value in values:
        if not len(surfaces.isovalues):
            return [None] * len(values)
        pieces = surfaces.pieces(int(np.abs(surfaces.isovalues - value).argmin()))
        lengths = [np.linalg.norm(piece.gradients, axis=1) for piece in pieces]
        found.append(float(np.median(np.concatenate(lengths))) if lengths else None)
    return found

"""What a command works on: a volume file, or a cache folder that stands for one."""

from __future__ import annotations

import os
import re
import time
from dataclasses import dataclass, replace
from functools import partial
from itertools import takewhile
from pathlib import Path
from typing import TYPE_CHECKING, Any

from isosample.cli.arguments import CACHE_FOLDER, CACHE_VARIABLE
from isosample.cli.console import note
from isosample.defaults import DEFAULT_PER_SLOPE
from isosample.errors import CacheError, InputError

if TYPE_CHECKING:
    import argparse
    from collections.abc import Sequence

    from isosample.cli.console import Progress
    from isosample.rendering.quality import Quality
    from isosample.surfaces.cache import CachedScene, OpenedScene
    from isosample.surfaces.extract import SurfaceSet
    from isosample.surfaces.settings import ExtractionSettings
    from isosample.surfaces.stored_surfaces import StoredSurfaces
    from isosample.transfer.isovalues import IsovaluePlan
    from isosample.transfer.sheets import Gradients
    from isosample.transfer.transfer_function import TransferFunction
    from isosample.volume.grid import F64, Volume

VOLUME_OPTIONS = ("shape", "dtype", "spacing", "channel", "time", "dataset", "frame")
CACHE_FILES = ("volume.json", "scene.json")
LARGEST_IN_MEMORY = 256 << 20  # bytes of meshes; where there are more, they stay in the cache folder
NEAR_COUNT = 3  # isovalues that a message suggests
HASH_DIGITS = 8  # enough to tell volumes of the same name apart; the folder checks the whole hash


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PreparedScene:
    """Surfaces, what they look like, and how long it took to get them.

    Attributes
    ----------
    surfaces : SurfaceSet or StoredSurfaces
    plan : IsovaluePlan
    transfer_function : TransferFunction
    name : str
        Name of the volume.
    tf_origin : str
        Where the transfer function comes from.
    seconds : dict of str to float
        By stage.
    mesh_distance : float or None
        Of an automatic refinement: largest rms distance of a level from its isosurface [voxel].
    """

    surfaces: SurfaceSet | StoredSurfaces
    plan: IsovaluePlan
    transfer_function: TransferFunction
    name: str
    tf_origin: str
    seconds: dict[str, float]
    mesh_distance: float | None = None


def is_cache_folder(path: Path) -> bool:
    """Tell whether a path is a mesh cache, or what is left of one; a folder `surfaces` alone proves nothing."""
    if not path.is_dir():
        return False
    return any((path / name).exists() for name in CACHE_FILES) or any(path.glob("surfaces/*.npz"))


def open_source_volume(args: argparse.Namespace, path: Path) -> Volume:
    """Open the volume that the arguments describe.

    Raises
    ------
    InputError
        If it cannot be read, or is a cache folder.
    """
    from isosample.volume.readers import open_volume

    if is_cache_folder(path):
        raise InputError(f"{path} is a mesh cache, not a volume. Render or export it, or name a volume file.")
    volume = open_volume(
        path,
        shape=args.shape,
        dtype=args.dtype,
        spacing=args.spacing,
        channel=args.channel,
        time=args.time,
        dataset=args.dataset,
    )
    return volume.in_index_frame() if args.frame == "index" else volume


def refuse_volume_options(args: argparse.Namespace, folder: Path, more: Sequence[str] = ()) -> None:
    """Raise `InputError` where options that describe a volume are given for a cache folder."""
    names = (*VOLUME_OPTIONS, *more)
    given = [name.replace("_", "-") for name in names if getattr(args, name) is not None]
    if given:
        raise InputError(
            f"--{given[0]} belongs to a volume file, and {folder} is a mesh cache; its meshes are what they "
            f"are. Leave out --{given[0]}, or name the volume."
        )


def load_transfer_function(path: Path | None) -> TransferFunction | None:
    """Return the transfer function of a file, or None without one."""
    from isosample.transfer.transfer_function import TransferFunction

    return None if path is None else TransferFunction.load(path)


def plan_for(
    transfer_function: TransferFunction,
    value_range: tuple[float, float],
    per_slope: int | None,
    gradients: Gradients | None,
) -> IsovaluePlan:
    """Return the isovalues with K = `per_slope`, or the default for None."""
    from isosample.transfer.isovalues import plan_isovalues

    chosen = DEFAULT_PER_SLOPE if per_slope is None else per_slope
    return plan_isovalues(transfer_function, value_range, per_slope=chosen, gradients=gradients)


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


def transfer_function_of(
    volume: Volume, given: TransferFunction | None, path: Path | None, *, nan_masked: bool
) -> tuple[TransferFunction, str]:
    """Return the given transfer function or a suggested one, and where it comes from.

    Raises
    ------
    InputError
        If the volume can have no surfaces, or is constant and none is given.
    """
    from isosample.surfaces.extract import ExtractionSettings, check_volume
    from isosample.transfer.transfer_function import TransferFunction

    check_volume(volume, ExtractionSettings(nan_masked=nan_masked))
    if given is not None:
        return given, str(path)
    suggested = TransferFunction.suggest(volume)
    note("no --tf is given; using a transfer function suggested from the histogram")
    return suggested, "suggested from the histogram"


def quality_of(args: argparse.Namespace) -> Quality:
    """Return how many isovalues and how fine meshes the arguments ask for.

    Raises
    ------
    InputError
        If two options contradict each other.
    """
    from isosample.cli.arguments import UNSET
    from isosample.defaults import DEFAULT_MAX_ISOVALUES
    from isosample.rendering.quality import Quality
    from isosample.volume.reconstruction import Reconstruction

    if args.tolerance is not None and args.per_slope is not None:
        raise InputError(
            f"--tolerance {args.tolerance:g} and --per-slope {args.per_slope} both decide about the isovalues; "
            "leave out one of them."
        )
    if args.max_isovalues is not None and args.tolerance is None:
        raise InputError(
            f"--max-isovalues {args.max_isovalues} limits what --tolerance chooses; add --tolerance, or leave it out."
        )
    if args.tolerance is not None and getattr(args, "segment", "cubic") != "cubic":
        raise InputError(
            f"--tolerance {args.tolerance:g} is searched for with cubic segments, and --segment {args.segment} makes "
            "another picture; leave out one of them."
        )
    if args.tolerance is not None and getattr(args, "curved", None) is not None:
        raise InputError(
            "--tolerance is searched for with the crossings that its reconstruction asks for; leave out --curved and "
            "--no-curved."
        )
    refine = args.refine
    if refine == UNSET:
        refine = 1 if args.tolerance is None else None
    return Quality(
        per_slope=args.per_slope,
        tolerance=args.tolerance,
        max_isovalues=DEFAULT_MAX_ISOVALUES if args.max_isovalues is None else args.max_isovalues,
        reconstruction=Reconstruction(args.reconstruction or "trilinear"),
        refine=refine,
        curved=getattr(args, "curved", None),
        details=getattr(args, "details", None) or 0,
    )


def scene_from_volume(
    args: argparse.Namespace,
    volume: Volume,
    given: TransferFunction | None,
    *,
    quality: Quality,
    residuals: bool,
    cache: Path | None,
    progress: Progress,
    **kept: Any,
) -> PreparedScene:
    """Plan and extract the surfaces that a picture of a volume needs.

    Parameters
    ----------
    args : Namespace
        With `tf` and `nan`.
    volume : Volume
    given : TransferFunction or None
        None: one is suggested.
    quality, residuals, cache, progress
        As for `prepare_surfaces`.
    kept : optional
        `plain` and `budget_bytes` of `prepare_surfaces`.
    """
    from isosample.rendering.preparation import prepare_surfaces

    masked = args.nan == "masked"
    tf, origin = transfer_function_of(volume, given, args.tf, nan_masked=masked)
    surfaces, plan, seconds, distance = prepare_surfaces(
        volume, tf, quality, nan_masked=masked, residuals=residuals, cache=cache, progress=progress, **kept
    )
    return PreparedScene(
        surfaces=surfaces,
        plan=plan,
        transfer_function=tf,
        name=volume.name,
        tf_origin=origin,
        seconds=seconds,
        mesh_distance=distance,
    )


def scene_from_cache(
    folder: Path,
    given: TransferFunction | None,
    *,
    tf_path: Path | None = None,
    per_slope: int | None = None,
    nan_masked: bool = False,
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

    Raises
    ------
    CacheError
        If the folder is damaged, of another version, or lacks a scene or an isovalue.
    """
    from isosample.surfaces.cache import open_surface_set
    from isosample.surfaces.settings import ExtractionSettings

    start = time.perf_counter()
    own = _scene_of(folder) if (folder / "scene.json").exists() or given is None else None
    settings = own.surfaces.settings if own else ExtractionSettings()
    settings = replace(settings, nan_masked=nan_masked or settings.nan_masked)
    if own is not None and given is None and per_slope is None:
        surfaces, plan, tf = own.surfaces, own.plan, own.transfer_function
        if surfaces.settings != settings:
            surfaces = _surfaces_of(folder, plan.isovalues, settings, len(own.surfaces.details))
    else:
        tf = given if given is not None else own.transfer_function  # type: ignore[union-attr]  # loaded above
        value_range = own.surfaces.value_range if own else open_surface_set(folder, (), settings).value_range
        gradients = None if own is None else partial(mesh_gradients, own.surfaces)
        plan = plan_for(tf, value_range, per_slope, gradients)
        surfaces = _surfaces_of(folder, plan.isovalues, settings, len(own.surfaces.details) if own else 0)
    return PreparedScene(
        surfaces=surfaces,
        plan=plan,
        transfer_function=tf,
        name=folder.name,
        tf_origin=str(tf_path or folder),
        seconds={"load": time.perf_counter() - start},
    )


def _scene_of(folder: Path) -> CachedScene | OpenedScene:
    """Return the scene of a cache folder, whose meshes stay there where they are too many."""
    from isosample.surfaces.cache import load_cache, open_cache

    opened = open_cache(folder)
    return opened if _are_many(opened.surfaces) else load_cache(folder)


def _surfaces_of(
    folder: Path, isovalues: Sequence[float] | F64, settings: ExtractionSettings, details: int
) -> SurfaceSet | StoredSurfaces:
    """Return surfaces of a cache folder, which stay there where they are too many, with the details of them all."""
    from isosample.surfaces.cache import lists_surfaces, load_surface_set, open_surface_set

    opened = open_surface_set(folder, isovalues, settings)
    coarser = [replace(settings, detail=detail) for detail in range(1, details + 1)]
    there = list(takewhile(partial(lists_surfaces, folder, isovalues), coarser))
    if len(there) < details:  # of another transfer function, for which none were made
        note(
            f"{folder} lacks coarser meshes of some isovalues; {len(there)} of its scene's {details} details are used. "
            f"`isosample precompute --details {details}` with this transfer function adds them"
        )
    opened = replace(opened, details=tuple(open_surface_set(folder, isovalues, one) for one in there))
    if _are_many(opened):
        return opened
    finest = load_surface_set(folder, isovalues, **settings.as_keywords())
    loaded = (load_surface_set(folder, isovalues, **one.as_keywords()) for one in there)
    return replace(finest, details=tuple(loaded))


def _are_many(surfaces: StoredSurfaces) -> bool:
    """Tell whether meshes, with their coarser details, take too much memory."""
    tables = [one.chunk_table for one in (surfaces, *surfaces.details)]
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

    load_surface_set(folder, ())  # tells what is wrong with the folder itself
    scene = _stored_scene(folder) if (folder / "scene.json").exists() else {}
    settings = ExtractionSettings.from_dict(scene["settings"]) if scene else ExtractionSettings()
    settings = replace(settings, nan_masked=nan_masked or settings.nan_masked)
    try:
        return load_surface_set(folder, (isovalue,), **settings.as_keywords())
    except CacheError as error:
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


def default_cache_folder(volume: Volume, content_hash: str) -> Path:
    """Return NAME-HASH in the folder of caches: $ISOSAMPLE_CACHE, else meshes_cache in the current one."""
    return _folder_of_caches() / f"{_folder_name(volume)}-{content_hash[:HASH_DIGITS]}"


def likely_cache_folders(volume: Volume) -> list[Path]:
    """Return the folders that are there under the default name of a volume, whatever its content."""
    return sorted(_folder_of_caches().glob(f"{_folder_name(volume)}-{'[0-9a-f]' * HASH_DIGITS}"))


def _folder_of_caches() -> Path:
    return Path(os.environ.get(CACHE_VARIABLE) or CACHE_FOLDER)


def _folder_name(volume: Volume) -> str:
    stem = volume.name.partition(".")[0] or volume.name
    return (re.sub(r"[^A-Za-z0-9_-]+", "-", stem).strip("-") or "volume")[:64]

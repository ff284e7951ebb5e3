"""The mesh cache: a folder per volume from which a scene is rendered again without the volume.

    volume.json          geometry and content hash of the volume
    boundary.npz         samples on its six faces, value range; boundary-cubic.npz etc.: of a reconstruction
    surfaces/<key>.npz   one isosurface, all its bricks; the key names content, isovalue and settings
    scene.json           transfer function, plan, and the surfaces that they need

Every file is replaced whole, carries the format's version, and is checked against its digest when read.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from isosample.errors import CacheError
from isosample.surfaces.boundary_files import boundary_path, read_boundary, write_boundary
from isosample.surfaces.cache_files import (
    REMEDY,
    digest_of,
    read_json,
    write_json,
)
from isosample.surfaces.extract import (
    ExtractionStatistics,
    SurfaceSet,
    extract_surfaces,
)
from isosample.surfaces.settings import ExtractionSettings, check_isovalues, check_volume
from isosample.surfaces.surface_files import read_surface, surface_key, surface_path, write_surface
from isosample.surfaces.surface_set import count_per_level
from isosample.transfer.isovalues import IsovaluePlan
from isosample.transfer.transfer_function import TransferFunction
from isosample.volume.bricks import BRICK_CELLS, bricks_of
from isosample.volume.grid import SCAN_BYTES, GridGeometry
from isosample.volume.reconstruction import Reconstruction

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from isosample.surfaces.mesh import BrickMesh
    from isosample.volume.grid import F64, Volume


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CachedScene:
    """A scene as `load_cache` gives it back.

    Attributes
    ----------
    surfaces : SurfaceSet
    transfer_function : TransferFunction
    plan : IsovaluePlan
    name : str
        Name of the volume.
    """

    surfaces: SurfaceSet
    transfer_function: TransferFunction
    plan: IsovaluePlan
    name: str


def content_hash(volume: Volume) -> str:
    """Return the sha256 of a volume's geometry, dtype and samples, hexadecimal; reads it block by block."""
    head = {"geometry": volume.geometry.to_dict(), "dtype": volume.array.dtype.str}
    digest = hashlib.sha256(digest_of(head).encode())
    step = max(1, SCAN_BYTES // max(1, volume.array[0].nbytes))
    for z in range(0, volume.array.shape[0], step):
        block = np.ascontiguousarray(volume.array[z : z + step])
        digest.update(block.reshape(-1).view(np.uint8).data)
    return digest.hexdigest()


def write_cache(
    folder: str | Path,
    surfaces: SurfaceSet,
    *,
    content_hash: str,
    transfer_function: TransferFunction,
    plan: IsovaluePlan,
    name: str = "volume",
) -> None:
    """Write a scene into a folder, next to surfaces of the same volume that are there already.

    Parameters
    ----------
    folder : path
        Made if absent.
    surfaces : SurfaceSet
    content_hash : str
        What `content_hash(volume)` gave.
    transfer_function : TransferFunction
    plan : IsovaluePlan
    name : str
        Name of the volume, for messages and titles.

    Raises
    ------
    CacheError
        If the folder belongs to another volume or format version, is damaged, or cannot be written.
    """
    folder = Path(folder)
    boundary = _write_volume(folder, surfaces, content_hash, name)
    files = []
    for level, isovalue in enumerate(surfaces.isovalues.tolist()):
        key = surface_key(content_hash, isovalue, surfaces.settings)
        files.append(
            {
                "key": key,
                "isovalue": isovalue.hex(),
                "sha256": write_surface(surface_path(folder, key), key, surfaces.pieces(level)),
            }
        )
    scene = {
        "content_hash": content_hash,
        "settings": surfaces.settings.to_dict(),
        "boundary_sha256": boundary,
        "transfer_function": transfer_function.to_dict(),
        "plan": plan.to_dict(),
        "surfaces": files,
    }
    write_json(folder / "scene.json", "scene", scene)


def load_cache(folder: str | Path) -> CachedScene:
    """Return the scene of a cache folder, bit for bit as it was written, without its volume.

    Raises
    ------
    CacheError
        If the folder is not a cache, has no scene, or a file is missing, damaged or of another version.
    """
    folder = Path(folder)
    volume = _read_volume(folder)
    scene = read_json(folder / "scene.json", "scene")
    if scene["content_hash"] != volume["content_hash"]:
        raise CacheError(f"{folder / 'scene.json'} is of another volume than volume.json. {REMEDY}")
    isovalues = [float.fromhex(entry["isovalue"]) for entry in scene["surfaces"]]
    digests = {entry["key"]: entry["sha256"] for entry in scene["surfaces"]}
    digests["boundary"] = scene["boundary_sha256"]
    settings = ExtractionSettings.from_dict(scene["settings"])
    return CachedScene(
        surfaces=_read_surfaces(folder, volume, check_isovalues(isovalues), settings, digests),
        transfer_function=TransferFunction.from_dict(scene["transfer_function"]),
        plan=IsovaluePlan.from_dict(scene["plan"]),
        name=volume["name"],
    )


def load_surface_set(
    folder: str | Path,
    isovalues: Sequence[float] | F64,
    *,
    brick_cells: int = BRICK_CELLS,
    nan_masked: bool = False,
    reconstruction: Reconstruction = Reconstruction.TRILINEAR,
    refine: int = 1,
    residuals: bool = False,
) -> SurfaceSet:
    """Return surfaces of a cache folder, which were extracted with the same settings.

    Raises
    ------
    InputError
        If the isovalues are not finite and strictly ascending, or the settings are impossible.
    CacheError
        As `load_cache`; also if a surface is not there (names the isovalue).
    """
    folder = Path(folder)
    settings = ExtractionSettings(
        brick_cells=brick_cells,
        nan_masked=nan_masked,
        reconstruction=reconstruction,
        refine=refine,
        residuals=residuals,
    )
    return _read_surfaces(folder, _read_volume(folder), check_isovalues(isovalues), settings, {})


def extract_with_cache(
    volume: Volume,
    isovalues: Sequence[float] | F64,
    folder: str | Path,
    *,
    brick_cells: int = BRICK_CELLS,
    nan_masked: bool = False,
    reconstruction: Reconstruction = Reconstruction.TRILINEAR,
    refine: int = 1,
    residuals: bool = False,
    progress: Callable[[int, int], None] | None = None,
) -> SurfaceSet:
    """Return the isosurfaces of a volume, of which those in the folder are read and the others added to it.

    Parameters
    ----------
    volume, isovalues, brick_cells, nan_masked, reconstruction, refine, residuals, progress
        As for `extract_surfaces`.
    folder : path
        The volume's cache folder, made if absent.

    Returns
    -------
    surfaces : SurfaceSet
        The same, bit for bit, as `extract_surfaces` gives; ``statistics.levels_reused`` says how many levels
        were read, the other counts are of the levels that were extracted now.

    Raises
    ------
    InputError
        As `extract_surfaces`.
    CacheError
        If the folder belongs to another volume or format version, is damaged, or cannot be written.
    """
    folder = Path(folder)
    settings = ExtractionSettings(
        brick_cells=brick_cells,
        nan_masked=nan_masked,
        reconstruction=reconstruction,
        refine=refine,
        residuals=residuals,
    )
    levels = check_isovalues(isovalues)
    check_volume(volume, settings)
    volume_hash = content_hash(volume)
    _check_owner(folder, volume_hash)
    keys = [surface_key(volume_hash, isovalue, settings) for isovalue in levels.tolist()]
    missing = np.array([not surface_path(folder, key).exists() for key in keys], dtype=np.bool_)
    if not missing.any() and boundary_path(folder, settings).exists():
        return _read_surfaces(folder, _read_volume(folder), levels, settings, {})
    extracted = extract_surfaces(volume, levels[missing], **settings.as_keywords(), progress=progress)
    _write_volume(folder, extracted, volume_hash, volume.name)
    for level, place in enumerate(np.flatnonzero(missing)):
        write_surface(surface_path(folder, keys[place]), keys[place], extracted.pieces(level))
    reused = _read_surfaces(folder, _read_volume(folder), levels[~missing], settings, {})
    meshes = sorted(
        (*extracted.meshes, *reused.meshes), key=lambda mesh: mesh.isovalue
    )  # stable: brick order
    statistics = replace(
        extracted.statistics,
        levels_reused=len(reused.isovalues),
        triangles=count_per_level(levels, meshes, "triangles"),
        vertices=count_per_level(levels, meshes, "positions"),
    )
    return replace(extracted, isovalues=levels, meshes=tuple(meshes), statistics=statistics)


def _check_owner(folder: Path, content_hash: str) -> bool:
    """Tell whether a folder is the volume's already; raise `CacheError` if it is another one's."""
    if not (folder / "volume.json").exists():
        return False
    found = _read_volume(folder)["content_hash"]
    if found != content_hash:
        raise CacheError(
            f"{folder} holds surfaces of another volume (content {found[:12]}…, this one has "
            f"{content_hash[:12]}…). Choose another --cache folder."
        )
    return True


def _write_volume(folder: Path, surfaces: SurfaceSet, content_hash: str, name: str) -> str:
    """Write what is not there of volume.json and the boundary, whose digest is returned; refuse another volume."""
    known = _check_owner(folder, content_hash)
    digest = write_boundary(folder, content_hash, surfaces, keep=known)
    if not known:
        entries = {"name": name, "content_hash": content_hash, "geometry": surfaces.geometry.to_dict()}
        write_json(folder / "volume.json", "cache", entries)
    return digest


def _read_volume(folder: Path) -> dict[str, Any]:
    if not (folder / "volume.json").is_file():
        raise CacheError(
            f"{folder} is not a mesh cache: it has no volume.json. "
            "Make one with `isosample precompute VOLUME --tf TF --cache FOLDER`."
        )
    return read_json(folder / "volume.json", "cache")


def _read_surfaces(
    folder: Path, volume: dict[str, Any], levels: F64, settings: ExtractionSettings, digests: dict[str, str]
) -> SurfaceSet:
    """Read the surfaces of all levels; `digests` by key, and of the boundary, where a scene pins them."""
    volume_hash = volume["content_hash"]
    meshes: list[BrickMesh] = []
    for isovalue in levels.tolist():
        key = surface_key(volume_hash, isovalue, settings)
        meshes += read_surface(folder, key, isovalue, digests.get(key))
    boundary, value_range = read_boundary(folder, volume_hash, settings, digests.get("boundary"))
    geometry = GridGeometry.from_dict(volume["geometry"])
    return SurfaceSet(
        geometry=geometry,
        isovalues=levels,
        meshes=tuple(meshes),
        boundary=boundary,
        value_range=value_range,
        settings=settings,
        statistics=ExtractionStatistics(
            bricks_total=len(bricks_of(geometry.size_xyz, settings.brick_cells)),
            brick_visits=0,
            brick_visits_skipped=0,
            levels_reused=len(levels),
            triangles=count_per_level(levels, meshes, "triangles"),
            vertices=count_per_level(levels, meshes, "positions"),
        ),
    )

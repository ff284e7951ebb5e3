"""Whose a cache folder is: volume.json holds a volume's name, geometry and the digest of its samples.

scene.json says of which volume it is, too.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from isosample.errors import CacheError
from isosample.surfaces.cache_files import REMEDY, digest_of, read_json, understood, write_json
from isosample.volume.bricks import BRICK_CELLS
from isosample.volume.geometry import GridGeometry
from isosample.volume.scan import scan_volume

if TYPE_CHECKING:
    from pathlib import Path

    from isosample.volume.grid import Volume
    from isosample.volume.scan import BrickScan


def content_hash(volume: Volume, scan: BrickScan | None = None) -> str:
    """Return a sha256 of a volume's geometry, dtype and samples, hexadecimal.

    Parameters
    ----------
    volume : Volume
        Read once, block by block.
    scan : BrickScan, optional
        Of this volume with bricks of `BRICK_CELLS`, where there is one: then nothing is read.
    """
    if scan is None or scan.brick_cells != BRICK_CELLS:
        scan = scan_volume(volume)
    placement = volume.geometry.to_dict()
    placement.pop("patient_axes", None)  # what the axes are called moves no sample
    return digest_of({"geometry": placement, "samples": scan.content})


def claim_folder(folder: Path, geometry: GridGeometry, content_hash: str, name: str) -> None:
    """Write volume.json unless it is there; refuse another volume's folder."""
    if not _check_owner(folder, content_hash):
        entries = {"name": name, "content_hash": content_hash, "geometry": geometry.to_dict()}
        write_json(folder / "volume.json", "cache", entries)


def _check_owner(folder: Path, content_hash: str) -> bool:
    """Tell whether a folder is the volume's already; raise `CacheError` if it is another one's."""
    if not (folder / "volume.json").exists():
        return False
    found = read_volume(folder)["content_hash"]
    if found != content_hash:
        raise CacheError(
            f"{folder} holds surfaces of another volume (content {found[:12]}…, this one has "
            f"{content_hash[:12]}…). Choose another --cache folder."
        )
    return True


def read_volume(folder: Path) -> dict[str, Any]:
    """Return what volume.json says; raise `CacheError` where there is none, or it cannot be used."""
    if not (folder / "volume.json").is_file():
        raise CacheError(
            f"{folder} is not a mesh cache: it has no volume.json. "
            "Make one with `isosample precompute VOLUME --tf TF --cache FOLDER`."
        )
    return volume_entries(folder)


def volume_entries(folder: Path) -> dict[str, Any]:
    """Return what volume.json says of a folder that is, or was, a cache; raises as `read_volume`."""
    volume = read_json(folder / "volume.json", "cache")
    with understood(folder / "volume.json", "cache"):
        _ = volume["name"], volume["content_hash"], GridGeometry.from_dict(volume["geometry"])
    return volume


def read_scene(folder: Path, content_hash: str | None) -> dict[str, Any]:
    """Return what scene.json says.

    Parameters
    ----------
    folder : Path
    content_hash : str or None
        Of the folder's volume; None where that is not known.

    Raises
    ------
    CacheError
        If there is none, it cannot be used, or it is of another volume.
    """
    scene = read_json(folder / "scene.json", "scene")
    if content_hash not in (None, scene["content_hash"]):
        raise CacheError(f"{folder / 'scene.json'} is of another volume than volume.json. {REMEDY}")
    return scene

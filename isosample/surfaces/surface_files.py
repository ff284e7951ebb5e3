"""One isosurface of the mesh cache: what is known of its chunks, as a file of its own."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from isosample.errors import CacheError
from isosample.surfaces.cache_files import FORMAT_VERSION, REMEDY, digest_of, read_arrays, write_arrays
from isosample.surfaces.chunk_table import CHUNK_ROW

if TYPE_CHECKING:
    from collections.abc import Collection
    from pathlib import Path

    from isosample.surfaces.cache_files import Arrays
    from isosample.surfaces.chunk_table import Rows
    from isosample.surfaces.settings import ExtractionSettings


class AbsentSurfaceError(CacheError):
    """A folder lists no such isosurface; it may be whole nevertheless."""


def surface_key(
    content_hash: str, isovalue: float, settings: ExtractionSettings, *, by_place: bool = False
) -> str:
    """Return the name of one isosurface's file: a digest of everything that decides about its meshes.

    `by_place` is of a list of chunks that are named by the content of the whole volume and their place in it, as
    where meshes are kept without the volume at hand, and not by the content of their bricks.
    """
    named = {"content_hash": content_hash, "isovalue": (isovalue + 0.0).hex(), "version": FORMAT_VERSION}
    return digest_of({**named, "settings": settings.to_dict(), "by_place": by_place})


def listed_key(
    folder: Path,
    content_hash: str,
    isovalue: float,
    settings: ExtractionSettings,
    pinned: Collection[str] = (),
) -> str:
    """Return the key under which a folder lists an isosurface: a pinned one, else by content, else by place."""
    by_content = surface_key(content_hash, isovalue, settings)
    if by_content in pinned:
        return by_content
    there = surface_path(folder, by_content).exists()
    if there and not pinned:
        return by_content
    by_place = surface_key(content_hash, isovalue, settings, by_place=True)
    wanted = by_place in pinned or (not there and surface_path(folder, by_place).exists())
    return by_place if wanted else by_content


def surface_path(folder: Path, key: str) -> Path:
    """Return where a cache folder keeps the list of the chunks of one isosurface."""
    return folder / "surfaces" / f"{key}.npz"


def write_rows(folder: Path, key: str, rows: Rows) -> str:
    """Write the rows of one isosurface, and return their digest.

    Parameters
    ----------
    folder : Path
    key : str
        What `surface_key` gave.
    rows : (N,) `CHUNK_ROW`
        Of the chunks that have triangles, in the order of the bricks.

    Raises
    ------
    CacheError
        If the file cannot be written.
    """
    plain = np.ascontiguousarray(rows).view(np.uint8)  # numpy reads the type of rows slower than 1000 of them
    return write_arrays(surface_path(folder, key), {"key": key}, {"rows": plain})


def read_rows(folder: Path, key: str, isovalue: float, digest: str | None = None) -> tuple[Rows, str]:
    """Return the rows of one isosurface, and their digest.

    Raises
    ------
    AbsentSurfaceError
        If the file is missing (names the isovalue).
    CacheError
        If it is damaged, or its rows have another `digest`.
    """
    path = surface_path(folder, key)
    try:
        arrays, found = read_arrays(path, {"key": key}, digest=digest)
    except CacheError as error:
        if not isinstance(error.__cause__, FileNotFoundError):
            raise
        raise AbsentSurfaceError(
            f"{folder} has no isosurface {isovalue!r} for these settings. Add what is missing with "
            f"`isosample precompute VOLUME --tf TF --cache {folder}`."
        ) from error
    return rows_of_arrays(arrays, path), found


def rows_of_arrays(arrays: Arrays, path: Path) -> Rows:
    """Return the rows among the arrays of a list of chunks.

    Raises
    ------
    CacheError
        If there are none, or they are no rows.
    """
    plain = arrays.get("rows")
    if plain is None:
        raise CacheError(f"{path} is damaged: it has no rows. {REMEDY}")
    if plain.dtype != np.uint8 or plain.ndim != 1 or plain.size % CHUNK_ROW.itemsize:
        raise CacheError(f"{path} is damaged: its rows are {plain.size} of {plain.dtype}. {REMEDY}")
    rows: Rows = plain.view(CHUNK_ROW)
    return rows

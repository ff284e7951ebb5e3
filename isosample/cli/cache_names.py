"""Where the cache folder of a volume is, if no other one is named."""

from __future__ import annotations

import os
import re
from pathlib import Path
from typing import TYPE_CHECKING

from isosample.cli.arguments import CACHE_FOLDER, CACHE_VARIABLE

if TYPE_CHECKING:
    from isosample.volume.grid import Volume

HASH_DIGITS = 8  # enough to tell volumes of the same name apart; the folder checks the whole hash


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

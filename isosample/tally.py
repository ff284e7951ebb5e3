"""How often costly things were made in this process: by it one sees what is made once and what is made again."""

from __future__ import annotations

from collections import Counter

EXTRACTIONS = "extractions"  # of isosurfaces from a volume or a cache folder
TRACERS = "reference_tracers"
MESH_UPLOADS = "mesh_uploads"
VOLUME_UPLOADS = "volume_uploads"
PROGRAMS = "programs_compiled"
POOLS = "fragment_pools"  # memory of fragment lists that was asked for

_made: Counter[str] = Counter()


def tally(kind: str) -> None:
    """Count one more of a kind."""
    _made[kind] += 1


def made_since(before: Counter[str]) -> dict[str, int]:
    """How many of every kind were made since `made_so_far` gave `before`; kinds without any are left out."""
    return {kind: number for kind, number in sorted((_made - before).items()) if number}


def made_so_far() -> Counter[str]:
    """How many of every kind were made since the process began."""
    return _made.copy()
